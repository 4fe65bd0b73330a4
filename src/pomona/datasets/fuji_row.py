"""The row of the Fuji-SfM dataset as values: cameras, masks and clouds of all sides, and its true fruits by tree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.datasets.fuji_files import FujiFiles, SideFiles
from pomona.datasets.published import FUJI_TABLE_3, FUJI_TREES
from pomona.errors import FormatError, InputError
from pomona.evaluate.fruits import Truth, read_truth
from pomona.formats.cameras.bundler import cameras_of, parse_bundle
from pomona.formats.detections.label_sets import part_of
from pomona.formats.detections.mat_masks import MatMasks, read_mat_masks
from pomona.formats.xyz import first_lines, read_xyz
from pomona.progress import Progress, track
from pomona.values.cameras import Cameras, WorldFrame, concatenate
from pomona.values.detections import Detections, SurveyDetections
from pomona.values.fruits import FruitCloud

_Value = TypeVar("_Value")

# The authors scaled their clouds, and the cameras with them, by plates 0.85 m apart.
_FRAME = WorldFrame("given", approximate=False, up_is_known=False)
_MOST_TREE_FILES = 40  # more files than that are not one a tree


@dataclass(frozen=True, eq=False)
class FujiRow:
    """What is given of the row: `cameras` of all sides in one frame, in metres; None where it is not there.

    Photos are named `SIDE/STEM`, by the photo files where there are some, else by the files of masks. `cloud` shows
    the apples alone.
    """

    cameras: Cameras | None
    detections: SurveyDetections | None
    cloud: FruitCloud | None


@dataclass(frozen=True, eq=False)
class TrueTrees:
    """The true fruits, each with its tree (from 1); the trees that are for training; the `source` of both, in words."""

    truth: Truth
    training: frozenset[int]
    source: str

    @property
    def trees(self) -> tuple[int, ...]:
        """All trees, in order."""
        return tuple(np.unique(self.truth.tree_ids).tolist())

    def of(self, part: str) -> frozenset[int]:
        """Return the trees of "training" or "test"."""
        return self.training if part == "training" else frozenset(self.trees) - self.training


def read_fuji_row(files: FujiFiles, progress: Progress) -> FujiRow:
    """Read what the sides have: cameras and masks of all sides that have cameras, and their clouds.

    A side without cameras has no place in the row, and is left out with a warning. Raises `FormatError` and
    `MissingFileError` of the formats, and `InputError` where the numbers of cameras, photos and masks differ.
    """
    placed = [side for side in files.sides if side.cameras is not None]
    for side in files.sides:
        if placed and side.cameras is None:
            progress.warn(f"The {side.name} side has no cameras and is left out.")
    masks = {side.name: _read_masks(side, progress) for side in placed}
    cameras = [_read_cameras(side, masks[side.name]) for side in placed]
    found = {
        name: one
        for side in placed
        for name, one in _detections(side, masks[side.name], 1_000_000 * placed.index(side)).items()
    }
    clouds = [read_xyz(side.cloud) for side in placed if side.cloud is not None]
    return FujiRow(
        concatenate(cameras, _FRAME) if cameras else None,
        SurveyDetections(found) if found else None,
        _joined(clouds) if len(clouds) == len(placed) and clouds else None,
    )


def photo_names(side: SideFiles) -> tuple[str, ...]:
    """Return the names of a side's photos, in the order of its cameras."""
    return tuple(f"{side.name}/{path.stem}" for path in (side.photos or side.masks))


def read_true_trees(files: FujiFiles, n_trees: int) -> TrueTrees:
    """Read the boxes, and find which of `n_trees` trees each fruit is of.

    By a file for each tree, by the column `tree` of a table, else by where they are along the row, which is cut into
    parts of one length. Trees are for training where a file's name says so, else the three (of eleven) at that end of
    the row where their fruits are nearest to the paper's 434 of 1455.

    Raises `FormatError` that shows how a file begins where it holds something else.
    """
    parts = [_shown(file, read_truth) for file in files.boxes]
    truth = _together(parts)
    by_file = np.repeat(np.arange(1, len(parts) + 1), [len(part) for part in parts])
    if truth.tree_ids.all() and len(truth):
        source = "trees as the column tree says"
    elif 3 <= len(parts) <= _MOST_TREE_FILES:
        truth, source = replace(truth, tree_ids=by_file), "trees by file"
    else:
        cut = _along_row(truth.centers_in_world, n_trees)
        truth, source = replace(truth, tree_ids=cut), f"trees by cutting the row into {n_trees} parts of one length"
    roles = np.repeat([part_of(file.stem) for file in files.boxes], [len(part) for part in parts])
    if (roles == "training").any():
        training = frozenset(np.unique(truth.tree_ids[roles == "training"]).tolist())
        return TrueTrees(truth, training, f"{source}; training trees by the files' names")
    training = _training_end(truth.tree_ids)
    named = ", ".join(str(tree) for tree in sorted(training))
    return TrueTrees(
        truth, training, f"{source}; training trees {named}: the end whose share of fruits fits the paper's"
    )


def _read_masks(side: SideFiles, progress: Progress) -> list[MatMasks]:
    return [read_mat_masks(path) for path in track(side.masks, progress, f"reading masks, {side.name} side")]


def _read_cameras(side: SideFiles, masks: Sequence[MatMasks]) -> Cameras:
    assert side.cameras is not None
    bundle = _shown(side.cameras, parse_bundle)
    for what, paths in (("photos", side.photos), ("masks", side.masks)):
        if paths and len(paths) != len(bundle):
            raise InputError(
                f"{side.cameras}: expected a camera for each of the {len(paths)} {what} of the {side.name} side, in "
                f"the order of their names, found {len(bundle)} cameras"
            )
    if not side.photos and not side.masks:
        raise InputError(f"{side.cameras}: expected photos or masks of the {side.name} side as well, found neither")
    sizes = [(one.width_px, one.height_px) for one in masks] or _photo_sizes(side.photos)
    return replace(cameras_of(bundle, photo_names(side), sizes), frame=_FRAME)


def _photo_sizes(photos: Sequence[Path]) -> list[tuple[int, int]]:
    from pomona.stages.capture.images import size_of

    return [size_of(path) for path in photos]


def _detections(side: SideFiles, masks: Sequence[MatMasks], first_id: int) -> dict[str, Detections]:
    """A side's detections by photo, ids from `first_id` + 1; masks without scores are sure."""
    found: dict[str, Detections] = {}
    if not masks:
        return found
    _check_order(side)
    for name, one in zip(photo_names(side), masks, strict=True):
        scores = np.ones(len(one.masks)) if one.scores is None else one.scores
        ids = np.arange(first_id + 1, first_id + 1 + len(one.masks))
        first_id += len(one.masks)
        found[name] = Detections(name, one.width_px, one.height_px, one.masks, scores, ids)
    return found


def _check_order(side: SideFiles) -> None:
    """Photos and masks are paired by the order of their names; where both have the same numbers, these must agree."""
    numbers = [[_number(path.stem) for path in paths] for paths in (side.photos, side.masks)]
    if set(numbers[0]) != set(numbers[1]) or numbers[0] == numbers[1]:
        return
    k = next(i for i, (photo, mask) in enumerate(zip(*numbers, strict=True)) if photo != mask)
    raise InputError(
        f"{side.masks[k]}: expected the masks of {side.photos[k].name}, which has this place in the order of names of "
        f"the {side.name} side: name photos and masks alike"
    )


def _number(text: str) -> str:
    digits = "".join(character if character.isdigit() else " " for character in text).split()
    return digits[-1].lstrip("0") if digits else ""


def _joined(clouds: Sequence[FruitCloud]) -> FruitCloud:
    return FruitCloud(
        np.concatenate([cloud.points_in_world for cloud in clouds]),
        np.concatenate([cloud.rgb for cloud in clouds]),
        np.zeros(sum(len(cloud) for cloud in clouds), np.int64),
    )


def _shown(file: Path, read: Callable[[Path], _Value]) -> _Value:
    """Return what a file holds; an error that it has another form shows how it begins."""
    try:
        return read(file)
    except FormatError as error:
        raise FormatError(f"{error}; the file begins:\n{first_lines(file)}") from None


def _together(parts: Sequence[Truth]) -> Truth:
    """All files' fruits, numbered from 1; files with boxes are the only ones found."""
    boxes = np.concatenate([part.boxes_in_world for part in parts if part.boxes_in_world is not None])
    return replace(Truth.from_boxes(boxes), tree_ids=np.concatenate([part.tree_ids for part in parts]))


def _along_row(centers: FloatArray, n_trees: int) -> IntArray:
    """Number fruits by where they are along the row, which is the longest way through them all."""
    middle = centers - centers.mean(0)
    along = middle @ np.linalg.svd(middle, full_matrices=False)[2][0]
    edges = np.linspace(along.min(), along.max(), n_trees + 1)[1:-1]
    trees: IntArray = np.searchsorted(edges, along) + 1
    return trees


def _training_end(tree_ids: IntArray) -> frozenset[int]:
    trees, counts = np.unique(tree_ids, return_counts=True)
    share = FUJI_TREES["training"] / sum(FUJI_TREES.values())
    n = max(1, round(share * len(trees)))
    printed = {part: table.figures["T"] for part, table in FUJI_TABLE_3.items()}
    wanted = printed["training"] / sum(printed.values()) * counts.sum()
    ends = (slice(None, n), slice(-n, None))
    best = min(ends, key=lambda end: abs(counts[end].sum() - wanted))
    return frozenset(trees[best].tolist())
