"""Result of structure from motion: pieces in frames of their own, and the photos it could not place."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.values.cameras import Cameras


@dataclass(frozen=True)
class Unregistered:
    """A photo without a place: its side, the likely reason, and what a person can do about it."""

    photo: str
    side: str
    reason: str
    advice: str


@dataclass(frozen=True, eq=False)
class Piece:
    """Photos of one side that were placed together, in a frame of arbitrary scale, place and direction."""

    side: str
    cameras: Cameras
    mean_reprojection_error_px: float


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """All pieces, the largest of each side first, and the photos that belong to none."""

    pieces: tuple[Piece, ...]
    unregistered: tuple[Unregistered, ...] = ()
