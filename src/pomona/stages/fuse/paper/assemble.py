"""From points and sightings of each fruit to the values that a fusion gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona.basics.arrays import IntArray
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.stages.fuse.fused import Fused
from pomona.stages.fuse.paper.options import PaperOptions
from pomona.stages.fuse.paper.sphere_fit import first_estimates
from pomona.stages.fuse.paper.unify import Sighting
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations

# One fruit: the indices of its points in the cloud, and who saw it.
Member = tuple[IntArray, list[Sighting]]


def assemble(
    members: list[Member], detections: SurveyDetections, cameras: Cameras, cloud: FruitCloud, options: PaperOptions
) -> Fused:
    """Return the fruits numbered from 1 in the order given, their observations, and the cloud with their ids."""
    fruit_id = np.zeros(len(cloud), np.int64)
    for new_id, (points_idx, _) in enumerate(members, start=1):
        fruit_id[points_idx] = new_id
    labelled = replace(cloud, fruit_id=fruit_id)
    if not members:
        return Fused(Fruits.empty(), Observations.empty(), labelled)
    eyes = cameras.centers_in_world
    centers, diameters = first_estimates(
        [cloud.points_in_world[points_idx] for points_idx, _ in members],
        [eyes[[s.photo_idx for s in sightings]] for _, sightings in members],
        size_by_widths(members, detections, cameras, cloud),
        options,
    )
    ids = np.arange(1, len(members) + 1)
    views = np.array([len({s.photo_idx for s in sightings}) for _, sightings in members])
    scores = np.array([_mean_score(sightings, detections, cameras) for _, sightings in members])
    fruits = Fruits(ids, centers, diameters, scores, views)
    return Fused(fruits, _observations(members, detections, cameras), labelled)


def size_by_widths(
    members: list[Member], detections: SurveyDetections, cameras: Cameras, cloud: FruitCloud
) -> FruitSize:
    """Return the median over fruits, at least one, of the width of the widest mask of each at the depth of its points.

    A mask's width is the shorter side of its box: neighbours under one mask make only the longer side longer. Leaves
    make masks narrower, but seldom all masks of a fruit.
    """
    widths = []
    for points_idx, sightings in members:
        middle = np.append(cloud.points_in_world[points_idx].mean(0), 1.0)
        each = []
        for sighting in sightings:
            mask = detections[cameras.photos[sighting.photo_idx]].masks[sighting.detection_idx]
            depth_m = float(cameras.cam_from_world[sighting.photo_idx][2] @ middle)
            focal_px = cameras.intrinsics_of(sighting.photo_idx).focal_px
            each.append(min(mask.width_px, mask.height_px) * depth_m / focal_px)
        widths.append(max(each))
    return size_of_fruits(np.array(widths), FruitSize())


def _mean_score(sightings: list[Sighting], detections: SurveyDetections, cameras: Cameras) -> float:
    return float(np.mean([detections[cameras.photos[s.photo_idx]].scores[s.detection_idx] for s in sightings]))


def _observations(members: list[Member], detections: SurveyDetections, cameras: Cameras) -> Observations:
    seen = [(new_id, s) for new_id, (_, sightings) in enumerate(members, start=1) for s in sightings]
    photos = tuple(cameras.photos[s.photo_idx] for _, s in seen)
    found = [(detections[photo], s.detection_idx) for photo, (_, s) in zip(photos, seen, strict=True)]
    return Observations(
        np.array([new_id for new_id, _ in seen]),
        photos,
        np.array([d.ids[k] for d, k in found]),
        np.array([d.masks[k].center_px for d, k in found]),
    )
