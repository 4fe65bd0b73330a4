"""The photos of a survey: from folders or a video, with what EXIF says of them; and their pixels, upright."""

from pomona.stages.capture.images import read_grey, read_pixels
from pomona.stages.capture.keyframes import KeyFrameOptions
from pomona.stages.capture.load import load_photos

__all__ = ["KeyFrameOptions", "load_photos", "read_grey", "read_pixels"]
