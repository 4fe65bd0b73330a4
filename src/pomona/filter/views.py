"""What photos say of a fruit: how often it was seen where it should be, how surely, how much of it, how well."""

from __future__ import annotations

import numpy as np

from pomona.arrays import BoolArray, FloatArray, IntArray
from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.fuse import Fused
from pomona.fuse.object.gate import misfits
from pomona.fuse.object.masks import Masks, masks_of
from pomona.fuse.object.spheres import Spheres

VIEW_FEATURE_NAMES = (
    "log_views",
    "seen_share",
    "mean_score",
    "best_score",
    "largest_share",
    "misfit",
    "log_size",
    "angle",
)
_RAYS = 16
# A photo should see a fruit that another sees from a direction so near, at most so much nearer.
_NEAR_DEG, _FARTHER = 20.0, 1.15
_MOST_ANGLE_DEG = 30.0


def view_features(fused: Fused, detections: SurveyDetections, cameras: Cameras) -> FloatArray:
    """Return `VIEW_FEATURE_NAMES` (n, 8) of the n fruits. Each has observations in photos that have cameras.

    The logarithm of the number of photos that saw it; these as a share of the photos that should have, being near to
    one that did and having it in the picture; mean and best score of its detections; the largest share of its disc that
    a mask fills; how far masks reach out of it; the logarithm of its diameter over the median; and the angle between
    the first and the last photo that saw it, which tells how sure its distance is, in units of 30°.
    """
    masks = masks_of(detections, cameras, rays=_RAYS)
    spheres = Spheres(fused.fruits.centers_in_world, fused.fruits.diameters_m / 2)
    sphere_idx, mask_idx = _claims(fused, masks)
    misfit, share = misfits(spheres, sphere_idx, mask_idx, masks)
    n = len(spheres)
    views = np.maximum(np.bincount(sphere_idx, minlength=n), 1)
    scores = masks.scores[mask_idx]
    best_score, largest_share = np.zeros(n), np.zeros(n)
    np.maximum.at(best_score, sphere_idx, scores)
    np.maximum.at(largest_share, sphere_idx, share)
    seen_share, angle = _visibility(spheres, sphere_idx, masks.photo_idx[mask_idx], cameras)
    return np.stack(
        [
            np.log(views),
            seen_share,
            np.bincount(sphere_idx, scores, n) / views,
            best_score,
            largest_share,
            np.bincount(sphere_idx, np.minimum(misfit, 1), n) / views,
            np.log(spheres.radii_m / np.median(spheres.radii_m)),
            angle,
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


def _visibility(
    spheres: Spheres, sphere_idx: IntArray, photo_idx: IntArray, cameras: Cameras
) -> tuple[FloatArray, FloatArray]:
    """Return the share of the photos that should see each sphere which do (n,), and the widest angle between these."""
    in_picture = np.stack([_in_picture(spheres, cameras, i) for i in range(len(cameras))], axis=1)
    eyes = cameras.centers_in_world
    seen_share, angle = np.ones(len(spheres)), np.zeros(len(spheres))
    order = np.argsort(sphere_idx, kind="stable")
    for photos in np.split(order, np.flatnonzero(np.diff(sphere_idx[order])) + 1):
        if len(photos) == 0:
            continue
        i, seen = sphere_idx[photos[0]], photo_idx[photos]
        sights = spheres.centers_in_world[i] - eyes
        distances = np.linalg.norm(sights, axis=1)
        cosines = (sights / distances[:, None]) @ (sights[seen] / distances[seen, None]).T
        should = in_picture[i] & (cosines.max(1) > np.cos(np.radians(_NEAR_DEG)))
        should &= distances < _FARTHER * distances[seen].max()
        should[seen] = True
        seen_share[i] = len(seen) / should.sum()
        angle[i] = min(np.degrees(np.arccos(np.clip(cosines[seen].min(), -1, 1))) / _MOST_ANGLE_DEG, 1.0)
    return seen_share, angle


def _in_picture(spheres: Spheres, cameras: Cameras, photo_idx: int) -> BoolArray:
    xy_px, depths = cameras.project(photo_idx, spheres.centers_in_world)
    intrinsics = cameras.intrinsics_of(photo_idx)
    margin_px = (spheres.radii_m * intrinsics.focal_px / np.maximum(depths, 1e-9))[:, None]
    inside: BoolArray = (xy_px > margin_px).all(1) & (
        xy_px < [intrinsics.width_px, intrinsics.height_px] - margin_px
    ).all(1)
    return inside
