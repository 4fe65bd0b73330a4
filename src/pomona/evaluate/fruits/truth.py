"""The fruits of a row that are known beforehand, in which photos they can be seen, and reading them from files."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, OneLine, set_checked
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.coordinate_systems import DEGREES, check_use, given_xy_between
from pomona.formats.files import read_bytes
from pomona.formats.json_file import load_json
from pomona.formats.small_table import SmallTable, column_names, decoded, read_small_table
from pomona.values.cameras import WorldFrame


@dataclass(frozen=True, eq=False, repr=False)
class Truth(OneLine):
    """n true fruits: `ids` (n,), `centers_in_world` (n, 3) and `diameters_m` (n,), `tree_ids` (n,; 0: not known).

    `boxes_in_world` (n, 6) holds x, y, z of the lowest and of the highest corner where fruits were annotated as boxes,
    else None. Of k sightings `seen_id[i]` shows `seen_px[i]` pixels in photo `seen_photo[i]`; `seen_photo` is None
    where nobody knows what can be seen.
    """

    _one = "fruit"

    ids: IntArray
    centers_in_world: FloatArray
    diameters_m: FloatArray
    tree_ids: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    boxes_in_world: FloatArray | None = None
    seen_photo: tuple[str, ...] | None = None
    seen_id: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    seen_px: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        n, k = len(self.ids), len(self.seen_photo or ())
        if len(self.tree_ids) == 0:
            object.__setattr__(self, "tree_ids", np.zeros(n, np.int64))
        for name in ("ids", "tree_ids"):
            set_checked(self, name, (n,), np.int64)
        set_checked(self, "centers_in_world", (n, 3), np.float64)
        set_checked(self, "diameters_m", (n,), np.float64)
        if self.boxes_in_world is not None:
            set_checked(self, "boxes_in_world", (n, 6), np.float64)
        set_checked(self, "seen_id", (k,), np.int64)
        set_checked(self, "seen_px", (k,), np.int64)
        if len(np.unique(self.ids)) != n:
            raise InputError("Truth.ids: expected unique ids")
        if not (np.isfinite(self.centers_in_world).all() and (self.diameters_m > 0).all()):
            raise InputError("Truth: expected finite centres and positive diameters of all fruits")

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def from_boxes(cls, boxes_in_world: FloatArray, ids: IntArray | None = None) -> Truth:
        """Return fruits from boxes (n, 6): the centre is the box's, the diameter the mean of its three sides."""
        boxes = np.asarray(boxes_in_world, float).reshape(-1, 6)
        low, high = boxes[:, :3], boxes[:, 3:]
        if not (high > low).all():
            raise InputError("Truth.boxes_in_world: expected each highest corner above its lowest corner")
        ids = np.arange(1, len(boxes) + 1) if ids is None else ids
        return cls(ids, (low + high) / 2, (high - low).mean(1), boxes_in_world=boxes)

    def brought_from(self, crs: str | None, frame: WorldFrame) -> Truth:
        """Return the fruits in a survey's `frame`, whose x and y were coordinates of `crs`, and z heights in metres.

        Without a `crs` they are in that frame already. Easting or longitude comes first. Boxes lie along the frame's
        axes then, as wide and deep as they were. Raises `InputError` where the frame has no place on Earth, for a
        system that does not exist, or places it cannot have.
        """
        if crs is None:
            return self
        if frame.crs is None:
            raise InputError(
                f"`truth_crs` {crs}: the survey's frame has no place on Earth. GNSS positions, `markers_crs` or `gcp` "
                "give it one"
            )

        where = "`truth_crs`"
        if len(self):
            degrees = np.median(given_xy_between(self.centers_in_world[:, :2], crs, DEGREES, where), axis=0)
            check_use(crs, float(degrees[0]), float(degrees[1]), where)

        def brought(points: FloatArray) -> FloatArray:
            assert frame.crs is not None
            height = points[:, 2] - (frame.origin[2] if frame.origin else 0.0)
            return np.column_stack([given_xy_between(points[:, :2], crs, frame.crs, where), height])

        centers = brought(self.centers_in_world)
        if self.boxes_in_world is None:
            return replace(self, centers_in_world=centers)
        sides_m = np.empty_like(centers)
        for axis in range(3):
            low, high = self.centers_in_world.copy(), self.centers_in_world.copy()
            low[:, axis], high[:, axis] = self.boxes_in_world[:, axis], self.boxes_in_world[:, 3 + axis]
            sides_m[:, axis] = np.linalg.norm(brought(high) - brought(low), axis=1)
        boxes = np.hstack([centers - sides_m / 2, centers + sides_m / 2])
        return replace(self, centers_in_world=centers, diameters_m=sides_m.mean(1), boxes_in_world=boxes)

    def visible(self, min_px: int = 120, min_photos: int = 2) -> BoolArray | None:
        """Say of each fruit (n,) whether `min_photos` photos show `min_px` pixels of it; None where it is not known."""
        if self.seen_photo is None:
            return None
        seen_ids, photos = np.unique(self.seen_id[self.seen_px >= min_px], return_counts=True)
        return np.isin(self.ids, seen_ids[photos >= min_photos])


_FRUIT_COLUMNS = ("id", "x", "y", "z", "diameter")
_BOX_COLUMNS = ("x_min", "y_min", "z_min", "x_max", "y_max", "z_max")
_CORNERS = 8
_OF_PHOTOS = frozenset({".json", ".xml"})


def read_truth(path: Path) -> Truth:
    """Read true fruits (metres, world frame, but see `Truth.brought_from`) from one of these, by what they hold:

    - a row's folder, its `truth` folder, or `fruits.csv` with the columns `id,x,y,z,diameter` and perhaps `tree`, or as
      surveys call them (`x_m`, `diameter_m`, `tree_id`); a `visible_pixels.json` beside it, {photo: {fruit id:
      pixels}}, says what can be seen;
    - a table with the columns `x_min,y_min,z_min,x_max,y_max,z_max` and perhaps `id` and `tree`, a line a fruit;
    - numbers without a header, the paper's annotation of boxes: 6 a line (lowest and highest corner), 24 a line (the
      eight corners), or 3 a line (eight lines of corners a fruit). Turned boxes become the upright box around them.

    Raises `MissingFileError`, and `FormatError` naming the line and what was expected.
    """
    file = _file_of(Path(path))
    text = decoded(read_bytes(file, "true fruits"))
    if text is None:
        raise FormatError(f"{file}: expected true fruits, a text file (CSV), found other data")
    if not text.strip():
        raise FormatError(f"{file}: expected true fruits, but the file is empty")
    if file.suffix.lower() in _OF_PHOTOS:
        raise FormatError(
            f"{file}: expected a table of true fruits in space ({', '.join(_FRUIT_COLUMNS)}); labels of photos are "
            "compared with the detections in these: `pomona evaluate --detections`"
        )
    names = set(column_names(text, {*_FRUIT_COLUMNS, *_BOX_COLUMNS}))
    if names >= set(_FRUIT_COLUMNS):
        return _with_visible(file, _read_columns(file))
    if names >= set(_BOX_COLUMNS):
        table = _table(file, _BOX_COLUMNS, optional=("id", "tree"))
        boxes = np.stack([table.numbers(name) for name in _BOX_COLUMNS], axis=1)
        numbered = any(table.cells.get("id", ()))
        ids = np.array(table.ids("id"), np.int64) if numbered else None
        return _boxes(file, boxes, ids, _trees(table), table.lines)
    return _boxes(file, _read_boxes(file, text.splitlines()))


def _boxes(
    file: Path,
    boxes: FloatArray,
    ids: IntArray | None = None,
    trees: IntArray | None = None,
    lines: tuple[int, ...] = (),
) -> Truth:
    flat = np.flatnonzero(~(boxes[:, 3:] > boxes[:, :3]).all(axis=1))
    if len(flat):
        where = f", line {lines[flat[0]]}" if lines else f", box {flat[0] + 1}"
        raise FormatError(
            f"{file}{where}: expected the lowest, then the highest corner, found "
            f"{' '.join(f'{value:g}' for value in boxes[flat[0]])}"
        )
    try:
        truth = Truth.from_boxes(boxes, ids)
        return truth if trees is None else replace(truth, tree_ids=trees)
    except InputError as error:
        raise FormatError(f"{file}: {error}") from error


def _file_of(path: Path) -> Path:
    if not path.exists():
        raise MissingFileError(
            f"No truth found: {path} does not exist; expected a table of true fruits ({', '.join(_FRUIT_COLUMNS)}), "
            "their boxes, or a folder with truth/fruits.csv or fruits.csv"
        )
    tried = [path / "truth" / "fruits.csv", path / "fruits.csv"] if path.is_dir() else [path]
    for file in tried:
        if file.is_file():
            return file
    raise MissingFileError(f"No truth found in {path}: expected {' or '.join(map(str, tried))}")


def _read_columns(file: Path) -> Truth:
    table = _table(file, _FRUIT_COLUMNS, optional=("tree",))
    ids = np.array(table.ids("id"), np.int64)
    centers = np.stack([table.numbers(axis) for axis in "xyz"], axis=1)
    diameters_m = table.numbers("diameter")
    for line, diameter_m in zip(table.lines, diameters_m, strict=True):
        if diameter_m <= 0:
            raise FormatError(f"{file}, line {line}, column diameter: expected metres above 0, found {diameter_m:g}")
    return Truth(ids, centers, diameters_m, _trees(table))


def _table(file: Path, columns: tuple[str, ...], *, optional: tuple[str, ...]) -> SmallTable:
    return read_small_table(file, columns, "the truth", "fruit", optional=optional, also_called={"tree": "tree_id"})


def _trees(table: SmallTable) -> IntArray:
    """The trees of fruits, 0 where they are not known."""
    return np.nan_to_num(table.numbers_if_given("tree")).astype(np.int64)


def _with_visible(file: Path, truth: Truth) -> Truth:
    beside = file.with_name("visible_pixels.json")
    if not beside.is_file():
        return truth
    table = load_json(beside, "{photo: {fruit id: pixels}}")
    try:
        seen = [(photo, int(i), int(px)) for photo, pixels in table.items() for i, px in pixels.items()]
        ids, visible_px = np.array([s[1:] for s in seen], np.int64).reshape(-1, 2).T
    except (ValueError, TypeError, AttributeError, OverflowError) as error:
        raise FormatError(f"{beside}: expected {{photo: {{fruit id: pixels}}}}, but {error}") from error
    return Truth(
        truth.ids, truth.centers_in_world, truth.diameters_m, truth.tree_ids, truth.boxes_in_world,
        tuple(s[0] for s in seen), ids, visible_px,
    )  # fmt: skip


def _read_boxes(file: Path, lines: list[str]) -> FloatArray:
    """Return boxes (n, 6) from lines of 6, 24 or 3 numbers."""
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        words = line.replace(",", " ").replace(";", " ").replace("\t", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            rows.append([float(word) for word in words])
        except ValueError as error:
            raise FormatError(
                f"{file}, line {number}: expected the columns {','.join(_FRUIT_COLUMNS)}, the columns "
                f"{','.join(_BOX_COLUMNS)}, or boxes as numbers; found '{line[:60]}'"
            ) from error
        if len(rows[-1]) not in (3, 6, 3 * _CORNERS) or len(rows[-1]) != len(rows[0]):
            raise FormatError(
                f"{file}, line {number}: expected 6, 24 or 3 numbers on every line, found {len(rows[-1])}"
            )
    if not rows:
        raise FormatError(f"{file}: expected true fruits, found an empty file")
    table = np.array(rows)
    if table.shape[1] == 6:
        return table
    if table.size % (3 * _CORNERS):
        raise FormatError(f"{file}: expected eight corners a box, found {len(table)} lines of corners")
    corners = table.reshape(-1, _CORNERS, 3)
    return np.concatenate([corners.min(1), corners.max(1)], axis=1)
