"""Depth maps of whole photos: the opinions of two pairs joined, checked with the maps of other photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pomona.basics.arrays import Array, BoolArray, ByteArray, Float32Array, FloatArray
from pomona.basics.threads import cores, in_order
from pomona.stages.dense.views import View
from pomona.stages.scene.options import DenseSceneOptions
from pomona.stages.scene.stereo import inverse_depths

# How far edges of the row may be off in a depth map; how far around them colours are looked at; and by how much, summed
# over red, green and blue, row and background must differ.
_EDGE_PX, _AROUND_PX, _CONTRAST = 5, 13, 60


@dataclass(frozen=True, eq=False)
class SceneMap:
    """Inverse depths (1 / m) of one view: `inverse_m` (h, w), NaN where not known.

    `agreed` (h, w): whether two pairs of photos say so; `tolerance`: how far opinions that agree may be apart.
    """

    view: View
    inverse_m: Float32Array
    agreed: BoolArray
    tolerance: float

    def __len__(self) -> int:
        return int(np.isfinite(self.inverse_m).sum())


def scene_map(view: View, partners: Sequence[View], depth_m: float, options: DenseSceneOptions) -> SceneMap | None:
    """Return the map of a view by its partners; None where it can be compared with none of them.

    Where two opinions differ, neither counts. What is behind `options.farthest` is looked for as well, so that the
    background is known for what it is.
    """
    search_m = options.nearest * depth_m, 2 * options.farthest * depth_m
    pairs = in_order(lambda partner: inverse_depths(view, partner, *search_m), partners, min(2, cores()))
    found = [pair for pair in pairs if pair is not None]
    if not found:
        return None
    first, parallax = found[0]
    tolerance = options.agreement_px / parallax
    if len(found) == 1:
        return SceneMap(view, first, np.zeros(first.shape, bool), tolerance)
    second, other_parallax = found[1]
    tolerance = options.agreement_px / min(parallax, other_parallax)
    agreed = np.abs(first - second) <= tolerance
    alone = np.where(np.isnan(first), second, np.where(np.isnan(second), first, np.float32(np.nan)))
    return SceneMap(view, np.where(agreed, (first + second) / 2, alone), agreed, tolerance)


def row_points(
    own: SceneMap, others: Sequence[SceneMap], depth_m: float, options: DenseSceneOptions
) -> tuple[FloatArray, ByteArray]:
    """Return points (m, 3) and colours (m, 3) of the row in a map: not too far, and confirmed by others often enough.

    With a single other map, one confirmation has to do.
    """
    confirmed = own.agreed.astype(np.uint8)
    for other in others:
        confirmed += _seen_alike(own, other)
    needed = min(options.min_agreeing, len(others))
    in_row = own.inverse_m >= 1 / (options.farthest * depth_m)
    kept = in_row & (confirmed >= needed) & ~_of_background(own.view.rgb, in_row)
    rows, columns = np.nonzero(kept)
    rays = np.stack([columns, rows, np.ones_like(rows)], 1) @ np.linalg.inv(own.view.matrix).T
    points_in_cam = rays / own.inverse_m[kept][:, None]
    pose = own.view.cam_from_world
    points: FloatArray = (points_in_cam - pose[:, 3]) @ pose[:, :3]
    return points, own.view.rgb[kept]


def _of_background(rgb: ByteArray, in_row: BoolArray) -> BoolArray:
    """Say of each pixel (h, w) whether it looks like what is behind the row around it rather than like the row.

    Around leaves that are seen against the sky, windows take the sky's pixels for leaves.
    """
    window = (_AROUND_PX, _AROUND_PX)
    colours = rgb.astype(np.float32)
    surely = cv2.erode(in_row.astype(np.uint8), np.ones((_EDGE_PX, _EDGE_PX), np.uint8)) > 0

    def mean_around(pixels: BoolArray) -> tuple[Array, Array]:
        weight = cv2.boxFilter(pixels.astype(np.float32), -1, window, normalize=False)
        total = cv2.boxFilter(colours * pixels[..., None], -1, window, normalize=False)
        return total / np.maximum(weight, 1)[..., None], weight > 0

    row, has_row = mean_around(surely)
    behind, has_behind = mean_around(~in_row)
    to_behind, to_row, contrast = _apart(colours, behind), _apart(colours, row), _apart(row, behind)
    like_behind = np.where(has_row, (contrast > _CONTRAST) & (to_behind < to_row), to_behind < _CONTRAST / 2)
    background: BoolArray = has_behind & like_behind
    return background


def _apart(one: Array, other: Array) -> Array:
    """How much colours (h, w, 3) differ, summed over red, green and blue (h, w)."""
    red, green, blue = cv2.split(cv2.absdiff(one, other))
    apart: Array = red + green + blue
    return apart


def _seen_alike(own: SceneMap, other: SceneMap) -> Array:
    """Say of each pixel (h, w) whether the other map has a surface where this one has."""
    rotation = other.view.cam_from_world[:, :3] @ own.view.cam_from_world[:, :3].T
    shift = (other.view.cam_from_world[:, 3] - rotation @ own.view.cam_from_world[:, 3]).astype(np.float32)
    turned = (rotation @ np.linalg.inv(own.view.matrix)).astype(np.float32)
    y, x = np.ogrid[: own.inverse_m.shape[0], : own.inverse_m.shape[1]]
    x, y = x.astype(np.float32), y.astype(np.float32)
    # Places in the other camera, times the inverse depth in this one.
    right, down, ahead = (t[0] * x + t[1] * y + t[2] + s * own.inverse_m for t, s in zip(turned, shift, strict=True))
    ahead = np.where(ahead > 0, ahead, np.float32(np.nan))
    matrix = other.view.matrix.astype(np.float32)
    place = matrix[0, 0] * right / ahead + matrix[0, 2], matrix[1, 1] * down / ahead + matrix[1, 2]
    there = cv2.remap(
        other.inverse_m, *place, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=float("nan")
    )
    alike: Array = np.abs(there - own.inverse_m / ahead) <= own.tolerance
    return alike
