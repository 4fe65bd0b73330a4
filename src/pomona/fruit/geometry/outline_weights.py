"""How much rays along the outline of a mask count in a fit, by where they pass a fruit's edge."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import FloatArray

# Cauchy scales, in radii, of outlines inside of a disc, where leaves cut it, and outside.
INSIDE_SCALE, OUTSIDE_SCALE = 0.06, 0.12
# Neighbouring rays of an outline err together: all of one mask count as so many.
_INDEPENDENT = 3.0


def outline_weights(
    residuals: FloatArray, inside_scale: float = INSIDE_SCALE, outside_scale: float = OUTSIDE_SCALE
) -> FloatArray:
    """Return the weights (k, r) of rays that pass so far outside of the edge, in radii; inside where it is less than 0.

    In the inverse square of a radius.
    """
    scales = np.where(residuals < 0, inside_scale, outside_scale)
    weights: FloatArray = _INDEPENDENT / (residuals.shape[1] * inside_scale**2) / (1 + (residuals / scales) ** 2)
    return weights
