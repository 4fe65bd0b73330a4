"""Tiles: the paper's 6 × 4, and the general rule."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pomona.errors import InputError
from pomona.stages.segment import Window, tile_windows


def test_paper_tiles() -> None:
    windows = tile_windows(5184, 3456, tile_px=1024)
    assert len(windows) == 24
    xs, ys = sorted({w.x_px for w in windows}), sorted({w.y_px for w in windows})
    assert all((w.width_px, w.height_px) == (1024, 1024) for w in windows)
    assert (1024 - np.diff(xs)).tolist() == [192] * 5
    assert (1024 - np.diff(ys)).tolist() == [213, 214, 213]
    assert windows[1].x_px == 832
    assert windows[1].y_px == 0


@pytest.mark.parametrize(("width", "height"), [(1, 1), (500, 300), (1024, 1024), (32, 1024)])
def test_small_photo_is_one_tile(width: int, height: int) -> None:
    assert tile_windows(width, height) == (Window(0, 0, height, width),)


@settings(max_examples=40, deadline=None)
@given(
    width=st.integers(1, 3000),
    height=st.integers(1, 3000),
    tile=st.integers(40, 700),
    share=st.floats(0, 0.9),
    fit=st.booleans(),
)
def test_tiles_cover_evenly(width: int, height: int, tile: int, share: float, fit: bool) -> None:
    overlap = max(1, int(share * tile))
    windows = tile_windows(width, height, tile_px=tile, min_overlap_px=overlap, fit=fit)
    for length, spans in (
        (width, sorted({(w.x_px, w.width_px) for w in windows})),
        (height, sorted({(w.y_px, w.height_px) for w in windows})),
    ):
        starts, sizes = np.array(spans).T
        assert starts[0] == 0
        assert starts[-1] + sizes[-1] == length
        overlaps = starts[:-1] + sizes[:-1] - starts[1:]
        assert (overlaps >= overlap - 1).all(), "rounding of starts takes a pixel at most"
        assert len(overlaps) == 0 or np.ptp(overlaps) <= 1
        if not fit:
            assert (sizes <= tile).all()
            # One tile less would not do.
            assert len(starts) == 1 or (len(starts) - 1) * (tile - overlap) + overlap < length
    if fit:
        squares = tile_windows(width, height, tile_px=tile, min_overlap_px=overlap)
        assert all(w.width_px * w.height_px <= tile**2 for w in windows)
        assert pixels_of(windows) <= pixels_of(squares)


def pixels_of(windows: tuple[Window, ...]) -> int:
    return sum(w.width_px * w.height_px for w in windows)


def test_fitted_tiles_waste_little() -> None:
    windows = tile_windows(2074, 1382, tile_px=1280, min_overlap_px=96, fit=True)
    assert len(windows) == 2
    assert {(w.width_px, w.height_px) for w in windows} == {(1088, 1382)}
    assert tile_windows(968, 1452, tile_px=1280, min_overlap_px=96, fit=True) == (Window(0, 0, 1452, 968),)


@pytest.mark.parametrize(("tile", "overlap"), [(100, 100), (100, 0), (1, 1), (100, 120)])
def test_senseless_sizes(tile: int, overlap: int) -> None:
    with pytest.raises(InputError, match="overlap"):
        tile_windows(500, 500, tile_px=tile, min_overlap_px=overlap)
