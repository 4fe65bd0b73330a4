"""From the maps of a centre-offset network to instances with masks; numpy alone, no network.

The network says for each cell of a grid (`stride` pixels) how likely a fruit's centre is there, how far that fruit's
box reaches, whether the cell shows fruit, and where the centre of the fruit that it shows is. A mask is made of the
fruit pixels that point at its centre, so that touching fruits come apart (compare Panoptic-DeepLab, Cheng 2020).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pomona.basics.arrays import BoolArray, Float32Array, FloatArray, set_checked
from pomona.stages.segment.box_overlap import non_maximum_suppression, overlapping_pairs
from pomona.stages.segment.protocol import TileDetections
from pomona.values.detections import Mask


@dataclass(frozen=True, kw_only=True)
class DecodeOptions:
    """How instances are read from the maps.

    `box_growth` is a share of the box's side that masks may reach beyond it; `max_center_error` how far from the
    instance's centre a pixel may point, as a share of the box's mean half side.
    """

    score_threshold: float = 0.1
    foreground_threshold: float = 0.5
    max_box_iou: float = 0.6
    box_growth: float = 0.1
    max_center_error: float = 1.0
    min_area_px: int = 12


@dataclass(frozen=True, eq=False)
class Maps:
    """The network's outputs on one tile of h × w cells.

    `heatmap` (h, w) and `foreground` (h, w) are probabilities; `box` (4, h, w) left, top, right, bottom distances and
    `offset` (2, h, w) dx, dy to the centre, in pixels from the cell's centre, which is ((i + 0.5) * `stride`).
    `circle` (5, h, w), where the network says it, is the whole fruit: dx, dy to its centre, its radius, and the
    standard deviations of centre and radius, in pixels.
    """

    heatmap: Float32Array
    box: Float32Array
    foreground: Float32Array
    offset: Float32Array
    stride: int
    circle: Float32Array | None = None

    def __post_init__(self) -> None:
        h, w = self.heatmap.shape
        if self.circle is not None:
            set_checked(self, "circle", (5, h, w), np.float32)
        set_checked(self, "box", (4, h, w), np.float32)
        set_checked(self, "foreground", (h, w), np.float32)
        set_checked(self, "offset", (2, h, w), np.float32)


def decode(maps: Maps, width_px: int, height_px: int, options: DecodeOptions) -> TileDetections:
    """Return the instances of a tile whose valid part is `width_px` × `height_px` (the rest is padding).

    Instances are ordered by falling score; those without a mask are dropped.
    """
    boxes, scores, circles = _peaks(maps, width_px, height_px, options)
    if len(scores) == 0:
        return TileDetections.empty()
    foreground, target_x, target_y = _upsampled(maps, width_px, height_px, options.foreground_threshold)
    masks = _masks(boxes, foreground, target_x, target_y, options)
    found = np.array([k for k, mask in enumerate(masks) if mask is not None], np.int64)
    limits = np.array([width_px, height_px, width_px, height_px], float)
    clipped = np.clip(boxes[found], 0, limits)
    seen = tuple(mask for mask in masks if mask is not None)
    return TileDetections(clipped, scores[found], seen, None if circles is None else circles[found])


def _peaks(
    maps: Maps, width_px: int, height_px: int, options: DecodeOptions
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Boxes (n, 4), scores (n,), circles (n, 5) of the heatmap's 3 × 3 maxima, best first, duplicates removed."""
    highest = cv2.dilate(maps.heatmap, np.ones((3, 3), np.uint8))
    rows, columns = np.nonzero((maps.heatmap >= highest) & (maps.heatmap >= options.score_threshold))
    x, y = (columns + 0.5) * maps.stride, (rows + 0.5) * maps.stride
    inside = (x < width_px) & (y < height_px)
    rows, columns, x, y = rows[inside], columns[inside], x[inside], y[inside]
    left, top, right, bottom = np.maximum(maps.box[:, rows, columns].astype(float), 0.5)
    boxes = np.stack([x - left, y - top, x + right, y + bottom], axis=1)
    scores = np.clip(maps.heatmap[rows, columns].astype(float), 0, 1)
    kept = np.flatnonzero(non_maximum_suppression(boxes, scores, options.max_box_iou))
    kept = kept[np.argsort(-scores[kept], kind="stable")]
    if maps.circle is None:
        return boxes[kept], scores[kept], None
    circles = maps.circle[:, rows[kept], columns[kept]].T.astype(float)
    circles[:, :2] += np.stack([x[kept], y[kept]], axis=1)
    return boxes[kept], scores[kept], circles


def _upsampled(
    maps: Maps, width_px: int, height_px: int, threshold: float
) -> tuple[BoolArray, Float32Array, Float32Array]:
    """Per pixel of the tile (height, width): is it fruit, and the x and y of the centre that it points at."""
    stacked = np.ascontiguousarray(np.stack([maps.foreground, *maps.offset], axis=2), np.float32)
    h, w = maps.foreground.shape
    # OpenCV aligns pixel areas, not pixel centres: cell i covers pixels i * stride to (i + 1) * stride.
    full = cv2.resize(stacked, (w * maps.stride, h * maps.stride), interpolation=cv2.INTER_LINEAR)
    full = full[:height_px, :width_px]
    target_x = full[:, :, 1] + np.arange(width_px, dtype=np.float32)[None, :] + np.float32(0.5)
    target_y = full[:, :, 2] + np.arange(height_px, dtype=np.float32)[:, None] + np.float32(0.5)
    return full[:, :, 0] > threshold, target_x, target_y


def _masks(
    boxes: FloatArray, foreground: BoolArray, target_x: Float32Array, target_y: Float32Array, options: DecodeOptions
) -> list[Mask | None]:
    """The mask of each box: its fruit pixels that point at its centre and at no neighbour's, or None."""
    height, width = foreground.shape
    centers = (boxes[:, :2] + boxes[:, 2:]) / 2
    half_sides = (boxes[:, 2:] - boxes[:, :2]).mean(1) / 2
    margin = np.maximum((boxes[:, 2:] - boxes[:, :2]) * options.box_growth, 2)
    grown = np.concatenate([boxes[:, :2] - margin, boxes[:, 2:] + margin], axis=1)
    crops = np.clip(np.round(grown), 0, [width, height, width, height]).astype(np.int64)
    i, j = overlapping_pairs(grown, grown)
    i, j = i[i != j], j[i != j]
    order = np.argsort(i, kind="stable")
    neighbours = np.split(j[order], np.searchsorted(i[order], np.arange(1, len(boxes))))
    masks: list[Mask | None] = []
    for k, (x0, y0, x1, y1) in enumerate(crops):
        pixels = foreground[y0:y1, x0:x1]
        if pixels.any():
            at_x, at_y = target_x[y0:y1, x0:x1], target_y[y0:y1, x0:x1]
            distance = _squared_distance(at_x, at_y, centers[k])
            pixels = pixels & (distance <= (options.max_center_error * half_sides[k]) ** 2)
            for other in neighbours[k]:
                theirs = _squared_distance(at_x, at_y, centers[other])
                pixels &= (distance < theirs) if other < k else (distance <= theirs)
        masks.append(Mask.from_pixels(pixels, x0, y0) if pixels.sum() >= max(options.min_area_px, 1) else None)
    return masks


def _squared_distance(x: Float32Array, y: Float32Array, center: FloatArray) -> Float32Array:
    distance: Float32Array = np.square(x - np.float32(center[0])) + np.square(y - np.float32(center[1]))
    return distance
