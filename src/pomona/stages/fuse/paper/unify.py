"""Detections of one fruit in several photos, unified by the points of the cloud that they share."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.stages.fuse.paper.options import Overlap, Unify


@dataclass
class Sighting:
    """One detection that saw a fruit."""

    photo_idx: int
    detection_idx: int


@dataclass
class _Candidate:
    """A fruit in the making: how many points it holds now, all it ever took, and who saw it."""

    size: int = 0
    taken: list[IntArray] = field(default_factory=list)
    sightings: list[Sighting] = field(default_factory=list)


class Unifier:
    """Takes the points of one detection after the other; each point of the cloud belongs to one fruit or none.

    A detection takes its points from whichever fruit had them before, as in the authors' published code. The work for a
    detection depends on its own points and those of the fruits they belong to, not on the length of the row.
    """

    def __init__(self, points: int, overlap: Overlap, min_overlap: float, unify: Unify) -> None:
        self._label = np.zeros(points, np.int64)
        self._detections, self._score_sums = np.zeros(points, np.int64), np.zeros(points)
        self._fruits: dict[int, _Candidate] = {}
        self._overlap, self._min_overlap, self._unify = overlap, min_overlap, unify
        self._last = 0

    @property
    def detections(self) -> IntArray:
        """How many detections took each point."""
        return self._detections

    @property
    def mean_scores(self) -> FloatArray:
        """The mean score of the detections that took each point; 0 of none."""
        means: FloatArray = self._score_sums / np.maximum(self._detections, 1)
        return means

    def add(self, points_idx: IntArray, sighting: Sighting, score: float = 0.0) -> None:
        """Give a detection's points (indices without repetition) to the fruit it overlaps, or to a new one."""
        self._detections[points_idx] += 1
        self._score_sums[points_idx] += score
        fits = self._overlapping(points_idx)
        if fits:
            target, *others = fits
            for other in others if self._unify == "all" else []:
                self._merge(target, other)
        else:
            self._last += 1
            target = self._last
            self._fruits[target] = _Candidate()
        self._take(target, points_idx)
        self._fruits[target].sightings.append(sighting)

    def fruits(self) -> list[tuple[IntArray, list[Sighting]]]:
        """Return for every fruit, in order of first sight, the indices of its points and its sightings."""
        found = [(self._members(label), self._fruits[label].sightings) for label in sorted(self._fruits)]
        return [(members, sightings) for members, sightings in found if len(members)]

    def _overlapping(self, points_idx: IntArray) -> list[int]:
        """Return the fruits that overlap enough, the best first; where the first is to be joined, the earliest."""
        labels, counts = np.unique(self._label[points_idx], return_counts=True)
        scored = []
        for label, shared in zip(labels.tolist(), counts.tolist(), strict=True):
            if label:
                overlap = self._measure(shared, len(points_idx), self._fruits[label].size)
                if overlap > self._min_overlap:
                    scored.append((-overlap, label))
        return (
            sorted(label for _, label in scored) if self._unify == "first" else [label for _, label in sorted(scored)]
        )

    def _measure(self, shared: int, mine: int, theirs: int) -> float:
        return shared / (min(mine, theirs) if self._overlap == "either" else mine + theirs - shared)

    def _take(self, target: int, points_idx: IntArray) -> None:
        labels, counts = np.unique(self._label[points_idx], return_counts=True)
        for label, count in zip(labels.tolist(), counts.tolist(), strict=True):
            if label:
                self._fruits[label].size -= count
        self._label[points_idx] = target
        self._fruits[target].size += len(points_idx)
        self._fruits[target].taken.append(points_idx)

    def _merge(self, target: int, other: int) -> None:
        self._take(target, self._members(other))
        self._fruits[target].sightings += self._fruits.pop(other).sightings

    def _members(self, label: int) -> IntArray:
        taken = np.unique(np.concatenate(self._fruits[label].taken))
        members: IntArray = taken[self._label[taken] == label]
        return members
