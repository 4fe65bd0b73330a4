"""The scale stage's notebook: which pieces have a place, which a scale alone, and what to tell a person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from pomona.cameras import Cameras, ScaleSource
from pomona.progress import Progress
from pomona.scale.values import MarkerResidual, PieceScale, SideTie
from pomona.sfm.pieces import Piece


@dataclass
class Work:
    """What is known so far of each piece, by its index.

    `tied` holds cameras that are in the world frame already; `metres_per_unit` the pieces that have a scale alone;
    `scales` tells of both; `failures` says what was tried in vain;
    `ties` how sides agree on fruits that both see.
    """

    pieces: Sequence[Piece]
    progress: Progress
    tied: dict[int, Cameras] = field(default_factory=dict)
    metres_per_unit: dict[int, float] = field(default_factory=dict)
    scales: dict[int, PieceScale] = field(default_factory=dict)
    failures: dict[int, list[str]] = field(default_factory=dict)
    markers: list[MarkerResidual] = field(default_factory=list)
    unseen: tuple[int, ...] = ()
    notes: list[str] = field(default_factory=list)
    ties: list[SideTie] = field(default_factory=list)

    def tell(self, message: str) -> None:
        """Warn the person, and keep the message for the survey."""
        self.notes.append(message)
        self.progress.warn(message)

    def fail(self, idx: int, reason: str) -> None:
        """Remember why a source gave a piece no scale."""
        self.failures.setdefault(idx, []).append(reason)

    def scale(self, idx: int, source: ScaleSource, metres_per_unit: float, rms_mm: float = float("nan")) -> None:
        """Remember where a piece's metres came from."""
        piece = self.pieces[idx]
        self.metres_per_unit[idx] = metres_per_unit
        self.scales[idx] = PieceScale(piece.side, len(piece.cameras), source, metres_per_unit, rms_mm)

    def name(self, idx: int) -> str:
        """Name a piece for a person."""
        piece = self.pieces[idx]
        return f"Side {piece.side or 'of the row'}{'' if self.is_main(idx) else f', piece {idx + 1}'}"

    def is_main(self, idx: int) -> bool:
        """Say whether a piece is the largest of its side (it comes first)."""
        return all(piece.side != self.pieces[idx].side for piece in self.pieces[:idx])

    def unscaled(self) -> list[int]:
        """The pieces without a scale, so far."""
        return [i for i in range(len(self.pieces)) if i not in self.metres_per_unit]
