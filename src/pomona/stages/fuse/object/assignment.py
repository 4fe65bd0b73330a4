"""Assignment: which mask is whose, one to one in each photo."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from pomona.basics.arrays import FloatArray, IntArray
from pomona.fruit.geometry.mask_rays import MaskRays
from pomona.stages.fuse.object.matches import Matches
from pomona.stages.fuse.object.options import ObjectOptions

# What a mask costs that does not fit: as many masks as can be are assigned.
_NEVER = 1e3
# Support below this counts as this: one mask that fits badly.
_LEAST_SUPPORT = 0.3


def assign(matches: Matches, masks: MaskRays, support: FloatArray, options: ObjectOptions) -> Matches:
    """Return one-to-one matches in each photo, of the least total cost; fruits with much `support` (n,) go first.

    The cost is the misfit, less `options.support_weight` times the logarithm of the support.
    """
    costs = matches.misfits - options.support_weight * np.log(np.maximum(support[matches.sphere_idx], _LEAST_SUPPORT))
    photo_idx = masks.photo_idx[matches.mask_idx]
    order = np.argsort(photo_idx, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(photo_idx[order])) + 1)
    chosen = [_in_photo(matches, costs, part) for part in parts if len(part)]
    return matches[np.concatenate([*chosen, np.zeros(0, np.int64)]).astype(np.int64)]


def tabulated(
    matches: Matches, values: FloatArray, part: IntArray, no_pair: float
) -> tuple[IntArray, FloatArray, IntArray]:
    """Return the spheres (s,) of matches `part` (k,), and tables (s, m) of these and their masks.

    The tables have the `values` of all matches, `no_pair` where a mask is not a sphere's, and which match it is, or −1.
    """
    spheres, row = np.unique(matches.sphere_idx[part], return_inverse=True)
    masks, column = np.unique(matches.mask_idx[part], return_inverse=True)
    table, match = np.full((len(spheres), len(masks)), no_pair), np.full((len(spheres), len(masks)), -1)
    table[row, column], match[row, column] = values[part], part
    return spheres, table, match


def _in_photo(matches: Matches, costs: FloatArray, part: IntArray) -> IntArray:
    _, matrix, match = tabulated(matches, costs, part, _NEVER)
    # As many as can be are assigned; a mask that may be a fruit's at all is better than none.
    rows, columns = linear_sum_assignment(matrix)
    found = match[rows, columns]
    result: IntArray = found[found >= 0]
    return result
