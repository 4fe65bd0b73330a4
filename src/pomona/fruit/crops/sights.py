"""Images of spheres in photos."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, groups, set_checked
from pomona.fruit.geometry.spheres import Spheres
from pomona.values.cameras import Cameras

_LEAST_RADIUS_PX = 3.0  # of a fruit in a photo: in fewer pixels nothing is to be seen


@dataclass(frozen=True, eq=False)
class Sights:
    """k pairs of a sphere and a photo that should show it, sorted by photo; its image there."""

    sphere_idx: IntArray
    photo_idx: IntArray
    centers_px: FloatArray
    radii_px: FloatArray

    def __post_init__(self) -> None:
        k = len(self.sphere_idx)
        set_checked(self, "sphere_idx", (k,), np.int64)
        set_checked(self, "photo_idx", (k,), np.int64)
        set_checked(self, "centers_px", (k, 2), np.float64)
        set_checked(self, "radii_px", (k,), np.float64)

    def __len__(self) -> int:
        return len(self.sphere_idx)

    def __getitem__(self, selection: BoolArray | IntArray) -> Sights:
        return Sights(
            self.sphere_idx[selection], self.photo_idx[selection], self.centers_px[selection], self.radii_px[selection]
        )


def sights_of(spheres: Spheres, sphere_idx: IntArray, photo_idx: IntArray, cameras: Cameras) -> Sights:
    """Return the images of spheres `sphere_idx` (k,) in photos `photo_idx` (k,), of those whose centres lie in these.

    Images too small to show anything are left out.
    """
    order = np.lexsort((sphere_idx, photo_idx))
    sphere_idx, photo_idx = sphere_idx[order], photo_idx[order]
    centers, radii = np.zeros((len(order), 2)), np.zeros(len(order))
    for photo, mine in groups(photo_idx):
        intrinsics = cameras.intrinsics_of(photo)
        xy_px, depths = cameras.project(photo, spheres.centers_in_world[sphere_idx[mine]])
        inside = (depths > 0) & (xy_px > 0).all(1) & (xy_px < [intrinsics.width_px, intrinsics.height_px]).all(1)
        centers[mine] = np.where(inside[:, None], xy_px, 0)
        radii_px = images_px(cameras, photo, spheres[sphere_idx[mine]])
        radii[mine] = np.where(inside, radii_px, 0)
    shown = radii >= _LEAST_RADIUS_PX
    return Sights(sphere_idx[shown], photo_idx[shown], centers[shown], radii[shown])


def images_px(cameras: Cameras, photo_idx: int, spheres: Spheres) -> FloatArray:
    """Return how large (n,), in pixels, the radii of spheres are in a photo, as distortion has it; NaN behind it.

    Of perspective alone a sphere is as wide as in the middle at its depth: its image is longer the other way, which the
    networks that look at crops know.
    """
    pose = cameras.cam_from_world[photo_idx]
    in_cam = spheres.centers_in_world @ pose[:, :3].T + pose[:, 3]
    return np.asarray(spheres.radii_m * np.sqrt(cameras.intrinsics_of(photo_idx).areas_px2(in_cam)))


def well_spread(sights: Sights, spheres: Spheres, cameras: Cameras, most: int) -> Sights:
    """Return the sights, of each sphere at most so many, which look at it from directions as far apart as all do.

    Photos from nearly one place show the same leaves, and tell no more together than one.
    """
    eyes, kept = cameras.centers_in_world, np.ones(len(sights.sphere_idx), dtype=bool)
    for i, mine in groups(sights.sphere_idx):
        if len(mine) <= most:
            continue
        directions = spheres.centers_in_world[i] - eyes[sights.photo_idx[mine]]
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        directions -= directions.mean(0)
        along = directions @ np.linalg.svd(directions, full_matrices=False)[2][0]
        order = mine[np.argsort(along, kind="stable")]
        kept[mine] = False
        kept[order[np.linspace(0, len(order) - 1, most).round().astype(int)]] = True
    return sights[kept]
