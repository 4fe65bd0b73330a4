"""Fruits as landmarks: spheres that explain the masks of all photos together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pomona.arrays import BoolArray, FloatArray
from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.errors import InputError
from pomona.fruit_ranges import fruit_ranges
from pomona.fruit_size import FruitSize, size_of_fruits
from pomona.fruits import FruitCloud, Fruits, Observations
from pomona.fuse.object.choice import apart, assigned, elected, likely_spheres
from pomona.fuse.object.fit import fit_spheres
from pomona.fuse.object.gate import Gate
from pomona.fuse.object.masks import Masks, masks_of
from pomona.fuse.object.options import ObjectOptions
from pomona.fuse.object.pieces import without_pieces
from pomona.fuse.object.seeds import Seeds, find_seeds
from pomona.fuse.object.spheres import Claims, Spheres
from pomona.fuse.values import Fused
from pomona.progress import Progress, Silent

# Fruits that tell the usual size: seen in so many photos, in one of them nearly whole; and at least so many of them.
_CLEAR, _CLEAR_VIEWS, _FEWEST_CLEAR, _FREE = 0.7, 3, 10, 1.0
_SAME_SIZE = 0.04  # a usual size that is off by less, as a share, changes nothing


@dataclass(frozen=True, eq=False)
class _Found:
    """The fruits so far, and the masks that are theirs."""

    spheres: Spheres
    claims: Claims

    @property
    def support(self) -> FloatArray:
        return self.claims.support(len(self.spheres))

    def kept(self, stays: BoolArray) -> _Found:
        return _Found(self.spheres[stays], self.claims.kept(stays))


def fuse(
    detections: SurveyDetections,
    cameras: Cameras,
    *,
    options: ObjectOptions | None = None,
    progress: Progress | None = None,
) -> Fused:
    """Return the fruits that explain the detections of all photos best, without any cloud.

    Rays to masks of two photos that nearly cross are guesses; masks of all photos elect spheres among them. Then masks
    are assigned to spheres, one to one in each photo, and spheres fitted to the outlines of their masks, in turns;
    masks that are left over may be further fruits. The result does not depend on the order of photos or detections,
    and fruits are numbered by where they are.

    Centres and diameters are first estimates. No detections give no fruits. Raises `InputError` where the cameras'
    frame is not metric: the usual size of fruit is in metres.
    """
    options, progress = options or ObjectOptions(), progress or Silent()
    if not cameras.frame.metric:
        raise InputError(
            "Fruits can be joined only where cameras are in metres (as fruits have a size), found cameras without a "
            "scale: give --markers, --scale-bar or --fruit-diameter"
        )
    size = fruit_ranges(detections, cameras, FruitSize(options.fruit_diameter_m)).size
    ordered = _in_order(cameras)
    masks = masks_of(detections, ordered, rays=options.rays_per_mask)
    if len(masks) == 0:
        return Fused(Fruits.empty(), Observations.empty(), FruitCloud.empty())
    found = _without_pieces(_search(masks, size, options, progress), masks)
    return _fused(found.kept(found.claims.largest_shares(len(found.spheres)) >= options.min_share), masks, ordered)


def _without_pieces(found: _Found, masks: Masks) -> _Found:
    if len(found.spheres) < 2:
        return found
    return _Found(*without_pieces(found.spheres, found.claims, masks, float(np.median(found.spheres.radii_m))))


def _search(masks: Masks, size: FruitSize, options: ObjectOptions, progress: Progress) -> _Found:
    """Look for fruits in rounds, each in what the earlier ones left; begun anew where fruits turn out of other size."""
    progress.start("fuse", 1 + options.rounds)
    gate, seeds = Gate(masks, size.radius_m), find_seeds(masks, size.radius_m, options)
    found = _nothing_found(size)
    progress.advance()
    for number in range(options.rounds):
        before = len(found.spheres)
        found = _further(found, seeds, gate, masks, size.radius_m, options)
        if number == 0:
            before_m, size = size.diameter_m, _refined_size(found, masks, size)
            if abs(size.diameter_m / before_m - 1) > _SAME_SIZE:
                gate, seeds = Gate(masks, size.radius_m), find_seeds(masks, size.radius_m, options)
                found = _further(_nothing_found(size), seeds, gate, masks, size.radius_m, options)
        progress.advance()
        if len(found.spheres) <= before:
            break
    return found


def _nothing_found(size: FruitSize) -> _Found:
    return _Found(Spheres.alike(np.zeros((0, 3)), size.radius_m), Claims.none())


def _further(found: _Found, seeds: Seeds, gate: Gate, masks: Masks, usual_m: float, options: ObjectOptions) -> _Found:
    """Add the fruits that masks speak for which are no fruit's yet, and settle whose masks are whose."""
    free = np.ones(len(masks), dtype=bool)
    free[found.claims.mask_idx] = False
    new = likely_spheres(seeds, gate, masks, usual_m, free)
    new = new[elected(new, gate, masks, free, options.min_support)]
    new = new[_away_from(found.spheres, new, options.overlap_radii * usual_m)]
    support = np.concatenate([found.support, np.ones(len(new))])
    spheres = Spheres.joined([found.spheres, new])
    for _ in range(options.repeats):
        found = _settled(spheres, support, gate, masks, usual_m, options)
        spheres, support = found.spheres, found.support
    return found


def _refined_size(found: _Found, masks: Masks, size: FruitSize) -> FruitSize:
    """Return the size of fruits that are well seen, fitted without a prior on it; `size` where they are few."""
    n = len(found.spheres)
    clear = np.zeros(n, dtype=bool)
    clear[found.claims.sphere_idx[found.claims.shares >= _CLEAR]] = True
    clear &= found.claims.counts(n) >= _CLEAR_VIEWS
    if clear.sum() < _FEWEST_CLEAR:
        return size
    some = found.kept(clear)
    fitted = fit_spheres(some.spheres, some.claims, masks, size.radius_m, radius_spread=_FREE)
    return size_of_fruits(2 * fitted.radii_m, size)


def _settled(
    spheres: Spheres, support: FloatArray, gate: Gate, masks: Masks, usual_m: float, options: ObjectOptions
) -> _Found:
    """Assign masks to spheres and fit these again; who is seen too seldom, or inside another, is no fruit."""
    claims = assigned(gate.claims(spheres), masks, support)
    found = _Found(spheres, claims)
    found = found.kept(claims.counts(len(spheres)) >= options.min_views)
    found = _Found(fit_spheres(found.spheres, found.claims, masks, usual_m), found.claims)
    return found.kept(apart(found.spheres, found.support, options.overlap_radii * usual_m))


def _away_from(spheres: Spheres, new: Spheres, distance_m: float) -> BoolArray:
    if len(spheres) == 0 or len(new) == 0:
        return np.ones(len(new), dtype=bool)
    return np.asarray(cKDTree(spheres.centers_in_world).query(new.centers_in_world)[0] > distance_m)


def _in_order(cameras: Cameras) -> Cameras:
    """Return the cameras, without points, sorted by where the photos were taken from."""
    order = np.lexsort(cameras.centers_in_world.T)
    return Cameras(
        photos=tuple(cameras.photos[i] for i in order),
        intrinsics=cameras.intrinsics,
        intrinsics_idx=cameras.intrinsics_idx[order],
        cam_from_world=cameras.cam_from_world[order],
        frame=cameras.frame,
    )


def _fused(found: _Found, masks: Masks, cameras: Cameras) -> Fused:
    """Return the values that a fusion gives, fruits numbered from 1 by where they are."""
    order = np.lexsort(found.spheres.centers_in_world.T[::-1])
    number = np.empty(len(order), np.int64)
    number[order] = np.arange(1, len(order) + 1)
    spheres, n = found.spheres[order], len(order)
    if n == 0:
        return Fused(Fruits.empty(), Observations.empty(), FruitCloud.empty())
    fruit_id, mask_idx = number[found.claims.sphere_idx], found.claims.mask_idx
    sorting = np.lexsort((masks.photo_idx[mask_idx], fruit_id))
    fruit_id, mask_idx = fruit_id[sorting], mask_idx[sorting]
    views = np.bincount(fruit_id, minlength=n + 1)[1:]
    fruits = Fruits(
        np.arange(1, n + 1),
        spheres.centers_in_world,
        2 * spheres.radii_m,
        np.bincount(fruit_id, masks.scores[mask_idx], n + 1)[1:] / views,
        views,
    )
    observations = Observations(
        fruit_id,
        tuple(cameras.photos[i] for i in masks.photo_idx[mask_idx]),
        masks.ids[mask_idx],
        masks.centers_px[mask_idx],
    )
    return Fused(fruits, observations, FruitCloud.empty())
