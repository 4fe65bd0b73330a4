"""Fruits that photos show beside those found: places at which evidence that nothing explains yet agrees."""

from __future__ import annotations

from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.object.suppression import away_from, suppress_overlapping
from pomona.stages.second_look.evidence import Evidence
from pomona.stages.second_look.explained import unexplained
from pomona.stages.second_look.grid_search import GridSearch
from pomona.stages.second_look.looked import Looked
from pomona.stages.second_look.options import SecondLookOptions
from pomona.values.cameras import Cameras


def proposed(
    starts: Spheres, found: Looked, evidence: Evidence, cameras: Cameras, options: SecondLookOptions, radius_m: float
) -> Looked:
    """Return further fruits of the usual `radius_m`, about `starts`, which the sights of the evidence are of.

    What the fruits `found` explain is left out. They may be as near as `new_radii` to one of these, as that one may be
    in the wrong place: which of the two it is, `selection` decides.
    """
    left = unexplained(evidence, found.spheres, found.shown.seen, cameras, options, own=True)
    search = GridSearch(left, cameras, options, options.new_reach, options.new_steps, radius_m)
    new = search.best(Spheres.alike(starts.centers_in_world, radius_m))
    new = new[new.shown.likelihoods_nats > options.new_nats]
    new = new[away_from(found.spheres, new.spheres, options.new_radii * radius_m)]
    return new[suppress_overlapping(new.spheres, new.shown.likelihoods_nats, options.overlap_radii * radius_m)]
