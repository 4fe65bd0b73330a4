"""Cameras: poses, sparse points and their tracks, and the frame they are in.

Camera axes are OpenCV's (x right, y down, z forward); pixels are COLMAP's (`pomona.values.intrinsics`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray, IntArray, OneLine, counted, groups, set_checked
from pomona.basics.data_frames import data_frame
from pomona.basics.geometry import Similarity
from pomona.errors import InputError, few
from pomona.values.intrinsics import Intrinsics

ScaleSource = Literal["markers", "control-points", "scale-bar", "gnss", "fruit-diameter", "given", "none"]
METRES_FROM: dict[ScaleSource, str] = {
    "markers": "markers",
    "control-points": "control points",
    "scale-bar": "the scale bar",
    "gnss": "GNSS positions",
    "fruit-diameter": "an assumed fruit diameter",
    "given": "the cameras given",
}
"""Where metres come from, in words; nowhere with "none"."""


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

    @property
    def zero_altitude_m(self) -> float:
        """The altitude at which z is 0; 0 without a place on Earth."""
        return self.origin[2] if self.crs is not None and self.origin is not None else 0.0


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


@dataclass(frozen=True, eq=False, repr=False)
class Cameras(OneLine):
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

    @classmethod
    def empty(cls) -> Cameras:
        """Return no cameras."""
        return cls((), (), np.zeros(0, np.int64), np.zeros((0, 3, 4)))

    def __len__(self) -> int:
        return len(self.photos)

    def _holds(self) -> str:
        return f"{counted(len(self), 'photo')}, {counted(len(self.points_in_world), 'point')}"

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame`, a row a camera: its photo, centre in the world frame, focal length in pixels."""
        x_m, y_m, z_m = self.centers_in_world.T
        focal_px = [self.intrinsics_of(i).focal_px for i in range(len(self))]
        return data_frame({"photo": self.photos, "x_m": x_m, "y_m": y_m, "z_m": z_m, "focal_px": focal_px})

    def index_of(self, photo: str) -> int | None:
        """Return the index of a photo by name, or None where it did not register."""
        return self._places.get(photo)

    @cached_property
    def _places(self) -> dict[str, int]:
        return {photo: i for i, photo in reversed([*enumerate(self.photos)])}

    @property
    def centers_in_world(self) -> FloatArray:
        """(n, 3): the cameras' centres, −Rᵀt."""
        rotation, translation = self.cam_from_world[:, :, :3], self.cam_from_world[:, :, 3]
        centers: FloatArray = -np.einsum("nji,nj->ni", rotation, translation)
        return centers

    def sorted_by_center(self) -> Cameras:
        """Return the cameras, without points, in an order that depends on nothing but where they are."""
        order = np.lexsort(self.centers_in_world.T)
        return Cameras(
            photos=tuple(self.photos[i] for i in order),
            intrinsics=self.intrinsics,
            intrinsics_idx=self.intrinsics_idx[order],
            cam_from_world=self.cam_from_world[order],
            frame=self.frame,
        )

    def of_photos(self, names: Iterable[str]) -> Cameras:
        """Return the cameras of these photos, in their order, with all points and those photos' part of the tracks."""
        chosen = frozenset(names)
        kept = np.array([name in chosen for name in self.photos], bool)
        tracks = kept[self.track_photo_idx]
        return replace(
            self,
            photos=tuple(name for name in self.photos if name in chosen),
            intrinsics_idx=self.intrinsics_idx[kept],
            cam_from_world=self.cam_from_world[kept],
            track_point_idx=self.track_point_idx[tracks],
            track_photo_idx=(np.cumsum(kept) - 1)[self.track_photo_idx[tracks]],
            track_xy_px=self.track_xy_px[tracks],
        )

    def _idx_of(self, photo: int | str) -> int:
        if not isinstance(photo, str):
            return photo
        idx = self.index_of(photo)
        if idx is None:
            raise InputError(
                f"Cameras: no photo '{photo}' has a camera: expected an index, or one of {few(self.photos)}"
            )
        return idx

    def intrinsics_of(self, photo: int | str) -> Intrinsics:
        """Return the intrinsics of one photo, given by its index or name."""
        return self.intrinsics[int(self.intrinsics_idx[self._idx_of(photo)])]

    def project(self, photo: int | str, points_in_world: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Project points (n, 3) into a photo, given by its index or name.

        Returns pixels (n, 2), NaN behind the camera, and depths (n,): the paper's equations 1 and 2, with lens
        distortion. Raises `InputError` for a name that has no camera, and for points that are not (n, 3).
        """
        photo_idx = self._idx_of(photo)
        pose = self.cam_from_world[photo_idx]
        points_in_cam = _rows_of(points_in_world, 3, "points (n, 3)") @ pose[:, :3].T + pose[:, 3]
        return self.intrinsics_of(photo_idx).px_from_cam(points_in_cam), points_in_cam[:, 2]

    def project_each(self, photo_idx: IntArray, points_in_world: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Project each of n points (n, 3) into a photo of its own (n,): what `project` returns, in one go."""
        poses = self.cam_from_world[photo_idx]
        points_in_cam = np.einsum("nij,nj->ni", poses[:, :, :3], points_in_world) + poses[:, :, 3]
        xy_px = np.empty((len(points_in_cam), 2))
        for lens, mine in groups(self.intrinsics_idx[photo_idx]):
            xy_px[mine] = self.intrinsics[lens].px_from_cam(points_in_cam[mine])
        return xy_px, points_in_cam[:, 2]

    def rays_in_world(self, photo: int | str, xy_px: FloatArray) -> FloatArray:
        """Return unit viewing directions (n, 3) in the world frame for pixels (n, 2) of a photo: its index or name.

        Raises `InputError` for a name that has no camera, and for pixels that are not (n, 2).
        """
        photo_idx = self._idx_of(photo)
        xy_px = _rows_of(xy_px, 2, "pixels (n, 2)")
        rays: FloatArray = self.intrinsics_of(photo_idx).cam_from_px(xy_px) @ self.cam_from_world[photo_idx][:, :3]
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        return rays

    def rays_each(self, photo_idx: IntArray, xy_px: FloatArray) -> FloatArray:
        """Return unit viewing directions (n, 3) of pixels (n, 2), each of a photo of its own (n,): `rays_in_world`."""
        rays = np.empty((len(xy_px), 3))
        for lens, mine in groups(self.intrinsics_idx[photo_idx]):
            rays[mine] = self.intrinsics[lens].cam_from_px(xy_px[mine])
        rays = np.einsum("ni,nij->nj", rays, self.cam_from_world[photo_idx][:, :, :3])
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))

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


def split(cameras: Cameras, lengths: Sequence[int]) -> list[Cameras]:
    """Undo `concatenate` of cameras that have these numbers of photos."""
    ends = np.cumsum([0, *lengths])
    return [_part(cameras, int(start), int(end)) for start, end in pairwise(ends)]


def _part(cameras: Cameras, start: int, end: int) -> Cameras:
    in_part = (cameras.track_photo_idx >= start) & (cameras.track_photo_idx < end)
    points, point_idx = np.unique(cameras.track_point_idx[in_part], return_inverse=True)
    lenses, lens_idx = np.unique(cameras.intrinsics_idx[start:end], return_inverse=True)
    return Cameras(
        photos=cameras.photos[start:end],
        intrinsics=tuple(cameras.intrinsics[i] for i in lenses),
        intrinsics_idx=lens_idx,
        cam_from_world=cameras.cam_from_world[start:end],
        points_in_world=cameras.points_in_world[points],
        points_rgb=cameras.points_rgb[points],
        points_error_px=cameras.points_error_px[points],
        track_point_idx=point_idx,
        track_photo_idx=cameras.track_photo_idx[in_part] - start,
        track_xy_px=cameras.track_xy_px[in_part],
        frame=cameras.frame,
    )


def _rows_of(values: FloatArray, width: int, expected: str) -> FloatArray:
    rows = np.asarray(values, float)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise InputError(f"Cameras: expected {expected}, found an array of shape {rows.shape}: of one, give [[…]]")
    return rows
