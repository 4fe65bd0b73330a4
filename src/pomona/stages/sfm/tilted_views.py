"""Features of a photo as it is and as it would look tilted: affine-covariant ones, for photos that are far apart.

A leaf seen from elsewhere is a leaf foreshortened. SIFT bears little of that; a photo compressed beforehand in many
directions has features that look as they do from there. Source: Yu and Morel 2011 (ASIFT), as OpenCV has it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pomona.basics.arrays import Array, ByteArray, set_checked
from pomona.stages.capture.images import read_pixels
from pomona.stages.sfm.epipolar import DescribedPoints
from pomona.stages.sfm.features import colours_at, in_fixed_order, sift, working_scale
from pomona.stages.sfm.options import SfmOptions
from pomona.values.photos import Photo

# Photos are no larger for this: eighteen views take eighteen times as long.
_MAX_SIDE_PX = 864
# Compressed up to 2.8 times, in directions that are 72° apart divided by the tilt: section 3.2 of the source.
_TILTS = (1.0, 2**0.5, 2.0, 2 * 2**0.5)
_STEP_DEG = 72.0
_FEATURES_OF_A_VIEW = 2500


@dataclass(frozen=True, eq=False)
class TiltedFeatures:
    """n features in working pixels: of the photo as it is, then of views that are tilted more and more.

    `keypoints` (n, 4) float32: x, y, scale (px), direction (rad). `descriptors` (n, 128) uint8. `rgb` (n, 3).
    """

    keypoints: Array
    descriptors: ByteArray
    rgb: ByteArray

    def __post_init__(self) -> None:
        set_checked(self, "keypoints", (None, 4), np.float32)
        set_checked(self, "descriptors", (len(self.keypoints), 128), np.uint8)
        set_checked(self, "rgb", (len(self.keypoints), 3), np.uint8)

    @property
    def points(self) -> DescribedPoints:
        """All of them as points to match."""
        return DescribedPoints(self.keypoints[:, :2].astype(float), self.descriptors)


def views() -> list[tuple[float, float]]:
    """Return tilts and directions (degrees) of the views, the photo as it is first."""
    return [(tilt, turn) for tilt in _TILTS for turn in ([0.0] if tilt == 1 else np.arange(0, 180, _STEP_DEG / tilt))]


def tilted_features(photo: Photo, options: SfmOptions) -> TiltedFeatures:
    """Find the features of all views of a photo.

    Raises `InputError` or `MissingFileError` when the photo cannot be read.
    """
    pixels = read_pixels(photo, max_side_px=min(_MAX_SIDE_PX, options.max_side_px))
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    tilting = cv2.AffineFeature_create(sift(_FEATURES_OF_A_VIEW, options))  # type: ignore[attr-defined]
    found = []
    for tilt, turn in views():
        tilting.setViewParams([tilt], [turn])
        found.append(in_fixed_order(*tilting.detectAndCompute(grey, None)))
    keypoints = np.concatenate([geometry for geometry, _ in found])
    descriptors = np.concatenate([of_view for _, of_view in found])
    rgb = colours_at(pixels, keypoints[:, :2])
    working = working_scale(photo, options) * np.array([photo.width_px, photo.height_px])
    exact = working / grey.shape[::-1]
    keypoints[:, :2] = (keypoints[:, :2] + 0.5) * exact
    keypoints[:, 2] *= exact.mean()
    return TiltedFeatures(keypoints.astype(np.float32), descriptors, rgb)
