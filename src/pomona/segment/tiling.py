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
    With `fit`, tiles are only as large as that number of tiles needs (a multiple of 32 where the photo allows it).

    Raises `InputError` when the sizes make no sense.
    """
    if min(width_px, height_px) < 1:
        raise InputError(f"Tiling: expected a photo of at least 1 × 1 pixel, found {width_px} × {height_px}")
    if not 1 <= min_overlap_px < tile_px:
        raise InputError(f"Tiling: expected an overlap of 1 to {tile_px - 1} px, found {min_overlap_px}")
    columns = _spread(width_px, tile_px, min_overlap_px, fit)
    rows = _spread(height_px, tile_px, min_overlap_px, fit)
    return tuple(Window(y, x, height, width) for y, height in rows for x, width in columns)


def _spread(length_px: int, tile_px: int, min_overlap_px: int, fit: bool) -> list[tuple[int, int]]:
    """The start and length of each tile along one side."""
    if length_px <= tile_px:
        return [(0, length_px)]
    count = math.ceil((length_px - min_overlap_px) / (tile_px - min_overlap_px))
    if fit:
        needed = math.ceil((length_px + (count - 1) * min_overlap_px) / count)
        tile_px = min(tile_px, math.ceil(needed / 32) * 32)
    return [(round(i * (length_px - tile_px) / (count - 1)), tile_px) for i in range(count)]
