"""What photos saw of fruits: sightings, and outlines of detections."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import cv2
import numpy as np

from pomona.arrays import FloatArray
from pomona.detections import Mask
from pomona.report.contract import F32, U32, DetectionColumns, Sightings, packed
from pomona.report.data import ReportData

MAX_SIGHTINGS = 200_000
Box = tuple[float, float, float, float]
"""Four numbers in pixels: edges x0, y0, x1, y1 of a detection, or x, y, width, height of a crop."""
# How much larger than the detection a crop is.
_AROUND = 2.0
_LEAST_CROP_PX = 24.0
# An outline may leave out what is less than this off.
_OUTLINE_OFF_PX = 0.6


def sightings(data: ReportData, crops: Mapping[int, str]) -> Sightings:
    """Return which photos saw which fruit; the largest detection of each fruit comes first."""
    fruit_idx = {int(fruit_id): i for i, fruit_id in enumerate(data.fruits.ids)}
    photo_idx = {name: i for i, name in enumerate(data.cameras.photos)}
    boxes, usual = boxes_by_id(data), _usual_crop_px(data)
    rows = []
    for fruit_id, photo, detection_id, (x, y) in each_observation(data):
        if fruit_id in fruit_idx and photo in photo_idx:
            box = boxes.get(detection_id)
            crop = crop_box(box) if box else (x - usual / 2, y - usual / 2, usual, usual)
            rows.append((fruit_idx[fruit_id], photo_idx[photo], detection_id, *crop))
    rows.sort(key=lambda row: (row[0], -row[5], row[1]))
    table = np.array(rows[:MAX_SIGHTINGS], float).reshape(-1, 7)
    return Sightings(
        fruits=U32(packed(table[:, 0], "<u4")),
        photos=U32(packed(table[:, 1], "<u4")),
        detections=U32(packed(table[:, 2], "<u4")),
        boxes=F32(packed(table[:, 3:], "<f4")),
        crops=[crops.get(int(detection), "") for detection in table[:, 2]] if crops else [],
    )


def crop_box(box_px: Box) -> Box:
    """Return x, y, width and height of the square crop around a detection with edges x0, y0, x1, y1."""
    x0, y0, x1, y1 = box_px
    side = float(np.ceil(max(_AROUND * max(x1 - x0, y1 - y0), _LEAST_CROP_PX)))
    return float(np.floor((x0 + x1 - side) / 2)), float(np.floor((y0 + y1 - side) / 2)), side, side


def detection_columns(
    data: ReportData, *, only: Iterable[int] | None = None, photo: str | None = None
) -> DetectionColumns:
    """Return detections of the photos that have a place, with outlines; `only` some ids, or those of one photo."""
    kept = None if only is None else set(only)
    fruit_of = dict(zip(data.observations.detection_id.tolist(), data.observations.fruit_id.tolist(), strict=True))
    rows: list[tuple[int, int, int, float]] = []
    outlines: list[FloatArray] = []
    for k, name in enumerate(data.cameras.photos):
        found = data.masks.get(name) if data.masks is not None and photo in (None, name) else None
        if found is None:
            continue
        for mask, score, id_ in zip(found.masks, found.scores.tolist(), found.ids.tolist(), strict=True):
            if kept is None or id_ in kept:
                rows.append((id_, k, fruit_of.get(id_, 0), score))
                outlines.append(_outline(mask))
    table = np.array(rows, float).reshape(-1, 4)
    return DetectionColumns(
        ids=U32(packed(table[:, 0], "<u4")),
        photos=U32(packed(table[:, 1], "<u4")),
        fruits=U32(packed(table[:, 2], "<u4")),
        scores=F32(packed(table[:, 3], "<f4")),
        starts=U32(packed(np.cumsum([0, *(len(outline) for outline in outlines)]), "<u4")),
        points=F32(packed(np.concatenate([np.zeros((0, 2)), *outlines]), "<f4")),
    )


def _outline(mask: Mask) -> FloatArray:
    """The outline of a mask's largest part, (k, 2) pixels, with as few points as show its form."""
    # Twice as large, so that the outline runs near the pixels' edges and not through their centres.
    twice = np.repeat(np.repeat(np.pad(mask.pixels, 1), 2, 0), 2, 1).astype(np.uint8)
    contours, _ = cv2.findContours(twice, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    few = cv2.approxPolyDP(max(contours, key=len), 2 * _OUTLINE_OFF_PX, True)[:, 0]
    xy_px: FloatArray = (few + 0.5) / 2 - 1 + np.array([mask.x_px, mask.y_px])
    return xy_px


def each_observation(data: ReportData) -> Iterable[tuple[int, str, int, tuple[float, float]]]:
    """Return fruit id, photo, detection id and place in pixels of each observation."""
    seen = data.observations
    places = [(x, y) for x, y in seen.xy_px.tolist()]
    return zip(seen.fruit_id.tolist(), seen.photo, seen.detection_id.tolist(), places, strict=True)


def boxes_by_id(data: ReportData) -> dict[int, Box]:
    """Return the edges x0, y0, x1, y1 of each detection's mask by its id."""
    found = data.masks.values() if data.masks is not None else ()
    return {
        id_: (float(x0), float(y0), float(x1), float(y1))
        for of_photo in found
        for id_, (x0, y0, x1, y1) in zip(of_photo.ids.tolist(), (m.box_px for m in of_photo.masks), strict=True)
    }


def _usual_crop_px(data: ReportData) -> float:
    """The side of a crop where the detection is not known: a twelfth of the photo."""
    widths = [lens.width_px for lens in data.cameras.intrinsics]
    return float(np.median(widths)) / 12 if widths else 64.0
