"""COCO's run-length encoding to and from crops, without ever laying out a whole photo.

Runs go down the columns of the photo, first of unset pixels, then of set ones, in turn. The compressed form writes
each run, from the fourth on as the difference to the run before the last, in groups of 5 bits, least first, as ASCII
from 48.
Source: cocoapi, common/maskApi.c, rleToString and rleFrString.
"""

from __future__ import annotations

import numpy as np
from pycocotools import mask as coco_mask

from pomona.basics.arrays import Array, IntArray, places_within
from pomona.errors import InputError
from pomona.values.detections import Mask


def encode(mask: Mask, width_px: int, height_px: int) -> str:
    """Return the compressed runs of a mask of a photo of `width_px` × `height_px`."""
    runs = {"size": [height_px, width_px], "counts": counts_of(mask, width_px, height_px).tolist()}
    compressed: bytes = coco_mask.frPyObjects(runs, height_px, width_px)["counts"]
    return compressed.decode("ascii")


def counts_of(mask: Mask, width_px: int, height_px: int) -> IntArray:
    """Return the lengths of the runs, unset pixels first; they sum to the photo's size."""
    columns = np.zeros((mask.width_px, mask.height_px + 2), np.int8)
    columns[:, 1:-1] = mask.pixels.T
    steps = np.diff(columns, axis=1)
    starts, ends = (_places(steps == step, mask, height_px) for step in (1, -1))
    # A run that reaches the photo's lower edge goes on at the top of the next column.
    whole = starts[1:] != ends[:-1]
    starts, ends = starts[np.append(True, whole)], ends[np.append(whole, True)]
    edges = np.stack([starts, ends], axis=1).ravel()
    counts = np.diff(edges, prepend=0, append=width_px * height_px)
    return counts[:-1] if counts[-1] == 0 else counts


def _places(steps: Array, mask: Mask, height_px: int) -> IntArray:
    """Where runs start or end, in pixels down the columns of the photo."""
    columns, rows = np.nonzero(steps)
    return np.asarray((columns + mask.x_px) * height_px + rows + mask.y_px, np.int64)


def decode_counts(text: str) -> IntArray:
    """Return the lengths of the runs of a compressed encoding; raises `InputError` where it is none."""
    digits = np.frombuffer(text.encode("utf-8", "surrogatepass"), np.uint8).astype(np.int64) - 48
    if len(digits) == 0:
        return np.zeros(0, np.int64)
    if digits.min() < 0 or digits.max() > 63:
        raise InputError("expected characters from '0' to 'o' in compressed counts")
    last = (digits & 0x20) == 0
    if not last[-1]:
        raise InputError("the compressed counts end in the middle of a number")
    stops = np.flatnonzero(last) + 1
    starts = np.concatenate([[0], stops[:-1]])
    if (stops - starts).max() > 12:
        raise InputError("a number in the compressed counts is too long")
    place = places_within(stops - starts)
    counts = np.add.reduceat((digits & 0x1F) << (5 * place), starts)
    counts -= np.where(digits[stops - 1] & 0x10, np.int64(1) << (5 * (stops - starts)), 0)
    counts[1::2] = np.cumsum(counts[1::2])
    counts[2::2] = np.cumsum(counts[2::2])
    return counts


def mask_from_counts(counts: IntArray, width_px: int, height_px: int) -> Mask | None:
    """Return the mask of the runs of a photo of `width_px` × `height_px`; None where no pixel is set.

    Raises `InputError` when a run is negative or the runs do not sum to the photo's size.
    """
    counts = np.asarray(counts, np.int64)
    if (counts < 0).any():
        raise InputError("expected runs of 0 pixels or more, found a negative one")
    if (counts > width_px * height_px).any():
        raise InputError(f"expected runs of at most {width_px} × {height_px} pixels, found one of {counts.max()}")
    if counts.sum() != width_px * height_px:
        raise InputError(
            f"expected runs that sum to {width_px} × {height_px} = {width_px * height_px} pixels, found {counts.sum()}"
        )
    ends = np.cumsum(counts)
    filled = np.flatnonzero(counts[1::2] > 0) * 2 + 1
    if len(filled) == 0:
        return None
    starts = ends - counts
    first = int(starts[filled[0]] // height_px)
    stop = int((ends[filled[-1]] - 1) // height_px) + 1
    runs = slice(filled[0], filled[-1] + 1)
    low, high = first * height_px, stop * height_px
    lengths = np.concatenate([[starts[filled[0]] - low], counts[runs], [high - ends[filled[-1]]]])
    values = np.zeros(len(lengths), bool)
    values[1::2] = True
    pixels = np.repeat(values, lengths).reshape(stop - first, height_px).T
    return Mask.from_pixels(pixels, first, 0)
