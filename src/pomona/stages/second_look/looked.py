"""Spheres, and what photos show at their places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import BoolArray, IntArray
from pomona.errors import InputError
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse import Shown


@dataclass(frozen=True, eq=False)
class Looked:
    """n spheres, and what photos show at their places."""

    spheres: Spheres
    shown: Shown

    def __post_init__(self) -> None:
        if len(self.shown) != len(self.spheres):
            raise InputError(f"Looked.shown: expected it of {len(self.spheres)} spheres, found {len(self.shown)}")

    @classmethod
    def joined(cls, parts: Sequence[Looked]) -> Looked:
        """Return the spheres of all parts, one part after the other."""
        seen, likelihoods_nats = (
            np.concatenate([getattr(part.shown, name) for part in parts]) for name in ("seen", "likelihoods_nats")
        )
        return cls(Spheres.joined([part.spheres for part in parts]), Shown(seen, likelihoods_nats))

    def __getitem__(self, selection: BoolArray | IntArray) -> Looked:
        return Looked(self.spheres[selection], self.shown[selection])
