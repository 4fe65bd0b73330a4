"""Our lenses for programs that know polynomials alone: nerfstudio and Metashape, with k1 to k4 and p1, p2."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.errors import InputError
from pomona.formats.cameras.lenses import MOST_OFF_PX, Lens
from pomona.values.intrinsics import Intrinsics

_STEPS = 40  # places a side of the photo at which lenses are compared


def polynomial_lens(intrinsics: Intrinsics, name: str, *, fewest: int = 4) -> Lens:
    """Return a lens with a polynomial of four coefficients for one of ours: the same, or the nearest to a rational one.

    Those beyond the first `fewest` are 0 wherever a lens without them is near enough. Raises `InputError`, with `name`,
    where none is nearer than 0.1 px (RMS) over the photo.
    """
    fx, fy, cx, cy, k1, k2, p1, p2, k3, *below = intrinsics.opencv_params.tolist()
    width_px, height_px = intrinsics.width_px, intrinsics.height_px
    radial = (k1, k2, k3, 0.0)
    lens = Lens(width_px=width_px, height_px=height_px, fx=fx, fy=fy, cx=cx, cy=cy, radial=radial, p1=p1, p2=p2)
    if not any(below):
        return lens
    rays = intrinsics.cam_from_px(_grid(intrinsics))
    px = intrinsics.px_from_cam(rays)
    for count in range(fewest, 5):
        lens = replace(lens, radial=_nearest(intrinsics, count))
        rms_px = float(np.sqrt(((lens.px_from_cam(rays) - px) ** 2).sum(1).mean()))
        if rms_px < MOST_OFF_PX:
            return lens
    raise InputError(
        f"The lens of {name} is too wide for a polynomial: the nearest is {rms_px:.2f} px away over the photo, "
        f"expected {MOST_OFF_PX}. Export COLMAP's format instead"
    )


def _grid(intrinsics: Intrinsics) -> FloatArray:
    u, v = np.meshgrid(np.linspace(0, intrinsics.width_px, _STEPS), np.linspace(0, intrinsics.height_px, _STEPS))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def _nearest(intrinsics: Intrinsics, count: int) -> tuple[float, float, float, float]:
    """k1 to k4, 0 beyond `count`, that bend like the ratio of two polynomials, by least squares over the photo."""
    x, y, _ = intrinsics.cam_from_px(_grid(intrinsics)).T
    r2 = x * x + y * y
    k1, k2, _, _, k3, k4, k5, k6 = intrinsics.distortion
    ratio = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    r = np.sqrt(r2)  # pixels are moved by the factor times the radius
    powers = np.stack([r * r2**n for n in range(1, count + 1)], axis=1)
    found = np.linalg.lstsq(powers, r * (ratio - 1), rcond=None)[0]
    first, second, third, fourth = [*found.tolist(), 0.0][:4]
    return first, second, third, fourth
