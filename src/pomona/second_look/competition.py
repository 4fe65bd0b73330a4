"""Which masks are whose, and with that which fruits there are: the likelier ones take theirs first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona.arrays import BoolArray
from pomona.fruit_geometry.mask_rays import MaskRays
from pomona.fuse.object import ObjectOptions
from pomona.fuse.object.assignment import assign
from pomona.fuse.object.gating import Gate
from pomona.fuse.object.matches import Matches
from pomona.fuse.object.suppression import suppress_overlapping
from pomona.second_look.looked import Looked
from pomona.second_look.options import SecondLookOptions

_MOST_NATS = 8.0  # beyond these, fruits are alike


def compete(
    looked: Looked, masks: MaskRays, radius_m: float, options: SecondLookOptions, association: ObjectOptions
) -> tuple[BoolArray, Matches]:
    """Return which spheres (n,) are fruits, and the masks of these, numbered anew.

    Masks are assigned as in the association, but that spheres have as much support as photos speak for them. Of two
    that overlap the likelier one stays.
    """
    n, support = len(looked.spheres), np.exp(np.minimum(looked.shown.likelihoods_nats, _MOST_NATS))
    by_nats = replace(association, support_weight=options.nat_weight)
    matches = assign(Gate(masks, radius_m, association).matches(looked.spheres), masks, support, by_nats)
    stays = (matches.counts(n) >= association.min_views) & (matches.largest_shares(n) >= association.min_share)
    idx, overlap_m = np.flatnonzero(stays), options.overlap_radii * radius_m
    stays[idx] = suppress_overlapping(looked.spheres[idx], looked.shown.likelihoods_nats[idx], overlap_m)
    return stays, matches.of_spheres(stays)
