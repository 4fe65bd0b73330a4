"""What a folder with the Fuji-SfM dataset holds, whatever its folders are called: found by content.

The published layout (doi 10.1016/j.dib.2020.105591, zenodo.org/records/3712808), and what its authors' program reads
(github.com/GRAP-UdL-AT/SfM_3D_fruit_detection):

    1-Mask-set/{training,validation}_images_and_annotations/   tiles; VIA labels as one JSON, and as a CSV a tile
    2-SfM-set/raw_images_{east,west}_side/                     291 photos a side
    3-3D_data/                                                 the scene's cloud; boxes around apples
    data/camaras/{east,west}_side_cameras.out                  Bundler
    data/pt_clouds/{east,west}_side_pc.txt                     the apples' clouds, x y z r g b
    data/masks/{east,west}_side_masks/*.mat                    a label image and scores, a file a photo

Boxes are text files of numbers; which are boxes and which clouds, their first lines show.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.detections.label_sets import part_of
from pomona.formats.detections.via import is_via
from pomona.formats.detections.via_csv import is_via_csv
from pomona.formats.json_file import load_json
from pomona.formats.xyz import first_lines, head_numbers, looks_like_xyz
from pomona.stages.capture.files import natural_key
from pomona.values.photos import PHOTO_SUFFIXES

# In the order in which the authors' program goes through them.
_SIDES = ("west", "east")
_SIDE = re.compile(r"(?:^|[^a-z])(east|west)(?:[^a-z]|$)")
_NUMBERS = frozenset({".txt", ".csv", ".xyz", ".asc", ".pts"})
# What files of boxes and of clouds are called: one that holds something else is an error, not passed over.
_BOXES_NAME = re.compile(r"box|annot|label|truth|location|(?:^|[^a-z])gt(?:[^a-z]|$)")
_CLOUD_NAME = re.compile(r"cloud|(?:^|[^a-z])pc(?:[^a-z]|$)")
# Numbers on a line of a file of boxes: lowest and highest corner, eight corners, or one corner.
_BOX_COLUMNS = frozenset({6, 24, 3})


@dataclass(frozen=True)
class SideFiles:
    """What there is of one side of the row: `photos` and `masks` in the order of their names."""

    name: str
    photos: tuple[Path, ...] = ()
    masks: tuple[Path, ...] = ()
    cameras: Path | None = None
    cloud: Path | None = None


@dataclass(frozen=True)
class FujiFiles:
    """What was found below `root`. `tiles` are the VIA files of "training" and "validation"; `boxes` of true fruits.

    `unused` are clouds that show the whole scene, not apples alone.
    """

    root: Path
    tiles: dict[str, tuple[Path, ...]] = field(default_factory=dict)
    sides: tuple[SideFiles, ...] = ()
    boxes: tuple[Path, ...] = ()
    unused: tuple[Path, ...] = ()

    def described(self) -> tuple[str, ...]:
        """Return what was found, a line each."""
        lines = [f"{part} tiles: labels in {self._named(files)}" for part, files in self.tiles.items()]
        for side in self.sides:
            parts = [f"{len(side.photos)} photos" if side.photos else "", f"{len(side.masks)} masks"]
            parts += [self._named((path,)) for path in (side.cameras, side.cloud) if path is not None]
            lines.append(f"{side.name} side: {', '.join(part for part in parts if part and part != '0 masks')}")
        if self.boxes:
            lines.append(f"true fruits: {self._named(self.boxes)}")
        lines += [f"{self._named((path,))}: a cloud of the whole scene, not used" for path in self.unused]
        return tuple(lines)

    def _named(self, files: tuple[Path, ...]) -> str:
        first = files[0].relative_to(self.root).as_posix()
        return first if len(files) == 1 else f"{first} and {len(files) - 1} more"


def find_fuji_files(root: Path) -> FujiFiles:
    """Look through a folder and those below it.

    Raises `MissingFileError` where it is not there, `InputError` where two files claim one place, and `FormatError`,
    with the file's first lines, where one is called as boxes or clouds are and is neither, or is broken JSON.
    """
    if not root.is_dir():
        raise MissingFileError(f"{root}: expected the folder of the unpacked Fuji-SfM dataset, but there is none")
    files = sorted(_files_below(root), key=lambda path: natural_key(path.relative_to(root).as_posix()))
    labels = [file for file in files if _is_labels(file)]
    numbers = [file for file in files if file.suffix.lower() in _NUMBERS and file not in set(labels)]
    clouds = [file for file in numbers if _is_cloud(file)]
    boxes = tuple(file for file in numbers if file not in set(clouds) and _is_boxes(file))
    sides = tuple(side for name in (*_SIDES, "") if (side := _side(root, name, files, clouds, labels)))
    used = {side.cloud for side in sides}
    return FujiFiles(
        root,
        _tiles(root, labels),
        sides,
        boxes,
        tuple(cloud for cloud in clouds if cloud not in used),
    )


def _files_below(root: Path) -> Iterator[Path]:
    for path in root.iterdir():
        if path.name.startswith("."):
            continue
        if path.is_dir():
            yield from _files_below(path)
        elif path.is_file():
            yield path


def _is_labels(file: Path) -> bool:
    if file.suffix.lower() == ".json":
        return is_via(load_json(file, "labels of the VGG Image Annotator"))
    if file.suffix.lower() != ".csv":
        return False
    with file.open(encoding="utf-8-sig", errors="replace") as opened:
        return is_via_csv(opened.readline())


def _is_cameras(file: Path) -> bool:
    """Say whether a file is to be Bundler's: by its name, so that a broken one is an error, or by its first line."""
    if file.suffix.lower() != ".out":
        return False
    with file.open(encoding="utf-8-sig", errors="replace") as opened:
        head = opened.readline()
    return "camera" in file.stem.lower() or file.stem.lower() == "bundle" or head.startswith("# Bundle")


def _is_cloud(file: Path) -> bool:
    if _BOXES_NAME.search(file.stem.lower()):
        return False
    return bool(_CLOUD_NAME.search(file.stem.lower())) or looks_like_xyz(file)


def _is_boxes(file: Path) -> bool:
    """Say whether a file has boxes; raises `FormatError` where it is called so and has something else."""
    with file.open(encoding="utf-8-sig", errors="replace") as opened:
        head = opened.readline()
    if {"x_min", "z_max"} <= {name.strip() for name in head.split(",")}:
        return True
    table = head_numbers(file)
    if table is not None and table.shape[1] in _BOX_COLUMNS:
        return True
    if _BOXES_NAME.search(file.stem.lower()):
        raise FormatError(
            f"{file}: expected boxes around apples as text: 6 numbers a line (lowest and highest corner), 24 (eight "
            "corners), 3 (a corner a line, eight lines an apple), or a table with the columns "
            f"x_min,y_min,z_min,x_max,y_max,z_max; found something else. The file begins:\n{first_lines(file)}"
        )
    return False


def _tiles(root: Path, labels: list[Path]) -> dict[str, tuple[Path, ...]]:
    """The label files of each part: its JSON alone where there is one, as the tables say the same again."""
    parts: dict[str, tuple[Path, ...]] = {}
    for part in ("training", "validation"):
        of_part = [file for file in labels if part_of(file.relative_to(root).as_posix()) == part]
        whole = [file for file in of_part if file.suffix.lower() == ".json"]
        if len(whole) > 1:
            raise InputError(f"{root}: expected one JSON of {part} tiles, found {whole[0]} and {whole[1]}")
        if of_part:
            parts[part] = tuple(whole or of_part)
    return parts


def _side(root: Path, name: str, files: list[Path], clouds: list[Path], labels: list[Path]) -> SideFiles | None:
    """What belongs to a side; to "", the only side of a row whose files name none."""
    with_labels = {label.parent for label in labels}
    here = [f for f in files if _side_of(root, f) == name and f.parent not in with_labels]
    cameras = _only(root, name, "Bundler file", [f for f in here if _is_cameras(f)])
    # The cloud of a scene names no side, and one of apples is called so.
    of_apples = [f for f in here if f in set(clouds) and (name or f.stem.lower().endswith("pc"))]
    cloud = _only(root, name, "cloud", of_apples)
    masks = tuple(f for f in here if f.suffix.lower() == ".mat")
    photos = tuple(f for f in here if f.suffix.lower() in PHOTO_SUFFIXES)
    if not name and cameras is None:
        return None  # photos alone that name no side may be of anything
    if not (cameras or cloud or masks or photos):
        return None
    return SideFiles(name or "row", photos, masks, cameras, cloud)


def _side_of(root: Path, file: Path) -> str:
    found = _SIDE.findall(file.relative_to(root).as_posix().lower())
    return str(found[-1]) if found else ""


def _only(root: Path, side: str, what: str, files: list[Path]) -> Path | None:
    if len(files) > 1:
        named = ", ".join(file.relative_to(root).as_posix() for file in files[:3])
        raise InputError(f"{root}: expected one {what} of the {side or 'only'} side, found {named}: move the others")
    return files[0] if files else None
