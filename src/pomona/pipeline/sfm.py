"""Stage `sfm`: the cameras, each piece in a frame of its own, by structure from motion or as given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pomona.errors import ReconstructionError
from pomona.pipeline.select import SELECT
from pomona.pipeline.stage import PHOTOS, Fact, Stage, Store, SurveyContext
from pomona.progress import Progress
from pomona.stages.sfm.pieces import Piece, Reconstruction, Unregistered
from pomona.survey.digest import file_digest, plain
from pomona.values.cameras import Cameras
from pomona.values.photos import Photos

if TYPE_CHECKING:
    from pomona.pipeline.options import StageOptions
    from pomona.stages.sfm.options import SfmOptions


@dataclass(frozen=True)
class CameraFiles:
    """Cameras of another program, by the files of `path` that are theirs."""

    path: Path
    files: tuple[Path, ...]

    @property
    def content_key(self) -> Any:
        """The contents of the files, wherever they lie."""
        return [file_digest(file) for file in self.files]


@dataclass(frozen=True, kw_only=True)
class CamerasChoice:
    """Where cameras come from: a file, or structure from motion with its options."""

    given: CameraFiles | None
    options: SfmOptions | None


def _choice(options: StageOptions) -> CamerasChoice:
    path = options.run.cameras
    if path is None:
        return CamerasChoice(given=None, options=options.sfm)
    from pomona.formats.cameras.read import find_cameras

    return CamerasChoice(given=CameraFiles(path, tuple(find_cameras(path).files)), options=None)


def _cameras(
    photos: Photos, fruitless: bool, *, options: CamerasChoice, own_key: str, work_dir: Path, progress: Progress
) -> Reconstruction:
    if options.given is not None:
        return _given(options.given.path, photos, progress)
    from pomona.stages.sfm import reconstruct

    try:
        reconstruction = reconstruct(
            photos, options=options.options, work_dir=work_dir, code_key=own_key, progress=progress
        )
        if not reconstruction.pieces:
            raise ReconstructionError(_no_piece(reconstruction))
    except ReconstructionError as error:
        if not fruitless:
            raise
        progress.warn(f"No camera could be placed, which does not matter here as there is no fruit: {error}")
        return Reconstruction(())
    return reconstruction


def _no_piece(reconstruction: Reconstruction) -> str:
    lost = reconstruction.unregistered
    reasons = "; ".join(dict.fromkeys(f"{photo.reason}: {photo.advice}" for photo in lost))
    return f"None of {len(lost)} photos could be placed. {reasons}"


def _given(path: Path, photos: Photos, progress: Progress) -> Reconstruction:
    from pomona.formats.cameras.read import read_cameras

    progress.start("reading the cameras given")
    given = read_cameras(path, photos)
    for note in given.notes:
        progress.warn(f"Cameras of {given.program}: {note}")
    if not given.cameras.frame.metric:
        progress.warn(
            f"Cameras of {given.program}: the file does not say that they are in metres; markers, a scale bar, GNSS or "
            'the fruits decide. A file frame.json beside them with {"scale_source": "given"} says that they are, z up'
        )
    missing = [photo for photo in photos if photo.name not in given.cameras.photos]
    reason, advice = "not among the cameras given", "add it to the model, or leave `cameras` out"
    lost = tuple(Unregistered(photo.name, photo.side, reason, advice) for photo in missing)
    side = " and ".join(photos.sides)
    return Reconstruction((Piece(side, given.cameras, _mean_error(given.cameras)),), lost)


def _mean_error(cameras: Cameras) -> float:
    errors = cameras.points_error_px[np.isfinite(cameras.points_error_px)]
    return float(errors.mean()) if len(errors) else float("nan")


def _save(reconstruction: Reconstruction, context: SurveyContext) -> Mapping[str, Any]:
    from pomona.stages.sfm.store import write_reconstruction

    write_reconstruction(context.survey.work("pieces"), reconstruction, context.photos)
    pieces = [
        {"side": p.side, "photos": len(p.cameras), "mean_reprojection_error_px": p.mean_reprojection_error_px}
        for p in reconstruction.pieces
    ]
    return {"pieces": pieces, "unregistered": plain(reconstruction.unregistered)}


def _load(info: Mapping[str, Any], context: SurveyContext) -> Reconstruction:
    from pomona.stages.sfm.store import read_reconstruction

    return read_reconstruction(context.survey.work("pieces"), context.photos)


SFM = Stage(
    name="sfm",
    inputs={"photos": PHOTOS, "fruitless": Fact(SELECT, "fruitless")},
    options=_choice,
    compute=_cameras,
    # COLMAP keeps rotations as quaternions, which give matrices with other last digits.
    store=Store(save=_save, load=_load, outputs=lambda survey: (survey.work("pieces"),), rounds=True),
)
"""Writes `work/pieces/`."""
