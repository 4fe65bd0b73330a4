"""One rendered row, from options to a folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from PIL import Image

from pomona.basics.arrays import IntArray
from pomona.errors import SurveyError
from pomona.learning.synth import truth
from pomona.learning.synth.cameras import RowCamera, row_cameras
from pomona.learning.synth.develop import develop
from pomona.learning.synth.encoding import ids_from_colours
from pomona.learning.synth.layout import Plates, Row, lay_out_row
from pomona.learning.synth.options import RowOptions
from pomona.progress import Progress, Silent


class RowStudio(Protocol):
    """A row that is ready to be photographed; a photo and its mask have one number."""

    def photograph(self, camera: RowCamera, path: Path, *, photo_idx: int) -> None:
        """Write a photo to a PNG file, before it is developed."""

    def mask(self, camera: RowCamera, path: Path, *, photo_idx: int) -> None:
        """Write the fruits' ids as colours to a PNG file."""


def render_row(options: RowOptions, out: Path, progress: Progress | None = None) -> Path:
    """Render a row into the new folder `out`: photos, masks, fruits, cameras, markers; return `out`.

    It is written to `out` + ".part" and renamed when it is complete; a run that was stopped goes on where it was when
    it is called again with the same options. Raises `MissingExtraError` without bpy (for rough photos, without OpenGL),
    and `SurveyError` where `out` exists or the unfinished folder belongs to other options.
    """
    progress, engine = progress or Silent(), _engine(options)
    folder = _unfinished(options, out)
    row, cameras = lay_out_row(options), row_cameras(options)
    truth.write_fruits(folder.truth("fruits.csv"), row.fruits)
    truth.write_cameras(folder.truth("cameras.json"), cameras)
    truth.write_markers(folder.truth("markers.csv"), row.plates)
    wanted = options.trees * options.fruits_per_tree
    wanted -= round(options.drop_share * wanted)
    if len(row.fruits.ids) < wanted:
        progress.warn(f"Only {len(row.fruits.ids)} of {wanted} fruits found room in the trees")
    stage = engine(row, marker_cells(row.plates), options)
    draft = folder.root / "draft.png"
    progress.start("photos", len(cameras))
    for i, camera in enumerate(cameras):
        _once(folder.photo(camera.name), partial(_photo, stage, camera, draft, options, i))
        progress.advance()
    if options.masks:
        progress.start("masks", len(cameras))
        for i, camera in enumerate(cameras):
            _once(folder.mask(camera.name), partial(_mask, stage, camera, draft, i))
            progress.advance()
        truth.write_visible_pixels(folder, [camera.name for camera in cameras])
    draft.unlink(missing_ok=True)
    folder.root.rename(out)
    return out


def _engine(options: RowOptions) -> Callable[[Row, list[IntArray], RowOptions], RowStudio]:
    """Return what draws; both engines are heavy, and optional."""
    if options.rough:
        from pomona.learning.synth.quick.stage import QuickStage

        return QuickStage
    from pomona.learning.synth.blender import BlenderStage

    return BlenderStage


def marker_cells(plates: Plates) -> list[IntArray]:
    """Return the cells (6, 6) of each plate's ArUco DICT_4X4_50 marker with its black border, 1 where white."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    return [(cv2.aruco.generateImageMarker(dictionary, int(i), 6) > 0).astype(np.int64) for i in plates.ids]


def _unfinished(options: RowOptions, out: Path) -> truth.RowFolder:
    if out.exists():
        raise SurveyError(f"{out} exists already; name a new folder for the row, or remove it")
    folder = truth.RowFolder(out.with_name(out.name + ".part"))
    stated = json.dumps(asdict(options), indent=1)
    if folder.root.exists() and (not folder.options.is_file() or folder.options.read_text() != stated):
        raise SurveyError(f"{folder.root} holds an unfinished row of other options; remove it, or name another folder")
    folder.make()
    folder.options.write_text(stated)
    return folder


def _once(path: Path, write: Callable[[Path], None]) -> None:
    """Write a file unless an earlier run did; it appears under its name only when it is whole."""
    if path.exists():
        return
    half = path.with_name("half-" + path.name)
    write(half)
    half.rename(path)


def _photo(stage: RowStudio, camera: RowCamera, draft: Path, options: RowOptions, number: int, path: Path) -> None:
    stage.photograph(camera, draft, photo_idx=number)
    develop(draft, path, options, number=number)


def _mask(stage: RowStudio, camera: RowCamera, draft: Path, number: int, path: Path) -> None:
    stage.mask(camera, draft, photo_idx=number)
    with Image.open(draft) as image:
        truth.write_mask(path, ids_from_colours(np.asarray(image.convert("RGB"))))
