"""The paper's fusion: detections projected onto the cloud of fruit, section 2.2.3 of Gené-Mola et al. 2020."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona.errors import InputError
from pomona.progress import Progress, Silent, track
from pomona.stages.fuse.fused import Fused
from pomona.stages.fuse.paper.assemble import Member, assemble
from pomona.stages.fuse.paper.clustering import nearest_group, nearest_reach, split_in_two
from pomona.stages.fuse.paper.options import PaperOptions
from pomona.stages.fuse.paper.projection import MIN_DLT_POINTS, Projector
from pomona.stages.fuse.paper.unify import Sighting, Unifier
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import FruitCloud

# Side of the cubes that the cloud is sorted into, in DBSCAN distances: about a tree's branch.
_CELL_EPS = 20


def fuse(
    detections: SurveyDetections,
    cameras: Cameras,
    cloud: FruitCloud,
    *,
    options: PaperOptions | None = None,
    progress: Progress | None = None,
) -> Fused:
    """Return the fruits that the detections cut out of the cloud, photo after photo in the order of `cameras`.

    Each detection takes the points that project into its mask; of these the connected group nearest to the camera is
    kept; where it overlaps an earlier fruit they are one, else it is a new fruit. Centres and diameters are first
    estimates. No detections or no points give no fruits.

    Raises `InputError` where the cameras' frame is not metric (the distances above are metres), and where cameras are
    to be fitted to their sparse points, but have none.
    """
    options, progress = options or PaperOptions(), progress or Silent()
    _check(cameras, options)
    unifier = Unifier(len(cloud), options.overlap, options.min_overlap, options.unify)
    projector = Projector(cameras, cloud.points_in_world, _CELL_EPS * options.eps_m, options.projection)
    nearest = nearest_reach if options.grouping == "reach" else nearest_group
    for photo_idx, photo in enumerate(track(cameras.photos, progress, "fuse")):
        found = detections.get(photo)
        if found is None:
            continue
        for k, points_idx, depth_m in projector.points_in_masks(photo_idx, found):
            if found.scores[k] < options.min_score:
                continue
            points = cloud.points_in_world[points_idx]
            group = nearest(points, depth_m, eps_m=options.eps_m, min_points=options.dbscan_min_points)
            if len(group):
                unifier.add(points_idx[group], Sighting(photo_idx, k), float(found.scores[k]))
    members = _split([m for m in unifier.fruits() if _kept(m, options)], cloud, options.split_above_points)
    labelled = replace(cloud, detections=unifier.detections, scores=unifier.mean_scores)
    return assemble(members, detections, cameras, labelled, options)


def _check(cameras: Cameras, options: PaperOptions) -> None:
    if not cameras.frame.metric:
        raise InputError(
            "The paper's method needs cameras in metres (its DBSCAN distance is 3 cm), found cameras without a scale: "
            "`place_in_world` gives them one, by markers, a scale bar, GNSS or the fruits' size"
        )
    seen = np.bincount(cameras.track_photo_idx, minlength=len(cameras))
    if options.projection == "dlt" and len(cameras) and seen.max() < MIN_DLT_POINTS:
        raise InputError(
            f"The published code fits each camera to its tie points, at least {MIN_DLT_POINTS} a photo, but these "
            "cameras have none: give cameras with tie points, or leave `variant` published-code out"
        )


def _kept(member: Member, options: PaperOptions) -> bool:
    points_idx, sightings = member
    views = len({sighting.photo_idx for sighting in sightings})
    return len(points_idx) >= options.min_points and views >= options.min_views


def _split(members: list[Member], cloud: FruitCloud, above_points: int | None) -> list[Member]:
    """Split what has too many points for one fruit; both halves were seen by all of its detections."""
    result: list[Member] = []
    for points_idx, sightings in members:
        if above_points is None or len(points_idx) <= above_points:
            result.append((points_idx, sightings))
            continue
        half = split_in_two(cloud.points_in_world[points_idx])
        result += [(points_idx[half == h], sightings) for h in (0, 1)]
    return result
