"""What adjusted cameras are worth: covariances from the normal equations of a bundle adjustment.

A photo has six parameters (a turn in camera axes, its centre in the world); a lens its focal length, as a logarithm,
and its distortion. Points are eliminated (Schur complement) but for those that are asked for.
Source: Triggs et al. 2000, "Bundle adjustment: a modern synthesis", sections 6 and 9.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import bsr_array, csr_array, hstack

from pomona.adjustment.bundle import TAIL
from pomona.arrays import FloatArray, IntArray, set_checked
from pomona.cameras import Cameras
from pomona.intrinsics import Intrinsics

# Steps of numerical derivatives, as shares: the cube root of the precision of numbers, as central differences want.
_STEP = 6e-6
# What nothing measures is known to ten thousand times what it would be if all else were known, which is not singular.
_VAGUE = 1e-8
# Rounds in which centres that are hardly known come to weigh little.
_ROUNDS = 4
# Eigenvalues of a point's normal equations below this share of the largest are of directions that no photo tells.
_SINGULAR = 1e-9


@dataclass(frozen=True, eq=False)
class Weights:
    """How exactly things are known beforehand: what an adjustment of `Cameras` weighs its observations with.

    `track_sds_px` (k,) of each observation of a point. `log_focal_sds` (l,) of each lens, as shares of its focal
    length; infinite where nothing is known. `known_idx` (q,) points of known place, and `known_sds_m` (q,) how well.
    `free_frames` (n,): photos with the same number are in one frame that nothing fixes; -1 where known points do.
    """

    track_sds_px: FloatArray
    log_focal_sds: FloatArray
    known_idx: IntArray
    known_sds_m: FloatArray
    free_frames: IntArray

    def __post_init__(self) -> None:
        set_checked(self, "track_sds_px", (len(self.track_sds_px),), np.float64)
        set_checked(self, "log_focal_sds", (len(self.log_focal_sds),), np.float64)
        set_checked(self, "known_idx", (len(self.known_idx),), np.int64)
        set_checked(self, "known_sds_m", (len(self.known_idx),), np.float64)
        set_checked(self, "free_frames", (len(self.free_frames),), np.int64)


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
    for point_idx, sd_m, covered in zip(weights.known_idx, weights.known_sds_m, found.known_points, strict=True):
        prior = np.eye(3) / sd_m**2
        own, pull = _of_point(cameras, weights, int(point_idx))
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


def _of_point(cameras: Cameras, weights: Weights, point_idx: int) -> tuple[FloatArray, FloatArray]:
    """The normal equations (3, 3) and right side (3,) of one point, by its own observations, cameras held."""
    normal, pull = np.zeros((3, 3)), np.zeros(3)
    mine = np.flatnonzero(cameras.track_point_idx == point_idx)
    for i in np.unique(cameras.track_photo_idx[mine]):
        here = mine[cameras.track_photo_idx[mine] == i]
        _, _, of_point, off_px = _derivatives(cameras, int(i), here)
        weight = 1 / np.asarray(weights.track_sds_px)[here] ** 2
        normal += np.einsum("k,kij,kil->jl", weight, of_point, of_point)
        pull -= np.einsum("k,kij,ki->j", weight, of_point, off_px)
    return normal, pull


def focal_sds(cameras: Cameras, weights: Weights) -> FloatArray:
    """Return the standard deviations (l,) of the focal lengths of adjusted cameras, as shares of them."""
    normal, gauge = _normal_equations(cameras, weights)
    starts = _lens_starts(cameras)
    return np.asarray(np.sqrt(np.diag(_inverse(normal, gauge, starts)[starts])))


def covariance(cameras: Cameras, weights: Weights) -> Covariance:
    """Return how uncertain adjusted cameras are; the wrong observations among their tracks count little (Cauchy)."""
    normal, gauge = _normal_equations(cameras, weights)
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


def _normal_equations(cameras: Cameras, weights: Weights) -> tuple[FloatArray, FloatArray]:
    """The normal equations (p, p) of photos, lenses and known points, in this order, and what nothing fixes (p, g)."""
    by_parameter, by_point = _design(cameras, weights)
    known = np.asarray(weights.known_idx)
    kept = np.zeros(len(cameras.points_in_world), bool)
    kept[known] = True
    columns = (3 * np.flatnonzero(~kept)[:, None] + np.arange(3)).ravel()
    known_columns = (3 * known[:, None] + np.arange(3)).ravel()
    keep = csr_array(hstack([by_parameter, by_point[:, known_columns]]))
    eliminated = by_point[:, columns]
    cross = (keep.T @ eliminated).tocsr()
    normal = (keep.T @ keep - cross @ _blocks(eliminated) @ cross.T).toarray()
    prior = np.zeros(len(normal))
    prior[_lens_starts(cameras)] = 1 / np.asarray(weights.log_focal_sds) ** 2
    prior[len(prior) - len(known_columns) :] = np.repeat(1 / np.asarray(weights.known_sds_m) ** 2, 3)
    normal[np.diag_indices(len(normal))] += prior
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


def _lens_starts(cameras: Cameras) -> IntArray:
    """The parameters (l,) that are the lenses' focal lengths; those of their distortion follow each."""
    sizes = [1 + len(lens.distortion_idx) for lens in cameras.intrinsics]
    return np.asarray(6 * len(cameras) + np.cumsum([0, *sizes[:-1]]), np.int64)


def _design(cameras: Cameras, weights: Weights) -> tuple[csr_array, csr_array]:
    """The derivatives of all observations by parameters of photos and lenses, and by points, weighted."""
    starts = _lens_starts(cameras)
    width = int(starts[-1]) + 1 + len(cameras.intrinsics[-1].distortion_idx)
    rows, columns, values, points = [], [], [], []
    for i in range(len(cameras)):
        here = np.flatnonzero(cameras.track_photo_idx == i)
        of_photo, of_lens, of_point, off_px = _derivatives(cameras, i, here)
        sds_px = np.asarray(weights.track_sds_px)[here]
        loss = (1 + (off_px**2).sum(1) / (TAIL * sds_px) ** 2) ** -0.5  # the root of the weight in the adjustment
        loss[np.isin(cameras.track_point_idx[here], weights.known_idx)] = 1.0  # as `left_out` takes them
        weight = (loss / sds_px)[:, None, None]
        start = starts[cameras.intrinsics_idx[i]]
        both = np.concatenate([of_photo, of_lens], axis=2) * weight
        column = np.concatenate([6 * i + np.arange(6), start + np.arange(of_lens.shape[2])])
        row = 2 * here[:, None] + np.arange(2)
        rows.append(np.broadcast_to(row[:, :, None], both.shape).ravel())
        columns.append(np.broadcast_to(column, both.shape).ravel())
        values.append(both.ravel())
        points.append((here, of_point * weight))
    height = 2 * len(cameras.track_point_idx)
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    by_point = np.zeros((len(cameras.track_point_idx), 2, 3))
    for here, of_point in points:
        by_point[here] = of_point
    shape = (height, 3 * len(cameras.points_in_world))
    bsr = bsr_array((by_point, cameras.track_point_idx, np.arange(len(by_point) + 1)), shape=shape)
    return csr_array(entries, shape=(height, width)), bsr.tocsr()


def _derivatives(cameras: Cameras, i: int, here: IntArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Of the observations `here` (k,) of photo i: derivatives (k, 2, 6), (k, 2, q), (k, 2, 3), and residuals (k, 2)."""
    pose, lens = cameras.cam_from_world[i], cameras.intrinsics_of(i)
    in_cam = cameras.points_in_world[cameras.track_point_idx[here]] @ pose[:, :3].T + pose[:, 3]
    steps = _STEP * np.maximum(np.abs(in_cam[:, 2:]), 1e-9)
    by_place = np.stack(
        [
            (lens.px_from_cam(in_cam + steps * axis) - lens.px_from_cam(in_cam - steps * axis)) / (2 * steps)
            for axis in np.eye(3)
        ],
        axis=2,
    )
    turned = np.cross(np.eye(3)[None], in_cam[:, None]).transpose(0, 2, 1)
    of_photo = np.concatenate([by_place @ turned, -by_place @ pose[:, :3]], axis=2)
    of_lens = np.stack(
        [_by_lens(lens, in_cam, idx) for idx in (lens.focal_idx, *((j,) for j in lens.distortion_idx))], 2
    )
    off_px = lens.px_from_cam(in_cam) - cameras.track_xy_px[here]
    return of_photo, of_lens, by_place @ pose[:, :3], off_px


def _by_lens(lens: Intrinsics, in_cam: FloatArray, idx: tuple[int, ...]) -> FloatArray:
    """The derivatives (k, 2) of pixels by one parameter of a lens; by its logarithm if it is the focal length."""
    step = np.zeros(len(lens.params))
    step[list(idx)] = _STEP * (lens.params[list(idx)] if idx == lens.focal_idx else 1.0)
    more, less = replace(lens, params=lens.params + step), replace(lens, params=lens.params - step)
    return np.asarray((more.px_from_cam(in_cam) - less.px_from_cam(in_cam)) / (2 * _STEP))


def _blocks(by_point: csr_array) -> bsr_array:
    """The inverses of the 3 × 3 blocks of points' own normal equations, in the directions in which they are fixed."""
    normal = bsr_array(by_point.T @ by_point, blocksize=(3, 3))
    m = by_point.shape[1] // 3
    own = np.zeros((m, 3, 3))
    own[np.repeat(np.arange(m), np.diff(normal.indptr))] = normal.data
    inverse = np.linalg.pinv(own, rcond=_SINGULAR, hermitian=True)
    return bsr_array((inverse, np.arange(m), np.arange(m + 1)), shape=(3 * m, 3 * m))


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
