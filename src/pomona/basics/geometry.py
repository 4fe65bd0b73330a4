"""Similarity transforms, named `target_from_source`, and their least-squares and robust fits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import SD_OF_MAD, BoolArray, FloatArray, IntArray, set_checked, some_subsets
from pomona.errors import InputError

# Points lie on one line where their spread across it is less than this share of the spread along it, unless they are so
# exact that they tell a turn about it to this angle all the same: people hold cameras no more exactly than that.
_LINE_RATIO, _EXACT_TURN = 0.04, np.radians(1)
# Points that are spread less than so many times farther one way than across it are round, as a tree's crown is.
_LONGISH = 1.5
# People place markers to this.
PLACED_SD_M = 0.005
# Where there are more triples, a random sample of so many bounds the time.
_MOST_TRIPLES = 2000
# So many residuals are computed together, which bounds memory.
_TOGETHER = 200_000


@dataclass(frozen=True, eq=False)
class Similarity:
    """`x_target = scale * rotation @ x_source + translation`; `rotation` (3, 3), `translation` (3,)."""

    scale: float
    rotation: FloatArray
    translation: FloatArray

    def __post_init__(self) -> None:
        set_checked(self, "rotation", (3, 3), np.float64)
        set_checked(self, "translation", (3,), np.float64)
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise InputError(f"Similarity.scale: expected a positive number, found {self.scale}")

    @classmethod
    def identity(cls) -> Similarity:
        """Return the transform that leaves every point where it is."""
        return cls(1.0, np.eye(3), np.zeros(3))

    def apply(self, points: FloatArray) -> FloatArray:
        """Transform points (n, 3) from the source frame into the target frame."""
        return self.scale * np.asarray(points) @ self.rotation.T + self.translation

    def inverse(self) -> Similarity:
        """Return `source_from_target`."""
        rotation = self.rotation.T
        return Similarity(1.0 / self.scale, rotation, -(rotation @ self.translation) / self.scale)

    def compose(self, other: Similarity) -> Similarity:
        """Return `self ∘ other`: first `other`, then `self`."""
        return Similarity(
            self.scale * other.scale,
            self.rotation @ other.rotation,
            self.scale * self.rotation @ other.translation + self.translation,
        )


def estimate_similarity(
    points_in_source: FloatArray,
    points_in_target: FloatArray,
    *,
    rigid: bool = False,
    weights: FloatArray | None = None,
) -> Similarity:
    """Return the least-squares `target_from_source` of n ≥ 3 point pairs, each (n, 3); `rigid`: of scale 1.

    `weights` (n,) of the pairs are by default all the same. Source: Umeyama 1991.

    Raises `InputError` when fewer than three pairs are given or when the points lie on one line.
    """
    source, target = np.asarray(points_in_source, float), np.asarray(points_in_target, float)
    if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 3 or len(source) < 3:
        raise InputError(f"A similarity needs at least 3 point pairs, found shapes {source.shape} and {target.shape}")
    shares = np.full(len(source), 1 / len(source)) if weights is None else weights / weights.sum()
    source_mean, target_mean = shares @ source, shares @ target
    source_centred, target_centred = source - source_mean, target - target_mean
    rotation, stretch, fixed = _turned_onto((target_centred * shares[:, None]).T @ source_centred)
    if not fixed:
        raise InputError("A similarity needs points that do not lie on one line")
    scale = 1.0 if rigid else float(stretch / (shares @ (source_centred**2).sum(1)))
    return Similarity(scale, rotation, target_mean - scale * rotation @ source_mean)


def _turned_onto(covariances: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """The rotations (..., 3, 3) of covariances (..., 3, 3) of target and source, scales times the source's variance.

    And which (...) are fixed, as points do not lie on one line. Source: Umeyama 1991, equations 40 to 43.
    """
    u, singular, vt = np.linalg.svd(covariances)
    signs = np.ones_like(singular)
    signs[..., 2] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    fixed = singular[..., 1] > 1e-9 * np.maximum(singular[..., 0], 1e-300)
    return (u * signs[..., None, :]) @ vt, (singular * signs).sum(-1), fixed


def robust_similarity(points_in_source: FloatArray, points_in_target: FloatArray) -> tuple[Similarity, BoolArray]:
    """Return `target_from_source` of n ≥ 3 pairs (n, 3) and which pairs (n,) agree with it.

    Every three pairs propose one; that with the least median residual separates inliers from outliers (least median of
    squares, Rousseeuw 1984), and the inliers are fitted by least squares. With three pairs all are taken as inliers.
    Residuals up to three times `PLACED_SD_M`, in the target's units, never make an outlier.

    Raises `InputError` when fewer than three pairs are given, or when they lie on one line in either frame.
    """
    n = len(points_in_source)
    if n < 3 or on_one_line(points_in_target, PLACED_SD_M):
        raise InputError(f"A place in space needs three markers that are not on one line, found {n} on one")
    inliers = np.ones(n, bool)
    if n > 3:
        # Of n residuals three are small by construction: judge by the middle of the others.
        rank = 3 + (n - 3) // 2
        triples = np.array(some_subsets(n, 3, _MOST_TRIPLES))
        least = np.inf
        for first in range(0, len(triples), step := max(1, _TOGETHER // n)):
            some = triples[first : first + step]
            residuals = _residuals_of_triples(points_in_source, points_in_target, some, PLACED_SD_M)
            middles = middle_of(residuals, rank)
            if len(middles) and middles.min() < least:
                least, best = float(middles.min()), residuals[middles.argmin()]
        if not np.isfinite(least):
            raise InputError(f"A place in space needs three markers that are not on one line; of {n}, no three are")
        sigma = SD_OF_MAD * least
        inliers = best < 3 * max(sigma, PLACED_SD_M)
        if inliers.sum() < 3 or on_one_line(points_in_target[inliers], PLACED_SD_M):
            inliers = np.ones(n, bool)
    return estimate_similarity(points_in_source[inliers], points_in_target[inliers]), inliers


def middle_of(residuals: FloatArray, rank: int) -> FloatArray:
    """Return of each row of residuals (k, n) the mean (k,) of the two that are `rank`-th and next in order."""
    ranks = [rank - 1, min(rank, residuals.shape[1] - 1)]
    return np.asarray(np.partition(residuals, ranks, axis=1)[:, rank - 1 : rank + 1].mean(1))


def on_one_line(points: FloatArray, noise: float) -> bool:
    """Say whether points (n, 3) lie on one line, or so nearly that they do not fix a rotation about it.

    `noise` is the standard deviation of a coordinate, in the points' units.
    """
    return len(points) < 3 or bool(_are_on_lines(points[None] - points.mean(0), np.array([noise]))[0])


def _are_on_lines(centred: FloatArray, noise: FloatArray) -> BoolArray:
    """The same of k sets of points about their means (k, n, 3), with the noise (k,) of each."""
    along, across = np.linalg.svd(centred, compute_uv=False)[:, :2].T
    return np.asarray((across < _LINE_RATIO * along) & (noise > _EXACT_TURN * across))


def _residuals_of_triples(source: FloatArray, target: FloatArray, triples: IntArray, noise_m: float) -> FloatArray:
    """How far (m, n) n pairs of points are from each other by the similarity of each triple (k, 3) that fixes one."""
    a, b = source[triples], target[triples]
    a_means, b_means = a.mean(1), b.mean(1)
    a, b = a - a_means[:, None], b - b_means[:, None]
    a_sizes, b_sizes = np.linalg.norm(a, axis=(1, 2)), np.linalg.norm(b, axis=(1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        lines = _are_on_lines(b, np.full(len(b), noise_m)) | _are_on_lines(a, noise_m * a_sizes / b_sizes)
    rotations, stretches, fixed = _turned_onto(b.transpose(0, 2, 1) @ a)
    fixed &= (np.minimum(a_sizes, b_sizes) > 0) & ~lines
    rotations, scales = rotations[fixed], stretches[fixed] / a_sizes[fixed] ** 2
    moved = scales[:, None, None] * (source - a_means[fixed, None]) @ rotations.transpose(0, 2, 1)
    return np.asarray(np.linalg.norm(moved + b_means[fixed, None] - target, axis=2))


def frame_along(direction: FloatArray) -> FloatArray:
    """Return a rotation (3, 3) whose last row points along a direction (3,); the others lie across it."""
    across = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    rows = np.array([across, np.cross(direction, across), direction])
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def offsets_from_rays(points: FloatArray, origins: FloatArray, rays: FloatArray) -> FloatArray:
    """Return the vectors (..., 3) from the nearest points on rays to points.

    `points`, `origins` and the unit directions `rays`, all (..., 3), are broadcast against each other.
    """
    from_origins = points - origins
    # einsum: NumPy's sum is slow over axes as short as this.
    along = np.einsum("...i,...i->...", from_origins, rays)
    offsets: FloatArray = from_origins - along[..., None] * rays
    return offsets


def row_axis(points_in_world: FloatArray, walk: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Return a place (2,) amid n points (n, 3) of a row, z up, and the unit direction (2,) along it.

    That is the direction of the `walk` (2,) along it, if it is known, where the points are about as wide as long, as on
    a single tree. Along it the larger coordinate grows; trees are numbered that way.
    """
    flat = points_in_world[:, :2]
    origin = np.median(flat, axis=0)
    _, sizes, directions = np.linalg.svd(flat - origin, full_matrices=False)
    axis = directions[0]
    if walk is not None and sizes[0] < _LONGISH * sizes[-1]:
        axis = walk
    return origin, axis * (np.sign(axis[np.argmax(np.abs(axis))]) or 1.0)
