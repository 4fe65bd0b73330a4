"""How much of which true fruit lies in which detection of a photo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.errors import FormatError
from pomona.evaluate.fruits.truth import Truth
from pomona.formats.detections.png_masks import read_ids
from pomona.fruit.geometry.sphere_outlines import centers_px, sphere_outlines_px
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, Mask
from pomona.values.intrinsics import Intrinsics
from pomona.values.photo_names import pair_names

# A detection shows a fruit that has so much of it: of pixels the rest may be leaves; a disc reaches under neighbours.
_LEAST_BY_IDS, _LEAST_BY_DISCS = 1 / 3, 1 / 2


@dataclass(frozen=True, eq=False)
class Overlaps:
    """k pairs of a detection and a true fruit of one photo that share pixels.

    `of_detection` and `of_fruit` (k,) are what they share as a part of each; `rank` (k,) says which fruit a detection
    shows rather, of those with at least `least` of it.
    """

    detection_idx: IntArray
    true_idx: IntArray
    of_detection: FloatArray
    of_fruit: FloatArray
    rank: FloatArray
    least: float

    def owners(self, n_detections: int) -> IntArray:
        """Return the true fruit that each detection shows (n,), −1 for none."""
        result = np.full(n_detections, -1)
        enough = self.of_detection >= self.least
        order = np.argsort(self.rank[enough], kind="stable")
        result[self.detection_idx[enough][order]] = self.true_idx[enough][order]
        return result


def by_ids(path: Path, lens: Intrinsics, found: Detections | None, truth: Truth) -> tuple[Overlaps, FloatArray]:
    """Return the overlaps in a photo whose true fruits an image of ids shows, and the pixels seen of each fruit (n,).

    Raises `FormatError` where the image cannot be read or has not the photo's size.
    """
    ids = read_ids(path)
    if ids.shape != (lens.height_px, lens.width_px):
        raise FormatError(
            f"{path}: expected an image of fruit ids as large as the photo, {lens.width_px} × {lens.height_px}, "
            f"found {ids.shape[1]} × {ids.shape[0]}"
        )
    index = {fruit_id: i for i, fruit_id in enumerate(truth.ids.tolist()) if fruit_id != 0}  # 0: no fruit
    known, counts = np.unique(ids[ids != 0], return_counts=True)
    seen_px = np.zeros(len(truth))
    for fruit_id, pixels in zip(known.tolist(), counts.tolist(), strict=True):
        if fruit_id in index:
            seen_px[index[fruit_id]] = pixels
    rows = []
    for k, mask in enumerate(found.masks if found else ()):
        x0, y0, x1, y1 = mask.box_px
        pixels = mask.pixels
        under, shared = np.unique(ids[y0:y1, x0:x1][pixels], return_counts=True)
        for fruit_id, px in zip(under.tolist(), shared.tolist(), strict=True):
            if fruit_id in index:
                i = index[fruit_id]
                rows.append((k, i, px / np.count_nonzero(pixels), px / seen_px[i], px))
    return _overlaps(rows, _LEAST_BY_IDS), seen_px


def by_discs(cameras: Cameras, photo_idx: int, found: Detections | None, truth: Truth) -> Overlaps:
    """Return the overlaps of detections with the discs to which the true fruits project, leaves or not.

    A detection shows the fruit whose disc it fills best: the intersection over the union is the rank.
    """
    if not found or not len(truth):
        return _overlaps([], _LEAST_BY_DISCS)
    ahead = np.flatnonzero(np.isfinite(centers_px(cameras, photo_idx, truth.centers_in_world)).all(axis=1))
    discs = sphere_outlines_px(cameras, photo_idx, truth.centers_in_world[ahead], truth.diameters_m[ahead])
    low, high = discs.min(axis=1), discs.max(axis=1)  # NaN where a part is out of sight: never near
    rows = []
    for k, mask in enumerate(found.masks):
        x0, y0, x1, y1 = mask.box_px
        near = (low < [x1, y1]).all(axis=1) & (high > [x0, y0]).all(axis=1)
        for i in np.flatnonzero(near):
            shared = _pixels_within(mask, discs[i])
            if shared:
                area, disc = mask.area_px, float(cv2.contourArea(discs[i].astype(np.float32)))
                rows.append((k, int(ahead[i]), shared / area, min(1.0, shared / disc), shared / (area + disc - shared)))
    return _overlaps(rows, _LEAST_BY_DISCS)


def _pixels_within(mask: Mask, outline_px: FloatArray) -> int:
    """The number of a mask's pixels inside an outline (k, 2)."""
    disc = np.zeros((mask.height_px, mask.width_px), np.uint8)
    corners = np.round((outline_px - 0.5 - [mask.x_px, mask.y_px]) * 16).astype(np.int32)
    cv2.fillPoly(disc, [corners], 1, cv2.LINE_8, 4)
    return int(np.count_nonzero(mask.pixels & (disc > 0)))


def _overlaps(rows: list[tuple[int, int, float, float, float]], least: float) -> Overlaps:
    table = np.array(rows, float).reshape(-1, 5)
    return Overlaps(
        table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2], table[:, 3], table[:, 4], least
    )


def masks_beside(truth: Path, photos: Sequence[str]) -> dict[str, Path]:
    """Return, by photo, the images of true fruit ids in `truth/masks/` or `masks/` of a row's folder or beside a table.

    Empty where the truth has none. Raises `InputError` where an image fits several of `photos`.
    """
    places = [truth / "truth" / "masks", truth / "masks"] if truth.is_dir() else [truth.parent / "masks"]
    images = next((found for place in places if (found := sorted(place.glob("*.png")))), [])
    by_stem = {image.stem: image for image in images}
    return {photo: by_stem[stem] for stem, photo in pair_names(tuple(by_stem), photos).items()}
