"""Voting: each mask votes for the best supported of the hypotheses that it fits; who wins its masks is a fruit."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import BoolArray, IntArray
from pomona.fruit.geometry.mask_rays import MaskRays
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.object.gating import Gate, best_in_photo
from pomona.stages.fuse.object.options import ObjectOptions


def vote(spheres: Spheres, gate: Gate, masks: MaskRays, free: BoolArray, options: ObjectOptions) -> IntArray:
    """Return the hypotheses that the `free` (n,) masks vote for, each for the best supported of all that it fits.

    In rounds: who wins nearly all masks that fit it is a fruit, and its masks are taken; the others lose these.
    """
    matches, n = gate.matches(spheres, free=free), len(spheres)
    free, running = free.copy(), np.ones(n, dtype=bool)
    winners: list[IntArray] = []
    while True:
        matches = matches[free[matches.mask_idx] & running[matches.sphere_idx]]
        best = best_in_photo(matches, masks)
        support, counts = best.support(n), best.counts(n)
        running &= (support >= options.min_support) & (counts >= 2)
        best = best[running[best.sphere_idx]]
        if len(best) == 0:
            return np.concatenate(winners) if winners else np.zeros(0, np.int64)
        order = np.lexsort((best.sphere_idx, -support[best.sphere_idx], best.mask_idx))
        first = np.ones(len(order), dtype=bool)
        first[1:] = np.diff(best.mask_idx[order]) > 0
        votes = best[order[first]]
        won = running & (votes.counts(n) >= options.won_share * counts)
        if not won.any():
            won[np.argmax(np.where(running, support, -1))] = True
        free[votes.mask_idx[won[votes.sphere_idx]]] = False
        running &= ~won
        winners.append(np.flatnonzero(won))
