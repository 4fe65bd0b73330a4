"""Fruits in photos: tiling, a segmenter, detections stitched across seams and mapped to the photo."""

from pomona.stages.segment.load import load_segmenter
from pomona.stages.segment.photo_detections import (
    SegmentOptions,
    iter_detections,
    scales_of,
    segment_photo,
    segment_photos,
)
from pomona.stages.segment.protocol import Segmenter, SegmenterTraits, TileDetections
from pomona.stages.segment.reading_scale import ReadingScales
from pomona.stages.segment.stitch import StitchOptions, stitch
from pomona.stages.segment.tiled_image import segment_tiled
from pomona.stages.segment.tiling import Window, tile_windows

__all__ = [
    "ReadingScales",
    "SegmentOptions",
    "Segmenter",
    "SegmenterTraits",
    "StitchOptions",
    "TileDetections",
    "Window",
    "iter_detections",
    "load_segmenter",
    "scales_of",
    "segment_photo",
    "segment_photos",
    "segment_tiled",
    "stitch",
    "tile_windows",
]
