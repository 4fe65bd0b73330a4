"""From the detections of overlapping tiles to those of the photo: a fruit on a seam is one detection.

Two detections of different tiles are one fruit when they agree where both tiles look. Two of one tile are two fruits:
the segmenter saw both at once. The result does not depend on the order of tiles or detections.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import Array, BoolArray, FloatArray
from pomona.stages.segment.box_overlap import overlapping_pairs, suppress
from pomona.stages.segment.protocol import TileDetections
from pomona.stages.segment.tiling import Window
from pomona.values.detections import Mask

Box = tuple[int, int, int, int]


@dataclass(frozen=True, kw_only=True)
class StitchOptions:
    """When two detections of neighbouring tiles are one fruit.

    `min_iou` is the intersection over union in the zone that both tiles see; `min_share` the intersection over the
    smaller, which counts where a tile's border cut one of the two. A mask is cut when it comes within
    `border_px` of a border of its tile that lies inside the photo. A mask that reaches no further than `sliver_px` into
    its tile from such a border is dropped where another tile sees it with room around: that one knows better.
    """

    min_iou: float = 0.5
    min_share: float = 0.7
    border_px: int = 3
    sliver_px: int = 6


@dataclass(frozen=True, eq=False)
class _Piece:
    """One detection of one tile, in photo pixels; `box_px` is the segmenter's own, which may be wider than the mask."""

    tile: int
    score: float
    mask: Mask
    box_px: FloatArray
    cut: bool

    @property
    def key(self) -> tuple[int, ...]:
        return (*self.mask.box_px[1::-1], self.mask.width_px, self.mask.height_px)


def stitch(
    windows: Sequence[Window],
    detections: Sequence[TileDetections],
    width_px: int,
    height_px: int,
    options: StitchOptions | None = None,
) -> TileDetections:
    """Return the detections of the photo, in photo pixels, ordered from top to bottom.

    `detections[i]` are those of tile `windows[i]`, in tile pixels; masks that leave their tile are an error of the
    segmenter. A joined fruit has the best score of its parts and the box around theirs.
    """
    options = options or StitchOptions()
    assert len(windows) == len(detections)
    tiles = sorted(zip(windows, detections, strict=True), key=lambda tile: tile[0])
    pieces = _pieces(tiles, width_px, height_px, options)
    fruits = [_joined([pieces[i] for i in group]) for group in _groups(tiles, pieces, options)]
    fruits = _without_duplicates(fruits, options.min_share)
    fruits.sort(key=lambda fruit: (*fruit.key, -fruit.score, fruit.mask.packed))
    boxes = np.array([fruit.box_px for fruit in fruits]).reshape(-1, 4)
    return TileDetections(boxes, np.array([fruit.score for fruit in fruits]), tuple(fruit.mask for fruit in fruits))


def _pieces(
    tiles: Sequence[tuple[Window, TileDetections]], width_px: int, height_px: int, options: StitchOptions
) -> list[_Piece]:
    """All detections in photo pixels, slivers dropped, in an order that depends on nothing but themselves."""
    pieces = []
    for index, (window, found) in enumerate(tiles):
        origin = [window.x_px, window.y_px] * 2
        for mask, box, score in zip(found.masks, found.boxes_px, found.scores, strict=True):
            moved = mask.moved(window.x_px, window.y_px)
            x0, y0, x1, y1 = moved.box_px
            assert _holds(window.box_px, moved.box_px), "a segmenter's mask leaves its tile"
            cut = _reaches(moved.box_px, window.box_px, width_px, height_px, options.border_px)
            if cut and _is_sliver(moved.box_px, window.box_px, width_px, height_px, options.sliver_px):
                room = options.sliver_px
                wider = max(x0 - room, 0), max(y0 - room, 0), min(x1 + room, width_px), min(y1 + room, height_px)
                if any(_holds(other.box_px, wider) for other, _ in tiles):
                    continue
            pieces.append(_Piece(index, float(score), moved, box + origin, cut))
    return sorted(pieces, key=lambda p: (p.tile, *p.key, -p.score, p.mask.packed))


def _reaches(box: Box, window: Box, width_px: int, height_px: int, border_px: int) -> bool:
    """Whether a box comes near a border of its tile that lies inside the photo (the photo's edge cuts for good)."""
    return (
        (window[0] > 0 and box[0] < window[0] + border_px)
        or (window[1] > 0 and box[1] < window[1] + border_px)
        or (window[2] < width_px and box[2] > window[2] - border_px)
        or (window[3] < height_px and box[3] > window[3] - border_px)
    )


def _is_sliver(box: Box, window: Box, width_px: int, height_px: int, sliver_px: int) -> bool:
    """Whether a box lies wholly near one border of its tile that is inside the photo."""
    return (
        (window[0] > 0 and box[2] <= window[0] + sliver_px)
        or (window[1] > 0 and box[3] <= window[1] + sliver_px)
        or (window[2] < width_px and box[0] >= window[2] - sliver_px)
        or (window[3] < height_px and box[1] >= window[3] - sliver_px)
    )


def _holds(outer: Box, inner: Box) -> bool:
    return outer[0] <= inner[0] and outer[1] <= inner[1] and outer[2] >= inner[2] and outer[3] >= inner[3]


def _groups(
    tiles: Sequence[tuple[Window, TileDetections]], pieces: Sequence[_Piece], options: StitchOptions
) -> list[list[int]]:
    """Indices of the pieces that are one fruit; at most one of each tile, the most alike joined first."""
    links = sorted(_links(tiles, pieces, options), key=lambda link: (-link[0], link[1], link[2]))
    group_of = list(range(len(pieces)))
    members = [[i] for i in range(len(pieces))]
    for _, i, j in links:
        a, b = group_of[i], group_of[j]
        if a == b or {pieces[k].tile for k in members[a]} & {pieces[k].tile for k in members[b]}:
            continue
        for k in members[b]:
            group_of[k] = a
        members[a] += members[b]
        members[b] = []
    return [group for group in members if group]


def _links(
    tiles: Sequence[tuple[Window, TileDetections]], pieces: Sequence[_Piece], options: StitchOptions
) -> Iterator[tuple[float, int, int]]:
    """(likeness, i, j) of pieces of different tiles that are one fruit."""
    tile_of = np.array([piece.tile for piece in pieces], np.int64)
    first = np.searchsorted(tile_of, np.arange(len(tiles) + 1))
    boxes = np.array([piece.mask.box_px for piece in pieces], float).reshape(-1, 4)
    windows = np.array([window.box_px for window, _ in tiles], float).reshape(-1, 4)
    for a, b in zip(*overlapping_pairs(windows, windows), strict=True):
        zone = _box_intersection(tiles[a][0].box_px, tiles[b][0].box_px) if a < b else None
        if zone is None:
            continue
        in_a, in_b = (first[t] + np.flatnonzero(_meets(boxes[first[t] : first[t + 1]], zone)) for t in (a, b))
        for i, j in zip(*overlapping_pairs(boxes[in_a], boxes[in_b]), strict=True):
            likeness = _likeness(pieces[in_a[i]], pieces[in_b[j]], zone, options)
            if likeness > 0:
                yield likeness, int(in_a[i]), int(in_b[j])


def _meets(boxes: FloatArray, zone: Box) -> BoolArray:
    x0, y0, x1, y1 = zone
    meets = (boxes[:, 0] < x1) & (boxes[:, 2] > x0) & (boxes[:, 1] < y1) & (boxes[:, 3] > y0)
    return np.asarray(meets, bool)


def _likeness(a: _Piece, b: _Piece, zone: Box, options: StitchOptions) -> float:
    """How alike two pieces are where both tiles look, in (0, 1]; 0 where they are different fruits."""
    both = _box_intersection(a.mask.box_px, b.mask.box_px)
    if both is None:
        return 0.0
    shared = _pixels(a.mask, both) & _pixels(b.mask, both)
    intersection = int(shared.sum())
    if intersection == 0:
        return 0.0
    in_a, in_b = _area_in(a.mask, zone), _area_in(b.mask, zone)
    iou = intersection / (in_a + in_b - intersection)
    share = intersection / min(in_a, in_b)
    same = iou >= options.min_iou or (share >= options.min_share and (a.cut or b.cut))
    return iou if same else 0.0


def _joined(group: Sequence[_Piece]) -> _Piece:
    """One piece for a fruit: the best whole one where a tile saw it whole, else all parts together."""
    score = max(piece.score for piece in group)
    whole = [piece for piece in group if not piece.cut]
    if whole or len(group) == 1:
        best = max(whole or group, key=lambda piece: (piece.score, piece.mask.area_px, piece.key))
        return _Piece(best.tile, score, best.mask, best.box_px, best.cut)
    x0, y0, x1, y1 = (int(v) for v in _hull(np.array([piece.mask.box_px for piece in group])))
    pixels = np.zeros((y1 - y0, x1 - x0), bool)
    for piece in group:
        left, top, right, bottom = piece.mask.box_px
        pixels[top - y0 : bottom - y0, left - x0 : right - x0] |= piece.mask.pixels
    # No tile saw it whole: tile -1 is that of none, so that duplicates of it are looked for everywhere.
    box = _hull(np.array([piece.box_px for piece in group]))
    return _Piece(-1, score, Mask.from_pixels(pixels, x0, y0), box, cut=True)


def _hull(boxes: Array) -> Array:
    return np.concatenate([boxes[:, :2].min(0), boxes[:, 2:].max(0)])


def _without_duplicates(fruits: list[_Piece], min_share: float) -> list[_Piece]:
    """Drop what lies mostly inside a better fruit that another tile saw."""
    boxes = np.array([fruit.mask.box_px for fruit in fruits], float).reshape(-1, 4)
    order = sorted(range(len(fruits)), key=lambda k: (-fruits[k].score, fruits[k].key, fruits[k].mask.packed))
    rank = np.empty(len(fruits), np.int64)
    rank[order] = np.arange(len(fruits))
    better, worse = [], []
    for i, j in zip(*overlapping_pairs(boxes, boxes), strict=True):
        a, b = fruits[i], fruits[j]
        if rank[i] < rank[j] and (a.tile != b.tile or a.tile < 0):
            smaller = min(a.mask.area_px, b.mask.area_px)
            if a.mask.intersection_px(b.mask) >= min_share * smaller:
                better.append(i)
                worse.append(j)
    keep = suppress(np.array(better, np.int64), np.array(worse, np.int64), rank)
    return [fruit for fruit, kept in zip(fruits, keep, strict=True) if kept]


def _pixels(mask: Mask, box: Box) -> BoolArray:
    """The mask's pixels in a box that lies inside its crop."""
    x0, y0, x1, y1 = box
    return mask.pixels[y0 - mask.y_px : y1 - mask.y_px, x0 - mask.x_px : x1 - mask.x_px]


def _area_in(mask: Mask, zone: Box) -> int:
    inside = _box_intersection(mask.box_px, zone)
    return 0 if inside is None else int(_pixels(mask, inside).sum())


def _box_intersection(a: Box, b: Box) -> Box | None:
    x0, y0, x1, y1 = max(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), min(a[3], b[3])
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else None
