"""How far what each pixel of a photo shows is, by one other photo: rectification and semi-global matching.

Hirschmüller 2008, "Stereo processing by semiglobal matching and mutual information" (IEEE TPAMI 30, 328-341), as OpenCV
has it (StereoSGBM, with the sampling-insensitive difference of Birchfield and Tomasi).
"""

from __future__ import annotations

import cv2
import numpy as np

from pomona.basics.arrays import Array, ByteArray, Float32Array, FloatArray
from pomona.stages.dense.views import View

_BLOCK_PX = 3
# Leaves are small and at all depths: changes of depth cost half of what OpenCV recommends for streets and rooms.
_P1, _P2 = 4 * _BLOCK_PX**2, 16 * _BLOCK_PX**2
_UNIQUENESS_PERCENT, _BOTH_WAYS_PX = 5, 1
_STEPS = 16  # of disparity in a pixel, as OpenCV gives it
# A photo's corners must be seen at this much of a right angle to the pair's baseline, and a rectified photo may have so
# many times its pixels; else the photos are one before the other rather than beside it.
_LEAST_AHEAD, _MOST_PIXELS = 0.3, 2.0


def inverse_depths(view: View, partner: View, nearest_m: float, farthest_m: float) -> tuple[Float32Array, float] | None:
    """Return the inverse depth (1 / m) of each pixel (h, w) of a view, NaN where not known, and the parallax.

    The parallax says how many pixels of disparity one unit of inverse depth makes. Depths are looked for from
    `nearest_m` to `farthest_m`. None where the pair cannot be rectified: one photo lies before the other.
    """
    rotation = view.cam_from_world[:, :3]
    baseline = rotation @ (_center(partner) - _center(view))
    length = float(np.linalg.norm(baseline))
    if length == 0:
        return None
    rectified_from_view = _rectification(baseline / length, rotation @ partner.cam_from_world[2, :3])
    focal = float(view.matrix[0, 0])
    placed = _canvas(view, rectified_from_view, focal)
    if placed is None:
        return None
    canvas, size = placed
    parallax = focal * length
    first = max(0, int(parallax / farthest_m) - 1)
    count = 16 * -(-(int(parallax / nearest_m) + 2 - first) // 16)
    if count >= size[0]:
        return None
    shifted = canvas.copy()
    shifted[0, 2] += first  # the disparities that are looked for begin at 0
    view_px = view.matrix @ rectified_from_view.T @ np.linalg.inv(canvas)
    partner_from_view = partner.cam_from_world[:, :3] @ rotation.T
    partner_px = partner.matrix @ partner_from_view @ rectified_from_view.T @ np.linalg.inv(shifted)
    matcher = cv2.StereoSGBM.create(
        numDisparities=count, blockSize=_BLOCK_PX, P1=_P1, P2=_P2, disp12MaxDiff=_BOTH_WAYS_PX, preFilterCap=31,
        uniquenessRatio=_UNIQUENESS_PERCENT, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    steps = matcher.compute(_warped(view, view_px, size), _warped(partner, partner_px, size))
    height, width = view.label.shape
    steps = cv2.warpPerspective(steps, view_px, (width, height), flags=cv2.INTER_NEAREST, borderValue=-_STEPS)
    rows = _depth_of_rectified(rectified_from_view, canvas, np.linalg.inv(view_px), (height, width))
    inverse = (steps.astype(np.float32) / _STEPS + first) / (np.float32(parallax) * rows)
    return np.where(steps > _STEPS // 2, inverse, np.float32(np.nan)), parallax


def _center(view: View) -> FloatArray:
    center: FloatArray = -view.cam_from_world[:, :3].T @ view.cam_from_world[:, 3]
    return center


def _rectification(along: FloatArray, partner_ahead: FloatArray) -> FloatArray:
    """Return rectified_from_view (3, 3): x along the baseline, z between both viewing directions (in the view's axes).

    Wherever the partner is, it is on the right: the rectified photos may be upside down.
    """
    ahead = np.array([0.0, 0.0, 1.0]) + partner_ahead
    ahead -= (ahead @ along) * along
    ahead /= np.linalg.norm(ahead)
    return np.stack([along, np.cross(ahead, along), ahead])


def _canvas(view: View, rectified_from_view: FloatArray, focal: float) -> tuple[FloatArray, tuple[int, int]] | None:
    """Return K (3, 3) of the rectified photos and their size, which holds all of the view."""
    height, width = view.label.shape
    corners = np.array([[0, 0, 1], [width - 1, 0, 1], [width - 1, height - 1, 1], [0, height - 1, 1]], float)
    rays = corners @ np.linalg.inv(view.matrix).T @ rectified_from_view.T
    if (rays[:, 2] < _LEAST_AHEAD * np.linalg.norm(rays, axis=1)).any():
        return None
    places = focal * rays[:, :2] / rays[:, 2:]
    low = np.floor(places.min(0))
    columns, rows = (int(extent) + 1 for extent in np.ceil(places.max(0) - low))
    if columns * rows > _MOST_PIXELS * width * height:
        return None
    return np.array([[focal, 0, -low[0]], [0, focal, -low[1]], [0, 0, 1]]), (columns, rows)


def _warped(view: View, px_from_rectified: FloatArray, size: tuple[int, int]) -> ByteArray:
    gray = cv2.cvtColor(view.rgb, cv2.COLOR_RGB2GRAY)
    warped = cv2.warpPerspective(gray, px_from_rectified, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    return np.asarray(warped, np.uint8)


def _depth_of_rectified(
    rectified_from_view: FloatArray, canvas: FloatArray, rectified_px: FloatArray, shape: tuple[int, int]
) -> Array:
    """Return for each pixel (h, w) of the view the depth, in the view, of what is at depth 1 in the rectified view."""
    y, x = np.ogrid[: shape[0], : shape[1]]
    x, y = x.astype(np.float32), y.astype(np.float32)
    ray = (rectified_from_view.T @ np.linalg.inv(canvas) @ rectified_px)[2].astype(np.float32)
    unit = rectified_px[2].astype(np.float32)
    depth: Array = (ray[0] * x + ray[1] * y + ray[2]) / (unit[0] * x + unit[1] * y + unit[2])
    return depth
