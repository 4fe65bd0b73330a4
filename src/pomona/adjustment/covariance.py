"""How uncertain adjusted cameras are, by their normal equations, and what they say of what is left out of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from pomona.adjustment.normal_equations import derivatives, lens_starts, normal_equations
from pomona.adjustment.weights import Weights
from pomona.arrays import FloatArray, IntArray, groups
from pomona.cameras import Cameras

# What nothing measures is known to ten thousand times what it would be if all else were known, which is not singular.
_VAGUE = 1e-8
# Rounds in which centres that are hardly known come to weigh little.
_ROUNDS = 4
# Eigenvalues of a point's normal equations below this share of the largest are of directions that no photo tells.
_SINGULAR = 1e-9
_UNSEEN = np.zeros(0, np.int64)


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariances of n photos' centres (3n, 3n) and of q known points (q, 3, 3).

    In a frame that nothing fixes, centres vary about the similarity that fits all of its cameras best.
    """

    centers_in_world: FloatArray
    known_points: FloatArray

    @property
    def center_sds(self) -> FloatArray:
        """(n,): how far off a photo's centre may be: the square root of the sum of its three variances."""
        return np.asarray(np.sqrt(np.diag(self.centers_in_world).reshape(-1, 3).sum(1)))

    def scale_sd(self, cameras: Cameras) -> float:
        """Return how far off lengths among the cameras may be, as a share; NaN for fewer than two.

        The standard deviation of the scale of the similarity that fits the cameras' true centres best.
        """
        arms = cameras.centers_in_world - cameras.centers_in_world.mean(0)
        spread = float((arms**2).sum())
        if spread == 0:
            return float("nan")
        share = arms.ravel() / spread
        return float(np.sqrt(share @ self.centers_in_world @ share))


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Where q known points are seen if what is known of the one looked at is left out of the adjustment.

    `offsets_m` (q, 3) from the known place; `sds_m` (q, 3): the principal standard deviations of these offsets,
    which contain that of the known place, and `axes` (q, 3, 3) their directions, as columns.
    """

    offsets_m: FloatArray
    sds_m: FloatArray
    axes: FloatArray

    @property
    def contradictions(self) -> FloatArray:
        """(q,): offsets in standard deviations, the largest of the three directions."""
        along = np.einsum("qij,qi->qj", self.axes, self.offsets_m)
        return np.asarray(np.abs(along / self.sds_m).max(axis=1, initial=0))


def left_out(cameras: Cameras, weights: Weights, found: Covariance) -> LeftOut:
    """Return where each known point would be seen without knowing it: cross-validation by the normal equations.

    The points of `cameras` must be at their known places. What is known of a point adds 1 / sd² to its inverse
    covariance; without that, its covariance and its place follow in closed form.
    Source: Cook and Weisberg 1982, "Residuals and influence in regression", section 2.2.
    """
    offsets, sds, axes = [], [], []
    known = np.flatnonzero(np.isin(cameras.track_point_idx, weights.known_idx))
    seen = {point: known[mine] for point, mine in groups(cameras.track_point_idx[known])}
    for point_idx, sd_m, covered in zip(weights.known_idx, weights.known_sds_m, found.known_points, strict=True):
        prior = np.eye(3) / sd_m**2
        own, pull = _of_point(cameras, weights, seen.get(int(point_idx), _UNSEEN))
        moved = np.linalg.solve(own + prior, pull)
        with_all = np.linalg.inv(covered)
        values, vectors = np.linalg.eigh(with_all - prior)
        values = np.maximum(values, np.finfo(float).tiny + _SINGULAR * np.trace(with_all))
        offsets.append(vectors @ ((vectors.T @ with_all @ moved) / values))
        sds.append(np.sqrt(1 / values + sd_m**2))
        axes.append(vectors)
    return LeftOut(
        *(np.array(part).reshape(-1, *shape) for part, shape in ((offsets, (3,)), (sds, (3,)), (axes, (3, 3))))
    )


def _of_point(cameras: Cameras, weights: Weights, mine: IntArray) -> tuple[FloatArray, FloatArray]:
    """The normal equations (3, 3) and right side (3,) of one point, by its own observations (k,), cameras held."""
    normal, pull = np.zeros((3, 3)), np.zeros(3)
    for lens, places in groups(cameras.intrinsics_idx[cameras.track_photo_idx[mine]]):
        here = mine[places]
        _, _, of_point, off_px = derivatives(cameras, lens, here)
        weight = 1 / np.asarray(weights.track_sds_px)[here] ** 2
        normal += np.einsum("k,kij,kil->jl", weight, of_point, of_point)
        pull -= np.einsum("k,kij,ki->j", weight, of_point, off_px)
    return normal, pull


def focal_sds(cameras: Cameras, weights: Weights) -> FloatArray:
    """Return the standard deviations (l,) of the focal lengths of adjusted cameras, as shares of them."""
    normal, gauge = _equations(cameras, weights)
    starts = lens_starts(cameras)
    return np.asarray(np.sqrt(np.diag(_inverse(normal, gauge, starts)[starts])))


def covariance(cameras: Cameras, weights: Weights) -> Covariance:
    """Return how uncertain adjusted cameras are; the wrong observations among their tracks count little (Cauchy)."""
    normal, gauge = _equations(cameras, weights)
    n, size = len(cameras), len(normal)
    centers = (6 * np.arange(n)[:, None] + [3, 4, 5]).ravel()
    places = np.arange(size - 3 * len(weights.known_idx), size)
    wanted = np.concatenate([centers, places])
    inverse = _inverse(normal, gauge, wanted)
    of_points = inverse[places, 3 * n :].reshape(len(weights.known_idx), 3, len(weights.known_idx), 3)
    each = np.arange(len(weights.known_idx))
    return Covariance(_about_the_best(inverse[centers, : 3 * n], gauge[centers]), of_points[each, :, each, :])


def _about_the_best(of_centers: FloatArray, gauge: FloatArray) -> FloatArray:
    """Covariances (3n, 3n) of centres about the similarity that fits them best, where `gauge` (3n, g) moves them all.

    Centres that are known less well than the middle one weigh less, or one would make all the others look vague.
    """
    if not gauge.shape[1]:
        return of_centers
    found = of_centers
    weights = np.ones(len(of_centers))
    for _ in range(_ROUNDS):
        fit = np.linalg.lstsq(gauge * weights[:, None], np.diag(weights), rcond=None)[0]
        fitted = np.eye(len(of_centers)) - gauge @ fit
        found = fitted @ of_centers @ fitted.T
        variances = np.diag(found).reshape(-1, 3).sum(1)
        weights = np.repeat(1 / np.sqrt(np.maximum(variances, np.median(variances))), 3)
    return found


def _equations(cameras: Cameras, weights: Weights) -> tuple[FloatArray, FloatArray]:
    """The normal equations (p, p) of photos, lenses and known points, in this order, and what nothing fixes (p, g)."""
    normal = normal_equations(cameras, weights).reduced().toarray()
    return normal, _gauge(cameras, np.asarray(weights.free_frames), len(normal))


def _inverse(normal: FloatArray, gauge: FloatArray, columns: IntArray) -> FloatArray:
    """Columns (p, c) of the inverse of normal equations (p, p), across the directions (p, g) that nothing fixes."""
    sizes = np.sqrt(np.diag(normal))
    sizes[sizes == 0] = 1.0  # of a photo without points
    scaled = normal / np.outer(sizes, sizes)
    free, _ = np.linalg.qr(gauge * sizes[:, None])
    scaled += free @ free.T
    scaled[np.diag_indices(len(scaled))] += _VAGUE
    wanted = np.zeros((len(scaled), len(columns)))
    wanted[columns, np.arange(len(columns))] = 1 / sizes[columns]
    return np.asarray(cho_solve(cho_factor(scaled), wanted) / sizes[:, None])


def _gauge(cameras: Cameras, free_frames: IntArray, height: int) -> FloatArray:
    """Unit columns (height, 7 f): how the parameters change where one of f free frames is moved as a whole."""
    columns = []
    centers, rotations = cameras.centers_in_world, cameras.cam_from_world[:, :, :3]
    for frame in np.unique(free_frames[free_frames >= 0]):
        inside = np.flatnonzero(free_frames == frame)
        arms = centers[inside] - centers[inside].mean(0)
        motions = [(np.zeros_like(arms), np.broadcast_to(axis, arms.shape)) for axis in np.eye(3)]
        motions += [(-rotations[inside] @ axis, np.cross(axis, arms)) for axis in np.eye(3)]
        motions.append((np.zeros_like(arms), arms))
        for turns, shifts in motions:
            column = np.zeros(height)
            column[(6 * inside[:, None] + np.arange(3)).ravel()] = turns.ravel()
            column[(6 * inside[:, None] + 3 + np.arange(3)).ravel()] = shifts.ravel()
            if (length := np.linalg.norm(column)) > 0:  # a single photo has no extent
                columns.append(column / length)
    return np.array(columns).reshape(-1, height).T
