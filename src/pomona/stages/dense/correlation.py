"""Plane sweep inside the masks: at which depth does a patch of fruit look the same in the neighbouring photos?

Two passes. The coarse one, at half scale, tries the whole depth range with windows half a fruit wide; the fine one, at
full working scale, tries depths within a fruit diameter of what the coarse one found, with smaller windows. Windows
hold pixels of one mask only, and count only where the neighbour has a mask too: leaves in front of a fruit, which
would draw a square window to their own depth, have no say.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from pomona.basics.arrays import Array
from pomona.basics.threads import cores
from pomona.stages.dense.atlas import Atlas
from pomona.stages.dense.views import View


@dataclass(frozen=True, kw_only=True)
class MatchOptions:
    """How patches are compared.

    `window_px`: width of the window; `noise`: standard deviation of the photos' noise, in brightness of 0 to 255, below
    which contrast says nothing; `mask_weight`: what lying on masks in both photos counts against correlation; `best`:
    the mean of that many best neighbours is the score, since fruits are hidden in some.
    """

    window_px: int
    noise: float = 4.0
    mask_weight: float = 0.25
    best: int = 2


def sweep(
    atlas: Atlas,
    view: View,
    neighbours: Sequence[View],
    base_inverse_depth: Array | float,
    offsets: Array,
    options: MatchOptions,
) -> Array:
    """Score every hypothesis `base_inverse_depth + offset` for every atlas pixel: float32 (len(offsets), h, w).

    1 + mask_weight would be perfect; 0 is nothing in common. Inverse depths are 1 / m.
    """
    window = _Window(atlas, options)
    warps = [_Warp(atlas, view, neighbour) for neighbour in neighbours]
    scores = np.empty((len(offsets), *atlas.mask.shape), np.float32)
    base = np.asarray(base_inverse_depth, np.float32)
    best = min(options.best, len(warps))

    def try_one(i: int) -> None:
        each = np.stack([window.score(*warp(base + np.float32(offsets[i]))) for warp in warps])
        if best < len(each):
            each = np.partition(each, len(each) - best, axis=0)[-best:]
        scores[i] = each.mean(0)

    # OpenCV and numpy let go of the interpreter's lock: threads do.
    with ThreadPoolExecutor(min(8, cores())) as pool:
        list(pool.map(try_one, range(len(offsets))))
    return scores


class _Warp:
    """Brings a neighbour's brightness and mask onto the atlas for a given inverse depth."""

    def __init__(self, atlas: Atlas, view: View, neighbour: View) -> None:
        rotation = neighbour.cam_from_world[:, :3] @ view.cam_from_world[:, :3].T
        shift = neighbour.cam_from_world[:, 3] - rotation @ view.cam_from_world[:, 3]
        homography = neighbour.matrix @ rotation @ np.linalg.inv(view.matrix)
        pixels = np.stack([atlas.x_px, atlas.y_px, np.ones_like(atlas.x_px)])
        self._at_infinity = np.einsum("ij,jhw->ihw", homography, pixels).astype(np.float32)
        self._epipole = (neighbour.matrix @ shift).astype(np.float32)
        self._image = neighbour.gray_and_mask

    def __call__(self, inverse_depth: Array) -> tuple[Array, Array]:
        """Return brightness and mask, float32 (h, w), the mask 0 to 1."""
        x, y, z = (a + e * inverse_depth for a, e in zip(self._at_infinity, self._epipole, strict=True))
        z = np.where(z > 1e-6, z, np.float32(np.nan))
        warped = cv2.remap(self._image, x / z, y / z, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        return warped[..., 0].astype(np.float32), (warped[..., 1] > 127).astype(np.float32)


class _Window:
    """Normalised correlation over the pixels of a window that lie on masks in both photos."""

    def __init__(self, atlas: Atlas, options: MatchOptions) -> None:
        self._options = options
        self._mask = atlas.mask.astype(np.float32)
        # Centred on the mean brightness, so that float32 sums of squares keep their digits.
        self._mean = float(atlas.gray[atlas.mask].mean()) if atlas.mask.any() else 0.0
        self._gray = (atlas.gray.astype(np.float32) - self._mean) * self._mask
        self._area = np.maximum(self._sum(self._mask), 1.0)

    def _sum(self, values: Array) -> Array:
        size = (self._options.window_px, self._options.window_px)
        summed: Array = cv2.boxFilter(values, cv2.CV_32F, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
        return summed

    def score(self, other: Array, other_mask: Array) -> Array:
        """Return the score (h, w): √(share of the window on both masks) × (correlation + mask_weight)."""
        both = self._mask * other_mask
        mine, theirs = self._gray * both, (other - self._mean) * both
        count = self._sum(both)
        safe = np.maximum(count, 1.0)
        mine_mean, theirs_mean = self._sum(mine) / safe, self._sum(theirs) / safe
        mine_variance = self._sum(mine * mine) / safe - mine_mean * mine_mean
        theirs_variance = self._sum(theirs * theirs) / safe - theirs_mean * theirs_mean
        covariance = self._sum(mine * theirs) / safe - mine_mean * theirs_mean
        spread = np.sqrt(np.maximum(mine_variance, 0) * np.maximum(theirs_variance, 0))
        correlation = covariance / (spread + self._options.noise**2)
        # The outline of a half-hidden fruit moves with the leaf in front of it: asking for whole overlap (without the
        # root) would draw the fruit forward to the leaf.
        score: Array = np.sqrt(count / self._area) * (correlation + self._options.mask_weight)
        return np.where(self._mask > 0, score, 0)


def best_inverse_depth(scores: Array, base_inverse_depth: Array | float, offsets: Array) -> tuple[Array, Array]:
    """Return the best hypothesis (h, w), refined between steps by a parabola, and its score (h, w)."""
    peak = scores.argmax(0)
    score = np.take_along_axis(scores, peak[None], 0)[0]
    inner = np.clip(peak, 1, len(offsets) - 2) if len(offsets) > 2 else peak
    shift = np.zeros_like(score)
    if len(offsets) > 2:
        low, mid, high = (np.take_along_axis(scores, inner[None] + d, 0)[0] for d in (-1, 0, 1))
        curvature = low - 2 * mid + high
        shift = np.where(curvature < -1e-9, 0.5 * (low - high) / np.where(curvature < -1e-9, curvature, 1), 0)
        shift = np.where(inner == peak, np.clip(shift, -0.5, 0.5), 0)
    step = offsets[1] - offsets[0] if len(offsets) > 1 else 0.0
    return np.asarray(base_inverse_depth, np.float32) + offsets[peak] + shift * step, score
