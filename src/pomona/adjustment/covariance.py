"""How uncertain adjusted cameras are, by their normal equations, and what they say of what is left out of them."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array, eye_array

from pomona.adjustment.normal_equations import derivatives, lens_starts, normal_equations
from pomona.adjustment.selected_inverse import SelectedInverse
from pomona.adjustment.weights import Weights
from pomona.basics.arrays import FloatArray, IntArray, groups
from pomona.values.cameras import Cameras

# What nothing measures is known to 100,000 times what it would be if all else were known; a smaller factor would hold
# long rows together. Where rounding makes equations singular all the same, it is 10,000, or 1,000.
_VAGUE = (1e-10, 1e-8, 1e-6)
# Rounds in which centres that are hardly known come to weigh little.
_ROUNDS = 4
# Eigenvalues of a point's normal equations below this share of the largest are of directions that no photo tells.
_SINGULAR = 1e-9
# So few centres fit each other by a similarity whatever they are.
_FIT_ALWAYS = 2
# What is left of equations below this share of what they were is rounding.
_ROUNDING = 1e-12
_UNSEEN = np.zeros(0, np.int64)


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariances of each of n photos' centres (n, 3, 3) and of each of q known points (q, 3, 3).

    In a frame that nothing fixes, centres vary about the similarity that fits all of its cameras best. Where that
    says nothing of a centre, as in a frame of two photos, or where photos see two or three points and only rounding is
    left, it is NaN. `scale_sd`: how far off lengths among the cameras may be, as a share; NaN for fewer than two, and
    where nothing fixes their frame. It is the standard deviation of the scale of the similarity that fits the cameras'
    true centres best.
    """

    centers_in_world: FloatArray
    known_points: FloatArray
    scale_sd: float

    @property
    def center_sds(self) -> FloatArray:
        """(n,): how far off a photo's centre may be: the square root of the sum of its three variances."""
        return np.asarray(np.sqrt(np.trace(self.centers_in_world, axis1=1, axis2=2)))


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
    starts = lens_starts(cameras)
    return np.asarray(np.sqrt(_Inverse.of(cameras, weights).blocks(starts[:, None])[:, 0, 0]))


def covariance(cameras: Cameras, weights: Weights) -> Covariance:
    """Return how uncertain adjusted cameras are; the wrong observations among their tracks count little (Cauchy)."""
    inverse, n = _Inverse.of(cameras, weights), len(cameras)
    centers = _centers(n)
    q = len(weights.known_idx)
    places = _known_points(inverse.size, q)
    free_frames = np.asarray(weights.free_frames)
    gauge = _gauge(cameras, free_frames)
    of_centers = inverse.blocks(centers)
    if gauge.shape[1]:
        of_centers = _about_the_best(inverse, of_centers, gauge, centers)
        for frame, inside in groups(free_frames):
            known = np.isfinite(of_centers[inside, 0, 0])
            if frame >= 0 and known.sum() <= _FIT_ALWAYS:
                of_centers[inside] = np.nan
    scale_sd = float("nan") if gauge.shape[1] else inverse.sd_of(_share_of_scale(inverse.size, cameras))
    return Covariance(of_centers, inverse.blocks(places), scale_sd)


def length_sd(cameras: Cameras, weights: Weights, ends: tuple[int, int]) -> float:
    """Return how far off lengths among the cameras may be, as a share, if the length between two points gives them.

    `ends` number two of the known points, whose places should be hardly known. It is the standard deviation of the
    ratio of that length to the scale of the similarity that fits the cameras' true centres best: nothing else needs
    to fix their frame. NaN where the cameras stand in one place.
    """
    inverse = _Inverse.of(cameras, weights)
    one, other = (weights.known_places[end] for end in ends)
    share = _share_of_scale(inverse.size, cameras)
    places = _known_points(inverse.size, len(weights.known_idx))
    for end, arm in zip(ends, (one - other, other - one), strict=True):
        share[places[end], 0] = -arm / (arm @ arm)
    return inverse.sd_of(share)


def _share_of_scale(size: int, cameras: Cameras) -> FloatArray:
    """Return (size, 1): how the scale that fits all centres best, as a share, changes with each parameter."""
    arms = cameras.centers_in_world - cameras.centers_in_world.mean(0)
    spread = float((arms**2).sum())
    share = np.zeros((size, 1))
    share[_centers(len(cameras)).ravel(), 0] = arms.ravel() / spread if spread > 0 else np.nan
    return share


def _known_points(size: int, q: int) -> IntArray:
    """Return the parameters (q, 3) of known points, which come last."""
    return np.asarray(size - 3 * q + np.arange(3 * q).reshape(-1, 3))


def _centers(n: int) -> IntArray:
    """Return the parameters (n, 3) of photos' centres."""
    return np.asarray(6 * np.arange(n)[:, None] + np.array([3, 4, 5]))


def _about_the_best(inverse: _Inverse, of_centers: FloatArray, gauge: FloatArray, centers: IntArray) -> FloatArray:
    """Covariances (n, 3, 3) of centres about the similarity that fits them best, where `gauge` (3n, g) moves them all.

    Centres that are known less well than the middle one weigh less, or one would make all the others look vague; those
    of which only rounding is left do not count, and have NaN.
    """
    found, weights = of_centers, np.ones(len(gauge))
    moved = gauge.reshape(len(centers), 3, -1)
    for _ in range(_ROUNDS):
        fit = np.linalg.pinv(gauge * weights[:, None]) * weights
        right = np.zeros((inverse.size, len(fit)))
        right[centers.ravel()] = fit.T
        with_fit = inverse.solve(right)[centers.ravel()]
        of_fit = fit @ with_fit
        crossed = np.einsum("nig,njg->nij", moved, with_fit.reshape(moved.shape))
        own = np.einsum("nig,gh,njh->nij", moved, of_fit, moved)
        found = of_centers - crossed - crossed.transpose(0, 2, 1) + own
        variances = np.trace(found, axis1=1, axis2=2)
        is_known = np.isfinite(variances) & (variances > 0)
        found[~is_known] = np.nan
        if not is_known.any():
            break
        least = np.median(variances[is_known])
        weights = np.repeat(np.where(is_known, 1 / np.sqrt(np.maximum(variances, least)), 0.0), 3)
    return found


@dataclass(frozen=True, eq=False)
class _Inverse:
    """The inverse of the normal equations of photos, lenses and known points, in this order; `sizes` (p,) scale them.

    Where nothing fixes a frame, one photo of it is held, and how far another is from that: what covariances about the
    best similarity are does not depend on which.
    """

    scaled: SelectedInverse
    sizes: FloatArray

    @classmethod
    def of(cls, cameras: Cameras, weights: Weights) -> _Inverse:
        equations = normal_equations(cameras, weights)
        normal = equations.reduced()
        # Of a photo without points, or whose points no other photo sees, what is left is rounding.
        is_known = normal.diagonal() > _ROUNDING * equations.of_kept.diagonal()
        sizes = np.sqrt(np.where(is_known, normal.diagonal(), 1.0))
        shrink = diags_array(is_known / sizes)
        held = _held(cameras, np.asarray(weights.free_frames), sizes)
        scaled, nodes = shrink @ normal @ shrink + held, _nodes(cameras, len(weights.known_idx))
        for vague in _VAGUE[:-1]:
            with suppress(np.linalg.LinAlgError):
                return cls(SelectedInverse(csr_array(scaled + vague * eye_array(len(sizes))), nodes), sizes)
        return cls(SelectedInverse(csr_array(scaled + _VAGUE[-1] * eye_array(len(sizes))), nodes), sizes)

    @property
    def size(self) -> int:
        return len(self.sizes)

    def blocks(self, params: IntArray) -> FloatArray:
        """Return the blocks (m, k, k) of parameters (m, k), each row of one photo, lens or point."""
        sizes = self.sizes[params]
        return self.scaled.blocks(params) / (sizes[:, :, None] * sizes[:, None, :])

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the inverse times a right side (p, c)."""
        return np.asarray(self.scaled.solve(right / self.sizes[:, None]) / self.sizes[:, None])

    def sd_of(self, change: FloatArray) -> float:
        """Return the standard deviation of what changes so much (p, 1) with each parameter; NaN where it is NaN."""
        if np.isnan(change).any():
            return float("nan")
        return float(np.sqrt(change[:, 0] @ self.solve(change)[:, 0]))


def _nodes(cameras: Cameras, known: int) -> IntArray:
    """Whose parameter each (p,) is: photos come first, then lenses, then known points."""
    n, lenses = len(cameras), len(cameras.intrinsics)
    of_lenses = np.repeat(n + np.arange(lenses), [1 + len(lens.distortion_idx) for lens in cameras.intrinsics])
    return np.concatenate([np.repeat(np.arange(n), 6), of_lenses, np.repeat(n + lenses + np.arange(known), 3)])


def _held(cameras: Cameras, free_frames: IntArray, sizes: FloatArray) -> csr_array:
    """What holds each free frame (p, p), in scaled parameters: the photo that sees most, and its distance to another.

    The other is the farthest among the better half of photos: one that few points hold would hold nothing.
    """
    rows, columns, values = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0)]
    seen, centers = np.bincount(cameras.track_photo_idx, minlength=len(cameras)), cameras.centers_in_world
    for frame, inside in groups(free_frames):
        if frame < 0:
            continue
        best_first = inside[np.argsort(-seen[inside], kind="stable")]
        first, well_seen = best_first[0], best_first[: 1 + len(inside) // 2]
        own = 6 * first + np.arange(6)
        rows, columns, values = [*rows, own], [*columns, own], [*values, np.ones(6)]
        arms = centers[well_seen] - centers[first]
        arm = arms[np.argmax(np.linalg.norm(arms, axis=1))]
        other = 6 * well_seen[np.argmax(np.linalg.norm(arms, axis=1))] + np.array([3, 4, 5])
        along = sizes[other] * arm
        if (length := np.linalg.norm(along)) > 0:  # a single photo has no extent
            along /= length
            rows, columns = [*rows, np.repeat(other, 3)], [*columns, np.tile(other, 3)]
            values.append(np.outer(along, along).ravel())
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return coo_array(entries, shape=(len(sizes), len(sizes))).tocsr()


def _gauge(cameras: Cameras, free_frames: IntArray) -> FloatArray:
    """Unit columns (3n, 7 f): how centres change where one of f free frames is moved as a whole."""
    columns = []
    centers = cameras.centers_in_world
    for frame, inside in groups(free_frames):
        if frame < 0:
            continue
        arms = centers[inside] - centers[inside].mean(0)
        motions = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)]
        motions += [np.cross(axis, arms) for axis in np.eye(3)]
        motions.append(arms)
        for shifts in motions:
            column = np.zeros(centers.shape)
            column[inside] = shifts
            if (length := np.linalg.norm(column)) > 0:  # a single photo has no extent
                columns.append(column.ravel() / length)
    return np.array(columns).reshape(-1, centers.size).T
