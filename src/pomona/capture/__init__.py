"""The photos of a survey: from folders or a video, with what EXIF says of them; and their pixels, upright."""

from pomona.capture.images import read_grey, read_pixels
from pomona.capture.keyframes import KeyFrameOptions
from pomona.capture.load import load_photos

__all__ = ["KeyFrameOptions", "load_photos", "read_grey", "read_pixels"]
