"""Covering a photo with overlapping tiles: the paper's rule (section 2.2.1), for every size."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pomona.errors import InputError


@dataclass(frozen=True, order=True)
class Window:
    """A rectangle of a photo: `x_px`, `y_px` are the column and row of its top-left pixel."""

    y_px: int
    x_px: int
    height_px: int
    width_px: int

    @property
    def box_px(self) -> tuple[int, int, int, int]:
        """(x0, y0, x1, y1), the edges."""
        return self.x_px, self.y_px, self.x_px + self.width_px, self.y_px + self.height_px


def tile_windows(
    width_px: int, height_px: int, *, tile_px: int = 1024, min_overlap_px: int = 128, fit: bool = False
) -> tuple[Window, ...]:
    """Return the tiles of a photo, row by row.

    As few tiles as overlap by at least `min_overlap_px`, spread evenly from edge to edge: a photo of 5184 × 3456 gives
    the paper's 6 × 4 tiles of 1024, 192 px and 213 px of overlap. A side shorter than a tile is one tile of its length.
    With `fit`, tiles have at most as many pixels as a square of `tile_px`, in whatever shape covers the photo with the
    fewest pixels, and are only as large as that needs (multiples of 32 where that allows it).

    Raises `InputError` when the sizes make no sense.
    """
    if min(width_px, height_px) < 1:
        raise InputError(f"Tiling: expected a photo of at least 1 × 1 pixel, found {width_px} × {height_px}")
    if not 1 <= min_overlap_px < tile_px:
        raise InputError(f"Tiling: expected an overlap of 1 to {tile_px - 1} px, found {min_overlap_px}")
    if fit:
        columns, rows = _fitted(width_px, height_px, tile_px, min_overlap_px)
    else:
        columns, rows = (_spread(side, tile_px, min_overlap_px) for side in (width_px, height_px))
    return tuple(Window(y, x, height, width) for y, height in rows for x, width in columns)


_Spans = list[tuple[int, int]]  # start and length of each tile along one side


def _spread(length_px: int, tile_px: int, min_overlap_px: int) -> _Spans:
    if length_px <= tile_px:
        return [(0, length_px)]
    return _evenly(length_px, math.ceil((length_px - min_overlap_px) / (tile_px - min_overlap_px)), tile_px)


def _evenly(length_px: int, count: int, tile_px: int) -> _Spans:
    return [(round(i * (length_px - tile_px) / max(count - 1, 1)), tile_px) for i in range(count)]


def _fitted(width_px: int, height_px: int, tile_px: int, min_overlap_px: int) -> tuple[_Spans, _Spans]:
    """Return the columns and rows of the grid that has the fewest pixels, counting twice what tiles share."""

    def side_of(length_px: int, count: int) -> int:
        needed = math.ceil((length_px + (count - 1) * min_overlap_px) / count)
        return min(length_px, max(needed, min(math.ceil(needed / 32) * 32, tile_px)))

    # A grid of square tiles would do; one of twice as many columns or rows hardly has fewer pixels.
    most_columns, most_rows = (2 * len(_spread(side, tile_px, min_overlap_px)) for side in (width_px, height_px))
    grids = [
        (columns * rows * width * height, columns * rows, columns, rows, width, height)
        for columns in range(1, most_columns + 1)
        for rows in range(1, most_rows + 1)
        if (width := side_of(width_px, columns)) * (height := side_of(height_px, rows)) <= tile_px**2
    ]
    *_, columns, rows, width, height = min(grids)
    return _evenly(width_px, columns, width), _evenly(height_px, rows, height)
