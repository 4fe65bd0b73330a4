"""The lens of a camera: a COLMAP model, its projection and the way back, in COLMAP's pixels.

The centre of the top-left pixel is (0.5, 0.5); `opencv_from_colmap_px` is the one place that converts to OpenCV's
convention, where it is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray, set_checked
from pomona.errors import InputError

# COLMAP's perspective models, and where each parameter goes in OpenCV's (fx, fy, cx, cy, k1, k2, p1, p2, k3..k6).
_OPENCV_SLOTS: dict[str, tuple[tuple[int, ...], ...]] = {
    "SIMPLE_PINHOLE": ((0, 1), (2,), (3,)),
    "PINHOLE": ((0,), (1,), (2,), (3,)),
    "SIMPLE_RADIAL": ((0, 1), (2,), (3,), (4,)),
    "RADIAL": ((0, 1), (2,), (3,), (4,), (5,)),
    "OPENCV": ((0,), (1,), (2,), (3,), (4,), (5,), (6,), (7,)),
    "FULL_OPENCV": ((0,), (1,), (2,), (3,), (4,), (5,), (6,), (7,), (8,), (9,), (10,), (11,)),
}

# Lenses of ordinary cameras have converged long before; Newton's steps are for what is left at the rim of wide ones.
_FIXED_POINT_STEPS, _NEWTON_STEPS = 20, 8
# Where a lens model folds, pixels have no angle any more: they are taken to be no wider than so many in the middle.
_WIDEST_PIXEL = 10.0
# The distance at z = 1 at which inverting the distortion stops: less than a ten-thousandth of a pixel of any photo.
_CONVERGED = 1e-9


def opencv_from_colmap_px(xy_px: FloatArray) -> FloatArray:
    """Convert pixel coordinates from COLMAP's convention to OpenCV's (subtract half a pixel)."""
    return np.asarray(xy_px) - 0.5


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A perspective camera with lens distortion: a COLMAP model name and its parameters, in pixels."""

    model: str
    width_px: int
    height_px: int
    params: FloatArray

    def __post_init__(self) -> None:
        if self.model not in _OPENCV_SLOTS:
            raise InputError(f"Camera model {self.model} is not supported; expected one of {', '.join(_OPENCV_SLOTS)}")
        set_checked(self, "params", (len(_OPENCV_SLOTS[self.model]),), np.float64)

    @property
    def opencv_params(self) -> FloatArray:
        """(12,): fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6; the principal point in COLMAP's convention."""
        full = np.zeros(12)
        for value, slots in zip(self.params, _OPENCV_SLOTS[self.model], strict=True):
            full[list(slots)] = value
        return full

    @property
    def focal_px(self) -> float:
        """The mean of fx and fy."""
        return float(self.opencv_params[:2].mean())

    @property
    def focal_idx(self) -> tuple[int, ...]:
        """Which of `params` are focal lengths."""
        return tuple(i for i, slots in enumerate(_OPENCV_SLOTS[self.model]) if min(slots) < 2)

    @property
    def distortion_idx(self) -> tuple[int, ...]:
        """Which of `params` are distortion."""
        return tuple(i for i, slots in enumerate(_OPENCV_SLOTS[self.model]) if min(slots) > 3)

    @property
    def matrix(self) -> FloatArray:
        """K (3, 3), the paper's equation 2, principal point in COLMAP's convention."""
        fx, fy, cx, cy = self.opencv_params[:4]
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])

    @property
    def distortion(self) -> FloatArray:
        """(8,): k1, k2, p1, p2, k3, k4, k5, k6, in OpenCV's order."""
        return self.opencv_params[4:]

    def px_from_cam(self, points_in_cam: FloatArray) -> FloatArray:
        """Project points (n, 3) in camera axes to pixels (n, 2); NaN for points not in front of the camera."""
        fx, fy, cx, cy = self.opencv_params[:4]
        points_in_cam = np.asarray(points_in_cam, float)
        depth = np.where(points_in_cam[:, 2] > 0, points_in_cam[:, 2], np.nan)
        x, y = self._distorted(points_in_cam[:, 0] / depth, points_in_cam[:, 1] / depth)
        return np.stack([fx * x + cx, fy * y + cy], axis=1)

    def px_slopes(self, points_in_cam: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of `px_from_cam` by the points (n, 2, 3) and by the p `params` (n, 2, p).

        NaN for points not in front of the camera.
        """
        fx, fy = self.opencv_params[:2]
        depth = np.where(points_in_cam[:, 2] > 0, points_in_cam[:, 2], np.nan)
        x, y = points_in_cam[:, 0] / depth, points_in_cam[:, 1] / depth
        xx, xy, yy = self._slopes(x, y)
        of_x = np.stack([xx, xy, -xx * x - xy * y], axis=1) * (fx / depth)[:, None]
        of_y = np.stack([xy, yy, -xy * x - yy * y], axis=1) * (fy / depth)[:, None]
        by_opencv = self._slopes_by_opencv_params(x, y)
        by_params = np.stack([by_opencv[:, :, slots].sum(2) for slots in _OPENCV_SLOTS[self.model]], axis=2)
        return np.stack([of_x, of_y], axis=1), by_params

    def cam_from_px(self, xy_px: FloatArray) -> FloatArray:
        """Return for pixels (n, 2) the undistorted rays (n, 3) in camera axes with z = 1.

        Distortion is inverted by fixed-point iteration, as in OpenCV's `undistortPoints`; where that is slow, as at the
        rim of wide lenses, Newton's steps follow.
        """
        fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 = self.opencv_params
        xy_px = np.asarray(xy_px, float)
        x_distorted, y_distorted = (xy_px[:, 0] - cx) / fx, (xy_px[:, 1] - cy) / fy
        x, y = x_distorted, y_distorted
        if np.any(self.distortion):
            for _ in range(_FIXED_POINT_STEPS):
                r2 = x * x + y * y
                radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
                x, y = (
                    (x_distorted - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial,
                    (y_distorted - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial,
                )
            for _ in range(_NEWTON_STEPS):
                x, y, done = self._newton_step(x, y, x_distorted, y_distorted)
                if done:
                    break
        return np.stack([x, y, np.ones_like(x)], axis=1)

    def px_angles(self, xy_px: FloatArray) -> FloatArray:
        """Return the angle (n,), in radians, that a pixel at pixels (n, 2) is wide: the root of its solid angle.

        In the middle it is 1 / `focal_px`; towards the edge of a picture perspective makes it narrower, and barrel
        distortion wider.
        """
        rays = self.cam_from_px(xy_px)
        least = self.opencv_params[:2].prod() / _WIDEST_PIXEL**2
        return np.asarray((np.maximum(self.areas_px2(rays), least) * np.linalg.norm(rays, axis=1) ** 3) ** -0.5)

    def areas_px2(self, points_in_cam: FloatArray) -> FloatArray:
        """Return on how many pixels (n,) a square of side 1 across the camera's axis is seen at points (n, 3).

        NaN for points not in front of the camera.
        """
        fx, fy = self.opencv_params[:2]
        depth = np.where(points_in_cam[:, 2] > 0, points_in_cam[:, 2], np.nan)
        xx, xy, yy = self._slopes(points_in_cam[:, 0] / depth, points_in_cam[:, 1] / depth)
        x_px, y_px = fx / depth, fy / depth
        return np.asarray(np.abs(xx * x_px * (yy * y_px) - xy * x_px * (xy * y_px)))

    def _distorted(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where undistorted x and y (n,) are seen, at z = 1.

        Source: OpenCV's rational distortion model, which contains COLMAP's perspective models.
        """
        k1, k2, p1, p2, k3, k4, k5, k6 = self.distortion
        r2 = x * x + y * y
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        x_distorted = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        y_distorted = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return x_distorted, y_distorted

    def _newton_step(
        self, x: FloatArray, y: FloatArray, x_distorted: FloatArray, y_distorted: FloatArray
    ) -> tuple[FloatArray, FloatArray, bool]:
        """x and y (n,) a step nearer to what is seen at x and y distorted, and whether there is no more to gain."""
        x_seen, y_seen = self._distorted(x, y)
        x_off, y_off = x_seen - x_distorted, y_seen - y_distorted
        off = np.abs(x_off) + np.abs(y_off)
        if not off.max(initial=0) > _CONVERGED:
            return x, y, True
        xx, xy, yy = self._slopes(x, y)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            x_new = x - (yy * x_off - xy * y_off) / (xx * yy - xy * xy)
            y_new = y - (xx * y_off - xy * x_off) / (xx * yy - xy * xy)
            x_seen, y_seen = self._distorted(x_new, y_new)
            nearer = np.abs(x_seen - x_distorted) + np.abs(y_seen - y_distorted) < off
        return np.where(nearer, x_new, x), np.where(nearer, y_new, y), not nearer.any()

    def _slopes(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The derivatives (n,) of `_distorted`: of x by x, of x by y (which is that of y by x), and of y by y."""
        k1, k2, p1, p2, k3, k4, k5, k6 = self.distortion
        r2 = x * x + y * y
        above, below = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        above_slope, below_slope = k1 + r2 * (2 * k2 + 3 * k3 * r2), k4 + r2 * (2 * k5 + 3 * k6 * r2)
        radial, slope = above / below, (above_slope * below - above * below_slope) / below**2
        xx = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        yy = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        return xx, 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y, yy

    def _slopes_by_opencv_params(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """The derivatives (n, 2, 12) of pixels by `opencv_params`, seen at undistorted x and y (n,)."""
        fx, fy, _, _, k1, k2, _, _, k3, k4, k5, k6 = self.opencv_params
        found = np.zeros((len(x), 2, 12))
        found[:, 0, 0], found[:, 1, 1] = self._distorted(x, y)
        found[:, 0, 2] = found[:, 1, 3] = 1.0
        r2 = x * x + y * y
        below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / below
        outwards = np.stack([fx * x, fy * y], axis=1) / below[:, None]
        for power, (above_slot, below_slot) in enumerate(((4, 9), (5, 10), (8, 11)), start=1):
            found[:, :, above_slot] = outwards * (r2**power)[:, None]
            found[:, :, below_slot] = -found[:, :, above_slot] * radial[:, None]
        found[:, :, 6] = np.stack([fx * 2 * x * y, fy * (r2 + 2 * y * y)], axis=1)
        found[:, :, 7] = np.stack([fx * (r2 + 2 * x * x), fy * 2 * x * y], axis=1)
        return found

    def turned(self, quarters: int) -> Intrinsics:
        """Return the intrinsics of the same photo turned clockwise by that many quarters of a full turn."""
        if quarters % 4 == 0:
            return self
        fx, fy, cx, cy, k1, k2, p1, p2, *rest = self.opencv_params
        full = [fy, fx, self.height_px - cy, cx, k1, k2, p2, -p1, *rest]
        params = np.array([full[slots[0]] for slots in _OPENCV_SLOTS[self.model]])
        return Intrinsics(self.model, self.height_px, self.width_px, params).turned(quarters % 4 - 1)

    def scaled(self, factor: float) -> Intrinsics:
        """Return the intrinsics of the same photo resized by `factor`."""
        params = self.params.copy()
        params[[i for i, s in enumerate(_OPENCV_SLOTS[self.model]) if min(s) < 4]] *= factor
        return Intrinsics(self.model, round(self.width_px * factor), round(self.height_px * factor), params)
