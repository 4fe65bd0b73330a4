"""Why a photo has no place, and what a person can do about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.stages.sfm.colmap.two_views import Overlap
from pomona.stages.sfm.pieces import Unregistered
from pomona.values.photos import Photo

# Sharpness below this part of the usual one is called blur.
_BLURRED = 0.4
# Fewer features than these are blamed, where others have at least twice as many; fewer than the least always are.
_FEW_FEATURES, _LEAST_FEATURES = 300, 50
# With as many matches with a placed photo, too little overlap is not the reason.
_ENOUGH_MATCHES = 60

_SHARPER = "Take photos with a shorter exposure, hold still, or walk more slowly; then take this place again."
_TEXTURE = "Keep the tree in the frame, not sky, fog or a plain wall, and check exposure and focus."
_CLOSER = "Take photos at shorter steps, so that each shares at least two thirds of its view with the next."
_SIDEWAYS = "Move sideways between photos instead of turning on the spot: a tenth of the distance to the row each time."


@dataclass(frozen=True, eq=False)
class RegistrationEvidence:
    """What is known of n photos after matching and mapping.

    `features` (n,) counts; `sharpness` (n,); `unreadable` maps photo to reason; `placed` the photos that have a place;
    `dropped` photos that were in a piece too small or not credible.
    """

    photos: Sequence[Photo]
    features: IntArray
    sharpness: FloatArray
    unreadable: Mapping[int, str]
    overlaps: Sequence[Overlap]
    placed: frozenset[int]
    dropped: frozenset[int]


def explain_unregistered(evidence: RegistrationEvidence) -> list[Unregistered]:
    """Return a reason and an advice for each photo without a place."""
    lost = [i for i in range(len(evidence.photos)) if i not in evidence.placed]
    partners = _partners(evidence)
    typical = _typical(evidence)
    unregistered = []
    for i in lost:
        reason, advice = _reason(i, evidence, partners[i], typical)
        unregistered.append(Unregistered(evidence.photos[i].name, evidence.photos[i].side, reason, advice))
    return unregistered


def _reason(
    i: int, evidence: RegistrationEvidence, partners: Mapping[int, int], typical: tuple[float, float]
) -> tuple[str, str]:
    if i in evidence.unreadable:
        return evidence.unreadable[i], "Copy the file again from the camera, or remove it."
    features, usual_features = int(evidence.features[i]), typical[0]
    ratio = float(evidence.sharpness[i]) / max(typical[1], 1e-9)
    blurred = ratio < _BLURRED
    soft = f"it is blurred ({100 * ratio:.0f} % of the usual sharpness)"
    if features < min(_FEW_FEATURES, 0.5 * usual_features) or features < _LEAST_FEATURES:
        cause = "it is blurred: " if blurred else ""
        return f"{cause}only {features} features were found, others have about {usual_features:.0f}", (
            _SHARPER if blurred else _TEXTURE
        )
    if not partners:
        if blurred:
            return f"{soft} and matches no other photo", _SHARPER
        return "it matches no other photo: no overlap with its neighbours, or the scene moved between them", _CLOSER
    known = {j: count for j, count in partners.items() if j in evidence.placed}
    best = max(partners, key=lambda j: partners[j])
    count, name = partners[best], evidence.photos[best].name
    if blurred:
        return f"{soft}: at most {count} matches, with {name}", _SHARPER
    if i in evidence.dropped:
        return "it could be placed by too few points, or with too few other photos only, not beside the rest", _CLOSER
    if not known:
        others = ", ".join(evidence.photos[j].name for j in sorted(partners)[:3])
        return f"it overlaps only with photos that have no place either ({others})", _CLOSER
    best = max(known, key=lambda j: known[j])
    weak = f"its best match is {evidence.photos[best].name} with {known[best]} points"
    if known[best] < _ENOUGH_MATCHES:
        return f"it overlaps too little with the photos that have a place: {weak}", _CLOSER
    return f"it matches placed photos, but too few points in depth could be found from them: {weak}", _SIDEWAYS


def _partners(evidence: RegistrationEvidence) -> list[dict[int, int]]:
    """For each photo the photos that it has verified matches with, and how many."""
    partners: list[dict[int, int]] = [{} for _ in evidence.photos]
    for overlap in evidence.overlaps:
        partners[overlap.first][overlap.second] = partners[overlap.second][overlap.first] = len(overlap.idx)
    return partners


def _typical(evidence: RegistrationEvidence) -> tuple[float, float]:
    """Medians of features and sharpness over the photos that have a place, or over all where none has."""
    among = sorted(evidence.placed) or list(range(len(evidence.photos)))
    return float(np.median(evidence.features[among])), float(np.median(evidence.sharpness[among]))
