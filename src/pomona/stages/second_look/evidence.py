"""What photos show around spheres: for each sphere and photo a map of where fruits' centres are."""

from __future__ import annotations

from dataclasses import dataclass, fields
from tempfile import TemporaryFile, gettempdir
from typing import IO

import cv2
import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import Float32Array, FloatArray, IntArray, groups, set_checked
from pomona.errors import InputError
from pomona.fruit.crops.cutting import crops_by_photo
from pomona.fruit.crops.likeness import SeenFruits
from pomona.fruit.crops.sights import Sights, sights_of
from pomona.fruit.geometry.near_photos import photos_near
from pomona.fruit.geometry.spheres import Spheres
from pomona.progress import Progress
from pomona.stages.second_look.network import CentersNetwork
from pomona.stages.second_look.options import SecondLookOptions
from pomona.stages.second_look.peaks import Peaks
from pomona.values.cameras import Cameras
from pomona.values.photos import Photos

_AT_ONCE = 4096  # maps: bounds memory
_SAME_SIZE = 0.15  # of an image, as a logarithm: a map is of fruits of about the size that its crop was made for


@dataclass(frozen=True, eq=False)
class Evidence:
    """Maps of k sights: `maps` (k, h, w), the probability of a fruit's centre at cells of `cell_px` of a crop.

    The middle of a crop is at `sights.centers_px`; `scales` (k,) lead from the photo's pixels to the crop's. The maps
    may be in a file; `peaks` in them are left out where they are read.
    """

    sights: Sights
    scales: FloatArray
    maps: Float32Array
    cell_px: float
    peaks: Peaks

    def __post_init__(self) -> None:
        k = len(self.sights.sphere_idx)
        set_checked(self, "scales", (k,), np.float64)
        set_checked(self, "maps", (k, None, None), np.float32)
        if len(self.peaks.bounds) != k + 1:
            raise InputError(f"Evidence.peaks: expected those of {k} sights, found {len(self.peaks.bounds) - 1}")

    def about(self, idx: IntArray, center_in_world: FloatArray, cameras: Cameras) -> MapsAbout:
        """Return what sights `idx` (m,) show about a point (3,) in front of their photos."""
        sights, scales = self.sights, self.scales[idx] / self.cell_px
        poses = cameras.cam_from_world[sights.photo_idx[idx]]
        center_in_cam = poses[:, :, :3] @ center_in_world + poses[:, :, 3]
        xy_px, slopes = np.zeros((len(idx), 2)), np.zeros((len(idx), 2, 2))
        for lens, mine in groups(cameras.intrinsics_idx[sights.photo_idx[idx]]):
            xy_px[mine] = cameras.intrinsics[lens].px_from_cam(center_in_cam[mine])
            slopes[mine] = cameras.intrinsics[lens].px_slopes(center_in_cam[mine])[0][:, :, :2]
        slopes *= (scales * center_in_cam[:, 2])[:, None, None]
        half = np.array(self.maps.shape[:0:-1]) / 2
        cells = (xy_px - sights.centers_px[idx]) * scales[:, None] + half - 0.5
        maps = self.maps[idx]
        self.peaks.take_from(maps, idx)
        return MapsAbout(center_in_world, poses[:, :, :3], center_in_cam, slopes, cells, maps)


@dataclass(frozen=True, eq=False)
class MapsAbout:
    """The maps (m, h, w) of m sights about a point, and how points near it are seen in them.

    `rotations` (m, 3, 3) and `center_in_cam` (m, 3) of the photos; `slopes` (m, 2, 2), by how many cells an image moves
    for its place in the plane at z = 1; `cells` (m, 2), the point's own images. Over a crop, lenses' distortion is
    taken to be linear.
    """

    center_in_world: FloatArray
    rotations: FloatArray
    center_in_cam: FloatArray
    slopes: FloatArray
    cells: FloatArray
    maps: Float32Array

    def at(self, points_in_world: FloatArray) -> FloatArray:
        """Return the probabilities (m, n) at the images of points (n, 3); 0 outside of the crops."""
        x, y, z = np.moveaxis(self.rotations @ (points_in_world - self.center_in_world).T, 1, 0)
        x, y, z = (a + self.center_in_cam[:, k, None] for k, a in enumerate((x, y, z)))
        z = np.where(z > 0, z, np.nan)
        x = x / z - (self.center_in_cam[:, 0] / self.center_in_cam[:, 2])[:, None]
        y = y / z - (self.center_in_cam[:, 1] / self.center_in_cam[:, 2])[:, None]
        columns, rows = (
            (self.slopes[:, k, 0, None] * x + self.slopes[:, k, 1, None] * y + self.cells[:, k, None]) for k in range(2)
        )
        columns, rows = (np.nan_to_num(a.astype(np.float32), copy=False, nan=-9.0) for a in (columns, rows))
        result = np.empty(columns.shape, np.float32)
        for k, map_ in enumerate(self.maps):
            at = columns[k : k + 1], rows[k : k + 1]
            result[k] = cv2.remap(map_, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)[0]
        return np.asarray(result, np.float64)


def find_sights(
    spheres: Spheres, sphere_idx: IntArray, photo_idx: IntArray, cameras: Cameras, options: SecondLookOptions
) -> Sights:
    """Return which photos should show each sphere, given that photos `photo_idx` (k,) saw spheres `sphere_idx` (k,)."""
    places, limits = spheres.centers_in_world, {"farther": options.farther, "near_deg": options.near_deg}
    spheres_of, photos_of = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for i, _, near in photos_near(places, sphere_idx, photo_idx, cameras, **limits):
        spheres_of.append(np.full(len(near), i))
        photos_of.append(near)
    return sights_of(spheres, np.concatenate(spheres_of), np.concatenate(photos_of), cameras)


def look(
    sights: Sights,
    seen: SeenFruits,
    photos: Photos,
    cameras: Cameras,
    network: CentersNetwork,
    progress: Progress,
    known: Evidence | None = None,
    same_radii: float = 0.0,
) -> Evidence:
    """Return what photos show at the sights; without those of photos that cannot be decoded, of which it warns.

    `seen` tells the colours of this survey's fruits. Of an earlier look, `known` has maps: one serves a sight in its
    photo whose image is not farther than `same_radii` from the map's middle. Maps go to a temporary file, which the
    system reads from as it has memory: of a long row they are gigabytes. Raises `LostFileError` naming a photo that is
    gone.
    """
    known_idx = _known_about(sights, known, same_radii)
    anew = known_idx < 0
    some, scales = sights[anew], network.radius_px / np.maximum(sights.radii_px[anew], 1e-9)
    looked = np.zeros(len(some), dtype=bool)
    progress.start("looking again", len(np.unique(some.photo_idx)))
    with TemporaryFile() as file:
        for mine, crops in crops_by_photo(
            some, scales, network.side_px, seen, photos, cameras, progress, left_out="is not looked at again"
        ):
            _write(network.centers(crops), file)
            looked[mine] = True
        maps = _maps_in(file, int(looked.sum()), network.side_px // network.stride)
    now = Evidence(some[looked], scales[looked], maps, float(network.stride), Peaks.none(len(maps)))
    return now if known is None else _joined(now, known, sights[~anew], known_idx[~anew])


def _known_about(sights: Sights, known: Evidence | None, same_radii: float) -> IntArray:
    """Return which of the known maps has each sight (k,) near its middle; −1: none."""
    result = np.full(len(sights), -1)
    if known is None:
        return result
    of_photo = dict(groups(known.sights.photo_idx))
    for photo, mine in groups(sights.photo_idx):
        theirs = of_photo.get(photo)
        if theirs is not None:
            away_px, nearest = cKDTree(known.sights.centers_px[theirs]).query(sights.centers_px[mine])
            found, radii_px = theirs[nearest], sights.radii_px[mine]
            alike = np.abs(np.log(known.sights.radii_px[found] / radii_px)) < _SAME_SIZE
            result[mine] = np.where(alike & (away_px < same_radii * radii_px), found, -1)
    return result


def _joined(now: Evidence, known: Evidence, sights: Sights, idx: IntArray) -> Evidence:
    """Return what was looked at now, and `sights` (m,) that the known maps `idx` (m,) serve, in a file of its own."""
    placed = Sights(sights.sphere_idx, sights.photo_idx, known.sights.centers_px[idx], known.sights.radii_px[idx])
    columns = [np.concatenate([getattr(part, field.name) for part in (now.sights, placed)]) for field in fields(Sights)]
    joined, first = Sights(*columns), len(now.scales)
    order = np.lexsort((joined.sphere_idx, joined.photo_idx))
    with TemporaryFile() as file:
        for start in range(0, len(order), _AT_ONCE):
            some = order[start : start + _AT_ONCE]
            new, maps = some < first, np.empty((len(some), *now.maps.shape[1:]), np.float32)
            maps[new], maps[~new] = now.maps[some[new]], known.maps[idx[some[~new] - first]]
            _write(maps, file)
        maps = _maps_in(file, len(order), now.maps.shape[1])
    scales = np.concatenate([now.scales, known.scales[idx]])[order]
    return Evidence(joined[order], scales, maps, now.cell_px, Peaks.none(len(maps)))


def _write(maps: Float32Array, file: IO[bytes]) -> None:
    try:
        file.write(np.ascontiguousarray(maps, np.float32).data)
        file.flush()
    except OSError as error:  # a full disk: the file has no name
        error.filename = gettempdir()
        raise


def _maps_in(file: IO[bytes], count: int, cells: int) -> Float32Array:
    """Return the maps (count, cells, cells) that a file holds, without reading them; it may be closed then."""
    shape = (count, cells, cells)
    return np.memmap(file, np.float32, "r", shape=shape) if count else np.zeros(shape, np.float32)
