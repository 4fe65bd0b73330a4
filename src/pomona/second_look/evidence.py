"""What photos show around spheres: for each sphere and photo a map of where fruits' centres are."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from pomona.arrays import BoolArray, Float32Array, FloatArray, IntArray, set_checked
from pomona.cameras import Cameras
from pomona.capture import read_pixels
from pomona.errors import InputError
from pomona.photos import Photos
from pomona.progress import Progress
from pomona.second_look.crops import CropPlaces, cut
from pomona.second_look.network import CentersNetwork
from pomona.second_look.options import SecondLookOptions
from pomona.spheres import Spheres

_LEAST_RADIUS_PX = 3.0  # of a fruit in a photo: in fewer pixels nothing is to be seen
_FINER = 1.25  # photos are decoded with pixels so many times finer than most of their crops'


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

    def __getitem__(self, selection: BoolArray) -> Sights:
        return Sights(
            self.sphere_idx[selection], self.photo_idx[selection], self.centers_px[selection], self.radii_px[selection]
        )


@dataclass(frozen=True, eq=False)
class Evidence:
    """Maps of k sights: `maps` (k, h, w), the probability of a fruit's centre at cells of `cell_px` of a crop.

    The middle of a crop is at `sights.centers_px`; `scales` (k,) lead from the photo's pixels to the crop's.
    """

    sights: Sights
    scales: FloatArray
    maps: Float32Array
    cell_px: float

    def __post_init__(self) -> None:
        k = len(self.sights.sphere_idx)
        set_checked(self, "scales", (k,), np.float64)
        set_checked(self, "maps", (k, None, None), np.float32)

    def at(self, idx: IntArray, points_in_world: FloatArray, cameras: Cameras) -> FloatArray:
        """Return what sights `idx` (m,) show at the images of points (n, 3): probabilities (m, n); 0 outside."""
        result = np.zeros((len(idx), len(points_in_world)), np.float32)
        half = np.array(self.maps.shape[:0:-1]) / 2
        for row, k in enumerate(idx.tolist()):
            xy_px, _ = cameras.project(int(self.sights.photo_idx[k]), points_in_world)
            cells = (xy_px - self.sights.centers_px[k]) * (self.scales[k] / self.cell_px) + half - 0.5
            x, y = np.nan_to_num(cells, nan=-9.0).astype(np.float32).T
            result[row] = cv2.remap(self.maps[k], x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)[0]
        return np.asarray(result, np.float64)


def unexplained(
    evidence: Evidence, spheres: Spheres, seen: FloatArray, cameras: Cameras, options: SecondLookOptions
) -> Evidence:
    """Return the evidence less what other fruits explain: each sight's map without the peaks of its neighbours.

    Around the images of the spheres that are `seen` (n,), as probabilities, maps lose as much as is seen of these.
    """
    sights, maps = evidence.sights, evidence.maps.copy()
    rows, columns = (np.arange(side) + 0.5 - side / 2 for side in maps.shape[1:])
    plain = np.flatnonzero(np.nan_to_num(seen) >= options.plain)
    strength = np.minimum(1, np.nan_to_num(seen) / options.sure)
    for photo in np.unique(sights.photo_idx).tolist():
        xy_px, depths = cameras.project(photo, spheres.centers_in_world[plain])
        ahead = depths > 0
        others, xy_px = plain[ahead], xy_px[ahead]
        radii_px = cameras.intrinsics_of(photo).focal_px * spheres.radii_m[others] / depths[ahead]
        for k in np.flatnonzero(sights.photo_idx == photo).tolist():
            cells = (xy_px - sights.centers_px[k]) * (evidence.scales[k] / evidence.cell_px)
            widths = options.peak_width * radii_px * evidence.scales[k] / evidence.cell_px
            near = (np.abs(cells) < maps.shape[1]).all(1) & (others != sights.sphere_idx[k])
            for (x, y), width, share in zip(cells[near], widths[near], strength[others[near]], strict=True):
                across, down = (
                    np.exp(-((columns - x) ** 2) / (2 * width**2)),
                    np.exp(-((rows - y) ** 2) / (2 * width**2)),
                )
                maps[k] *= 1 - share * down[:, None] * across
    return Evidence(sights, evidence.scales, maps, evidence.cell_px)


def find_sights(
    spheres: Spheres, sphere_idx: IntArray, photo_idx: IntArray, cameras: Cameras, options: SecondLookOptions
) -> Sights:
    """Return which photos should show each sphere, given that photos `photo_idx` (k,) saw spheres `sphere_idx` (k,)."""
    eyes, tree = cameras.centers_in_world, cKDTree(cameras.centers_in_world)
    order = np.argsort(sphere_idx, kind="stable")
    bounds = np.searchsorted(sphere_idx[order], np.arange(len(spheres) + 1))
    spheres_of, photos_of = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for i, center in enumerate(spheres.centers_in_world):
        seen = photo_idx[order[bounds[i] : bounds[i + 1]]]
        if len(seen) == 0:
            continue
        of_seen = center - eyes[seen]
        distances = np.linalg.norm(of_seen, axis=1)
        near = np.array(sorted(tree.query_ball_point(center, options.farther * distances.max())), np.int64)
        of_near = center - eyes[near]
        of_near /= np.maximum(np.linalg.norm(of_near, axis=1, keepdims=True), 1e-12)
        cosines = (of_near @ (of_seen / distances[:, None]).T).max(1)
        near = near[cosines > np.cos(np.radians(options.near_deg))]
        spheres_of.append(np.full(len(near), i))
        photos_of.append(near)
    return _in_pictures(spheres, np.concatenate(spheres_of), np.concatenate(photos_of), cameras)


def _in_pictures(spheres: Spheres, sphere_idx: IntArray, photo_idx: IntArray, cameras: Cameras) -> Sights:
    order = np.lexsort((sphere_idx, photo_idx))
    sphere_idx, photo_idx = sphere_idx[order], photo_idx[order]
    centers, radii = np.zeros((len(order), 2)), np.zeros(len(order))
    for photo in np.unique(photo_idx).tolist():
        mine = np.flatnonzero(photo_idx == photo)
        intrinsics = cameras.intrinsics_of(photo)
        xy_px, depths = cameras.project(photo, spheres.centers_in_world[sphere_idx[mine]])
        inside = (depths > 0) & (xy_px > 0).all(1) & (xy_px < [intrinsics.width_px, intrinsics.height_px]).all(1)
        centers[mine] = np.where(inside[:, None], xy_px, 0)
        radii_px = intrinsics.focal_px * spheres.radii_m[sphere_idx[mine]] / np.maximum(depths, 1e-9)
        radii[mine] = np.where(inside, radii_px, 0)
    shown = radii >= _LEAST_RADIUS_PX
    return Sights(sphere_idx[shown], photo_idx[shown], centers[shown], radii[shown])


def look(sights: Sights, photos: Photos, cameras: Cameras, network: CentersNetwork, progress: Progress) -> Evidence:
    """Return what photos show at the sights; without those of photos that cannot be decoded, of which it warns.

    Raises `MissingFileError` naming a photo that is gone.
    """
    scales = network.radius_px / np.maximum(sights.radii_px, 1e-9)
    cells = network.side_px // network.stride
    maps = np.zeros((len(scales), cells, cells), np.float32)
    looked = np.zeros(len(scales), dtype=bool)
    by_name, photo_indices = photos.by_name(), np.unique(sights.photo_idx).tolist()
    progress.start("looking again", len(photo_indices))
    for photo_idx in photo_indices:
        mine = np.flatnonzero(sights.photo_idx == photo_idx)
        photo = by_name[cameras.photos[photo_idx]]
        scale = min(1.0, _FINER * float(np.median(scales[mine])))
        try:
            pixels = read_pixels(photo, max_side_px=max(1, round(scale * max(photo.width_px, photo.height_px))))
        except InputError as error:
            progress.warn(f"{photo.name} is not looked at again: {error}")
        else:
            places = CropPlaces(sights.centers_px[mine], scales[mine])
            maps[mine] = network.centers(cut(pixels, places, network.side_px, photo.width_px))
            looked[mine] = True
        progress.advance()
    return Evidence(sights[looked], scales[looked], maps[looked], float(network.stride))
