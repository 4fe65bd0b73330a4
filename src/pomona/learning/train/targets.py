"""What the network is to say of a crop, as maps at its stride."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor

from pomona.basics.arrays import Float32Array
from pomona.learning.train.crop import TrainingCrop
from pomona.learning.train.network import STRIDE
from pomona.learning.train.samples import IGNORED, Labels

_SPREAD = 0.54 / 6  # standard deviation of a centre's bump, of the box's side (Liu 2020, TTFNet)
_CORE = 0.3  # a box is learnt where its bump is higher than this


@dataclass(frozen=True, eq=False)
class Targets:
    """Maps of n crops at stride 4, float32 tensors.

    `heat` (n, 1, h, w) bumps of height 1 at centres, `heat_weight` 0 where doubtful; `box` (n, 4, h, w) left, top,
    right, bottom in pixels with `box_weight` (n, 1, h, w) that sums to 1 over a fruit; `foreground` (n, 1, h, w) the
    share of fruit among a cell's sure pixels with `foreground_weight`; `offset` (n, 2, h, w) to the box's centre with
    `offset_weight` (n, 1, h, w), which is one over the box's side on sure fruit; `circle` (n, 3, h, w) dx, dy to the
    whole fruit's centre and its radius, in pixels, with `circle_weight` (n, 1, h, w) that sums to 1 over a fruit whose
    circle is known. `complete` (n, 1, 1, 1) is 1 where all fruits are labelled.
    """

    heat: Tensor
    heat_weight: Tensor
    box: Tensor
    box_weight: Tensor
    foreground: Tensor
    foreground_weight: Tensor
    offset: Tensor
    offset_weight: Tensor
    circle: Tensor
    circle_weight: Tensor
    complete: Tensor


def targets_of(crops: list[TrainingCrop]) -> Targets:
    """Return the targets of crops of one size, which is a multiple of the stride."""
    each = [_maps(crop) for crop in crops]
    stacked = {f.name: torch.from_numpy(np.stack([maps[f.name] for maps in each])) for f in fields(Targets)}
    return Targets(**stacked)


def _maps(crop: TrainingCrop) -> dict[str, Float32Array]:
    size = crop.labels.shape[0] // STRIDE
    at = ((np.arange(size) + 0.5) * STRIDE).astype(np.float32)
    heat, best = np.zeros((size, size), np.float32), np.zeros((size, size), np.float32)
    box = np.ones((4, size, size), np.float32)
    box_weight = np.zeros((size, size), np.float32)
    circle, known = np.ones((3, size, size), np.float32), np.zeros((size, size), np.float32)
    for (x0, y0, x1, y1), (x, y, radius) in zip(crop.boxes_px, crop.known_circles_px, strict=True):
        if not np.isfinite([x0, y0, x1, y1]).all():
            continue
        width, height = x1 - x0, y1 - y0
        cx, cy = (x0 + x1) / 2, (y0 + y1) / 2
        # The peak is the cell that holds the centre: a bump between cells would have no cell of height 1.
        px, py = at[min(int(cx / STRIDE), size - 1)], at[min(int(cy / STRIDE), size - 1)]
        spread_x, spread_y = max(_SPREAD * width, STRIDE / 3), max(_SPREAD * height, STRIDE / 3)
        bump = np.exp(-((at[None, :] - px) ** 2) / (2 * spread_x**2) - (at[:, None] - py) ** 2 / (2 * spread_y**2))
        nearest = (bump > _CORE) & (bump > best)
        best[nearest] = bump[nearest]
        heat = np.maximum(heat, bump)
        rows, columns = np.nonzero(nearest)
        box[:, rows, columns] = [at[columns] - x0, at[rows] - y0, x1 - at[columns], y1 - at[rows]]
        known[nearest] = float(np.isfinite(radius))
        if np.isfinite(radius):
            circle[:, rows, columns] = [x - at[columns], y - at[rows], np.full(len(rows), radius)]
        box_weight[nearest] = bump[nearest] / bump[nearest].sum() if nearest.any() else 0
    cells = crop.labels.reshape(size, STRIDE, size, STRIDE).transpose(0, 2, 1, 3).reshape(size, size, -1)
    fruit, sure = (cells > 0).mean(2), (cells != IGNORED).mean(2)
    offset, offset_weight = _offsets(crop, cells[:, :, STRIDE * STRIDE // 2 + STRIDE // 2], at)
    valid_box = (box > 0).all(0)
    return {
        "heat": heat[None].astype(np.float32),
        "heat_weight": ((sure > 0.5) | (heat > 0.99))[None].astype(np.float32),
        "box": np.maximum(box, 0.5),
        "box_weight": (box_weight * valid_box)[None].astype(np.float32),
        "foreground": (fruit / np.maximum(sure, 1e-6))[None].astype(np.float32),
        "foreground_weight": np.where(sure >= 0.5, sure, 0)[None].astype(np.float32),
        "offset": offset,
        "offset_weight": offset_weight[None],
        "circle": circle,
        "circle_weight": (box_weight * known)[None].astype(np.float32),
        "complete": np.full((1, 1, 1), crop.complete, np.float32),
    }


def _offsets(crop: TrainingCrop, label: Labels, at: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Offsets (2, h, w) from cells to the centre of the fruit seen there, and weights (h, w)."""
    boxes = np.concatenate([np.full((1, 4), np.nan), crop.boxes_px]).astype(np.float32)
    of = boxes[np.maximum(label, 0)]
    known = np.isfinite(of).all(2)
    dx = (of[:, :, 0] + of[:, :, 2]) / 2 - at[None, :]
    dy = (of[:, :, 1] + of[:, :, 3]) / 2 - at[:, None]
    side = (of[:, :, 2] - of[:, :, 0] + of[:, :, 3] - of[:, :, 1]) / 2
    weight = np.where(known, 1 / np.maximum(side, 1), 0)
    return np.where(known, np.stack([dx, dy]), 0).astype(np.float32), weight.astype(np.float32)
