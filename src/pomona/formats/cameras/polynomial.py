"""Our lenses for programs that know polynomials alone: nerfstudio and Metashape, with k1 to k4 and p1, p2."""

from __future__ import annotations

import numpy as np

from pomona.arrays import FloatArray
from pomona.errors import InputError
from pomona.formats.cameras.lenses import MOST_OFF_PX, Lens
from pomona.intrinsics import Intrinsics

_STEPS = 40  # places a side of the photo at which lenses are compared


def polynomial_lens(intrinsics: Intrinsics, name: str) -> Lens:
    """Return a lens with a polynomial of four coefficients for one of ours: the same, or the nearest to a rational one.

    Raises `InputError`, with `name`, where none is nearer than 0.1 px (RMS) over the photo.
    """
    fx, fy, cx, cy, k1, k2, p1, p2, k3, *below = intrinsics.opencv_params.tolist()
    width_px, height_px = intrinsics.width_px, intrinsics.height_px
    radial = (k1, k2, k3, 0.0)
    if any(below):
        radial = _nearest(intrinsics)
    lens = Lens(width_px=width_px, height_px=height_px, fx=fx, fy=fy, cx=cx, cy=cy, radial=radial, p1=p1, p2=p2)
    if any(below):
        rays = intrinsics.cam_from_px(_grid(intrinsics))
        off = lens.px_from_cam(rays) - intrinsics.px_from_cam(rays)
        rms_px = float(np.sqrt((off**2).sum(1).mean()))
        if not rms_px < MOST_OFF_PX:
            raise InputError(
                f"The lens of {name} is too wide for a polynomial: the nearest is {rms_px:.2f} px away over the photo, "
                f"expected {MOST_OFF_PX}. Export COLMAP's format instead"
            )
    return lens


def _grid(intrinsics: Intrinsics) -> FloatArray:
    u, v = np.meshgrid(np.linspace(0, intrinsics.width_px, _STEPS), np.linspace(0, intrinsics.height_px, _STEPS))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def _nearest(intrinsics: Intrinsics) -> tuple[float, float, float, float]:
    """k1 to k4 that bend like the ratio of two polynomials, by least squares over the photo."""
    x, y, _ = intrinsics.cam_from_px(_grid(intrinsics)).T
    r2 = x * x + y * y
    k1, k2, _, _, k3, k4, k5, k6 = intrinsics.distortion
    ratio = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    r = np.sqrt(r2)  # pixels are moved by the factor times the radius
    found = np.linalg.lstsq(np.stack([r * r2**n for n in (1, 2, 3, 4)], axis=1), r * (ratio - 1), rcond=None)[0]
    first, second, third, fourth = found.tolist()
    return first, second, third, fourth
