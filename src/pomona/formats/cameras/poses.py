"""Rotations as files give them: checked, then made exactly orthonormal."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.errors import FormatError

# Files round to a few digits: what is further from a rotation than this is no rounding.
_MOST_OFF = 1e-3


def rotation_from(matrix: FloatArray, where: str) -> FloatArray:
    """Return the rotation (3, 3) nearest to `matrix` (3, 3), which is one but for rounding.

    Raises `FormatError`, beginning with `where`, when a number is not finite or the matrix is not a rotation.
    """
    matrix = np.asarray(matrix, float)
    if not np.isfinite(matrix).all():
        raise FormatError(f"{where}: expected a rotation, found numbers that are not finite")
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > _MOST_OFF:
        raise FormatError(f"{where}: expected a rotation, found a matrix whose rows are not orthonormal")
    if np.linalg.det(matrix) < 0:
        raise FormatError(f"{where}: expected a rotation, found a reflection (determinant -1)")
    u, _, vt = np.linalg.svd(matrix)
    rotation: FloatArray = u @ vt
    return rotation


def pose_from(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Return [R | t] (3, 4)."""
    return np.column_stack([rotation, np.asarray(translation, float)])
