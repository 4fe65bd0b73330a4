"""Every fruit looked at again, in all photos that should show it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.fruit_size import FruitSize, size_of_fruits
from pomona.fuse import Fused
from pomona.fuse.object import ObjectOptions
from pomona.fuse.object.matches import Matches
from pomona.fuse.object.refinement import place_covariances
from pomona.fuse.object.suppression import suppress_overlapping
from pomona.mask_rays import mask_rays
from pomona.photos import Photos
from pomona.progress import Progress, Silent
from pomona.second_look.evidence import find_sights, look, unexplained
from pomona.second_look.network import CentersNetwork
from pomona.second_look.options import SecondLookOptions
from pomona.second_look.refinement import Prior, refined
from pomona.spheres import Spheres


def look_again(
    fused: Fused,
    detections: SurveyDetections,
    photos: Photos,
    cameras: Cameras,
    *,
    network: CentersNetwork | None = None,
    options: SecondLookOptions | None = None,
    progress: Progress | None = None,
) -> Fused:
    """Return the fruits moved to where the evidence of all photos and their own outlines put them.

    Crops of every photo that should show a fruit, with fruits of one width in all, go through a small network that says
    where fruits' centres are, hidden parts and all. `detections` and `cameras` are those that `fused` was made of.
    Fruits that end in one place are one, the one that is seen more plainly; the others keep their ids.
    """
    options, progress = options or SecondLookOptions(), progress or Silent()
    fruits = fused.fruits
    if len(fruits) == 0:
        return fused
    network = network or CentersNetwork()
    size = size_of_fruits(fruits.diameters_m, FruitSize())
    spheres = Spheres.of_fruits(fruits.centers_in_world, fruits.diameters_m, size.radius_m)
    masks = mask_rays(detections, cameras, rays_per_mask=options.rays_per_mask, only=fused.observations)
    sphere_idx, mask_idx = masks.seen(fused.observations, fruits.ids)
    matches = Matches.known(spheres, sphere_idx, mask_idx, masks)
    covariances = place_covariances(spheres, matches, masks, size.radius_m, ObjectOptions())
    prior = Prior(spheres, covariances, size.radius_m)
    sights = find_sights(spheres, sphere_idx, masks.photo_idx[mask_idx], cameras, options)
    evidence = look(sights, photos, cameras, network, progress)
    moved, seen = refined(prior, evidence, cameras, options)
    for round_idx in range(1, len(options.reach)):
        left = unexplained(evidence, moved, seen, cameras, options)
        moved, seen = refined(prior, left, cameras, options, round_idx)
    stays = suppress_overlapping(moved, np.nan_to_num(seen), options.overlap_radii * size.radius_m)
    kept = replace(fruits, centers_in_world=moved.centers_in_world)[stays]
    return Fused(kept, fused.observations[np.isin(fused.observations.fruit_id, kept.ids)], fused.cloud)
