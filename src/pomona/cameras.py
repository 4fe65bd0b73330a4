"""Cameras: intrinsics, poses, sparse points, and the frame they are in.

Camera axes are OpenCV's (x right, y down, z forward); pixels are COLMAP's: the centre of the top-left pixel is
(0.5, 0.5). `opencv_from_colmap_px` is the one place that converts to OpenCV's convention, where it is (0, 0).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from pomona.arrays import ByteArray, FloatArray, IntArray, set_checked
from pomona.errors import InputError
from pomona.geometry import Similarity

# COLMAP's perspective models, and where each parameter goes in OpenCV's (fx, fy, cx, cy, k1, k2, p1, p2, k3..k6).
_OPENCV_SLOTS: dict[str, tuple[tuple[int, ...], ...]] = {
    "SIMPLE_PINHOLE": ((0, 1), (2,), (3,)),
    "PINHOLE": ((0,), (1,), (2,), (3,)),
    "SIMPLE_RADIAL": ((0, 1), (2,), (3,), (4,)),
    "RADIAL": ((0, 1), (2,), (3,), (4,), (5,)),
    "OPENCV": ((0,), (1,), (2,), (3,), (4,), (5,), (6,), (7,)),
    "FULL_OPENCV": ((0,), (1,), (2,), (3,), (4,), (5,), (6,), (7,), (8,), (9,), (10,), (11,)),
}

_FIXED_POINT_STEPS, _NEWTON_STEPS = 20, 8
# At z = 1: less than a ten-thousandth of a pixel of any photo.
_SEEN_CLOSELY = 1e-9


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
        if not off.max(initial=0) > _SEEN_CLOSELY:
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


ScaleSource = Literal["markers", "scale-bar", "gnss", "fruit-diameter", "given", "none"]


@dataclass(frozen=True)
class WorldFrame:
    """What the numbers of the world frame mean.

    `scale_source` says what made metres of it; `approximate` is True where that is only an assumed fruit diameter.
    With GNSS the frame is local east-north-up around `origin` (latitude_deg, longitude_deg, altitude_m), and `crs` is
    its PROJ string, so that nothing loses its place on Earth. `up_is_known` is False where z is only a guess.
    """

    scale_source: ScaleSource = "none"
    approximate: bool = True
    up_is_known: bool = False
    crs: str | None = None
    origin: tuple[float, float, float] | None = None

    @property
    def metric(self) -> bool:
        """Whether coordinates are metres (perhaps approximate ones)."""
        return self.scale_source != "none"


def local_crs(latitude_deg: float, longitude_deg: float) -> str:
    """Return the PROJ string of east and north metres around a place.

    It is a transverse Mercator projection about the place, which GIS programs read; within a kilometre it differs from
    the tangent plane by less than a millimetre.
    """
    return (
        f"+proj=tmerc +lat_0={latitude_deg} +lon_0={longitude_deg} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs "
        "+type=crs"
    )


def _no_points() -> FloatArray:
    return np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class Cameras:
    """n registered photos and m sparse points, all in one frame.

    `photos` (n,) names; `intrinsics_idx` (n,) into `intrinsics`; `cam_from_world` (n, 3, 4) = [R | t].
    `points_in_world` (m, 3), `points_rgb` (m, 3), `points_error_px` (m,).
    Tracks, k observations of points in photos: `track_point_idx`, `track_photo_idx` (k,), `track_xy_px` (k, 2).
    """

    photos: tuple[str, ...]
    intrinsics: tuple[Intrinsics, ...]
    intrinsics_idx: IntArray
    cam_from_world: FloatArray
    points_in_world: FloatArray = field(default_factory=_no_points)
    points_rgb: ByteArray = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    points_error_px: FloatArray = field(default_factory=lambda: np.zeros(0))
    track_point_idx: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    track_photo_idx: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    track_xy_px: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    frame: WorldFrame = WorldFrame()

    def __post_init__(self) -> None:
        n, m, k = len(self.photos), len(self.points_in_world), len(self.track_point_idx)
        set_checked(self, "intrinsics_idx", (n,), np.int64)
        set_checked(self, "cam_from_world", (n, 3, 4), np.float64)
        set_checked(self, "points_in_world", (m, 3), np.float64)
        set_checked(self, "points_rgb", (m, 3), np.uint8)
        set_checked(self, "points_error_px", (m,), np.float64)
        set_checked(self, "track_point_idx", (k,), np.int64)
        set_checked(self, "track_photo_idx", (k,), np.int64)
        set_checked(self, "track_xy_px", (k, 2), np.float64)
        if n and not (self.intrinsics_idx.min() >= 0 and self.intrinsics_idx.max() < len(self.intrinsics)):
            raise InputError(f"Cameras.intrinsics_idx: expected 0 to {len(self.intrinsics) - 1}")

    def __len__(self) -> int:
        return len(self.photos)

    def index_of(self, photo: str) -> int | None:
        """Return the index of a photo by name, or None where it did not register."""
        return self.photos.index(photo) if photo in self.photos else None

    @property
    def centers_in_world(self) -> FloatArray:
        """(n, 3): the cameras' centres, −Rᵀt."""
        rotation, translation = self.cam_from_world[:, :, :3], self.cam_from_world[:, :, 3]
        centers: FloatArray = -np.einsum("nji,nj->ni", rotation, translation)
        return centers

    def intrinsics_of(self, photo_idx: int) -> Intrinsics:
        """Return the intrinsics of one photo."""
        return self.intrinsics[int(self.intrinsics_idx[photo_idx])]

    def project(self, photo_idx: int, points_in_world: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Project points (n, 3) into a photo: pixels (n, 2), NaN behind the camera, and depths (n,).

        The paper's equations 1 and 2, with lens distortion.
        """
        pose = self.cam_from_world[photo_idx]
        points_in_cam = np.asarray(points_in_world) @ pose[:, :3].T + pose[:, 3]
        return self.intrinsics_of(photo_idx).px_from_cam(points_in_cam), points_in_cam[:, 2]

    def rays_in_world(self, photo_idx: int, xy_px: FloatArray) -> FloatArray:
        """Return unit viewing directions (n, 3) in the world frame for pixels (n, 2)."""
        rays: FloatArray = self.intrinsics_of(photo_idx).cam_from_px(xy_px) @ self.cam_from_world[photo_idx][:, :3]
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        return rays

    def transformed(self, target_from_world: Similarity, frame: WorldFrame | None = None) -> Cameras:
        """Return the cameras and points moved into another frame; cameras keep seeing the same pixels."""
        rotation = self.cam_from_world[:, :, :3] @ target_from_world.rotation.T
        translation = target_from_world.scale * self.cam_from_world[:, :, 3] - rotation @ target_from_world.translation
        return replace(
            self,
            cam_from_world=np.concatenate([rotation, translation[:, :, None]], axis=2),
            points_in_world=target_from_world.apply(self.points_in_world),
            frame=self.frame if frame is None else frame,
        )


def concatenate(parts: Sequence[Cameras], frame: WorldFrame) -> Cameras:
    """Join cameras that are already in one frame into one set."""
    point_offset = np.cumsum([0] + [len(p.points_in_world) for p in parts])
    photo_offset = np.cumsum([0] + [len(p) for p in parts])
    camera_offset = np.cumsum([0] + [len(p.intrinsics) for p in parts])
    return Cameras(
        photos=tuple(name for p in parts for name in p.photos),
        intrinsics=tuple(i for p in parts for i in p.intrinsics),
        intrinsics_idx=np.concatenate([p.intrinsics_idx + o for p, o in zip(parts, camera_offset[:-1], strict=True)]),
        cam_from_world=np.concatenate([p.cam_from_world for p in parts]),
        points_in_world=np.concatenate([p.points_in_world for p in parts]),
        points_rgb=np.concatenate([p.points_rgb for p in parts]),
        points_error_px=np.concatenate([p.points_error_px for p in parts]),
        track_point_idx=np.concatenate([p.track_point_idx + o for p, o in zip(parts, point_offset[:-1], strict=True)]),
        track_photo_idx=np.concatenate([p.track_photo_idx + o for p, o in zip(parts, photo_offset[:-1], strict=True)]),
        track_xy_px=np.concatenate([p.track_xy_px for p in parts]),
        frame=frame,
    )
