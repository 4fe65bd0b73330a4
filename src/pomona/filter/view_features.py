"""What photos say of a fruit: how often it was seen where it should be, how surely, how much of it, how well."""

from __future__ import annotations

import numpy as np
from scipy.special import erf

from pomona.arrays import BoolArray, FloatArray, IntArray
from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.filter.options import FilterOptions
from pomona.fruit_size import FruitSize, size_of_fruits
from pomona.fuse import Fused
from pomona.fuse.object import ObjectOptions
from pomona.fuse.object.matches import Matches, shares_of
from pomona.fuse.object.refinement import place_sds_m
from pomona.mask_rays import MaskRays, mask_rays
from pomona.spheres import Spheres

VIEW_FEATURE_NAMES = ("log_views", "seen_share", "mean_score", "largest_share", "log_place_sd")


def view_features(
    fused: Fused, detections: SurveyDetections, cameras: Cameras, options: FilterOptions | None = None
) -> FloatArray:
    """Return `VIEW_FEATURE_NAMES` (n, 5) of the n fruits. Each has observations in photos that have cameras.

    The logarithm of the number of photos that saw it; these as a share of the photos that should have, being near to
    one that did and having it in the picture; the mean score of its detections; the largest share of its disc that a
    mask fills; and the logarithm of how well its place is known, a standard deviation in diameters. More was tried,
    and added nothing (docs/reference/methods/object.md).
    """
    options = options or FilterOptions()
    masks = mask_rays(detections, cameras, rays_per_mask=options.rays_per_mask, only=fused.observations)
    size = size_of_fruits(fused.fruits.diameters_m, FruitSize())
    spheres = Spheres.of_fruits(fused.fruits.centers_in_world, fused.fruits.diameters_m, size.radius_m)
    sphere_idx, mask_idx = masks.seen(fused.observations, fused.fruits.ids)
    n = len(spheres)
    views = np.maximum(np.bincount(sphere_idx, minlength=n), 1)
    largest_share = np.zeros(n)
    np.maximum.at(largest_share, sphere_idx, shares_of(spheres, sphere_idx, mask_idx, masks))
    return np.stack(
        [
            np.log(views),
            _seen_shares(spheres, sphere_idx, masks.photo_idx[mask_idx], cameras, options),
            np.bincount(sphere_idx, masks.scores[mask_idx], n) / views,
            largest_share,
            np.log(np.maximum(_place_sds(spheres, sphere_idx, mask_idx, masks, size), options.least_place_sd)),
        ],
        axis=1,
    )


def place_probability(values: FloatArray) -> FloatArray:
    """Return the probability (n,) that fruits with these features are within half a diameter of where they are said.

    Rows that the filter learns from are seen from many sides. What they do not teach is geometry: a fruit that all
    photos see from one direction may be a fruit for sure, and nobody knows how far away.
    """
    sds = np.exp(np.asarray(values)[:, VIEW_FEATURE_NAMES.index("log_place_sd")])
    result: FloatArray = erf(0.5 / (np.sqrt(2) * sds))
    return result


def _place_sds(
    spheres: Spheres, sphere_idx: IntArray, mask_idx: IntArray, masks: MaskRays, size: FruitSize
) -> FloatArray:
    """Return how well it is known where each fruit is (n,): standard deviations in diameters of the fruits."""
    matches = Matches.known(spheres, sphere_idx, mask_idx, masks)
    return place_sds_m(spheres, matches, masks, size.radius_m, ObjectOptions()) / size.diameter_m


def _seen_shares(
    spheres: Spheres, sphere_idx: IntArray, photo_idx: IntArray, cameras: Cameras, options: FilterOptions
) -> FloatArray:
    """Return the share of the photos that should see each sphere which do (n,)."""
    in_picture = np.stack([_in_picture(spheres, cameras, i) for i in range(len(cameras))], axis=1)
    eyes = cameras.centers_in_world
    result = np.ones(len(spheres))
    order = np.argsort(sphere_idx, kind="stable")
    for mine in np.split(order, np.flatnonzero(np.diff(sphere_idx[order])) + 1):
        if len(mine) == 0:
            continue
        i, seen = sphere_idx[mine[0]], photo_idx[mine]
        sights = spheres.centers_in_world[i] - eyes
        distances = np.linalg.norm(sights, axis=1)
        cosines = (sights / distances[:, None]) @ (sights[seen] / distances[seen, None]).T
        should = in_picture[i] & (cosines.max(1) > np.cos(np.radians(options.near_deg)))
        should &= distances < options.farther * distances[seen].max()
        should[seen] = True
        result[i] = len(seen) / should.sum()
    return result


def _in_picture(spheres: Spheres, cameras: Cameras, photo_idx: int) -> BoolArray:
    xy_px, depths = cameras.project(photo_idx, spheres.centers_in_world)
    intrinsics = cameras.intrinsics_of(photo_idx)
    margin_px = (spheres.radii_m * intrinsics.focal_px / np.maximum(depths, 1e-9))[:, None]
    inside: BoolArray = (xy_px > margin_px).all(1) & (
        xy_px < [intrinsics.width_px, intrinsics.height_px] - margin_px
    ).all(1)
    return inside
