"""What photos say of a fruit: how often it was seen where it should be, how surely, how much of it, how well."""

from __future__ import annotations

import numpy as np
from scipy.special import erf

from pomona.arrays import BoolArray, FloatArray, IntArray
from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.fruit_size import FruitSize, size_of_fruits
from pomona.fuse import Fused
from pomona.fuse.object.fit import place_sds_m
from pomona.fuse.object.masks import Masks, masks_of
from pomona.fuse.object.spheres import Claims, Spheres, shares_of

VIEW_FEATURE_NAMES = ("log_views", "seen_share", "mean_score", "largest_share", "log_place_sd")
_RAYS = 16  # along each outline
_LEAST_SD = 0.01  # diameters: no place is known better than that
# A photo should see a fruit that another sees from a direction so near, unless it is so much farther away.
_NEAR_DEG, _FARTHER = 20.0, 1.15


def view_features(fused: Fused, detections: SurveyDetections, cameras: Cameras) -> FloatArray:
    """Return `VIEW_FEATURE_NAMES` (n, 5) of the n fruits. Each has observations in photos that have cameras.

    The logarithm of the number of photos that saw it; these as a share of the photos that should have, being near to
    one that did and having it in the picture; the mean score of its detections; the largest share of its disc that a
    mask fills; and the logarithm of how well its place is known, a standard deviation in diameters. More was tried,
    and told nothing more (docs/reference/methods/object.md).
    """
    masks = masks_of(detections, cameras, rays=_RAYS)
    usual_m = size_of_fruits(fused.fruits.diameters_m, FruitSize()).radius_m
    radii_m = fused.fruits.diameters_m / 2
    spheres = Spheres(fused.fruits.centers_in_world, np.where(np.isfinite(radii_m), radii_m, usual_m))
    sphere_idx, mask_idx = _claims(fused, masks)
    n = len(spheres)
    views = np.maximum(np.bincount(sphere_idx, minlength=n), 1)
    largest_share = np.zeros(n)
    np.maximum.at(largest_share, sphere_idx, shares_of(spheres, sphere_idx, mask_idx, masks))
    return np.stack(
        [
            np.log(views),
            _seen_shares(spheres, sphere_idx, masks.photo_idx[mask_idx], cameras),
            np.bincount(sphere_idx, masks.scores[mask_idx], n) / views,
            largest_share,
            np.log(_place_sds(spheres, sphere_idx, mask_idx, masks, usual_m)),
        ],
        axis=1,
    )


def _claims(fused: Fused, masks: Masks) -> tuple[IntArray, IntArray]:
    """Return which mask each observation is (k,), and whose fruit's (k,)."""
    place = {detection_id: k for k, detection_id in enumerate(masks.ids.tolist())}
    index = {fruit_id: i for i, fruit_id in enumerate(fused.fruits.ids.tolist())}
    pairs = [
        (index[fruit_id], place[detection_id])
        for fruit_id, detection_id in zip(
            fused.observations.fruit_id.tolist(), fused.observations.detection_id.tolist(), strict=True
        )
        if fruit_id in index and detection_id in place
    ]
    sphere_idx, mask_idx = np.array(pairs, np.int64).reshape(-1, 2).T
    return sphere_idx, mask_idx


def place_probability(values: FloatArray) -> FloatArray:
    """Return the probability (n,) that fruits with these features are within half a diameter of where they are said.

    Rows that the filter learns from are seen from many sides. What they do not teach is geometry: a fruit that all
    photos see from one direction may be a fruit for sure, and nobody knows how far away.
    """
    sds = np.exp(np.asarray(values)[:, VIEW_FEATURE_NAMES.index("log_place_sd")])
    result: FloatArray = erf(0.5 / (np.sqrt(2) * sds))
    return result


def _place_sds(spheres: Spheres, sphere_idx: IntArray, mask_idx: IntArray, masks: Masks, usual_m: float) -> FloatArray:
    """Return how well it is known where each fruit is (n,): standard deviations in diameters of the usual fruit."""
    shares = shares_of(spheres, sphere_idx, mask_idx, masks)
    claims = Claims(sphere_idx, mask_idx, np.zeros(len(shares)), shares)
    return np.maximum(place_sds_m(spheres, claims, masks, usual_m) / (2 * usual_m), _LEAST_SD)


def _seen_shares(spheres: Spheres, sphere_idx: IntArray, photo_idx: IntArray, cameras: Cameras) -> FloatArray:
    """Return the share of the photos that should see each sphere which do (n,)."""
    in_picture = np.stack([_in_picture(spheres, cameras, i) for i in range(len(cameras))], axis=1)
    eyes = cameras.centers_in_world
    result = np.ones(len(spheres))
    order = np.argsort(sphere_idx, kind="stable")
    for claims in np.split(order, np.flatnonzero(np.diff(sphere_idx[order])) + 1):
        if len(claims) == 0:
            continue
        i, seen = sphere_idx[claims[0]], photo_idx[claims]
        sights = spheres.centers_in_world[i] - eyes
        distances = np.linalg.norm(sights, axis=1)
        cosines = (sights / distances[:, None]) @ (sights[seen] / distances[seen, None]).T
        should = in_picture[i] & (cosines.max(1) > np.cos(np.radians(_NEAR_DEG)))
        should &= distances < _FARTHER * distances[seen].max()
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
