"""What photos say of a fruit: how often it was seen where it should be, how surely, how much of it, how well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.fruit.geometry.mask_rays import mask_rays
from pomona.fruit.geometry.near_photos import photos_near
from pomona.fruit.geometry.spheres import Spheres
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.stages.filter.options import FilterOptions
from pomona.stages.fuse import Fused
from pomona.stages.fuse.object import ObjectOptions
from pomona.stages.fuse.object.matches import Matches
from pomona.stages.fuse.object.refinement import place_sds_m
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections

VIEW_FEATURE_NAMES = ("log_views", "seen_share", "mean_score", "largest_share", "log_place_sd")
LOOKED_FEATURE_NAMES = (*VIEW_FEATURE_NAMES, "shown", "likelihood_nats")
"""Of fruits that were looked at again."""

# Outlines are surer of places than they are, by this factor.
_PLACE_AFTER_LOOKING = 1.2
# Leaves that cut a fruit's outline are before it in all photos from about one direction, which then agree on a wrong
# place: that of a fruit of which nothing shows is known no better than this, in diameters. Halves of the photos of a
# real video agree on fewer of such fruits than scores without it say (docs/lab/second-look.md).
_WHOLLY_HIDDEN_SD = 0.5


@dataclass(frozen=True, eq=False)
class ViewFeatures:
    """What photos say of n fruits: `values` (n, 5 or 7), and `hidden` (n,), the share that no photo shows of each.

    `values` are `VIEW_FEATURE_NAMES`, or `LOOKED_FEATURE_NAMES` of fruits that were looked at again: the logarithm of
    the number of photos that saw it; these as a share of the photos that should have, being near to one that did and
    having it in the picture; the mean score of its detections; the largest share of its disc that a mask fills; and the
    logarithm of how well its place is known by outlines, a standard deviation in diameters. Of the second look, what is
    seen of the fruit's centre in the photos that show it best, and how much likelier all photos are with a fruit there
    than without; both NaN where no photo was looked at.

    `hidden` is of a disc of the usual size: fruits that leaves hide seem small.
    """

    values: FloatArray
    hidden: FloatArray

    def __post_init__(self) -> None:
        set_checked(self, "hidden", (None,), np.float64)
        set_checked(self, "values", (len(self.hidden), None), np.float64)

    def __getitem__(self, selection: BoolArray | IntArray) -> ViewFeatures:
        return ViewFeatures(self.values[selection], self.hidden[selection])

    def place_probability(self, *, looked: bool) -> FloatArray:
        """Return the probability (n,) that fruits are within half a diameter of where they are said.

        Rows that the filter learns from are seen from many sides. What they do not teach is geometry: a fruit that all
        photos see from one direction may be a fruit for sure, and nobody knows how far away. `looked`: as the second
        look has placed them.
        """
        sds = np.exp(self.values[:, VIEW_FEATURE_NAMES.index("log_place_sd")])
        if looked:
            sds = np.hypot(_PLACE_AFTER_LOOKING * sds, _WHOLLY_HIDDEN_SD * self.hidden)
        result: FloatArray = erf(0.5 / (np.sqrt(2) * sds))
        return result


def view_features(
    fused: Fused, detections: SurveyDetections, cameras: Cameras, options: FilterOptions | None = None
) -> ViewFeatures:
    """Return what photos say of the fruits, each of which has observations in photos that have cameras."""
    options, cameras = options or FilterOptions(), cameras.sorted_by_center()
    masks = mask_rays(detections, cameras, rays_per_mask=options.rays_per_mask, only=fused.observations)
    size = size_of_fruits(fused.fruits.diameters_m, FruitSize())
    spheres = Spheres.of_fruits(fused.fruits.centers_in_world, fused.fruits.diameters_m, size.radius_m)
    sphere_idx, mask_idx = masks.seen(fused.observations, fused.fruits.ids)
    n = len(spheres)
    views = np.maximum(np.bincount(sphere_idx, minlength=n), 1)
    matches = Matches.known(spheres, sphere_idx, mask_idx, masks)
    place_sds = place_sds_m(spheres, matches, masks, size.radius_m, ObjectOptions()) / size.diameter_m
    columns = [
        np.log(views),
        seen_shares(spheres, sphere_idx, masks.photo_idx[mask_idx], cameras, options),
        np.bincount(sphere_idx, masks.scores[mask_idx], n) / views,
        matches.largest_shares(n),
        np.log(np.maximum(place_sds, options.least_place_sd)),
    ]
    if fused.shown is not None:
        none_looked = np.isnan(fused.shown.seen)
        columns += [fused.shown.seen, np.where(none_looked, np.nan, fused.shown.likelihoods_nats)]
    alike = Spheres.alike(spheres.centers_in_world, size.radius_m)
    hidden = 1 - Matches.known(alike, sphere_idx, mask_idx, masks).largest_shares(n)
    return ViewFeatures(np.stack(columns, axis=1), hidden)


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
