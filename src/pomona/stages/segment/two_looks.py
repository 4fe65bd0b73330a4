"""A tile seen twice by a centre-offset network: as it is, but mirrored, and made smaller; the maps of both made one.

Fruits are found best at the width that the network knows best, their edges where they are wider. What the network says
of both is worth more than either, and more than of one size and its mirror image (docs/lab/segmenter.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from scipy.special import expit, logit

from pomona.basics.arrays import ByteArray, Float32Array
from pomona.stages.segment.decode import Maps
from pomona.stages.segment.resize import resized_pixels

Look = Callable[[ByteArray], Maps]
"""From a tile (h, w, 3), whose sides are multiples of what the network takes, to maps that cover it."""

_PADDING = 114
_CERTAIN = 1e-6  # probabilities are kept so far from 0 and 1, where log odds have no end


def padded(tile: ByteArray, multiple: int) -> ByteArray:
    """Return a tile (h, w, 3) with grey at its right and below, so that its sides are multiples of `multiple`."""
    height, width = (-side % multiple for side in tile.shape[:2])
    return np.pad(tile, ((0, height), (0, width), (0, 0)), constant_values=_PADDING)


def seen_at_two_sizes(look: Look, tile: ByteArray, larger: float, multiple: int, *, enlarged: bool = False) -> Maps:
    """Return what the network says of a tile (h, w, 3) as it is, mirrored, and `larger` times smaller.

    The maps are those of the tile, padded to a multiple of `multiple`. Of probabilities the log odds are averaged. Of a
    tile that was `enlarged`, and shows no more than the smaller one, only the smaller one says where fruits are: the
    blur is nothing that the network has learnt from. Both say whose the pixels are.
    """
    height, width = tile.shape[:2]
    smaller = resized_pixels(tile, max(1, round(width / larger)), max(1, round(height / larger)))
    own, other = _seen_mirrored(look, padded(tile, multiple)), _with_log_odds(look(padded(smaller, multiple)))
    ratios = width / smaller.shape[1], height / smaller.shape[0]
    other = _enlarged(other, own.heatmap.shape, *ratios)
    both = _mean(own, other)
    return _with_probabilities(replace(both, heatmap=other.heatmap) if enlarged else both)


def seen_with_mirror_image(look: Look, tile: ByteArray, multiple: int) -> Maps:
    """Return what the network says of a tile (h, w, 3) and of its mirror image, as `seen_at_two_sizes` does."""
    whole = padded(tile, multiple)
    return _with_probabilities(_mean(_with_log_odds(look(whole)), _seen_mirrored(look, whole)))


def _seen_mirrored(look: Look, tile: ByteArray) -> Maps:
    return _with_log_odds(_mirrored(look(np.ascontiguousarray(tile[:, ::-1]))))


def _mirrored(maps: Maps) -> Maps:
    """Return the maps of a tile from those of its mirror image."""
    left, top, right, bottom = maps.box[:, :, ::-1]
    dx, dy = maps.offset[:, :, ::-1]
    circle = None
    if maps.circle is not None:
        to_x, *others = maps.circle[:, :, ::-1]
        circle = np.stack([-to_x, *others])
    return Maps(
        np.ascontiguousarray(maps.heatmap[:, ::-1]),
        np.stack([right, top, left, bottom]),
        np.ascontiguousarray(maps.foreground[:, ::-1]),
        np.stack([-dx, dy]),
        maps.stride,
        circle,
    )


def _enlarged(maps: Maps, shape: tuple[int, ...], x: float, y: float) -> Maps:
    """Return maps on a grid of `shape` cells of a tile that is `x` and `y` times as wide and high."""
    grid = np.array([[1 / x, 0, 0.5 / x - 0.5], [0, 1 / y, 0.5 / y - 0.5]])  # the middles of cells, as OpenCV counts

    def there(channel: Float32Array) -> Float32Array:
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        moved = cv2.warpAffine(channel, grid, shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(moved, np.float32)

    def scaled(channels: Float32Array, factors: tuple[float, ...]) -> Float32Array:
        return np.stack(
            [there(channel) * np.float32(factor) for channel, factor in zip(channels, factors, strict=True)]
        )

    mean = float(np.sqrt(x * y))
    circle = None if maps.circle is None else scaled(maps.circle, (x, y, mean, mean, mean))
    return Maps(
        there(maps.heatmap),
        scaled(maps.box, (x, y, x, y)),
        there(maps.foreground),
        scaled(maps.offset, (x, y)),
        maps.stride,
        circle,
    )


def _mean(one: Maps, other: Maps) -> Maps:
    circle = None if one.circle is None or other.circle is None else (one.circle + other.circle) / 2
    return Maps(
        (one.heatmap + other.heatmap) / 2,
        (one.box + other.box) / 2,
        (one.foreground + other.foreground) / 2,
        (one.offset + other.offset) / 2,
        one.stride,
        circle,
    )


def _with_log_odds(maps: Maps) -> Maps:
    return replace(maps, heatmap=_log_odds(maps.heatmap), foreground=_log_odds(maps.foreground))


def _log_odds(probabilities: Float32Array) -> Float32Array:
    return np.asarray(logit(np.clip(probabilities, _CERTAIN, 1 - _CERTAIN)), np.float32)


def _with_probabilities(maps: Maps) -> Maps:
    return replace(maps, heatmap=expit(maps.heatmap), foreground=expit(maps.foreground))
