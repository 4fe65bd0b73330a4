"""Rigid and similarity transforms, named `target_from_source`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import FloatArray, set_checked
from pomona.errors import InputError


@dataclass(frozen=True, eq=False)
class Similarity:
    """`x_target = scale * rotation @ x_source + translation`; `rotation` (3, 3), `translation` (3,)."""

    scale: float
    rotation: FloatArray
    translation: FloatArray

    def __post_init__(self) -> None:
        set_checked(self, "rotation", (3, 3), np.float64)
        set_checked(self, "translation", (3,), np.float64)
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise InputError(f"Similarity.scale: expected a positive number, found {self.scale}")

    @classmethod
    def identity(cls) -> Similarity:
        """Return the transform that leaves every point where it is."""
        return cls(1.0, np.eye(3), np.zeros(3))

    def apply(self, points: FloatArray) -> FloatArray:
        """Transform points (n, 3) from the source frame into the target frame."""
        return self.scale * np.asarray(points) @ self.rotation.T + self.translation

    def inverse(self) -> Similarity:
        """Return `source_from_target`."""
        rotation = self.rotation.T
        return Similarity(1.0 / self.scale, rotation, -(rotation @ self.translation) / self.scale)

    def compose(self, other: Similarity) -> Similarity:
        """Return `self ∘ other`: first `other`, then `self`."""
        return Similarity(
            self.scale * other.scale,
            self.rotation @ other.rotation,
            self.scale * self.rotation @ other.translation + self.translation,
        )


def estimate_similarity(points_in_source: FloatArray, points_in_target: FloatArray) -> Similarity:
    """Return the least-squares `target_from_source` of n ≥ 3 point pairs, each (n, 3).

    Source: Umeyama 1991, equations 40 to 43.

    Raises `InputError` when fewer than three pairs are given or when the points lie on one line.
    """
    source, target = np.asarray(points_in_source, float), np.asarray(points_in_target, float)
    if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 3 or len(source) < 3:
        raise InputError(f"A similarity needs at least 3 point pairs, found shapes {source.shape} and {target.shape}")
    source_mean, target_mean = source.mean(0), target.mean(0)
    source_centred, target_centred = source - source_mean, target - target_mean
    u, singular, vt = np.linalg.svd(target_centred.T @ source_centred / len(source))
    if singular[1] <= 1e-9 * max(singular[0], 1e-300):
        raise InputError("A similarity needs points that do not lie on one line")
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = u @ np.diag(sign) @ vt
    scale = float((singular * sign).sum() / (source_centred**2).sum(1).mean())
    return Similarity(scale, rotation, target_mean - scale * rotation @ source_mean)
