"""COLMAP's camera models by name and number, and which lens of ours each one is.

Source: https://colmap.github.io/cameras.html and `src/colmap/sensor/models.h`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.errors import FormatError, InputError
from pomona.formats.cameras.lenses import FittedLens, Lens, check_params, fit_lens
from pomona.values.intrinsics import Intrinsics

# Name and number of parameters by COLMAP's model id.
MODELS: dict[int, tuple[str, int]] = {
    0: ("SIMPLE_PINHOLE", 3), 1: ("PINHOLE", 4), 2: ("SIMPLE_RADIAL", 4), 3: ("RADIAL", 5), 4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8), 6: ("FULL_OPENCV", 12), 7: ("FOV", 5), 8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5), 10: ("THIN_PRISM_FISHEYE", 12), 11: ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
}  # fmt: skip
_COUNTS = dict(MODELS.values())


def colmap_lens(model: str, width_px: int, height_px: int, params: Sequence[float], where: str) -> FittedLens:
    """Return our lens for one of COLMAP's.

    Raises `FormatError`, beginning with `where`, for a model that is not known or cannot be stood for, wrong numbers of
    parameters, and numbers without sense.
    """
    count = _COUNTS.get(model)
    if count is not None and len(params) != count:
        raise FormatError(f"{where}: expected {count} parameters of {model}, found {len(params)}")
    check_params((width_px, height_px), params[:1], params[1:], where)
    if model in _FISHEYES:
        shared, radial = _FISHEYES[model]
        fx, fy, cx, cy, *k = (params[0], *params) if shared else params
        bent = tuple(k[:radial])
        lens = Lens(
            width_px=width_px, height_px=height_px, fx=fx, fy=fy, cx=cx, cy=cy, radial=bent, curve="equidistant"
        )
        return fit_lens(lens, where)
    try:
        return FittedLens(Intrinsics(model, width_px, height_px, np.array(params)))
    except InputError as error:
        raise FormatError(f"{where}: {error}. Undistort the photos with COLMAP's image_undistorter first") from None


# Whether fx is fy, and how many coefficients the polynomial of the angle has.
_FISHEYES = {"OPENCV_FISHEYE": (False, 4), "SIMPLE_RADIAL_FISHEYE": (True, 1), "RADIAL_FISHEYE": (True, 2)}
