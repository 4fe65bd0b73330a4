"""Fruits on seams: one detection each, whatever the order; touching fruits stay two."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from pomona.stages.segment import (
    SegmentOptions,
    TileDetections,
    Window,
    segment_photo,
    segment_tiled,
    stitch,
    tile_windows,
)
from pomona.stages.segment.box_overlap import non_maximum_suppression, overlapping_pairs, pair_iou
from pomona.values.detections import Mask
from segment_scenes import IdSegmenter, disc, id_image, masks_of
from work import counted


def random_discs(rng: np.random.Generator, count: int, width: int, height: int) -> list[tuple[float, float, float]]:
    return [(*rng.uniform([0, 0], [width, height]), rng.uniform(6, 26)) for _ in range(count)]


@pytest.mark.parametrize("overlap", [1, 4, 16, 64, 110])
@pytest.mark.parametrize("seed", range(2))
def test_every_disc_is_found_once(seed: int, overlap: int) -> None:
    discs = random_discs(np.random.default_rng(seed), 40, 400, 340)
    image = id_image(400, 340, discs)
    truth = masks_of(image)
    found = segment_tiled(image, IdSegmenter(), tile_px=160, min_overlap_px=overlap)
    best = [max(truth.values(), key=lambda t, m=mask: t.iou(m)) for mask in found.masks]
    assert len({id(b) for b in best}) == len(found), "no fruit twice"
    if overlap >= 64:  # every disc is whole in one tile of two: nothing may be lost, and masks are exact
        assert len(found) == len(truth)
        assert min(mask.iou(b) for mask, b in zip(found.masks, best, strict=True)) == 1
    else:  # where a hidden disc shows as slivers on both sides of a seam, a piece of a few pixels may go its own way
        assert len(truth) - 2 <= len(found) <= len(truth)


def test_disc_larger_than_the_overlap_is_joined_whole() -> None:
    image = id_image(300, 200, [(150, 100, 60)])
    found = segment_tiled(image, IdSegmenter(), tile_px=160, min_overlap_px=20)
    assert len(found) == 1
    assert found.masks[0].iou(masks_of(image)[1]) == 1


class WideBoxes(IdSegmenter):
    """Boxes reach 3 pixels beyond the masks, as those of networks that see fruit behind leaves."""

    def segment(self, tiles: Sequence[np.ndarray]) -> list[TileDetections]:
        wide = np.array([-3, -3, 3, 3])
        return [TileDetections(f.boxes_px + wide, f.scores, f.masks) for f in super().segment(tiles)]


def test_boxes_are_the_segmenters_own_joined_and_scaled() -> None:
    discs = [(50, 60, 20), (150, 100, 60)]  # one in a single tile, one across the seam
    found = segment_photo(
        id_image(300, 200, discs),
        WideBoxes(),
        size_px=(600, 400),
        options=SegmentOptions(tile_px=160, min_overlap_px=20),
    )
    expected = [[27, 37, 73, 83], [87, 37, 213, 163]]
    order = np.argsort(found.boxes_px[:, 0])
    np.testing.assert_allclose(found.boxes_px[order], 2 * np.array(expected), atol=2.1)
    for mask, box in zip(found.masks, found.boxes_px, strict=True):
        np.testing.assert_allclose(box - mask.box_px, [-6, -6, 6, 6], atol=2.1)


def test_disc_on_the_corner_of_four_tiles() -> None:
    image = id_image(300, 300, [(150, 150, 45)])
    found = segment_tiled(image, IdSegmenter(), tile_px=160, min_overlap_px=20)
    assert len(found) == 1
    assert found.masks[0].iou(masks_of(image)[1]) == 1


@pytest.mark.parametrize("x", range(120, 180, 7))
@pytest.mark.parametrize("overlap", [4, 20, 60])
def test_touching_discs_on_a_seam_stay_two(x: int, overlap: int) -> None:
    image = id_image(300, 100, [(x - 18.0, 50, 18), (x + 18.0, 52, 18)])
    found = segment_tiled(image, IdSegmenter(), tile_px=160, min_overlap_px=overlap)
    assert len(found) == 2
    truth = list(masks_of(image).values())
    assert all(max(mask.iou(t) for t in truth) == 1 for mask in found.masks)


def test_order_of_tiles_and_detections_does_not_matter() -> None:
    rng = np.random.default_rng(5)
    image = id_image(400, 400, random_discs(rng, 50, 400, 400))
    windows = tile_windows(400, 400, tile_px=150, min_overlap_px=30)
    tiles = [image[w.y_px : w.y_px + w.height_px, w.x_px : w.x_px + w.width_px] for w in windows]
    found = [noisy(d, rng, w) for d, w in zip(IdSegmenter().segment(tiles), windows, strict=True)]
    expected = stitch(windows, found, 400, 400)
    for _ in range(5):
        order = rng.permutation(len(windows))
        mixed = [found[i][rng.permutation(len(found[i]))] for i in order]
        again = stitch([windows[i] for i in order], mixed, 400, 400)
        assert [m.packed for m in again.masks] == [m.packed for m in expected.masks]
        np.testing.assert_array_equal(again.scores, expected.scores)
        np.testing.assert_array_equal(again.boxes_px, expected.boxes_px)


def noisy(found: TileDetections, rng: np.random.Generator, window: Window) -> TileDetections:
    """The detections with other scores, and masks shifted by up to a pixel, as two looks never agree quite."""
    masks = []
    for mask in found.masks:
        dx, dy = rng.integers(-1, 2, 2)
        pixels = np.zeros((window.height_px + 2, window.width_px + 2), bool)
        y, x = mask.y_px + 1 + dy, mask.x_px + 1 + dx
        pixels[y : y + mask.height_px, x : x + mask.width_px] = mask.pixels
        inside = pixels[1:-1, 1:-1]
        masks.append(Mask.from_pixels(inside) if inside.any() else mask)
    boxes = np.array([mask.box_px for mask in masks], float).reshape(-1, 4)
    return TileDetections(boxes, rng.uniform(0.5, 1, len(masks)), tuple(masks))


def test_noisy_looks_at_one_disc_are_one() -> None:
    rng = np.random.default_rng(7)
    discs = [(40.0 * i + 25, 40.0 * j + 25, 19.0) for i in range(9) for j in range(9)]
    image = id_image(400, 400, discs)
    windows = tile_windows(400, 400, tile_px=150, min_overlap_px=50)
    tiles = [image[w.y_px : w.y_px + w.height_px, w.x_px : w.x_px + w.width_px] for w in windows]
    found = [noisy(d, rng, w) for d, w in zip(IdSegmenter().segment(tiles), windows, strict=True)]
    stitched = stitch(windows, found, 400, 400)
    assert len(stitched) == len(discs)
    truth = list(masks_of(image).values())
    assert min(max(mask.iou(t) for t in truth) for mask in stitched.masks) > 0.8


def test_whole_look_wins_over_cut_one_and_score_is_the_best() -> None:
    whole = disc(100, 100, 50, 50, 20)
    left, right = Window(0, 0, 100, 60), Window(0, 20, 100, 80)
    cut = TileDetections(np.zeros((1, 4)), np.array([0.95]), (Mask.from_pixels(whole[:, :60]),))
    full = TileDetections(np.zeros((1, 4)), np.array([0.7]), (Mask.from_pixels(whole[:, 20:]),))
    found = stitch([left, right], [cut, full], 100, 100)
    assert len(found) == 1
    assert found.scores[0] == 0.95
    assert found.masks[0].area_px == whole.sum()


def test_two_of_one_tile_are_never_joined() -> None:
    one, two = disc(64, 64, 30, 32, 16), disc(64, 64, 34, 32, 16)
    both = TileDetections(np.zeros((2, 4)), np.array([0.9, 0.8]), (Mask.from_pixels(one), Mask.from_pixels(two)))
    assert len(stitch([Window(0, 0, 64, 64)], [both], 64, 64)) == 2


def test_nothing_in_nothing_out() -> None:
    assert len(stitch([Window(0, 0, 10, 10)], [TileDetections.empty()], 10, 10)) == 0


def test_hundreds_of_detections_are_stitched_in_no_time() -> None:
    stamp = disc(30, 30, 15, 15, 14)
    truth = [Mask.from_pixels(stamp, 30 * i, 30 * j) for i in range(40) for j in range(25)]
    windows = tile_windows(1200, 750, tile_px=400, min_overlap_px=64)
    found = []
    for w in windows:
        seen = [(m, _seen_by(w, m)) for m in truth]
        masks = tuple(Mask.from_pixels(crop, m.x_px - w.x_px, m.y_px - w.y_px) for m, crop in seen if crop.any())
        found.append(TileDetections(np.zeros((len(masks), 4)), np.full(len(masks), 0.9), masks))
    seen_in_all = sum(map(len, found))
    with counted() as work:
        stitched = stitch(windows, found, 1200, 750)
    assert 1000 < seen_in_all < work.calls < 200 * seen_in_all  # all pairs would be 6 million
    assert 0 < work.peak_mb < 20  # masks as large as the photo would be 2,000
    assert [(m.x_px, m.y_px, m.packed) for m in stitched.masks] == sorted(
        ((m.x_px, m.y_px, m.packed) for m in truth), key=lambda m: (m[1], m[0])
    )


def _seen_by(window: Window, mask: Mask) -> np.ndarray:
    """The mask's crop, without what lies outside a tile."""
    x0, y0, x1, y1 = window.box_px
    columns, rows = np.arange(mask.width_px) + mask.x_px, np.arange(mask.height_px) + mask.y_px
    inside = ((rows >= y0) & (rows < y1))[:, None] & ((columns >= x0) & (columns < x1))
    return mask.pixels & inside


def test_pairs_equal_comparing_each_with_each() -> None:
    rng = np.random.default_rng(0)
    for n, m in ((0, 5), (5, 0), (1, 1), (200, 150)):
        a, b = (
            np.concatenate([p, p + rng.uniform(1, 30, p.shape)], 1)
            for p in (rng.uniform(0, 200, (k, 2)) for k in (n, m))
        )
        share = np.minimum(a[:, None, 2:], b[None, :, 2:]) - np.maximum(a[:, None, :2], b[None, :, :2])
        expected = set(zip(*np.nonzero((share > 0).all(2)), strict=True))
        i, j = overlapping_pairs(a, b)
        assert set(zip(i.tolist(), j.tolist(), strict=True)) == {(int(x), int(y)) for x, y in expected}
        assert len(i) == len(expected)


def test_non_maximum_suppression_equals_the_greedy_loop() -> None:
    rng = np.random.default_rng(1)
    corners = rng.uniform(0, 100, (150, 2))
    boxes, scores = np.concatenate([corners, corners + rng.uniform(10, 30, (150, 2))], 1), rng.uniform(0, 1, 150)
    kept: list[int] = []
    for k in np.argsort(-scores):
        if not kept or (pair_iou(boxes[kept], np.repeat(boxes[[k]], len(kept), 0)) <= 0.4).all():
            kept.append(int(k))
    assert sorted(kept) == np.flatnonzero(non_maximum_suppression(boxes, scores, 0.4)).tolist()
