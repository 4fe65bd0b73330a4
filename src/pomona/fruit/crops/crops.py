"""Crops of photos around places, in which fruits of different distances are equally wide."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray, set_checked

# A photo is made smaller by halves before it is cut where a crop's pixel would be wider than this in the photo's.
_COARSE = 1.7


@dataclass(frozen=True, eq=False)
class CropPlaces:
    """n square crops of one photo: `centers_px` (n, 2) in the photo, `scales` (n,) from its pixels to the crops'."""

    centers_px: FloatArray
    scales: FloatArray

    def __post_init__(self) -> None:
        n = len(self.scales)
        set_checked(self, "centers_px", (n, 2), np.float64)
        set_checked(self, "scales", (n,), np.float64)

    def __len__(self) -> int:
        return len(self.scales)

    def in_crop(self, idx: int, xy_px: FloatArray, side_px: int) -> FloatArray:
        """Return points (m, 2) of the photo in the pixels of one crop."""
        result: FloatArray = (xy_px - self.centers_px[idx]) * self.scales[idx] + side_px / 2
        return result


def cut(pixels: ByteArray, places: CropPlaces, side_px: int, photo_width_px: int) -> ByteArray:
    """Return the crops (n, side, side, channels) of a photo; black where they reach beyond it.

    `pixels` (h, w, channels) is the photo at any scale, `photo_width_px` its full width, in whose pixels `places` are.
    """
    levels = [pixels]
    crops = np.zeros((len(places), side_px, side_px, pixels.shape[2]), np.uint8)
    for k in range(len(places)):
        level = 0
        while (
            places.scales[k] * photo_width_px / levels[level].shape[1] < 1 / _COARSE
            and min(levels[level].shape[:2]) > 1
        ):
            level += 1
            if level == len(levels):
                half = max(1, levels[-1].shape[1] // 2), max(1, levels[-1].shape[0] // 2)
                levels.append(np.asarray(cv2.resize(levels[-1], half, interpolation=cv2.INTER_AREA), np.uint8))
        shrunk = levels[level].shape[1] / photo_width_px
        scale = places.scales[k] / shrunk
        # OpenCV counts pixels from their centres: pixel i of an image is i + 0.5 of ours.
        shift = side_px / 2 - 0.5 - scale * (places.centers_px[k] * shrunk - 0.5)
        matrix = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
        cv2.warpAffine(levels[level], matrix, (side_px, side_px), dst=crops[k], flags=cv2.INTER_LINEAR)
    return crops
