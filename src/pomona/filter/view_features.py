"""What photos say of a fruit: how often it was seen where it should be, how surely, how much of it, how well."""

from __future__ import annotations

import numpy as np
from scipy.special import erf

from pomona.arrays import BoolArray, FloatArray, IntArray
from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.filter.options import FilterOptions
from pomona.fruit_geometry.mask_rays import MaskRays, mask_rays
from pomona.fruit_geometry.near_photos import photos_near
from pomona.fruit_geometry.spheres import Spheres
from pomona.fruit_traits.size import FruitSize, size_of_fruits
from pomona.fuse import Fused
from pomona.fuse.object import ObjectOptions
from pomona.fuse.object.matches import Matches, shares_of
from pomona.fuse.object.refinement import place_sds_m

VIEW_FEATURE_NAMES = ("log_views", "seen_share", "mean_score", "largest_share", "log_place_sd")
LOOKED_FEATURE_NAMES = (*VIEW_FEATURE_NAMES, "shown", "likelihood_nats")
"""Of fruits that were looked at again."""

# Outlines are surer of places than they are. Of a real video's fruits of a score of 0.8, two halves of the photos agree
# on the fewer the less this is; above 1.5 it costs fruits that are right (docs/lab/second-look.md).
_PLACE_AFTER_LOOKING = 1.4


def view_features(
    fused: Fused, detections: SurveyDetections, cameras: Cameras, options: FilterOptions | None = None
) -> FloatArray:
    """Return features of the n fruits: `VIEW_FEATURE_NAMES` (n, 5), or `LOOKED_FEATURE_NAMES` (n, 7) where they were
    looked at again. Each has observations in photos that have cameras.

    The logarithm of the number of photos that saw it; these as a share of the photos that should have, being near to
    one that did and having it in the picture; the mean score of its detections; the largest share of its disc that a
    mask fills; and the logarithm of how well its place is known, a standard deviation in diameters. Of the second look,
    what is seen of the fruit's centre in the photos that show it best, and how much likelier all photos are with a
    fruit there than without; both NaN where no photo was looked at.
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
    columns = [
        np.log(views),
        seen_shares(spheres, sphere_idx, masks.photo_idx[mask_idx], cameras, options),
        np.bincount(sphere_idx, masks.scores[mask_idx], n) / views,
        largest_share,
        np.log(np.maximum(_place_sds(spheres, sphere_idx, mask_idx, masks, size), options.least_place_sd)),
    ]
    if fused.shown is not None:
        none_looked = np.isnan(fused.shown.seen)
        columns += [fused.shown.seen, np.where(none_looked, np.nan, fused.shown.likelihoods_nats)]
    return np.stack(columns, axis=1)


def place_probability(values: FloatArray) -> FloatArray:
    """Return the probability (n,) that fruits with these features are within half a diameter of where they are said.

    Rows that the filter learns from are seen from many sides. What they do not teach is geometry: a fruit that all
    photos see from one direction may be a fruit for sure, and nobody knows how far away.
    """
    sds = np.exp(np.asarray(values)[:, VIEW_FEATURE_NAMES.index("log_place_sd")])
    if values.shape[1] == len(LOOKED_FEATURE_NAMES):
        sds = _PLACE_AFTER_LOOKING * sds
    result: FloatArray = erf(0.5 / (np.sqrt(2) * sds))
    return result


def _place_sds(
    spheres: Spheres, sphere_idx: IntArray, mask_idx: IntArray, masks: MaskRays, size: FruitSize
) -> FloatArray:
    """Return how well it is known where each fruit is (n,): standard deviations in diameters of the fruits."""
    matches = Matches.known(spheres, sphere_idx, mask_idx, masks)
    return place_sds_m(spheres, matches, masks, size.radius_m, ObjectOptions()) / size.diameter_m


def seen_shares(
    spheres: Spheres, sphere_idx: IntArray, photo_idx: IntArray, cameras: Cameras, options: FilterOptions
) -> FloatArray:
    """Return the share of the photos that should see each sphere which do (n,).

    Photos farther away than those that see it are not looked at: the time grows with the row, not with its square.
    """
    places, limits = spheres.centers_in_world, {"farther": options.farther, "near_deg": options.near_deg}
    result = np.ones(len(spheres))
    for i, seen, near in photos_near(places, sphere_idx, photo_idx, cameras, **limits):
        should = near[_in_picture(spheres, cameras, i, near)]
        result[i] = len(seen) / len(np.union1d(should, seen))
    return result


def _in_picture(spheres: Spheres, cameras: Cameras, sphere_idx: int, photo_idx: IntArray) -> BoolArray:
    """Say which photos (k,) have one sphere wholly in the picture."""
    place = np.broadcast_to(spheres.centers_in_world[sphere_idx], (len(photo_idx), 3))
    xy_px, depths = cameras.project_each(photo_idx, place)
    lenses = [cameras.intrinsics_of(i) for i in photo_idx]
    focals_px = np.array([lens.focal_px for lens in lenses])
    sizes_px = np.array([(lens.width_px, lens.height_px) for lens in lenses]).reshape(-1, 2)
    margin_px = (spheres.radii_m[sphere_idx] * focals_px / np.maximum(depths, 1e-9))[:, None]
    inside: BoolArray = (xy_px > margin_px).all(1) & (xy_px < sizes_px - margin_px).all(1)
    return inside
