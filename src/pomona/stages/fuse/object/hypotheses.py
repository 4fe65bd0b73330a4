"""Sphere hypotheses: crossings of rays that masks of several photos speak for, fitted to these masks."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import BoolArray, places_within
from pomona.fruit.geometry.mask_rays import MaskRays
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.object.crossings import Crossings
from pomona.stages.fuse.object.gating import Gate
from pomona.stages.fuse.object.matches import Matches
from pomona.stages.fuse.object.options import ObjectOptions
from pomona.stages.fuse.object.refinement import fit_spheres
from pomona.stages.fuse.object.suppression import suppress_hypotheses

# Hypotheses are fitted roughly: so often, in so many steps, with radii that hardly differ.
_FITS, _FIT_ROUNDS, _FIT_SPREAD = 2, 4, 0.02


def sphere_hypotheses(
    crossings: Crossings, gate: Gate, masks: MaskRays, radius_m: float, options: ObjectOptions, free: BoolArray
) -> Spheres:
    """Return spheres that `free` (n,) masks of at least two photos speak for, fitted to these, one in each place."""
    points = crossings.points_in_world[free[crossings.one_idx] & free[crossings.other_idx]]
    spheres = Spheres.alike(points, radius_m)
    matches = gate.best_matches(spheres, free=free, quick=True)
    before, after = (radii * radius_m for radii in options.hypothesis_radii)
    spheres = spheres[suppress_hypotheses(spheres, matches, masks, before)]
    for _ in range(_FITS):
        matches = gate.best_matches(spheres, free=free)
        seen = matches.counts(len(spheres)) >= 2
        spheres, matches = spheres[seen], _evenly_spread(matches.of_spheres(seen), masks, options.hypothesis_views)
        fitted = fit_spheres(spheres, matches, masks, radius_m, options, rounds=_FIT_ROUNDS, radius_spread=_FIT_SPREAD)
        spheres = Spheres.alike(fitted.centers_in_world, radius_m)
    matches = gate.best_matches(spheres, free=free)
    return spheres[suppress_hypotheses(spheres, matches, masks, after)]


def _evenly_spread(matches: Matches, masks: MaskRays, most: int) -> Matches:
    """Return at most `most` matches of each sphere, of photos evenly spread among those that see it."""
    order = np.lexsort((masks.photo_idx[matches.mask_idx], matches.sphere_idx))
    idx = matches.sphere_idx[order]
    counts = np.bincount(idx)
    place, total = places_within(counts), counts[idx]
    # Kept is who steps into the next of `most` equal parts.
    kept = (place * most) // total != ((place - 1) * most) // total
    return matches[order[kept | (total <= most)]]
