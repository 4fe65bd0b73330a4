"""Every fruit looked at again, in all photos that should show it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona.basics.arrays import BoolArray, IntArray
from pomona.fruit.crops.likeness import SeenFruits
from pomona.fruit.crops.sights import well_spread
from pomona.fruit.geometry.mask_rays import MaskRays, mask_rays
from pomona.fruit.geometry.spheres import Spheres
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.progress import Progress, Recorder, Silent
from pomona.stages.fuse import Fused, Shown
from pomona.stages.fuse.object import ObjectOptions
from pomona.stages.fuse.object.matches import Matches, with_raggedness
from pomona.stages.fuse.object.observations import fused_of
from pomona.stages.fuse.object.refinement import fit_spheres, place_covariances
from pomona.stages.fuse.object.suppression import suppress_overlapping
from pomona.stages.second_look.evidence import Evidence, find_sights, look
from pomona.stages.second_look.explained import unexplained
from pomona.stages.second_look.looked import Looked
from pomona.stages.second_look.network import CentersNetwork
from pomona.stages.second_look.options import SecondLookOptions
from pomona.stages.second_look.proposals import proposed
from pomona.stages.second_look.refinement import OutlinePrior, refined, unmoved
from pomona.stages.second_look.selection import select
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import Fruits
from pomona.values.photos import Photos


def look_again(
    fused: Fused,
    detections: SurveyDetections,
    photos: Photos,
    cameras: Cameras,
    *,
    network: CentersNetwork | None = None,
    options: SecondLookOptions | None = None,
    association: ObjectOptions | None = None,
    progress: Progress | None = None,
) -> Fused:
    """Return the fruits moved to where all photos and their own outlines put them, and others that photos show there.

    Crops of every photo that should show a fruit, with fruits of one width in all, go through a small network that says
    where fruits' centres are, hidden parts and all. What it shows beside the fruits is proposed as further ones; of all
    these, and the fruits where outlines have them, those stay that explain masks and photos best together. `detections`
    and `cameras` are those that `fused` was made of, `association` its options. Fruits keep their ids; further ones
    have greater ids. `shown` says what photos show of each. It is done `options.looks` times, each from the masks of
    the one before.
    """
    options, progress = options or SecondLookOptions(), Recorder(progress or Silent())  # a warning of each photo is one
    network, association = network or CentersNetwork(), association or ObjectOptions()
    if len(fused.fruits) == 0:
        return fused
    cameras, known = cameras.sorted_by_center(), None
    masks = mask_rays(detections, cameras, rays_per_mask=association.rays_per_mask)
    if len(masks) == 0:
        return fused
    masks = with_raggedness(masks, _spheres(fused.fruits)[0], *masks.seen(fused.observations, fused.fruits.ids))
    for _ in range(options.looks):
        if len(fused.fruits) == 0:
            break
        fused, known = _looked_at(
            fused, detections, masks, photos, cameras, network, known, options=options, association=association,
            progress=progress,
        )  # fmt: skip
    return fused


def _looked_at(
    fused: Fused,
    detections: SurveyDetections,
    masks: MaskRays,
    photos: Photos,
    cameras: Cameras,
    network: CentersNetwork,
    known: Evidence | None,
    *,
    options: SecondLookOptions,
    association: ObjectOptions,
    progress: Progress,
) -> tuple[Fused, Evidence]:
    """Look once, from where the masks of the fruits put these; `known` is what the look before saw, if any."""
    fruits = fused.fruits
    spheres, radius_m = _spheres(fruits)
    sphere_idx, mask_idx = masks.seen(fused.observations, fruits.ids)
    matches = Matches.known(spheres, sphere_idx, mask_idx, masks)
    if fused.shown is not None:
        spheres = _as_outlines_have_them(spheres, fused.shown, matches, masks, radius_m, association)
    covariances = place_covariances(spheres, matches, masks, radius_m, association)
    prior = OutlinePrior(spheres, covariances, matches.counts(len(spheres)), radius_m)
    sights = find_sights(spheres, sphere_idx, masks.photo_idx[mask_idx], cameras, options)
    sights = well_spread(sights, spheres, cameras, options.most_photos)
    seen_fruits = SeenFruits(detections, fused.observations.detection_id)
    evidence = look(sights, seen_fruits, photos, cameras, network, progress, known, options.same_radii)
    left, moved = evidence, refined(prior, evidence, cameras, options)
    for round_idx in range(1, len(options.reach)):
        # Of two at one place the weaker explains nothing: else each would explain what speaks for the other.
        explaining = np.where(_apart(moved, options, radius_m), moved.shown.seen, 0.0)
        left = unexplained(evidence, moved.spheres, explaining, cameras, options)
        moved = refined(prior, left, cameras, options, round_idx)
    stays = _apart(moved, options, radius_m)
    apart = moved[stays]
    new = proposed(moved.spheres, apart, evidence, cameras, options, radius_m)
    hypotheses = Looked.joined([apart, new, unmoved(prior, left, cameras, options)])
    origins = np.concatenate([fruits.ids[stays], np.full(len(new.spheres), -1), fruits.ids])
    chosen, matches = select(hypotheses, masks, radius_m, options, association)
    found, ids = hypotheses[chosen], _ids_from(origins[chosen], int(fruits.ids.max()))
    looked = fused_of(found.spheres, ids, matches, masks)
    return replace(looked, shown=found.shown[np.argsort(ids)]), evidence


def _spheres(fruits: Fruits) -> tuple[Spheres, float]:
    """Return fruits as spheres, and the usual radius of them in metres, which is that of fruits without a size."""
    radius_m = size_of_fruits(fruits.diameters_m, FruitSize()).radius_m
    return Spheres.of_fruits(fruits.centers_in_world, fruits.diameters_m, radius_m), radius_m


def _apart(looked: Looked, options: SecondLookOptions, radius_m: float) -> BoolArray:
    """Say of each sphere (n,) whether photos show it better than all others that stand where it does."""
    return suppress_overlapping(looked.spheres, np.nan_to_num(looked.shown.seen), options.overlap_radii * radius_m)


def _ids_from(origins: IntArray, last: int) -> IntArray:
    """Return ids (n,) of fruits that were `origins` (n,) before: the second of one, or one of none (−1), is new."""
    own = np.zeros(len(origins), dtype=bool)
    own[np.unique(origins, return_index=True)[1]] = True
    own &= origins >= 0
    ids = origins.copy()
    ids[~own] = last + 1 + np.arange(np.count_nonzero(~own))
    return ids


def _as_outlines_have_them(
    spheres: Spheres, shown: Shown, matches: Matches, masks: MaskRays, radius_m: float, association: ObjectOptions
) -> Spheres:
    """Return the spheres that an earlier look has moved as their masks alone have them.

    Where that look has put them, what it saw would hold them, and count twice.
    """
    own, by_photos = fit_spheres(spheres, matches, masks, radius_m, association), shown.likelihoods_nats > 0
    centers = np.where(by_photos[:, None], own.centers_in_world, spheres.centers_in_world)
    return Spheres(centers, np.where(by_photos, own.radii_m, spheres.radii_m))
