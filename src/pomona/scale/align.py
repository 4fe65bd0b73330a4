"""From markers in photos to a piece's place in the markers' frame: robust first, then exact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from pomona.arrays import BoolArray, FloatArray
from pomona.cameras import Cameras
from pomona.errors import InputError
from pomona.geometry import Similarity, estimate_similarity
from pomona.scale.aruco import Sighting, by_marker
from pomona.scale.triangulate import Triangulated, tolerance_px, triangulate

# Markers count as lying on one line where their spread across it is less than this share of the spread along it.
_LINE_RATIO = 0.04
_MOST_TRIPLES = 2000
# What a person can place markers to, at best: residuals below this never make a marker an outlier.
_PLACING_NOISE_M = 0.005


@dataclass(frozen=True, eq=False)
class PlacedMarker:
    """A marker seen in a piece: its sightings, and where their rays meet in the piece's own frame."""

    marker_id: int
    sightings: tuple[Sighting, ...]
    triangulated: Triangulated


def triangulate_markers(
    cameras: Cameras, sightings: Sequence[Sighting]
) -> tuple[dict[int, PlacedMarker], dict[int, str]]:
    """Return the markers that can be triangulated in a piece, and for the other sighted ones why they cannot."""
    index = {name: i for i, name in enumerate(cameras.photos)}
    placed: dict[int, PlacedMarker] = {}
    failed: dict[int, str] = {}
    for marker_id, seen in by_marker([s for s in sightings if s.photo in index]).items():
        xy_px = np.array([s.center_px for s in seen])
        found = triangulate(cameras, [index[s.photo] for s in seen], xy_px, most_error_px=tolerance_px(cameras))
        if isinstance(found, str):
            failed[marker_id] = found
        else:
            kept = tuple(s for s, good in zip(seen, found.inliers, strict=True) if good)
            placed[marker_id] = PlacedMarker(marker_id, kept, found)
    return placed, failed


def robust_similarity(points_in_source: FloatArray, points_in_target: FloatArray) -> tuple[Similarity, BoolArray]:
    """Return `target_from_source` of n ≥ 3 pairs (n, 3) and which pairs (n,) agree with it.

    Every three pairs propose one; that with the least median residual tells good pairs from wrong ones (least median
    of squares), and the good ones are fitted by least squares. With three pairs all are taken as good.

    Raises `InputError` when fewer than three pairs are given, or when they lie on one line.
    """
    n = len(points_in_source)
    if n < 3 or on_one_line(points_in_target):
        raise InputError(f"A place in space needs three markers that are not on one line, found {n} on one")
    good = np.ones(n, bool)
    if n > 3:
        triples = list(combinations(range(n), 3))
        if len(triples) > _MOST_TRIPLES:
            chosen = np.random.default_rng(0).choice(len(triples), _MOST_TRIPLES, replace=False)
            triples = [triples[i] for i in chosen]
        residuals = [_residuals_of(points_in_source, points_in_target, list(triple)) for triple in triples]
        # Of n residuals three are small by construction: judge by the middle of the others.
        rank = 3 + (n - 3) // 2
        best = min((r for r in residuals if r is not None), key=lambda r: float(np.sort(r)[rank - 1 : rank + 1].mean()))
        sigma = 1.4826 * float(np.sort(best)[rank - 1 : rank + 1].mean())
        good = best < 3 * max(sigma, _PLACING_NOISE_M)
        if good.sum() < 3 or on_one_line(points_in_target[good]):
            good = np.ones(n, bool)
    return estimate_similarity(points_in_source[good], points_in_target[good]), good


def on_one_line(points: FloatArray) -> bool:
    """Say whether points (n, 3) lie on one line, or so nearly that they do not fix a rotation about it."""
    singular = np.linalg.svd(points - points.mean(0), compute_uv=False)
    return len(points) < 3 or bool(singular[1] < _LINE_RATIO * singular[0])


def _residuals_of(source: FloatArray, target: FloatArray, triple: list[int]) -> FloatArray | None:
    if on_one_line(target[triple]) or on_one_line(source[triple]):
        return None
    similarity = estimate_similarity(source[triple], target[triple])
    return np.asarray(np.linalg.norm(similarity.apply(source) - target, axis=1))


def reprojection_px(cameras: Cameras, sightings: Sequence[Sighting], places: Mapping[int, FloatArray]) -> FloatArray:
    """Return how far (k,) each sighting's centre is from where its known place projects, in pixels."""
    index = {name: i for i, name in enumerate(cameras.photos)}
    errors = [cameras.project(index[s.photo], places[s.marker_id][None])[0][0] - s.center_px for s in sightings]
    return np.asarray(np.linalg.norm(np.array(errors).reshape(-1, 2), axis=1))
