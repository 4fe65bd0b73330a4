"""Markers that a piece does not fit as a rigid whole: wrong ones, and right ones where a long piece is bent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from pomona.adjustment.bundle import adjust_landmarks, feature_noise_px
from pomona.adjustment.covariance import covariance
from pomona.adjustment.weights import Landmark, weighted
from pomona.stages.scale.placement import Adjusted

# A place is known no better than a person can put up a marker.
_PLACED_M = 0.005
# Of a point that nothing is known of, in metres.
_UNKNOWN_M = 10.0
# Markers that are right are farther off by chance so often.
_CHANCE = 0.003


def markers_within_bends(
    adjusted: Adjusted, doubted: Mapping[int, Landmark], focals: Sequence[tuple[float, float] | None]
) -> set[int]:
    """Return which of the doubted markers may be where they are said to be, by cameras adjusted on the others.

    A doubted marker is a free point, seen as it is. Where the cameras have it is compared with its place: the offset is
    as large as the adjustment is uncertain there (its covariance), or the marker is wrong. At the end of a long piece
    that is decimetres, among the markers of a short one millimetres.
    """
    if not doubted:
        return set()
    cameras, known = adjusted.cameras, list(adjusted.markers.values())
    noise_px = feature_noise_px(cameras)
    free = [replace(marker, sd_m=_UNKNOWN_M) for marker in doubted.values()]
    cameras, places = adjust_landmarks(cameras, noise_px=noise_px, landmarks=[*known, *free], focals=focals)
    free = [replace(marker, place=place) for marker, place in zip(free, places[len(known) :], strict=True)]
    covariances = covariance(*weighted(cameras, noise_px=noise_px, landmarks=[*known, *free], focals=focals))
    placed_m = max(_PLACED_M, *(marker.sd_m for marker in known))
    offsets_m = np.array([marker.place - doubted[i].place for i, marker in zip(doubted, free, strict=True)])
    spread = covariances.known_points[len(known) :] + placed_m**2 * np.eye(3)
    squares = np.einsum("qi,qi->q", offsets_m, np.linalg.solve(spread, offsets_m[:, :, None])[:, :, 0])
    return {i for i, square in zip(doubted, squares, strict=True) if square < chdtri(3, _CHANCE)}
