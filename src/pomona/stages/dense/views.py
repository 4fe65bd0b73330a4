"""Photos as stereo needs them: at working scale, without lens distortion, with the detections painted in."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pomona.basics.arrays import Array, ByteArray, FloatArray
from pomona.values.detections import Detections
from pomona.values.intrinsics import Intrinsics, opencv_from_colmap_px
from pomona.values.label_image import paint_labels


@dataclass(frozen=True, eq=False)
class View:
    """One photo, undistorted, at working scale.

    `rgb` (h, w, 3) and `label` (h, w) uint16: 0 for none, else 1 + the detection's index in its photo. `matrix` (3, 3)
    is K in OpenCV's pixel convention; `cam_from_world` (3, 4).
    """

    photo_idx: int
    rgb: ByteArray
    label: Array
    matrix: FloatArray
    cam_from_world: FloatArray

    @property
    def gray_and_mask(self) -> ByteArray:
        """(h, w, 2): brightness, and 255 where a detection is; one array, so that both are warped at once."""
        gray = cv2.cvtColor(self.rgb, cv2.COLOR_RGB2GRAY)
        return np.dstack([gray, (self.label > 0).astype(np.uint8) * 255])

    def halved(self) -> View:
        """Return the view at half its scale (each pixel the mean of a block of 2 × 2)."""
        height, width = self.label.shape[0] // 2, self.label.shape[1] // 2
        matrix = self.matrix.copy()
        matrix[:2] *= 0.5
        matrix[:2, 2] -= 0.25  # OpenCV's pixel centres: block (0, 1) has its centre at 0.5 in the finer pixels
        rgb = cv2.resize(self.rgb[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA)
        return View(self.photo_idx, rgb, self.label[0 : 2 * height : 2, 0 : 2 * width : 2], matrix, self.cam_from_world)


def make_view(
    photo_idx: int, rgb: ByteArray, detections: Detections, intrinsics: Intrinsics, cam_from_world: FloatArray
) -> View:
    """Make a view from pixels (h, w, 3) at working scale; detections and intrinsics are those of the full photo."""
    height, width = rgb.shape[:2]
    scale_xy = np.array([width / intrinsics.width_px, height / intrinsics.height_px])
    matrix = intrinsics.matrix.copy()
    matrix[:2] *= scale_xy[:, None]
    matrix[:2, 2] = opencv_from_colmap_px(matrix[:2, 2])
    label = paint_labels(detections, width, height)
    if np.any(intrinsics.distortion):
        # The same K before and after: the borders that the lens pushed out of the photo are left to other photos.
        maps = cv2.initUndistortRectifyMap(matrix, intrinsics.distortion, None, matrix, (width, height), cv2.CV_32FC1)
        rgb = cv2.remap(rgb, *maps, interpolation=cv2.INTER_LINEAR)
        label = cv2.remap(label, *maps, interpolation=cv2.INTER_NEAREST, borderValue=0)
    return View(photo_idx, np.ascontiguousarray(rgb), label, matrix, cam_from_world)
