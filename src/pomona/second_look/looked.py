"""Spheres, and what photos show at their places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pomona.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.spheres import Spheres


@dataclass(frozen=True, eq=False)
class Looked:
    """n spheres, and what photos show at their places.

    `seen` (n,): the mean probability of a centre there in the photos that show it best, NaN where none looked.
    `likelihoods_nats` (n,): how much likelier it is to see what all photos show if there is a fruit than if there is
    none; 0 where none looked.
    """

    spheres: Spheres
    seen: FloatArray
    likelihoods_nats: FloatArray

    def __post_init__(self) -> None:
        set_checked(self, "seen", (len(self.spheres),), np.float64)
        set_checked(self, "likelihoods_nats", (len(self.spheres),), np.float64)

    @classmethod
    def joined(cls, parts: Sequence[Looked]) -> Looked:
        """Return the spheres of all parts, one part after the other."""
        return cls(
            Spheres.joined([part.spheres for part in parts]),
            np.concatenate([part.seen for part in parts]),
            np.concatenate([part.likelihoods_nats for part in parts]),
        )

    def __getitem__(self, selection: BoolArray | IntArray) -> Looked:
        return Looked(self.spheres[selection], self.seen[selection], self.likelihoods_nats[selection])
