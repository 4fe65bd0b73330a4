"""Spheroids fitted to the outlines of masks and to points on the fruits, where much is hidden or wrong.

Each fruit is fitted by itself, many of them at once. A ray along an outline touches the fruit, or is the edge of
something before it and passes anywhere inside, or the edge of another fruit that the mask holds, too, or ends at:
expectation–maximisation over all three, with Gauss–Newton steps in between.
What is known beforehand (size, height to width, how stalks lean) has its place in the equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray, set_checked
from pomona.stages.measure.circles import CircleTerms
from pomona.stages.measure.spheroids import Spheroids

_ROUNDS = 24
_TOGETHER = 256  # fruits fitted at once: bounds memory
_FIRST_NOISE, _NARROWER = 0.25, 0.75  # radii: rays so far off may touch in the first round; then ever fewer
_LONGEST_STEP = 0.3  # radii, or logarithms
# Of rays that do not touch, so many pass inside: behind a fruit's outline there is seldom more of its mask.
_INSIDE = 0.9
_TOUCH_FIRST, _AS_RAYS = 0.6, 4.0  # the share of rays that touch, before any is looked at, worth so many rays


@dataclass(frozen=True, eq=False)
class SpheroidEvidence:
    """What is seen of n fruits: g groups of k rays or points, sorted by fruit.

    `of` (g,) says of which fruit each group is, `eyes` and `rays` (g, k, 3) what is seen (a ray of zeros: a point, at
    `eyes`), `weights` (g, k) how much each says, in independent measurements, `noises_m` (g,) how exact they are;
    `trust` (g,) multiplies the weights where errors are told; `others` (g, k) is how likely rays are edges of other
    fruits, per metre.
    """

    of: IntArray
    eyes: FloatArray
    rays: FloatArray
    weights: FloatArray
    noises_m: FloatArray
    trust: FloatArray
    others: FloatArray

    def __post_init__(self) -> None:
        g, k = self.rays.shape[:2]
        set_checked(self, "of", (g,), np.int64)
        set_checked(self, "eyes", (g, k, 3), np.float64)
        set_checked(self, "rays", (g, k, 3), np.float64)
        set_checked(self, "weights", (g, k), np.float64)
        set_checked(self, "noises_m", (g,), np.float64)
        set_checked(self, "trust", (g,), np.float64)
        set_checked(self, "others", (g, k), np.float64)

    def of_fruits(self, first: int, last: int) -> SpheroidEvidence:
        """Return what is seen of the fruits from `first` to before `last`, numbered anew."""
        low, high = np.searchsorted(self.of, [first, last])
        own = slice(int(low), int(high))
        return SpheroidEvidence(
            self.of[own] - first, self.eyes[own], self.rays[own], self.weights[own], self.noises_m[own],
            self.trust[own], self.others[own],
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class SpheroidPrior:
    """What is known of all fruits: means, and standard deviations as shares or of tilts in radians.

    `radius_m` is half the width, `ratio` height to width; centres lie within `place_radii` of where fits begin.
    """

    radius_m: float
    radius_sd: float
    ratio: float
    ratio_sd: float
    tilt_sd: float
    place_radii: float

    def pull(self, spheroids: Spheroids, start: Spheroids) -> tuple[FloatArray, FloatArray]:
        """Return the weights (7,) of the prior, and its gradients (n, 7)."""
        place_m = self.place_radii * self.radius_m
        sds = [place_m] * 3 + [self.radius_sd, self.ratio_sd, self.tilt_sd, self.tilt_sd]
        weights = 1 / np.square(sds)
        off = np.column_stack([
            spheroids.centers - start.centers,
            np.log(spheroids.radii / self.radius_m),
            np.log(spheroids.ratios / self.ratio),
            spheroids.tilts,
        ])  # fmt: skip
        return weights, weights * off


@dataclass(frozen=True, eq=False)
class Fitted:
    """Fitted spheroids, with covariances (n, 7, 7) of what `Spheroids.moved` takes.

    `own_sds` (n,) are the standard deviations of widths, as shares, had nothing been known of their size beforehand.
    `distances_m` and `touching` (g, k) are of the evidence: how far outside rays pass, and how likely they touch.
    """

    spheroids: Spheroids
    covariances: FloatArray
    own_sds: FloatArray
    distances_m: FloatArray
    touching: FloatArray

    @classmethod
    def joined(cls, parts: Sequence[Fitted]) -> Fitted:
        """Return the fruits of all parts, at least one, one part after the other."""
        names = ("covariances", "own_sds", "distances_m", "touching")
        columns = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
        return cls(Spheroids.joined([part.spheroids for part in parts]), *columns)


def fit_spheroids(
    start: Spheroids, evidence: SpheroidEvidence, prior: SpheroidPrior, circles: CircleTerms | None = None
) -> Fitted:
    """Return the spheroids that the evidence, each of which has a group at least, and circles speak for.

    Fits begin with wide noise, so that they find what most rays agree on.
    """
    circles = CircleTerms.none(len(start)) if circles is None else circles
    parts = (slice(first, first + _TOGETHER) for first in range(0, max(len(start), 1), _TOGETHER))
    return Fitted.joined(
        [_fit(start[part], evidence.of_fruits(part.start, part.stop), prior, circles[part]) for part in parts]
    )


def _fit(start: Spheroids, evidence: SpheroidEvidence, prior: SpheroidPrior, circles: CircleTerms) -> Fitted:
    spheroids = start
    shares, all_of_it = np.full(len(evidence.of), _TOUCH_FIRST), np.ones(len(evidence.of))
    wide = _FIRST_NOISE
    for _ in range(_ROUNDS):
        noises_m = np.maximum(evidence.noises_m, wide * start.radii[evidence.of])
        normal, gradient, _, touching = _equations(spheroids, start, evidence, prior, noises_m, shares, all_of_it)
        normal[:, :4, :4] += circles.precisions
        gradient[:, :4] += circles.at(spheroids)
        shares = _shares(touching, evidence)
        steps = -np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
        sized = np.concatenate([steps[:, :3] / start.radii[:, None], steps[:, 3:]], axis=1)
        steps *= np.minimum(1, _LONGEST_STEP / np.maximum(np.abs(sized).max(axis=1), 1e-12))[:, None]
        spheroids = spheroids.moved(steps)
        wide *= _NARROWER
    # Of a mask that mostly shows other things' edges, what seems to touch may be chance: errors are larger for that.
    normal, _, distances_m, touching = _equations(
        spheroids, start, evidence, prior, evidence.noises_m, shares, shares * evidence.trust
    )
    normal[:, :4, :4] += circles.precisions
    covariances = np.linalg.inv(normal)
    own = np.maximum(1 / covariances[:, 3, 3] - prior.radius_sd**-2, 1e-12)
    return Fitted(spheroids, covariances, own**-0.5, distances_m, touching)


def _shares(touching: FloatArray, evidence: SpheroidEvidence) -> FloatArray:
    """Return the share (g,) of each mask's rays that touch the fruit."""
    known = evidence.weights > 0
    return np.asarray(((touching * known).sum(axis=1) + _TOUCH_FIRST * _AS_RAYS) / (known.sum(axis=1) + _AS_RAYS))


def _equations(
    spheroids: Spheroids,
    start: Spheroids,
    evidence: SpheroidEvidence,
    prior: SpheroidPrior,
    noises_m: FloatArray,
    shares: FloatArray,
    trust: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return matrices (n, 7, 7), gradients (n, 7), distances (g, k) of the rays, and how likely (g, k) they touch."""
    groups, k = evidence.weights.shape
    firsts = np.searchsorted(evidence.of, np.arange(len(start)))
    distances, slopes = spheroids.distances(
        evidence.eyes.reshape(-1, 3), evidence.rays.reshape(-1, 3), np.repeat(evidence.of, k)
    )
    distances, slopes = distances.reshape(groups, k), slopes.reshape(groups, k, 7)
    touching = _touching(
        distances, noises_m[:, None], shares[:, None], start.radii[evidence.of][:, None], evidence.others
    )
    weights = trust[:, None] * evidence.weights * touching / noises_m[:, None] ** 2
    weighted = slopes * weights[:, :, None]
    normal = np.add.reduceat(np.swapaxes(weighted, 1, 2) @ slopes, firsts, axis=0)
    gradient = np.add.reduceat((weighted * distances[:, :, None]).sum(axis=1), firsts, axis=0)
    of_prior, pulls = prior.pull(spheroids, start)
    normal[:, np.arange(7), np.arange(7)] += of_prior
    return normal, gradient + pulls, distances, touching


def _touching(
    distances: FloatArray, noises_m: FloatArray, shares: FloatArray, radii: FloatArray, others: FloatArray
) -> FloatArray:
    """Return how likely rays touch: those that do are as noise has it, `others` as said, the rest within a radius."""
    bell = np.exp(-0.5 * (distances / noises_m) ** 2) / (noises_m * np.sqrt(2 * np.pi))
    anywhere = np.where(distances < 0, _INSIDE, 1 - _INSIDE) / radii
    likely = shares * bell
    return np.asarray(likely / (likely + (1 - shares) * anywhere + others))
