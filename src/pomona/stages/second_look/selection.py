"""Selection: which hypotheses are fruits, as together they explain masks and photos best, and whose each mask is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, groups
from pomona.fruit.geometry.mask_rays import MaskRays
from pomona.stages.fuse.object import ObjectOptions
from pomona.stages.fuse.object.assignment import tabulated
from pomona.stages.fuse.object.gating import Gate, best_in_photo
from pomona.stages.fuse.object.matches import Matches
from pomona.stages.second_look.looked import Looked
from pomona.stages.second_look.options import SecondLookOptions

_SWEEPS = 4  # of the search; in the second or third nothing changes any more
_GAIN = 1e-6  # nats: by less, no selection is better
# Nats: a hypothesis whose masks no other wants is worth this at least, whatever photos show. Whether it is fruit, the
# filter decides; of fruit that the network does not know, photos speak for none.
_LEAST_ALONE = 0.1


def select(
    hypotheses: Looked, masks: MaskRays, radius_m: float, options: SecondLookOptions, association: ObjectOptions
) -> tuple[BoolArray, Matches]:
    """Return which hypotheses (n,) are fruits, and the masks of these, numbered anew.

    Of all sets in which no two are nearer than `overlap_radii`, one is sought that is worth most (hypothesis selection
    by description length, as in Leibe, Leonardis and Schiele 2008): what photos show at the place of each, in nats,
    less `fruit_nats` (neither where none looked), and for masks, one to one in each photo, `mask_nats` times how well
    they fit. One whose masks no other wants is worth something, as whether it is fruit the filter decides. Each
    hypothesis is tried in place of those that are too near to it, and each is tried to do without, until nothing is
    better.
    """
    n, spheres = len(hypotheses.spheres), hypotheses.spheres
    matches = Gate(masks, radius_m, association).matches(spheres)
    looked = ~np.isnan(hypotheses.shown.seen)  # of what no photo could be looked at, masks alone say that it is there
    own_nats = np.where(looked, hypotheses.shown.likelihoods_nats - options.fruit_nats, 0.0)
    rivals = cKDTree(spheres.centers_in_world).query_ball_point(
        spheres.centers_in_world, options.overlap_radii * radius_m, return_sorted=True
    )
    selection = _Selection(_parts_of(matches, masks, options.mask_nats), own_nats)
    able = np.flatnonzero(_enough(best_in_photo(matches, masks, -matches.worths), n, association))
    order = able[np.argsort(-selection.alone_nats[able], kind="stable")].tolist()
    for _ in range(_SWEEPS):
        better = [selection.exchange([j for j in rivals[i] if selection.chosen[j]], [i])
                  for i in order if not selection.chosen[i]]  # fmt: skip
        better += [selection.exchange([i], []) for i in reversed(order) if selection.chosen[i]]
        if not any(better):
            break
    matches = matches[selection.assigned()]
    stays = selection.chosen & _enough(matches, n, association)
    return stays, matches.of_spheres(stays)


def _enough(matches: Matches, spheres: int, association: ObjectOptions) -> BoolArray:
    """Say of each sphere (n,) whether it has as many masks, and as much of it is seen, as the association asks."""
    counts, shares = matches.counts(spheres), matches.largest_shares(spheres)
    return np.asarray((counts >= association.min_views) & (shares >= association.min_share))


@dataclass(frozen=True, eq=False)
class _Part:
    """Spheres (s,) and masks of one photo that could be each other's, apart from all others.

    `nats` (s, m): what a mask is worth as a sphere's, 0 where it does not fit; `pairs` (s, m): the matches, or −1.
    """

    sphere_idx: IntArray
    nats: FloatArray
    pairs: IntArray

    def worth_nats(self, chosen: BoolArray) -> float:
        """Return what the masks are worth that go to the `chosen` of all spheres (n,), each to one."""
        nats = self.nats[chosen[self.sphere_idx]]
        if min(nats.shape) <= 1:
            return float(nats.max(initial=0))
        return float(nats[linear_sum_assignment(nats, maximize=True)].sum())

    def assigned(self, chosen: BoolArray) -> IntArray:
        """Return the matches of the masks that go to the `chosen` of all spheres (n,)."""
        rows = chosen[self.sphere_idx]
        pairs = self.pairs[rows][linear_sum_assignment(self.nats[rows], maximize=True)]
        found: IntArray = pairs[pairs >= 0]
        return found


def _parts_of(matches: Matches, masks: MaskRays, mask_nats: float) -> list[_Part]:
    photos, n_masks = masks.photo_idx[matches.mask_idx], len(masks)
    in_photo, node = np.unique(np.stack([photos, matches.sphere_idx]), axis=1, return_inverse=True)
    size = n_masks + in_photo.shape[1]
    graph = coo_array((np.ones(len(matches)), (matches.mask_idx, n_masks + node.ravel())), shape=(size, size))
    label = connected_components(graph, directed=False)[1].astype(np.int64)
    nats = mask_nats * matches.worths
    return [_Part(*tabulated(matches, nats, mine, 0.0)) for _, mine in groups(label[matches.mask_idx])]


class _Selection:
    """The spheres that are `chosen` (n,), at first none, and what all masks are worth as theirs."""

    def __init__(self, parts: list[_Part], own_nats: FloatArray) -> None:
        self.chosen = np.zeros(len(own_nats), dtype=bool)
        masks_nats = np.zeros(len(own_nats))
        self._worth_nats = [0.0] * len(parts)
        self._of_sphere: list[list[int]] = [[] for _ in own_nats]
        for k, part in enumerate(parts):
            masks_nats[part.sphere_idx] += part.nats.max(1)
            for i in part.sphere_idx.tolist():
                self._of_sphere[i].append(k)
        self.alone_nats = np.maximum(own_nats + masks_nats, _LEAST_ALONE)
        self._parts, self._own_nats = parts, self.alone_nats - masks_nats

    def exchange(self, out: list[int], new: list[int]) -> bool:
        """Take spheres out and choose `new` ones, if that is better; return whether it is."""
        self.chosen[out], self.chosen[new] = False, True
        touched = sorted({k for i in (*out, *new) for k in self._of_sphere[i]})
        worth_nats = [self._parts[k].worth_nats(self.chosen) for k in touched]
        gain = sum(worth_nats) - sum(self._worth_nats[k] for k in touched)
        gain += float(self._own_nats[new].sum() - self._own_nats[out].sum())
        if gain <= _GAIN:
            self.chosen[new], self.chosen[out] = False, True
            return False
        for k, nats in zip(touched, worth_nats, strict=True):
            self._worth_nats[k] = nats
        return True

    def assigned(self) -> IntArray:
        """Return the matches of all masks that are a chosen sphere's, in order."""
        parts = [part.assigned(self.chosen) for part in self._parts if self.chosen[part.sphere_idx].any()]
        return np.sort(np.concatenate([np.zeros(0, np.int64), *parts]))
