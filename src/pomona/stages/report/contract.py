"""The contract with the viewer: dataclasses that become JSON, and the TypeScript types of the same, written from them.

`python -m pomona.stages.report.typescript` prints `viewer/src/contract.ts`; a test holds the two together. Fruits,
photos and detections are known by their own ids and names, so that an answer of a later request can be joined to the
first.

Columns of numbers (`U8`, `U16`, `U32` and `F32` name their type) travel as bytes behind the JSON
(`stages/report/columns.py`). Positions are in the world frame, relative to `SurveyData.origin`; pixels are COLMAP's
(the centre of the top-left pixel is (0.5, 0.5)).
"""

from __future__ import annotations

import dataclasses
from typing import Literal, NewType

import numpy as np

from pomona.basics.arrays import Array

U8 = NewType("U8", Array)
U16 = NewType("U16", Array)
U32 = NewType("U32", Array)
F32 = NewType("F32", Array)
Vector = tuple[float, float, float]
Source = Literal["report", "folder", "server"]
CorrectionKind = Literal["delete", "add", "split", "merge", "move", "undo", "redo"]
WatchPhase = Literal["waiting", "looking", "finishing", "finished"]


@dataclasses.dataclass(frozen=True)
class PackedCloud:
    """`count` points in an order by chance, so that the first of them are an even sample of all: `points` (k, 4).

    x, y and z divide the box from `min` of extent `size` in 65535 steps; the fourth number is a colour of 5, 6 and 5
    bits. Where k is less than `count`, a server has the other points in pieces of k, the second one being piece 1.
    """

    count: int
    min: Vector
    size: Vector
    points: U16


@dataclasses.dataclass(frozen=True)
class PointPiece:
    """More points of a cloud, (k, 4)."""

    points: U16


@dataclasses.dataclass(frozen=True)
class FruitColumns:
    """n fruits; NaN where something was not measured, and `reasons` says why. `trees`: 0 for none."""

    ids: list[int]
    centers: F32
    diameters: F32
    diameter_sds: F32
    visibilities: F32
    weights: F32
    scores: F32
    views: U32
    sides: list[str]
    trees: list[int]
    reasons: list[str]


@dataclasses.dataclass(frozen=True)
class PhotoColumns:
    """n photos that have a place. `frusta` (n, 5, 3): the centre, then the corners from the top left, clockwise.

    `rotations` (n, 3, 3) turn the world's axes into the camera's (x right, y down, z forward); `lenses` (n, 4) are fx,
    fy, cx, cy in pixels. `files`: where a resized copy lies, in an exported folder ("": none).
    """

    names: list[str]
    sides: list[str]
    widths: list[int]
    heights: list[int]
    frusta: F32
    rotations: F32
    lenses: F32
    files: list[str]


@dataclasses.dataclass(frozen=True)
class Sightings:
    """k times that a photo saw one of n fruits: the photo's index, the detection's id, the crop around it.

    Those of fruit i are `starts[i]` to `starts[i + 1]`, the largest first; `starts` has n + 1 entries. `boxes` (k, 4):
    x, y, width and height of the crop in pixels. Its JPEG is bytes `crop_starts[i]` to `crop_starts[i + 1]` of `crops`
    (none: not in this file).
    """

    starts: U32
    photos: U32
    detections: U32
    boxes: F32
    crop_starts: U32
    crops: U8


@dataclasses.dataclass(frozen=True)
class DetectionColumns:
    """n detections: ids, the index of the photo, the id of the fruit they became (0: none), and their outlines.

    Outline i is points `starts[i]` to `starts[i + 1]` of `points` (m, 2), pixels; `starts` has n + 1 entries.
    """

    ids: U32
    photos: U32
    fruits: U32
    scores: F32
    starts: U32
    points: F32


@dataclasses.dataclass(frozen=True)
class SeenFruit:
    """What photos saw of one fruit, asked for when it is selected."""

    sightings: Sightings
    detections: DetectionColumns


@dataclasses.dataclass(frozen=True)
class TreePlaces:
    """n trees: their ids and where they stand, on the ground, (n, 3)."""

    ids: list[int]
    places: F32


@dataclasses.dataclass(frozen=True)
class Rates:
    """Scores of the fruits whose score is at least `threshold`; None (null) where one is undefined."""

    threshold: float
    precision: float | None
    recall: float | None
    f1: float | None
    true: int
    false: int
    missed: int
    doubled: int


@dataclasses.dataclass(frozen=True)
class TruthData:
    """n true fruits, and what becomes of found and true ones at each of k score thresholds.

    `found` (k, fruits): 0 below the threshold, 1 true, 2 false, 3 doubled, 4 not scored. `missed` (k, n): 1 where no
    found fruit is the true one. `label` says over which true fruits the scores are: "all" or "visible".
    """

    label: str
    centers: F32
    diameters: F32
    steps: list[Rates]
    found: U8
    missed: U8


@dataclasses.dataclass(frozen=True)
class EarlierFruits:
    """n fruits of an earlier survey, laid over this one's, and the growth of these (NaN: not known).

    `later`: the index of the same fruit now, −1 for none. `in_view` (n,): photos of now show the place.
    """

    centers: F32
    diameters: F32
    later: list[int]
    in_view: U8
    growth: F32


@dataclasses.dataclass(frozen=True)
class ViewHints:
    """Where to look: `toward` is the direction from the fruits to where most photos were taken from (unit, in 3D).

    `along` and `across` are the row's axes, horizontal and of unit length; `across` points to most of the cameras.
    `radius` is that of the fruits; `row` the ends of the row's axis; `low` and `high` what there is in height.
    """

    radius: float
    toward: Vector
    along: Vector
    across: Vector
    row: tuple[float, float]
    low: float
    high: float
    ground: float
    grid: float


@dataclasses.dataclass(frozen=True)
class WatchHint:
    """What is the `matter` with a photo, and in words what to do."""

    photo: str
    matter: str
    text: str


@dataclasses.dataclass(frozen=True)
class WatchState:
    """How far the watch of photos that arrive is. `doing`: in words; the survey's folder where it is finished.

    `revision` is that of the page with the present answer. `placed` of the `photos` have a place; the others are null
    where they are not known: `fruits`, the `length` of row in metres, the usual `step`, and `well_seen`, the share of
    fruits that three photos saw. `hints`: the last ones, the newest first.
    """

    phase: WatchPhase
    doing: str
    revision: int
    photos: int
    placed: int
    fruits: int | None
    length: float | None
    step: float | None
    well_seen: float | None
    hints: list[WatchHint]


@dataclasses.dataclass(frozen=True)
class CorrectionState:
    """What a person changed, in words, the last one last; and what was undone, the next to be redone last.

    `revision` names this state of the log: a request made from another one is refused. `lost` are corrections that
    match no fruit. `fruits`: how each fruit was corrected ("": not at all). `usual_diameter` is the size of an added
    fruit unless it is clicked. `note` says why nothing can be corrected ("": it can).
    """

    revision: str
    done: list[str]
    undone: list[str]
    lost: list[str]
    fruits: list[str]
    usual_diameter: float | None
    note: str


@dataclasses.dataclass(frozen=True)
class PhotoMark:
    """A place clicked in a photo: the photo's index, pixels."""

    photo: int
    x: float
    y: float


@dataclasses.dataclass(frozen=True)
class CorrectionRequest:
    """What the page asks the server to change.

    `fruits` are ids: one to delete, split or move, two to merge. `marks` are the middle of a missed fruit in two or
    more photos, or the middles of two fruits that were taken for one, in one photo. `size`: none, or two marks on
    opposite edges of the fruit. `tree`: where to move a fruit to (0: to none).
    """

    kind: CorrectionKind
    revision: str
    fruits: list[int]
    marks: list[PhotoMark]
    size: list[PhotoMark]
    tree: int


@dataclasses.dataclass(frozen=True)
class CorrectionAnswer:
    """What was done, or why nothing was, in words; and the id of the fruit to look at then (0: none).

    `changed`: fruits are not what the page shows any more, so that it has to be loaded again.
    """

    changed: bool
    message: str
    fruit: int


@dataclasses.dataclass(frozen=True)
class SightLines:
    """Where other photos may show what was clicked in one: n photos, the best suited first, and a line in each.

    `lines[i]` are x and y of each of its points in turn, in pixels.
    """

    photos: list[int]
    lines: list[list[float]]


@dataclasses.dataclass(frozen=True)
class SurveyData:
    """All that the view shows at once. `source` says where photos come from: none in a report, files, or a server.

    `sightings` and `detections` are null where a server is asked for them, by fruit and by photo. `provisional`: photos
    still arrive, and the server tells of that. `photos_version` goes into the addresses of a server's photos: browsers
    keep photos, and another survey may have been at the same address.
    """

    source: Source
    provisional: bool
    photos_note: str
    photos_version: str
    title: str
    unit: str
    metric: bool
    origin: Vector
    scene: PackedCloud
    fruit_points: PackedCloud
    fruits: FruitColumns
    photos: PhotoColumns
    sightings: Sightings | None
    detections: DetectionColumns | None
    trees: TreePlaces
    view: ViewHints
    truth: TruthData | None
    earlier: EarlierFruits | None
    corrections: CorrectionState | None


def packed(values: Array, dtype: str) -> Array:
    """Return numbers as a column of little-endian `dtype`: "u1", "<u2", "<u4" or "<f4"."""
    return np.ascontiguousarray(values, dtype=dtype)


def vector(values: Array) -> Vector:
    """Return three numbers as the page takes them."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def camel_case(name: str) -> str:
    """Return a name as TypeScript writes it."""
    first, *rest = name.split("_")
    return first + "".join(word.capitalize() for word in rest)
