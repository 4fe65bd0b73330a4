"""What reading another program's cameras gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import IntArray
from pomona.values.cameras import Cameras
from pomona.values.intrinsics import Intrinsics


@dataclass(frozen=True, eq=False)
class GivenCameras:
    """Cameras from a file of `program`, and `notes`: what a person should know of how they were read.

    `upright` is True where the file is of the photos as they are looked at (EXIF orientation applied), as Pomona's own
    are; other programs mean the pixels as they are stored.
    """

    cameras: Cameras
    program: str
    notes: tuple[str, ...] = ()
    upright: bool = False


def shared(lenses: Sequence[Intrinsics]) -> tuple[tuple[Intrinsics, ...], IntArray]:
    """Return each different lens once, and which of them each camera has, (n,)."""
    keys = [(lens.model, lens.width_px, lens.height_px, *lens.params.tolist()) for lens in lenses]
    order = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    unique = dict(zip(keys, lenses, strict=True))
    return tuple(unique[key] for key in order), np.array([order[key] for key in keys], np.int64)
