"""One image through a segmenter: tiles, detections, stitched."""

from __future__ import annotations

from pomona.basics.arrays import ByteArray
from pomona.stages.segment.protocol import Segmenter, TileDetections
from pomona.stages.segment.stitch import stitch
from pomona.stages.segment.tiling import tile_windows


def segment_tiled(
    pixels: ByteArray,
    segmenter: Segmenter,
    *,
    score_threshold: float | None = None,
    tile_px: int | None = None,
    min_overlap_px: int | None = None,
) -> TileDetections:
    """Return the detections of an image, uint8 (H, W, 3) RGB, in its pixels, ordered from top to bottom.

    What is not given is the segmenter's own wish. Tiles go through the segmenter one at a time: memory is bounded by
    the image and one tile.
    """
    traits = segmenter.traits
    height, width = pixels.shape[:2]
    tile_px = traits.tile_px if tile_px is None else tile_px
    if min_overlap_px is None:
        min_overlap_px = min(traits.min_overlap_px, tile_px // 2)
    windows = tile_windows(width, height, tile_px=tile_px, min_overlap_px=min_overlap_px, fit=traits.fits_tiles)
    threshold = traits.score_threshold if score_threshold is None else score_threshold
    found = []
    for window in windows:
        x0, y0, x1, y1 = window.box_px
        (detections,) = segmenter.segment([pixels[y0:y1, x0:x1]])
        found.append(detections[detections.scores >= threshold])
    return stitch(windows, found, width, height)
