"""How much detections and true fruits of one photo overlap, without ever laying out a whole photo."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.arrays import BoolArray, FloatArray
from pomona.detections import Mask


def box_overlap(found: FloatArray, true: FloatArray, crowds: BoolArray | None = None) -> FloatArray:
    """Return the intersection over union (n, m) of boxes (n, 4) and (m, 4); over the found box alone in crowds (m,)."""
    low = np.maximum(found[:, None, :2], true[None, :, :2])
    high = np.minimum(found[:, None, 2:], true[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=2)
    return _ratio(shared, (found[:, 2:] - found[:, :2]).prod(axis=1), (true[:, 2:] - true[:, :2]).prod(axis=1), crowds)


def mask_overlap(found: Sequence[Mask], true: Sequence[Mask], crowds: BoolArray | None = None) -> FloatArray:
    """Return the intersection over union (n, m) of masks; over the found mask alone in crowds (m,).

    Only pairs whose crops meet are compared, and each mask is unpacked once.
    """
    ours, theirs = [mask.pixels for mask in found], [mask.pixels for mask in true]
    boxes_a, boxes_b = (np.array([m.box_px for m in masks], int).reshape(-1, 4) for masks in (found, true))
    low = np.maximum(boxes_a[:, None, :2], boxes_b[None, :, :2])
    high = np.minimum(boxes_a[:, None, 2:], boxes_b[None, :, 2:])
    shared = np.zeros((len(found), len(true)))
    for i, j in zip(*np.nonzero((low < high).all(axis=2)), strict=True):
        (x0, y0), (x1, y1) = low[i, j].tolist(), high[i, j].tolist()
        a, b = found[i], true[j]
        mine = ours[i][y0 - a.y_px : y1 - a.y_px, x0 - a.x_px : x1 - a.x_px]
        its = theirs[j][y0 - b.y_px : y1 - b.y_px, x0 - b.x_px : x1 - b.x_px]
        shared[i, j] = np.count_nonzero(mine & its)
    areas_a = np.array([np.count_nonzero(pixels) for pixels in ours], float)
    areas_b = np.array([np.count_nonzero(pixels) for pixels in theirs], float)
    return _ratio(shared, areas_a, areas_b, crowds)


def _ratio(shared: FloatArray, areas_a: FloatArray, areas_b: FloatArray, crowds: BoolArray | None) -> FloatArray:
    union = areas_a[:, None] + areas_b[None] - shared
    if crowds is not None:
        union = np.where(crowds[None], np.broadcast_to(areas_a[:, None], union.shape), union)
    result: FloatArray = np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)
    return result
