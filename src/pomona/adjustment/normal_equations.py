"""Normal equations of cameras: what an adjustment solves, and what tells how uncertain it leaves them.

Photos turn about their centres and move, lenses change by the logarithm of their focal length and by their distortion.
Scene points are eliminated (Schur complement), so that equations are of photos, lenses and points of known place alone.
Source: Triggs et al. 2000, "Bundle adjustment: a modern synthesis", sections 6 and 9.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import bsr_array, coo_array, csc_array, csr_array, diags_array, hstack
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from pomona.adjustment.weights import Weights
from pomona.basics.arrays import FloatArray, IntArray, groups
from pomona.values.cameras import Cameras
from pomona.values.intrinsics import Intrinsics

TAIL = 2.385
"""Residuals of features have long tails: from so many standard deviations on they count less and less (Cauchy).

Matches that are wrong, but near their epipolar lines, lie 5 to 10 standard deviations off, and agree with whatever
lens the mapper had; a loss that grows with the distance (soft L1) heeds them. 2.385 loses 5 % where there are none.
Source: Zhang 1997, "Parameter estimation techniques", section 9.4.
"""
# What is known of a place is no outlier so soon as a match is.
_PLACE_TAIL = 2 * TAIL
# Eigenvalues of a point's normal equations below this share of the largest are of directions that no photo tells.
_SINGULAR = 1e-9
# An observation of a point behind its camera counts as so far off, in standard deviations.
_BEHIND = 1e4


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The linear equations of weighted cameras at their present places.

    k observations of m points. `by_kept` (2k, p): derivatives by photos, lenses and points of known place, in this
    order; `by_point` (2k, 3m'): by all other points, `free_idx` (m',). `residuals` (2k,); `prior` (p,): the inverse
    variances of what is known beforehand, and `prior_residuals` (p,).
    """

    by_kept: csr_array
    by_point: csr_array
    free_idx: IntArray
    residuals: FloatArray
    prior: FloatArray
    prior_residuals: FloatArray

    @cached_property
    def _own(self) -> FloatArray:
        """The normal equations (m', 3, 3) of each point by itself."""
        normal = bsr_array(self.by_point.T @ self.by_point, blocksize=(3, 3))
        own = np.zeros((len(self.free_idx), 3, 3))
        own[np.repeat(np.arange(len(own)), np.diff(normal.indptr))] = normal.data
        return own

    @cached_property
    def _cross(self) -> csr_array:
        return csr_array(self.by_kept.T @ self.by_point)

    @cached_property
    def of_kept(self) -> csr_array:
        """The equations (p, p) of what is kept, with all other points held where they are."""
        return csr_array(self.by_kept.T @ self.by_kept + diags_array(self.prior))

    def _inverses(self, damping: float) -> bsr_array:
        """The inverses of points' own equations, in the directions in which they are fixed."""
        own = self._own * (1 + damping * np.eye(3))
        inverse = np.linalg.pinv(own, rcond=_SINGULAR, hermitian=True)
        m = len(own)
        return bsr_array((inverse, np.arange(m), np.arange(m + 1)), shape=(3 * m, 3 * m))

    def _by_points(self, inverses: bsr_array) -> csr_array:
        """What the other points take from the equations (p, p) of what is kept, given the inverses of their own.

        In blocks of 3 × 3, a turn or shift by a point: where many photos see each point, this takes most of the time.
        """
        p, m = self._cross.shape
        starts = np.pad(self._cross.indptr, (0, -p % 3), mode="edge")  # rows of zeros make the last block whole
        whole = csr_array((self._cross.data, self._cross.indices, starts), shape=(p + -p % 3, m))
        cross = bsr_array(whole, blocksize=(3, 3))
        return csr_array(cross @ inverses @ cross.T)[:p, :p]

    def reduced(self) -> csr_array:
        """Return the equations (p, p) of what is kept, with all other points where they are best."""
        return csr_array(self.of_kept - self._by_points(self._inverses(0.0)))

    def step(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """Return the step (p,) of what is kept, and that of the other points (m', 3), shortened by `damping`.

        Source: Levenberg and Marquardt; damping is a share of each parameter's own equation.
        """
        inverses = self._inverses(damping)
        pull = self.by_kept.T @ self.residuals + self.prior * self.prior_residuals
        of_points = self.by_point.T @ self.residuals
        sizes = self.of_kept.diagonal()
        normal = self.of_kept + diags_array(damping * sizes + (sizes == 0)) - self._by_points(inverses)
        # Photos of a row see few others: the equations are sparse, and rows of a thousand photos fit into memory.
        solver = splu(csc_array(normal), "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        kept = -solver.solve(pull - self._cross @ (inverses @ of_points))
        points = -(inverses @ (of_points + self._cross.T @ kept))
        return kept, points.reshape(-1, 3)


def normal_equations(cameras: Cameras, weights: Weights) -> NormalEquations:
    """Return the equations of cameras; observations that are far off among their tracks count little (Cauchy)."""
    starts = lens_starts(cameras)
    width = int(starts[-1]) + 1 + len(cameras.intrinsics[-1].distortion_idx)
    entries = []
    k, m = len(cameras.track_point_idx), len(cameras.points_in_world)
    by_place, residuals = np.zeros((k, 2, 3)), np.zeros((k, 2))
    for lens, here in groups(cameras.intrinsics_idx[cameras.track_photo_idx]):
        of_photo, of_lens, of_point, off_px = derivatives(cameras, lens, here)
        weight = np.sqrt(_heeded(cameras, weights, here, off_px)) / np.asarray(weights.track_sds_px)[here]
        both = np.concatenate([of_photo, of_lens], axis=2) * weight[:, None, None]
        columns = np.empty(both.shape, np.int64)
        columns[:, :, :6] = (6 * cameras.track_photo_idx[here, None] + np.arange(6))[:, None]
        columns[:, :, 6:] = starts[lens] + np.arange(of_lens.shape[2])
        rows = (2 * here[:, None] + np.arange(2))[:, :, None]
        entries.append((both.ravel(), np.broadcast_to(rows, both.shape).ravel(), columns.ravel()))
        by_place[here], residuals[here] = of_point * weight[:, None, None], off_px * weight[:, None]
    values, rows, columns = (np.concatenate(part) for part in zip(*entries, strict=True))
    by_parameter = coo_array((values, (rows, columns)), shape=(2 * k, width)).tocsr()
    by_points = bsr_array((by_place, cameras.track_point_idx, np.arange(k + 1)), shape=(2 * k, 3 * m)).tocsr()
    known = np.asarray(weights.known_idx)
    free = np.setdiff1d(np.arange(m), known)
    kept = hstack([by_parameter, by_points[:, _columns(known)]])
    prior = _prior(cameras, weights, starts, width)
    return NormalEquations(csr_array(kept), by_points[:, _columns(free)], free, residuals.ravel(), *prior)


def _columns(points: IntArray) -> IntArray:
    return np.asarray((3 * points[:, None] + np.arange(3)).ravel(), np.int64)


def _prior(cameras: Cameras, weights: Weights, starts: IntArray, width: int) -> tuple[FloatArray, FloatArray]:
    """The inverse variances, and residuals, of what is known of focal lengths and of places."""
    q = len(weights.known_idx)
    prior, off = np.zeros(width + 3 * q), np.zeros(width + 3 * q)
    focals_px = np.array([lens.focal_px for lens in cameras.intrinsics])
    prior[starts] = 1 / np.asarray(weights.log_focal_sds) ** 2
    off[starts] = np.where(prior[starts] > 0, np.log(focals_px / np.asarray(weights.focals_px)), 0.0)
    apart = cameras.points_in_world[weights.known_idx] - weights.known_places
    variances = np.asarray(weights.known_sds_m) ** 2
    prior[width:] = np.repeat(1 / (variances + (apart**2).sum(1) / _PLACE_TAIL**2), 3)
    off[width:] = apart.ravel()
    return prior, off


def cost(cameras: Cameras, weights: Weights) -> float:
    """Return what an adjustment makes small: the sum of all residuals' losses, in squared standard deviations."""
    in_photos, _ = cameras.project_each(cameras.track_photo_idx, cameras.points_in_world[cameras.track_point_idx])
    off = (in_photos - cameras.track_xy_px) / weights.track_sds_px[:, None]
    squares = (np.nan_to_num(off, nan=_BEHIND) ** 2).sum(1)
    exact = np.isin(cameras.track_point_idx, weights.known_idx)
    total = float(np.where(exact, squares, TAIL**2 * np.log1p(squares / TAIL**2)).sum())
    apart = (cameras.points_in_world[weights.known_idx] - weights.known_places) / weights.known_sds_m[:, None]
    total += float((_PLACE_TAIL**2 * np.log1p((apart**2).sum(1) / _PLACE_TAIL**2)).sum())
    focals_px = np.array([lens.focal_px for lens in cameras.intrinsics])
    return total + float(np.nansum((np.log(focals_px / weights.focals_px) / weights.log_focal_sds) ** 2))


def _heeded(cameras: Cameras, weights: Weights, here: IntArray, off_px: FloatArray) -> FloatArray:
    """The weights (k,) that residuals leave observations: Cauchy's, and 1 of points of known place."""
    squares = (off_px**2).sum(1) / np.asarray(weights.track_sds_px)[here] ** 2
    # Sightings of known points were checked before; `left_out` takes them as they are.
    return np.where(np.isin(cameras.track_point_idx[here], weights.known_idx), 1.0, 1 / (1 + squares / TAIL**2))


def moved(cameras: Cameras, equations: NormalEquations, weights: Weights, damping: float) -> Cameras:
    """Return the cameras and points after one step."""
    kept, of_points = equations.step(damping)
    n = len(cameras)
    turns, shifts = kept[: 6 * n].reshape(n, 2, 3).transpose(1, 0, 2)
    rotations = Rotation.from_rotvec(turns).as_matrix() @ cameras.cam_from_world[:, :, :3]
    centers = cameras.centers_in_world + shifts
    translations = -np.einsum("nij,nj->ni", rotations, centers)
    points = cameras.points_in_world.copy()
    points[equations.free_idx] += of_points
    points[weights.known_idx] += kept[len(kept) - 3 * len(weights.known_idx) :].reshape(-1, 3)
    lenses = [
        _changed(lens, kept[start : start + 1 + len(lens.distortion_idx)])
        for lens, start in zip(cameras.intrinsics, lens_starts(cameras), strict=True)
    ]
    poses = np.concatenate([rotations, translations[:, :, None]], axis=2)
    return replace(cameras, intrinsics=tuple(lenses), cam_from_world=poses, points_in_world=points)


def _changed(lens: Intrinsics, change: FloatArray) -> Intrinsics:
    params = lens.params.copy()
    params[list(lens.focal_idx)] *= np.exp(change[0])
    params[list(lens.distortion_idx)] += change[1:]
    return replace(lens, params=params)


def lens_starts(cameras: Cameras) -> IntArray:
    """Return the parameters (l,) that are the lenses' focal lengths; those of their distortion follow each."""
    sizes = [1 + len(lens.distortion_idx) for lens in cameras.intrinsics]
    return np.asarray(6 * len(cameras) + np.cumsum([0, *sizes[:-1]]), np.int64)


def derivatives(
    cameras: Cameras, lens_idx: int, here: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return of the observations `here` (k,), all by one lens, the derivatives by photos, lens, points, and residuals.

    (k, 2, 6), (k, 2, q), (k, 2, 3) and (k, 2), in pixels; all 0 of points that are behind the camera.
    """
    poses, lens = cameras.cam_from_world[cameras.track_photo_idx[here]], cameras.intrinsics[lens_idx]
    rotations = poses[:, :, :3]
    in_cam = np.einsum("kij,kj->ki", rotations, cameras.points_in_world[cameras.track_point_idx[here]]) + poses[:, :, 3]
    by_place, by_params = lens.px_slopes(in_cam)
    of_point = by_place @ rotations
    # A turn by a small vector t moves a point p in the camera's axes by t x p; a shift moves it as the point inversely.
    of_turn = np.cross(in_cam[:, None], by_place)
    focal = (by_params[:, :, lens.focal_idx] * lens.params[list(lens.focal_idx)]).sum(2, keepdims=True)
    of_lens = np.concatenate([focal, by_params[:, :, lens.distortion_idx]], axis=2)
    off_px = lens.px_from_cam(in_cam) - cameras.track_xy_px[here]
    found = np.concatenate([of_turn, -of_point], axis=2), of_lens, of_point, off_px
    behind = ~np.isfinite(off_px).all(1)
    for part in found:
        part[behind] = 0.0
    return found
