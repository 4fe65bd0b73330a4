"""Which hypotheses are fruits, and whose each mask is."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from fuse_scenes import cameras_in_a_row, detections_of
from pomona.basics.arrays import BoolArray, FloatArray
from pomona.fruit.geometry.mask_rays import MaskRays, mask_rays
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse import Shown
from pomona.stages.fuse.object import ObjectOptions
from pomona.stages.fuse.object.gating import Gate
from pomona.stages.second_look.looked import Looked
from pomona.stages.second_look.options import SecondLookOptions
from pomona.stages.second_look.selection import select
from pomona.values.cameras import Cameras

DIAMETER_M = 0.075
RADIUS_M = DIAMETER_M / 2
CENTERS = np.array([[-0.1, 0.0, 0.0], [-0.02, 0.01, 0.02], [0.15, 0.05, 0.05]])
OPTIONS = SecondLookOptions()


def masks_of(centers: FloatArray, cameras: Cameras) -> MaskRays:
    return mask_rays(detections_of(cameras, centers, np.full(len(centers), DIAMETER_M)), cameras, rays_per_mask=16)


def hypotheses_of(centers: FloatArray, nats: FloatArray, seen: FloatArray | None = None) -> Looked:
    seen = np.full(len(centers), 0.5) if seen is None else seen
    return Looked(Spheres.alike(np.asarray(centers), RADIUS_M), Shown(seen, np.asarray(nats, np.float64)))


def selected(hypotheses: Looked, masks: MaskRays) -> tuple[list[bool], list[int]]:
    """Return which hypotheses are fruits, and how many masks each of these has."""
    stays, matches = select(hypotheses, masks, RADIUS_M, OPTIONS, ObjectOptions())
    return stays.tolist(), matches.counts(int(stays.sum())).tolist()


def test_masks_go_to_the_fruit_that_photos_speak_for() -> None:
    """Of two spheres that one fruit's masks fit as well, the one that photos show has them all."""
    masks, both = masks_of(CENTERS[:1], cameras_in_a_row(8, step_m=0.1)), [CENTERS[0], CENTERS[0] + [0, 0, 0.01]]
    assert selected(hypotheses_of(np.array(both), np.array([5.0, -2.0])), masks) == ([True, False], [8])
    assert selected(hypotheses_of(np.array(both), np.array([-2.0, 5.0])), masks) == ([False, True], [8])


def test_a_sphere_too_near_does_not_explain_the_masks_of_a_fruit_behind_it() -> None:
    """From nearly one place it holds each of them, as those of a fruit that leaves hide in every photo."""
    cameras = cameras_in_a_row(8, step_m=0.01)
    masks, eye = masks_of(CENTERS[:1], cameras), cameras.centers_in_world.mean(0)
    too_near = eye + 0.75 * (CENTERS[0] - eye)
    tried = hypotheses_of(np.array([too_near, CENTERS[0]]), np.array([3.8, 3.0]))
    matches = Gate(masks, RADIUS_M, ObjectOptions()).matches(tried.spheres)
    assert matches.counts(2).tolist() == [8, 8]
    assert matches.misfits.max() < 0.05
    worths = [matches.worths[matches.sphere_idx == i].mean() for i in range(2)]
    assert 0.75 < worths[0] < 0.9 < 0.95 < worths[1] <= 1
    assert selected(tried, masks) == ([False, True], [8])


def test_a_fruit_is_not_replaced_by_two_that_share_its_masks() -> None:
    """Two beside it, each of which photos speak for as much, fit some of the masks each."""
    masks = masks_of(CENTERS[:1], cameras_in_a_row(8, step_m=0.1))
    beside = CENTERS[0] + RADIUS_M * np.array([[-0.75, 0, 0.3], [0.75, 0, 0.3]])
    tried = hypotheses_of(np.vstack([beside, CENTERS[:1]]), np.array([4.0, 4.0, 3.0]))
    assert selected(tried, masks) == ([False, False, True], [8])


def test_a_sphere_without_masks_of_its_own_is_no_fruit() -> None:
    masks = masks_of(CENTERS[:2], cameras_in_a_row(8, step_m=0.1))
    tried = hypotheses_of(np.vstack([CENTERS[:2], CENTERS[:2].mean(0)]), np.array([2.0, 2.0, 6.0]))
    assert selected(tried, masks) == ([True, True, False], [8, 8])


def test_masks_that_no_other_wants_are_a_fruit_whatever_photos_show() -> None:
    """Of few photos, or of fruit that the network does not know, photos speak for none: the filter decides."""
    few = masks_of(CENTERS[:1], cameras_in_a_row(2, step_m=0.1))
    for nats in (-1.0, 0.3, 3.0):
        assert selected(hypotheses_of(CENTERS[:1], np.array([nats])), few) == ([True], [2])


def test_a_second_sphere_needs_more_than_a_mask_that_the_first_could_have() -> None:
    """Two photos' masks are the one's alone, the other could have those of two more, as the one could."""
    masks = masks_of(CENTERS[:1], cameras_in_a_row(8, step_m=0.1))
    beside = CENTERS[0] + RADIUS_M * np.array([0.0, 0.0, 1.4])
    tried = hypotheses_of(np.array([CENTERS[0], beside]), np.array([3.0, 0.0]))
    assert selected(tried, masks) == ([True, False], [8])


def test_few_masks_are_a_fruit_where_none_looked() -> None:
    few = masks_of(CENTERS[:1], cameras_in_a_row(2, step_m=0.1))
    assert selected(hypotheses_of(CENTERS[:1], np.zeros(1), np.full(1, np.nan)), few) == ([True], [2])


def worth(chosen: BoolArray, hypotheses: Looked, masks: MaskRays) -> float:
    """What a set is worth, the slow and obvious way: −inf where two are too near, or one is left with too few masks."""
    centers = hypotheses.spheres.centers_in_world[chosen]
    apart = np.linalg.norm(centers[:, None] - centers[None], axis=2)[np.triu_indices(len(centers), 1)]
    if (apart <= OPTIONS.overlap_radii * RADIUS_M).any():
        return -np.inf
    matches = Gate(masks, RADIUS_M, ObjectOptions()).matches(hypotheses.spheres)
    best = np.zeros((len(hypotheses.spheres), len(masks.eyes_in_world)))  # a sphere's mask in each photo, alone
    np.maximum.at(best, (matches.sphere_idx, masks.photo_idx[matches.mask_idx]), OPTIONS.mask_nats * matches.worths)
    own = np.maximum(hypotheses.shown.likelihoods_nats - OPTIONS.fruit_nats, 0.1 - best.sum(1))
    result = float(own[chosen].sum())
    counts = np.zeros(len(centers), np.int64)
    for photo in range(len(masks.eyes_in_world)):
        nats = np.zeros((len(hypotheses.spheres), len(masks)))
        mine = masks.photo_idx[matches.mask_idx] == photo
        nats[matches.sphere_idx[mine], matches.mask_idx[mine]] = OPTIONS.mask_nats * matches.worths[mine]
        rows, columns = linear_sum_assignment(nats[chosen], maximize=True)
        counts[rows] += nats[chosen][rows, columns] > 0
        result += float(nats[chosen][rows, columns].sum())
    return result if (counts >= 2).all() else -np.inf


@pytest.mark.parametrize("seed", range(12))
def test_what_is_selected_is_worth_as_much_as_any_set(seed: int) -> None:
    """Three fruits, two of them side by side, and hypotheses about them: all sets of them are tried."""
    random = np.random.default_rng(seed)
    masks = masks_of(CENTERS, cameras_in_a_row(5, step_m=0.15))
    centers = np.repeat(CENTERS, 3, axis=0) + random.normal(0, 0.5 * RADIUS_M, (9, 3))
    hypotheses = hypotheses_of(centers, random.uniform(-2, 6, 9))
    stays, _ = select(hypotheses, masks, RADIUS_M, OPTIONS, ObjectOptions())
    sets = (np.array(chosen) for chosen in product([False, True], repeat=9))
    assert worth(stays, hypotheses, masks) == pytest.approx(max(worth(s, hypotheses, masks) for s in sets), abs=1e-6)
