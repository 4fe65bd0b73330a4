"""Boxes that overlap, without comparing each with each; duplicates among them."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, places_within


def overlapping_pairs(boxes_a: FloatArray, boxes_b: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the index pairs (i, j) of boxes `boxes_a` (n, 4) and `boxes_b` (m, 4) that share some area.

    Boxes are x0, y0, x1, y1. A sweep along the longer side of the scene: time grows with the pairs that are near each
    other along that side.
    """
    none = np.zeros(0, np.int64)
    if len(boxes_a) == 0 or len(boxes_b) == 0:
        return none, none
    extent = np.concatenate([boxes_a, boxes_b])
    axis = int(np.ptp(extent[:, [1, 3]]) > np.ptp(extent[:, [0, 2]]))
    order = np.argsort(boxes_b[:, axis], kind="stable")
    starts = boxes_b[order, axis]
    longest = float((boxes_b[:, axis + 2] - boxes_b[:, axis]).max())
    first = np.searchsorted(starts, boxes_a[:, axis] - longest, "left")
    stop = np.searchsorted(starts, boxes_a[:, axis + 2], "left")
    counts = np.maximum(stop - first, 0)
    i = np.repeat(np.arange(len(boxes_a)), counts)
    j = order[np.repeat(first, counts) + places_within(counts)]
    a, b = boxes_a[i], boxes_b[j]
    meets = (np.minimum(a[:, 2:], b[:, 2:]) > np.maximum(a[:, :2], b[:, :2])).all(1)
    return i[meets], j[meets]


def pair_iou(boxes_a: FloatArray, boxes_b: FloatArray) -> FloatArray:
    """Return the intersection over union (n,) of the boxes (n, 4) row by row."""
    sides = np.minimum(boxes_a[:, 2:], boxes_b[:, 2:]) - np.maximum(boxes_a[:, :2], boxes_b[:, :2])
    intersection = np.clip(sides, 0, None).prod(1)
    area = (boxes_a[:, 2:] - boxes_a[:, :2]).prod(1) + (boxes_b[:, 2:] - boxes_b[:, :2]).prod(1)
    return np.asarray(intersection / np.maximum(area - intersection, 1e-9), np.float64)


def non_maximum_suppression(boxes: FloatArray, scores: FloatArray, max_iou: float) -> BoolArray:
    """Greedy non-maximum suppression: say (n,) which boxes overlap no better one by more than `max_iou`."""
    i, j = overlapping_pairs(boxes, boxes)
    rank = np.empty(len(boxes), np.int64)
    rank[np.lexsort((boxes[:, 0], boxes[:, 1], -scores))] = np.arange(len(boxes))
    close = (rank[i] < rank[j]) & (pair_iou(boxes[i], boxes[j]) > max_iou)
    return suppress(i[close], j[close], rank)


def suppress(better: IntArray, worse: IntArray, rank: IntArray) -> BoolArray:
    """Say (n,) which are kept when each kept `better` drops its `worse`, the pairs taken from the best rank down."""
    keep = np.ones(len(rank), bool)
    for pair in np.argsort(rank[better], kind="stable"):
        if keep[better[pair]]:
            keep[worse[pair]] = False
    return keep
