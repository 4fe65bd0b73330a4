"""What photos saw of fruits: sightings, and outlines of detections."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

import cv2
import numpy as np

from pomona.basics.arrays import FloatArray, IntArray, places_within
from pomona.stages.report.axes import sightings_idx
from pomona.stages.report.contract import F32, U8, U32, DetectionColumns, Sightings, packed
from pomona.stages.report.data import ReportData
from pomona.values.detections import Mask

Box = tuple[float, float, float, float]
"""Four numbers in pixels: edges x0, y0, x1, y1 of a detection, or x, y, width, height of a crop."""
# How much larger than the detection a crop is: leaves and neighbours beside the fruit say why it was cut or missed.
_AROUND = 2.0
_LEAST_CROP_PX = 24.0  # fewer pixels are a blur on the page
# An outline may leave out what is less than this off, or less than this share of the detection's size.
_OUTLINE_OFF_PX, _OUTLINE_OFF = 0.6, 0.012


def sightings(data: ReportData, *, crops: Mapping[int, bytes], most: int) -> Sightings:
    """Return which photos saw which fruit: the largest ones of each, as many as make at most `most` together."""
    rows, fruits, photos = sightings_idx(data)
    boxes = _crops_px(data, rows, photos, boxes_by_id(data))
    order = np.lexsort((photos, -boxes[:, 2], fruits))
    rows, fruits, photos, boxes = rows[order], fruits[order], photos[order], boxes[order]
    counts = np.bincount(fruits, minlength=len(data.fruits))
    each = kept_of_each(counts, most)
    kept = places_within(counts) < each
    return _columns(data, rows[kept], np.minimum(counts, each), photos[kept], boxes[kept], crops)


def sightings_of(data: ReportData, fruit_id: int) -> Sightings:
    """Return which photos saw one fruit, the largest detection first."""
    rows, fruits, photos = sightings_idx(data)
    mine = data.fruits.ids[fruits] == fruit_id
    rows, photos = rows[mine], photos[mine]
    boxes = _crops_px(data, rows, photos, boxes_by_id(data, {data.cameras.photos[k] for k in photos}))
    order = np.lexsort((photos, -boxes[:, 2]))
    return _columns(data, rows[order], np.array([len(rows)]), photos[order], boxes[order], {})


def kept_of_each(counts: IntArray, most: int) -> int:
    """Return how many sightings of each fruit are kept so that at most `most` are (but one of each in any case)."""
    kept = int(counts.max(initial=1))
    while kept > 1 and int(np.minimum(counts, kept).sum()) > most:
        kept -= 1
    return kept


def _crops_px(data: ReportData, rows: IntArray, photos: IntArray, boxes: Mapping[int, Box]) -> FloatArray:
    """The crops (k, 4) around observations; where the detection is not known, a twelfth of the photo."""
    xy, ids = data.observations.xy_px[rows].tolist(), data.observations.detection_id[rows].tolist()
    sides = [data.cameras.intrinsics_of(int(k)).width_px / 24 for k in photos]
    edges = [
        boxes.get(id_) or (x - side / 2, y - side / 2, x + side / 2, y + side / 2)
        for id_, (x, y), side in zip(ids, xy, sides, strict=True)
    ]
    return crop_boxes(np.array(edges, float).reshape(-1, 4))


def _columns(
    data: ReportData, rows: IntArray, counts: IntArray, photos: IntArray, boxes: FloatArray, crops: Mapping[int, bytes]
) -> Sightings:
    detections = data.observations.detection_id[rows]
    pictures = [crops.get(id_, b"") for id_ in detections.tolist()]
    return Sightings(
        starts=U32(packed(np.concatenate([[0], np.cumsum(counts)]), "<u4")),
        photos=U32(packed(photos, "<u4")),
        detections=U32(packed(detections, "<u4")),
        boxes=F32(packed(boxes, "<f4")),
        crop_starts=U32(packed(np.cumsum([0, *map(len, pictures)]), "<u4")),
        crops=U8(np.frombuffer(b"".join(pictures), np.uint8)),
    )


def crop_boxes(edges_px: FloatArray) -> FloatArray:
    """Return x, y, width and height (k, 4) of square crops around detections with edges x0, y0, x1, y1 (k, 4)."""
    x0, y0, x1, y1 = edges_px.T
    side = np.ceil(np.maximum(_AROUND * np.maximum(x1 - x0, y1 - y0), _LEAST_CROP_PX))
    return np.stack([np.floor((x0 + x1 - side) / 2), np.floor((y0 + y1 - side) / 2), side, side], axis=1)


def crop_box(edges_px: Box) -> Box:
    """Return x, y, width and height of the square crop around one detection."""
    x, y, width, height = crop_boxes(np.array([edges_px], float))[0].tolist()
    return x, y, width, height


def detection_columns(
    data: ReportData, *, only: Collection[int] | None = None, photos: Collection[str] | None = None
) -> DetectionColumns:
    """Return detections of photos that have a place, with outlines; `only` some ids, or those of some photos."""
    kept = None if only is None else set(only)
    fruit_of = dict(zip(data.observations.detection_id.tolist(), data.observations.fruit_id.tolist(), strict=True))
    rows: list[tuple[int, int, int, float]] = []
    outlines: list[FloatArray] = []
    for k, name in enumerate(data.cameras.photos):
        found = data.masks.get(name) if data.masks is not None and (photos is None or name in photos) else None
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
    off_px = max(_OUTLINE_OFF_PX, _OUTLINE_OFF * max(mask.width_px, mask.height_px))
    few = cv2.approxPolyDP(max(contours, key=len), 2 * off_px, True)[:, 0]
    xy_px: FloatArray = (few + 0.5) / 2 - 1 + np.array([mask.x_px, mask.y_px])
    return xy_px


def each_observation(data: ReportData) -> Iterable[tuple[int, str, int, tuple[float, float]]]:
    """Return fruit id, photo, detection id and place in pixels of each observation."""
    seen = data.observations
    places = [(x, y) for x, y in seen.xy_px.tolist()]
    return zip(seen.fruit_id.tolist(), seen.photo, seen.detection_id.tolist(), places, strict=True)


def boxes_by_id(data: ReportData, photos: Collection[str] | None = None) -> dict[int, Box]:
    """Return the edges x0, y0, x1, y1 of each detection's mask by its id, of all photos or of some."""
    if data.masks is None:
        return {}
    return {
        id_: (float(x0), float(y0), float(x1), float(y1))
        for name in (data.masks if photos is None else photos)
        if (found := data.masks.get(name)) is not None
        for id_, (x0, y0, x1, y1) in zip(found.ids.tolist(), (m.box_px for m in found.masks), strict=True)
    }
