"""A row's folder: photos, and the truth beside them (`truth/fruits.csv`, `cameras.json`, `markers.csv`, `masks/`)."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
from PIL import Image

from pomona.errors import FormatError, MissingFileError
from pomona.formats.files import read_text
from pomona.formats.json_file import load_json
from pomona.learning.synth.cameras import RowCamera
from pomona.learning.synth.encoding import visible_pixels
from pomona.learning.synth.layout import Plates, TrueFruits
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.photos import Photo, Photos

Ids = np.ndarray[tuple[int, ...], np.dtype[np.uint16]]


class RowFolder:
    """Every path of a row's folder."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def photo(self, name: str) -> Path:
        """Return where a photo lies."""
        return self.root / "images" / f"{name}.jpg"

    def mask(self, name: str) -> Path:
        """Return where a photo's mask of fruit ids lies."""
        return self.root / "truth" / "masks" / f"{name}.png"

    def truth(self, file: str) -> Path:
        """Return where a file of the truth lies."""
        return self.root / "truth" / file

    @property
    def options(self) -> Path:
        """The options that the row was rendered with."""
        return self.root / "options.json"

    def make(self) -> None:
        """Make the folders."""
        self.photo("x").parent.mkdir(parents=True, exist_ok=True)
        self.mask("x").parent.mkdir(parents=True, exist_ok=True)


def write_fruits(path: Path, fruits: TrueFruits) -> None:
    """Write `id,tree,x,y,z,diameter` (metres)."""
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["id", "tree", "x", "y", "z", "diameter"])
        for i, tree, centre, size in zip(
            fruits.ids, fruits.trees, fruits.centres_in_world, fruits.diameters_m, strict=True
        ):
            table.writerow([i, tree, *(f"{v:.5f}" for v in centre), f"{size:.5f}"])


def read_fruits(path: Path) -> TrueFruits:
    """Read what `write_fruits` wrote; raise `FormatError` naming the line where a value is not a number."""
    rows = _read_table(path, ("id", "tree", "x", "y", "z", "diameter"))
    table = np.array(rows, float).reshape(-1, 6)
    return TrueFruits(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:5], table[:, 5])


def write_markers(path: Path, plates: Plates) -> None:
    """Write `id,x,y,z,yaw,size`: centres and the black square's side in metres, yaw in radians."""
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["id", "x", "y", "z", "yaw", "size"])
        for i, centre, yaw in zip(plates.ids, plates.centres_in_world, plates.yaw, strict=True):
            table.writerow([i, *(round(float(v), 5) for v in centre), round(float(yaw), 6), plates.size_m])


def _read_table(path: Path, columns: tuple[str, ...]) -> list[list[float]]:
    table = csv.DictReader(read_text(path, f"a table with the columns {','.join(columns)}").splitlines())
    if not set(columns) <= set(table.fieldnames or ()):
        raise FormatError(f"{path}, line 1: expected the columns {','.join(columns)}, found {table.fieldnames}")
    rows = []
    for row in table:
        try:
            rows.append([float(row[c]) for c in columns])
        except (TypeError, ValueError) as error:
            raise FormatError(f"{path}, line {table.line_num}: expected numbers, found {row}") from error
    return rows


def write_cameras(path: Path, cameras: tuple[RowCamera, ...]) -> None:
    """Write {name: {R, t, f, cx, cy, width, height}}: OpenCV axes, pixels in COLMAP's convention."""
    table = {
        c.name: {
            "R": c.rotation_cam_from_world.tolist(), "t": c.translation_m.tolist(), "f": c.focal_px,
            "cx": c.width_px / 2, "cy": c.height_px / 2, "width": c.width_px, "height": c.height_px,
        }
        for c in cameras
    }  # fmt: skip
    path.write_text(json.dumps(table), encoding="utf-8")


def read_cameras(path: Path) -> tuple[RowCamera, ...]:
    """Read what `write_cameras` wrote."""
    table = load_json(path, "the row's true cameras")
    try:
        return tuple(
            RowCamera(name, np.array(c["R"], float), np.array(c["t"], float), c["f"], c["width"], c["height"])
            for name, c in table.items()
        )
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise FormatError(f"{path}: expected {{name: {{R, t, f, width, height}}}}, but {error!r}") from error


def write_mask(path: Path, ids: Ids) -> None:
    """Write a 16-bit PNG of fruit ids (H, W), 0 where there is no fruit."""
    Image.fromarray(ids.astype(np.uint16)).save(path)


def read_mask(path: Path) -> Ids:
    """Read a 16-bit PNG of fruit ids (H, W)."""
    with Image.open(path) as image:
        return np.asarray(image).astype(np.uint16)


def write_visible_pixels(folder: RowFolder, names: list[str]) -> None:
    """Write {photo: {fruit id: visible pixels}} from the masks."""
    counts = {name: visible_pixels(read_mask(folder.mask(name))) for name in names}
    folder.truth("visible_pixels.json").write_text(json.dumps(counts))


def write_masks_as_coco(row: Path, path: Path) -> None:
    """Write a row's true masks as a COCO file, as `pomona run --detections` takes them; `row` is its folder."""
    from pomona.formats.detections.coco import write_coco

    photos, detections, next_id = [], {}, 1
    for file in sorted((row / "truth" / "masks").glob("*.png")):
        ids = read_mask(file)
        masks = tuple(Mask.from_pixels(ids == fruit) for fruit in np.unique(ids[ids > 0]))
        photo = Photo(f"{file.stem}.jpg", row / "images" / f"{file.stem}.jpg", ids.shape[1], ids.shape[0])
        numbers = np.arange(next_id, next_id + len(masks))
        next_id += len(masks)
        photos.append(photo)
        found = Detections(photo.name, photo.width_px, photo.height_px, masks, np.ones(len(masks)), numbers)
        detections[photo.name] = found
    if not photos:
        raise MissingFileError(f"{row / 'truth' / 'masks'} holds no masks; expected those of a rendered row")
    write_coco(path, Photos(tuple(photos)), SurveyDetections(detections))
