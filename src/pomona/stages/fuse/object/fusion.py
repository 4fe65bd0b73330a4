"""Fruits as landmarks: spheres that explain the masks of all photos together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray
from pomona.errors import InputError
from pomona.fruit.geometry.mask_rays import MaskRays, mask_rays
from pomona.fruit.geometry.spheres import Spheres
from pomona.fruit.traits.ranges import fruit_ranges
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.progress import Progress, Silent
from pomona.stages.fuse.fused import Fused
from pomona.stages.fuse.object.assignment import assign
from pomona.stages.fuse.object.crossings import Crossings, find_crossings, find_facing_crossings
from pomona.stages.fuse.object.gating import Gate
from pomona.stages.fuse.object.hypotheses import sphere_hypotheses
from pomona.stages.fuse.object.matches import Matches, with_raggedness
from pomona.stages.fuse.object.observations import fused_of
from pomona.stages.fuse.object.options import ObjectOptions
from pomona.stages.fuse.object.refinement import fit_spheres
from pomona.stages.fuse.object.split_fruits import merge_split_fruits
from pomona.stages.fuse.object.suppression import away_from, suppress_overlapping
from pomona.stages.fuse.object.voting import vote
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections

_BEGINNINGS = 3  # of the search at most, as what is found first tells the size of fruits, and how ragged masks are
_ANY_SIZE = 1.0  # the spread of radii, as a share, of a fit that is to say what the size is


@dataclass(frozen=True, eq=False)
class _Found:
    """The fruits so far, and the masks that are theirs."""

    spheres: Spheres
    matches: Matches

    @property
    def support(self) -> FloatArray:
        return self.matches.support(len(self.spheres))

    def kept(self, stays: BoolArray) -> _Found:
        return _Found(self.spheres[stays], self.matches.of_spheres(stays))


_NOTHING_FOUND = _Found(Spheres.none(), Matches.none())


@dataclass(frozen=True, eq=False)
class _Search:
    """What is looked through for fruits of one size: masks, the crossings of their rays, and the gate."""

    masks: MaskRays
    size: FruitSize
    options: ObjectOptions
    gate: Gate
    crossings: Crossings

    @classmethod
    def of(cls, masks: MaskRays, size: FruitSize, options: ObjectOptions) -> _Search:
        gate = Gate(masks, size.radius_m, options)
        return cls(masks, size, options, gate, find_crossings(masks, size.radius_m, options))

    @cached_property
    def crossings_for_left_over(self) -> Crossings:
        """The crossings and, behind them, those of photos that look at each other."""
        facing = find_facing_crossings(self.masks, self.size.radius_m, self.options)
        return Crossings.joined([self.crossings, facing])


def fuse(
    detections: SurveyDetections,
    cameras: Cameras,
    *,
    options: ObjectOptions | None = None,
    progress: Progress | None = None,
) -> Fused:
    """Return the fruits that explain the detections of all photos best, without any cloud.

    Where rays to masks of two photos nearly cross are hypotheses, for which the masks of all photos vote. Then masks
    are assigned to spheres, one to one in each photo, and spheres fitted to the outlines of their masks, in turns;
    masks that are left over may be further fruits. The result does not depend on the order of photos or detections,
    and fruits are numbered by where they are.

    Centres and diameters are first estimates. No detections give no fruits. Raises `InputError` where the cameras'
    frame is not metric: the size of fruit is in metres.
    """
    options, progress = options or ObjectOptions(), progress or Silent()
    if not cameras.frame.metric:
        raise InputError(
            "Fruits can be joined only where cameras are in metres (as fruits have a size), found cameras without a "
            "scale: `place_in_world` gives them one, by markers, a scale bar, GNSS or the fruits' size"
        )
    size = fruit_ranges(detections, cameras, FruitSize(options.fruit_diameter_m)).size
    masks = mask_rays(detections, cameras.sorted_by_center(), rays_per_mask=options.rays_per_mask)
    found, masks = _find(masks, size, options, progress) if len(masks) else (_NOTHING_FOUND, masks)
    found = _Found(*merge_split_fruits(found.spheres, found.matches, masks, options))
    shown = found.matches.largest_shares(len(found.spheres)) >= options.min_share
    found = found.kept(shown)
    ids = np.empty(len(found.spheres), np.int64)
    ids[np.lexsort(found.spheres.centers_in_world.T[::-1])] = np.arange(1, len(ids) + 1)
    return fused_of(found.spheres, ids, found.matches, masks)


def _find(masks: MaskRays, size: FruitSize, options: ObjectOptions, progress: Progress) -> tuple[_Found, MaskRays]:
    """Return fruits, looked for in rounds, each in what the earlier ones left, and masks that know how ragged they are.

    It is begun anew where fruits turn out of other size, or masks less ragged than a network's.
    """
    progress.start("fuse", 1 + options.rounds)
    search, found = _Search.of(masks, size, options), _NOTHING_FOUND
    progress.advance()
    for number in range(options.rounds):
        before = len(found.spheres)
        found = _find_more(found, search, search.crossings if number == 0 else search.crossings_for_left_over)
        if number == 0:
            found, search = _begun_anew(found, search)
        progress.advance()
        if len(found.spheres) <= before:
            break
    return found, search.masks


def _find_more(found: _Found, search: _Search, crossings: Crossings) -> _Found:
    """Add the fruits at crossings that masks speak for which are no fruit's yet, and assign all masks anew."""
    masks, options, radius_m = search.masks, search.options, search.size.radius_m
    free = np.ones(len(masks), dtype=bool)
    free[found.matches.mask_idx] = False
    new = sphere_hypotheses(crossings, search.gate, masks, radius_m, options, free)
    new = new[vote(new, search.gate, masks, free, options)]
    new = new[away_from(found.spheres, new, options.overlap_radii * radius_m)]
    support = np.concatenate([found.support, np.ones(len(new))])
    spheres = Spheres.joined([found.spheres, new])
    for _ in range(options.repeats):
        found = _assign_and_refine(spheres, support, search)
        spheres, support = found.spheres, found.support
    return found


def _begun_anew(found: _Found, search: _Search) -> tuple[_Found, _Search]:
    """Return what is found first, and the search, once it knows how large fruits are and how ragged their masks."""
    size, first = _refined_size(found, search), search.size
    if abs(size.diameter_m / first.diameter_m - 1) > search.options.same_size:
        first = size
    for _ in range(_BEGINNINGS):
        masks = with_raggedness(search.masks, found.spheres, found.matches.sphere_idx, found.matches.mask_idx)
        if masks is search.masks and first is search.size:
            break
        search = _Search.of(masks, first, search.options)
        found = _find_more(_NOTHING_FOUND, search, search.crossings)
    return found, replace(search, size=size)


def _refined_size(found: _Found, search: _Search) -> FruitSize:
    """Return the size of fruits that are well seen, fitted without a prior on it; the search's where they are few."""
    n, options = len(found.spheres), search.options
    clear = np.zeros(n, dtype=bool)
    clear[found.matches.sphere_idx[found.matches.shares >= options.clear_share]] = True
    clear &= found.matches.counts(n) >= options.clear_views
    if clear.sum() < options.fewest_clear:
        return search.size
    some = found.kept(clear)
    fitted = fit_spheres(
        some.spheres, some.matches, search.masks, search.size.radius_m, options, radius_spread=_ANY_SIZE
    )
    return size_of_fruits(2 * fitted.radii_m, search.size)


def _assign_and_refine(spheres: Spheres, support: FloatArray, search: _Search) -> _Found:
    """Assign masks to spheres and fit these again; who is seen too seldom, or inside another, is no fruit."""
    masks, options, radius_m = search.masks, search.options, search.size.radius_m
    matches = assign(search.gate.matches(spheres), masks, support, options)
    found = _Found(spheres, matches)
    found = found.kept(matches.counts(len(spheres)) >= options.min_views)
    found = _Found(fit_spheres(found.spheres, found.matches, masks, radius_m, options), found.matches)
    return found.kept(suppress_overlapping(found.spheres, found.support, options.overlap_radii * radius_m))
