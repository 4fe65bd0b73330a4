"""Lenses of other programs, and what of ours is equal to them over the whole photo.

Programs differ in what they bend: polynomials of four coefficients and more, skewed pixels, fisheyes, whose polynomial
takes the angle to the axis in place of its tangent. Pomona's lenses are COLMAP's perspective models, of which the
widest is a ratio of two polynomials. Where a lens is one of these it is taken over as it is; any other is fitted, and
the difference over the photo is reported. What cannot be fitted to a tenth of a pixel is an error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import least_squares

from pomona.basics.arrays import BoolArray, FloatArray
from pomona.errors import FormatError
from pomona.values.intrinsics import Intrinsics

# How the tangent of the angle to the axis becomes the radius that the polynomials see.
Curve = Literal["perspective", "equidistant", "equisolid"]

MOST_OFF_PX = 0.1  # root mean square over the photo: well below what structure from motion leaves
_EXACT_PX = 1e-3  # what is nearer is the same lens: differences are of rounding in the file
_WIDEST_DEG = 85.0  # from the axis: a perspective lens comes to an end at 90
# Directions from the middle, places on each, and steps by which the widest place is looked for: finer changes no fit.
_SPOKES, _RINGS, _STEPS = 32, 24, 400
_MOST_TRIES = 100  # evaluations of the refinement, which begins near its end
# Of sizes, focal lengths and coefficients: beyond all lenses, and far from where numbers overflow.
_MOST_PX = 1e7


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A lens as other programs describe it; pixels are COLMAP's (the first one's centre is 0.5).

    With (x, y) the ray at z = 1, its radius bent by `curve`, and r² = x² + y²: x' = x (1 + radial₁ r² + radial₂ r⁴ + …)
    + (2 p1 x y + p2 (r² + 2 x²)) (1 + prism₁ r² + …), y' likewise; u = fx x' + skew y' + cx, v = fy y' + cy.
    """

    width_px: int
    height_px: int
    fx: float
    fy: float
    cx: float
    cy: float
    radial: tuple[float, ...] = ()
    p1: float = 0.0
    p2: float = 0.0
    prism: tuple[float, ...] = ()
    skew: float = 0.0
    curve: Curve = "perspective"

    def px_from_cam(self, rays_in_cam: FloatArray) -> FloatArray:
        """Project rays (n, 3) before the camera to pixels (n, 2)."""
        x: FloatArray = rays_in_cam[:, 0] / rays_in_cam[:, 2]
        y: FloatArray = rays_in_cam[:, 1] / rays_in_cam[:, 2]
        bent = self.bend(np.hypot(x, y))
        x, y = x * bent, y * bent
        r2 = x * x + y * y
        radial, prism = 1.0 + _series(self.radial, r2), 1.0 + _series(self.prism, r2)
        x_seen = x * radial + (2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x)) * prism
        y_seen = y * radial + (self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y) * prism
        return np.stack([self.fx * x_seen + self.skew * y_seen + self.cx, self.fy * y_seen + self.cy], axis=1)

    def bend(self, tangent: FloatArray) -> FloatArray:
        """Return by what a ray's radius at z = 1 (n,) is multiplied before the polynomials see it."""
        if self.curve == "perspective":
            return np.ones_like(tangent)
        angle, safe = np.arctan(tangent), np.where(tangent > 0, tangent, 1.0)
        bent = angle if self.curve == "equidistant" else 2 * np.sin(angle / 2)
        return np.where(tangent > 0, bent / safe, 1.0)


@dataclass(frozen=True, eq=False)
class FittedLens:
    """Ours for a lens of another program, and how far they are from each other over the photo (RMS and most)."""

    intrinsics: Intrinsics
    rms_px: float = 0.0
    most_px: float = 0.0

    def note(self, name: str) -> str:
        """Say what was done to the lens `name`, "" where nothing was."""
        if self.most_px < _EXACT_PX:
            return ""
        return (
            f"the lens of {name} was replaced by an equivalent one of COLMAP's models, which differs by "
            f"{self.rms_px:.3f} px over the photo (RMS; {self.most_px:.3f} px at most)"
        )


def fit_lens(lens: Lens, where: str) -> FittedLens:
    """Return our lens for one of another program: the same where it can be, else the nearest.

    Raises `FormatError`, beginning with `where`, for one without sense or farther than 0.1 px (RMS) from any of ours.
    """
    _check(lens, where)
    same = _same(lens)
    if same is not None:
        return FittedLens(same)
    with np.errstate(all="ignore"):
        rays = _rays_over_photo(lens, where)
        fitted, px = _fitted(lens, rays), lens.px_from_cam(rays)
        off = np.linalg.norm(fitted.px_from_cam(rays) - px, axis=1)
        # Spokes are dense at the axis: weighted by their distance from it, pixels count alike over the whole photo.
        weight = np.linalg.norm(px - [lens.cx, lens.cy], axis=1)
        result = FittedLens(fitted, float(np.sqrt(np.average(off**2, weights=weight))), float(off.max()))
    if not result.rms_px < MOST_OFF_PX:
        raise FormatError(
            f"{where}: no perspective lens comes nearer to this one than {result.rms_px:.2f} px over the photo, "
            f"expected {MOST_OFF_PX}{_advice(lens)}"
        )
    return result


def check_params(size_px: tuple[int, int], focals_px: Sequence[float], others: Sequence[float], where: str) -> None:
    """Raise `FormatError`, beginning with `where`, where the numbers of a lens are of no camera on Earth."""
    whole = all(0 < side <= _MOST_PX for side in size_px) and all(0 < focal <= _MOST_PX for focal in focals_px)
    if not whole or not np.isfinite(others).all() or np.abs(others).max(initial=0) > _MOST_PX:
        numbers = " ".join(f"{number:g}" for number in (*focals_px, *others))
        raise FormatError(
            f"{where}: expected a photo's size and a focal length above 0, and finite numbers, all in pixels, found "
            f"{size_px[0]} × {size_px[1]} and {numbers}"
        )


def _check(lens: Lens, where: str) -> None:
    others = (lens.cx, lens.cy, lens.p1, lens.p2, lens.skew, *lens.radial, *lens.prism)
    check_params((lens.width_px, lens.height_px), (lens.fx, lens.fy), others, where)


def _advice(lens: Lens) -> str:
    if lens.skew:
        return f". Its pixels are skewed by {lens.skew:.3g} px: optimize the cameras without skew (B2)"
    return ". Undistort the photos in that program, and give the undistorted ones with their cameras"


def _same(lens: Lens) -> Intrinsics | None:
    """Ours where the lens is one of COLMAP's perspective models already."""
    radial = np.trim_zeros(np.array(lens.radial), "b")
    if lens.curve != "perspective" or lens.skew or np.any(lens.prism) or len(radial) > 3:
        return None
    k1, k2, k3 = [*radial.tolist(), 0.0, 0.0, 0.0][:3]
    params = [lens.fx, lens.fy, lens.cx, lens.cy, k1, k2, lens.p1, lens.p2]
    if k3 == 0:
        return Intrinsics("OPENCV", lens.width_px, lens.height_px, np.array(params))
    return Intrinsics("FULL_OPENCV", lens.width_px, lens.height_px, np.array([*params, k3, 0.0, 0.0, 0.0]))


def _rays_over_photo(lens: Lens, where: str) -> FloatArray:
    """Rays (n, 3) whose pixels fill the photo: along spokes from the axis until each leaves the photo."""
    corners = np.array([[0, 0], [lens.width_px, 0], [0, lens.height_px], [lens.width_px, lens.height_px]])
    to_corners = np.arctan2(corners[:, 1] - lens.cy, corners[:, 0] - lens.cx)
    turns = np.concatenate([np.linspace(0, 2 * np.pi, _SPOKES, endpoint=False), to_corners])
    tangents = np.tan(np.radians(np.linspace(0, _WIDEST_DEG, _STEPS)))
    spokes = []
    for turn in turns:
        direction = np.array([np.cos(turn), np.sin(turn)])
        rays = _spoke(direction, tangents)
        px = lens.px_from_cam(rays)
        inside = _inside(lens, px)
        last = int(np.argmin(inside)) if not inside.all() else -1
        if last < 0:
            raise FormatError(
                f"{where}: this lens sees more than {2 * _WIDEST_DEG:.0f} degrees, or folds the scene over within the "
                "photo; expected one that a perspective lens can stand for. Undistort the photos in that program, and "
                "give the undistorted ones with their cameras"
            )
        if last > 0:
            spokes.append(_spoke(direction, np.tan(np.arctan(tangents[last]) * np.linspace(0, 1, _RINGS))))
    if not spokes:
        raise FormatError(f"{where}: expected a principal point within the photo, found ({lens.cx:g}, {lens.cy:g})")
    return np.concatenate(spokes)


def _spoke(direction: FloatArray, tangents: FloatArray) -> FloatArray:
    return np.column_stack([tangents[:, None] * direction, np.ones(len(tangents))])


def _inside(lens: Lens, px: FloatArray) -> BoolArray:
    inside: BoolArray = ((px >= 0) & (px <= [lens.width_px, lens.height_px])).all(axis=1)
    return inside


def _fitted(lens: Lens, rays: FloatArray) -> Intrinsics:
    """The rational lens nearest to `lens`: its radial part by linear least squares, and all of it if that is not it."""
    start = np.array([lens.fx, lens.fy, lens.cx, lens.cy, 0, 0, lens.p1, lens.p2, 0, 0, 0, 0])
    start[[4, 5, 8, 9, 10, 11]] = _rational(lens, rays)
    first = Intrinsics("FULL_OPENCV", lens.width_px, lens.height_px, start)
    wanted = lens.px_from_cam(rays)
    off = first.px_from_cam(rays) - wanted
    if np.abs(off).max() < _EXACT_PX:
        return first
    scale = np.array([lens.fx, lens.fy, lens.fx, lens.fy, 1, 1, 1, 1, 1, 1, 1, 1.0])

    def misfit(params: FloatArray) -> FloatArray:
        tried = Intrinsics("FULL_OPENCV", lens.width_px, lens.height_px, start + scale * params)
        return np.nan_to_num(tried.px_from_cam(rays) - wanted, nan=1e6, posinf=1e6, neginf=-1e6).ravel()

    found = least_squares(misfit, np.zeros(12), method="lm", max_nfev=_MOST_TRIES)
    second = Intrinsics("FULL_OPENCV", lens.width_px, lens.height_px, start + scale * found.x)
    return second if np.square(misfit(found.x)).sum() < np.square(off).sum() else first


def _rational(lens: Lens, rays: FloatArray) -> FloatArray:
    """k1, k2, k3, k4, k5, k6 of (1 + k1 s + k2 s² + k3 s³) / (1 + k4 s + k5 s² + k6 s³) nearest to the radial factor.

    s is the squared tangent. The ratio is made linear by its denominator, which is then a weight (Sanathanan and
    Koerner 1963).
    """
    widest = np.arctan(np.hypot(rays[:, 0], rays[:, 1]).max())
    tangent = np.tan(np.linspace(0, widest, _STEPS)[1:])
    bent = lens.bend(tangent)
    squared: FloatArray = (tangent * bent) ** 2
    factor = bent * (1 + _series(lens.radial, squared))
    s = tangent**2 / tangent.max() ** 2
    powers = np.stack([s, s**2, s**3], axis=1)
    below = np.ones_like(s)
    for _ in range(10):
        weight = (tangent / np.abs(below))[:, None]
        rows = np.hstack([powers, -factor[:, None] * powers])
        found = np.linalg.lstsq(rows * weight, (factor - 1) * weight[:, 0], rcond=1e-12)[0]
        below = 1 + powers @ found[3:]
        if not np.abs(below).min() > 1e-6:
            break
    result: FloatArray = found / np.tile(tangent.max() ** np.array([2.0, 4.0, 6.0]), 2)
    return result


def _series(coefficients: tuple[float, ...], s: FloatArray) -> FloatArray:
    """c₁ s + c₂ s² + …"""
    total: FloatArray = np.zeros(s.shape)
    for coefficient in reversed(coefficients):
        total = (total + coefficient) * s
    return total
