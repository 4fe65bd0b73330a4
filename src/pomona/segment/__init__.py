"""Fruits in photos: tiling, a segmenter, detections stitched across seams and mapped to the photo."""

from pomona.segment.load import load_segmenter
from pomona.segment.photo_detections import SegmentOptions, iter_detections, scales_of, segment_photo, segment_photos
from pomona.segment.protocol import Segmenter, SegmenterTraits, TileDetections
from pomona.segment.reading_scale import ReadingScales
from pomona.segment.stitch import StitchOptions, stitch
from pomona.segment.tiled_image import segment_tiled
from pomona.segment.tiling import Window, tile_windows

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
