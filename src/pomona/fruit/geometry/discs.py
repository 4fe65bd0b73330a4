"""Where the centres of fruits are seen: by the discs that the outlines of their masks are parts of.

Leaves hide parts of nearly every fruit, so that a mask's own middle is off by a third of a radius; what is left of its
outline still lies on the fruit's disc, whose size is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray, set_checked
from pomona.basics.geometry import offsets_from_rays
from pomona.fruit.geometry.mask_rays import mask_rays
from pomona.fruit.geometry.outline_weights import outline_weights
from pomona.fruit.geometry.spheres import Spheres
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import Fruits, Observations

_RAYS = 16
# Steps of the fit, and the longest of them in radii: they end far nearer than a disc can be measured.
_STEPS, _LONGEST_STEP = 10, 0.3


@dataclass(frozen=True, eq=False)
class FruitDiscs:
    """n fruits, `centers_in_world` (n, 3) and `diameters_m` (n,), and the k discs by which photos see them.

    `fruit_idx` and `photo_idx` (k,), `xy_px` (k, 2) where a disc's centre is, each coordinate to `sds_px` (k,) if
    outlines are as exact as they usually are; `shares` (k,), which part of a disc its mask fills.
    """

    centers_in_world: FloatArray
    diameters_m: FloatArray
    fruit_idx: IntArray
    photo_idx: IntArray
    xy_px: FloatArray
    sds_px: FloatArray
    shares: FloatArray

    def __post_init__(self) -> None:
        n, k = len(self.diameters_m), len(self.fruit_idx)
        set_checked(self, "centers_in_world", (n, 3), np.float64)
        set_checked(self, "diameters_m", (n,), np.float64)
        set_checked(self, "fruit_idx", (k,), np.int64)
        set_checked(self, "photo_idx", (k,), np.int64)
        set_checked(self, "xy_px", (k, 2), np.float64)
        set_checked(self, "sds_px", (k,), np.float64)
        set_checked(self, "shares", (k,), np.float64)

    def __len__(self) -> int:
        return len(self.diameters_m)


def fruit_discs(
    fruits: Fruits, observations: Observations, detections: SurveyDetections, cameras: Cameras
) -> FruitDiscs:
    """Return the fruits with the discs in their photos.

    Each disc is that of its fruit's sphere, moved across the sight until the mask's outline lies on it: least squares,
    in which edges of leaves, that run inside of the disc, count little.
    """
    masks = mask_rays(detections, cameras, rays_per_mask=_RAYS, only=observations)
    spheres = Spheres(fruits.centers_in_world, fruits.diameters_m / 2)
    fruit_idx, mask_idx = masks.seen(observations, fruits.ids)
    photo_idx = masks.photo_idx[mask_idx]
    eyes, rays = masks.eyes_in_world[photo_idx], masks.outlines[mask_idx]
    centers, radii_m = spheres.centers_in_world[fruit_idx], spheres.radii_m[fruit_idx]
    shifts_m, sds = _fitted(centers, radii_m, eyes, rays)
    xy_px = cameras.project_each(photo_idx, centers + shifts_m)[0]
    distances_m = masks.distances(centers, mask_idx)
    shares = np.minimum(masks.areas[mask_idx] * distances_m**2 / (np.pi * radii_m**2), 1)
    return FruitDiscs(
        fruits.centers_in_world,
        fruits.diameters_m,
        fruit_idx,
        photo_idx,
        xy_px,
        sds * radii_m / (distances_m * masks.px_angles[mask_idx]),
        shares,
    )


def _fitted(
    centers: FloatArray, radii_m: FloatArray, eyes: FloatArray, rays: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The shifts (k, 3) of centres across the sight, and how well they are known (k,), in radii, where least."""
    sights = (centers - eyes) / np.linalg.norm(centers - eyes, axis=1, keepdims=True)
    first = np.cross(sights, np.eye(3)[np.argmin(np.abs(sights), axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    across = np.stack([first, np.cross(sights, first)], axis=1)
    shifts = np.zeros((len(centers), 2))
    normal = np.broadcast_to(np.eye(2), (len(centers), 2, 2))
    for _ in range(_STEPS):
        places = centers + radii_m[:, None] * np.einsum("ki,kij->kj", shifts, across)
        beside = offsets_from_rays(places[:, None], eyes[:, None], rays)
        off = np.maximum(np.linalg.norm(beside, axis=2), 1e-12)
        residuals = off / radii_m[:, None] - 1
        slopes = (beside / off[:, :, None]) @ np.swapaxes(across, 1, 2)
        weights = outline_weights(residuals)
        # A disc of which nothing is seen would be a radius off.
        normal = np.einsum("kr,kri,krj->kij", weights, slopes, slopes) + np.eye(2)
        pull = np.einsum("kr,kri,kr->ki", weights, slopes, residuals) + shifts
        step = -np.linalg.solve(normal, pull[:, :, None])[:, :, 0]
        lengths = np.linalg.norm(step, axis=1, keepdims=True)
        shifts += step * np.minimum(1, _LONGEST_STEP / np.maximum(lengths, 1e-12))
    variances = np.linalg.eigvalsh(np.linalg.inv(normal))[:, -1] if len(normal) else np.zeros(0)
    return radii_m[:, None] * np.einsum("ki,kij->kj", shifts, across), np.sqrt(variances)
