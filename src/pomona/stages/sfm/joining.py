"""Pieces and photos without a place, brought into the frame of the largest piece by the matches between them.

A mapper places a photo by points that it knows already. Where a walk turns a corner, most matches are of points that
only two photos see: they fix how the second photo is turned and in which direction it lies, and the few points that a
third photo sees fix how far.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np

from pomona.basics.arrays import Array, FloatArray, IntArray
from pomona.basics.geometry import Similarity
from pomona.stages.sfm.colmap.two_views import Overlap
from pomona.stages.sfm.models import Model
from pomona.stages.sfm.selection import FULL_WEIGHT, TOLERANCE_PX, sampson_distance

# A pose of two photos has five degrees of freedom; with so many matches agreeing it is no accident.
_LEAST_MATCHES = 15
# One depth gives the distance; with so many, wrong ones do not matter.
LEAST_DEPTHS = 5
# Rays that meet under a smaller angle say little of depth.
_LEAST_ANGLE = np.radians(1.0)
# Distances that single points give may differ by so much (median deviation, relative).
_MOST_SPREAD = 0.25

_RelativePose = tuple[FloatArray, IntArray]


@dataclass(frozen=True, eq=False)
class MatchedPhotos:
    """What is known of n photos: their matches, their rays (k, 3), z = 1, and focal lengths in working pixels (n,)."""

    overlaps: Sequence[Overlap]
    rays: Sequence[FloatArray]
    focals_px: FloatArray
    _relative: dict[tuple[int, int], _RelativePose | None] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def overlaps_of(self) -> Mapping[int, Sequence[Overlap]]:
        """The overlaps of each photo that has some, in their order."""
        of_photo = defaultdict[int, list[Overlap]](list)
        for overlap in self.overlaps:
            of_photo[overlap.first].append(overlap)
            of_photo[overlap.second].append(overlap)
        return of_photo

    def relative_pose(self, overlap: Overlap) -> _RelativePose | None:
        """Return the second photo's pose [R | t], |t| = 1, in the first one's frame, and the matches (k, 2) that agree.

        None where few agree. It is found once for each overlap, and each way that it is turned.
        """
        pair = overlap.first, overlap.second
        if pair not in self._relative:
            self._relative[pair] = _relative_pose(overlap, self)
        return self._relative[pair]


@dataclass(frozen=True, eq=False)
class Group:
    """Photos in one frame: `poses` maps photo to [R | t] (3, 4). A photo without a place is a group of its own."""

    poses: dict[int, FloatArray]

    @classmethod
    def of_model(cls, model: Model) -> Group:
        """Return the photos of a model."""
        poses = model.cameras.cam_from_world
        return cls({int(photo): poses[i] for i, photo in enumerate(model.photo_idx)})

    @classmethod
    def of_photo(cls, photo: int) -> Group:
        """Return a photo without a place, in its own frame."""
        return cls({photo: np.eye(4)[:3]})


def join_groups(groups: Sequence[Group], scene: MatchedPhotos) -> list[Group]:
    """Return the groups, largest first, after those were joined that matches bring together.

    A group is joined where clearly more of the matches between it and the other are explained by the join than are not.
    """
    left, done = sorted(groups, key=lambda group: -len(group.poses)), list[Group]()
    while left:
        base = left.pop(0)
        while len(base.poses) > 1:
            found = [(k, _join(base, other, scene)) for k, other in enumerate(left)]
            possible = [(weight, k, group) for k, join in found if join is not None for weight, group in [join]]
            if not possible:
                break
            _, k, base = max(possible, key=lambda join: join[0])
            del left[k]
        done.append(base)
    return sorted(done, key=lambda group: -len(group.poses))


def _join(base: Group, other: Group, scene: MatchedPhotos) -> tuple[float, Group] | None:
    """Return both as one, and the weight of the matches by which; None where matches do not bring them together."""
    ours, theirs = base.poses.keys(), other.poses.keys()
    of_theirs = {id(o): o for photo in theirs for o in scene.overlaps_of.get(photo, ())}.values()
    across = [_from(overlap, ours) for overlap in of_theirs if {overlap.first, overlap.second} & ours]
    best = None
    for overlap in across:
        similarity = _similarity(base, other, overlap, scene)
        if similarity is None:
            continue
        group = Group(base.poses | _moved(other, similarity))
        explained, contradicted = _agreement(group, across, scene)
        excess = explained - contradicted
        if excess > _LEAST_MATCHES and (best is None or excess > best[0]):
            best = excess, group
    return best


def _from(overlap: Overlap, photos: Container[int]) -> Overlap:
    """The overlap, turned so that its first photo is one of these."""
    if overlap.first in photos:
        return overlap
    return Overlap(overlap.second, overlap.first, overlap.idx[:, ::-1])


def _moved(group: Group, base_from_group: Similarity) -> dict[int, FloatArray]:
    moved = {}
    for photo, pose in group.poses.items():
        rotation = pose[:, :3] @ base_from_group.rotation.T
        translation = base_from_group.scale * pose[:, 3] - rotation @ base_from_group.translation
        moved[photo] = np.column_stack([rotation, translation])
    return moved


def _agreement(group: Group, overlaps: Sequence[Overlap], scene: MatchedPhotos) -> tuple[float, float]:
    """Weights of what the group's poses explain of the matches, and of what they do not (see `selection.explained`)."""
    explained = contradicted = 0.0
    for overlap in overlaps:
        error_px = _errors_px(group.poses[overlap.first], group.poses[overlap.second], overlap, scene)
        share = float(np.clip(1 - (error_px / TOLERANCE_PX) ** 2, 0, None).mean())
        weight = float(np.clip(len(overlap.idx) - _LEAST_MATCHES, 0, FULL_WEIGHT))
        explained += weight * share
        contradicted += weight * (1 - share)
    return explained, contradicted


def _errors_px(first: FloatArray, second: FloatArray, overlap: Overlap, scene: MatchedPhotos) -> FloatArray:
    rays1, rays2 = _rays(overlap, scene)
    focal_px = (scene.focals_px[overlap.first] + scene.focals_px[overlap.second]) / 2
    return np.asarray(focal_px * sampson_distance(first, second, rays1, rays2))


def _rays(overlap: Overlap, scene: MatchedPhotos) -> tuple[FloatArray, FloatArray]:
    return scene.rays[overlap.first][overlap.idx[:, 0]], scene.rays[overlap.second][overlap.idx[:, 1]]


def _similarity(base: Group, other: Group, overlap: Overlap, scene: MatchedPhotos) -> Similarity | None:
    """Return `base_from_other` from the matches of one photo of each (the first is the base's), or None."""
    relative = scene.relative_pose(overlap)
    if relative is None:
        return None
    pose, idx = relative
    kept = Overlap(overlap.first, overlap.second, idx)
    rays1, rays2 = _rays(kept, scene)
    depth1, _ = _depths(np.eye(4)[:3], pose, rays1, rays2)
    depth2 = (depth1[:, None] * rays1 @ pose[:, :3].T + pose[:, 3])[:, 2]
    distance = _median_ratio(_known_depths(base, overlap.first, idx[:, 0], scene), depth1)
    if distance is None:
        return None
    scale: float | None = 1.0
    if len(other.poses) > 1:
        scale = _median_ratio(distance * depth2, _known_depths(other, overlap.second, idx[:, 1], scene))
    if scale is None:
        return None
    first, second = base.poses[overlap.first], other.poses[overlap.second]
    rotation = pose[:, :3] @ first[:, :3]
    translation = pose[:, :3] @ first[:, 3] + distance * pose[:, 3]
    return Similarity(scale, rotation.T @ second[:, :3], rotation.T @ (scale * second[:, 3] - translation))


def _relative_pose(overlap: Overlap, scene: MatchedPhotos) -> _RelativePose | None:
    if len(overlap.idx) < _LEAST_MATCHES:
        return None
    rays1, rays2 = _rays(overlap, scene)
    focal_px = (scene.focals_px[overlap.first] + scene.focals_px[overlap.second]) / 2
    cv2.setRNGSeed(0)
    essential, mask = cv2.findEssentialMat(
        rays1[:, :2], rays2[:, :2], np.eye(3), cv2.RANSAC, 0.9999, TOLERANCE_PX / 2 / focal_px
    )
    if essential is None or essential.shape != (3, 3):
        return None
    _, rotation, translation, mask = cv2.recoverPose(essential, rays1[:, :2], rays2[:, :2], np.eye(3), mask=mask)
    idx = overlap.idx[mask.ravel() > 0]
    return (np.column_stack([rotation, translation.ravel()]), idx) if len(idx) >= _LEAST_MATCHES else None


def _known_depths(group: Group, photo: int, keypoints: IntArray, scene: MatchedPhotos) -> FloatArray:
    """Depths (k,) of keypoints in a photo of a group, by the rays of the group's other photos; NaN where there is none.

    Of several, that under the widest angle.
    """
    depths, angles = np.full(len(scene.rays[photo]), np.nan), np.zeros(len(scene.rays[photo]))
    for overlap in scene.overlaps_of.get(photo, ()):
        if not {overlap.first, overlap.second} <= group.poses.keys():
            continue
        forward = _from(overlap, {photo})
        poses = group.poses[photo], group.poses[forward.second]
        good = _errors_px(*poses, forward, scene) < TOLERANCE_PX / 2
        found, angle = _depths(*poses, *_rays(forward, scene))
        at = forward.idx[:, 0]
        better = good & (found > 0) & (angle > np.maximum(angles[at], _LEAST_ANGLE))
        depths[at[better]], angles[at[better]] = found[better], angle[better]
    return np.asarray(depths[keypoints])


def _depths(
    pose1: FloatArray, pose2: FloatArray, rays1: FloatArray, rays2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Depths (k,) in the first photo where its rays (k, 3) come nearest to the second's; the angles between them."""
    rotation = pose2[:, :3] @ pose1[:, :3].T
    translation = pose2[:, 3] - rotation @ pose1[:, 3]
    turned = rays1 @ rotation.T
    normal, offset = np.cross(rays2, turned), np.cross(rays2, translation)
    square = (normal**2).sum(1)
    sine = np.sqrt(square) / np.linalg.norm(rays2, axis=1) / np.linalg.norm(turned, axis=1)
    depths = -(normal * offset).sum(1) / np.maximum(square, 1e-18)
    return np.asarray(depths), np.asarray(np.arcsin(np.clip(sine, 0, 1)))


def _median_ratio(over: FloatArray, under: FloatArray) -> float | None:
    """The median ratio of two depths of the same points; None where there are few, or where they do not agree."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios: Array = over / under
    ratios = ratios[np.isfinite(ratios) & (ratios > 0)]
    if len(ratios) < LEAST_DEPTHS:
        return None
    middle = float(np.median(ratios))
    return middle if float(np.median(np.abs(ratios / middle - 1))) < _MOST_SPREAD else None
