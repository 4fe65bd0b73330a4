"""What the scale stage knows of each piece while it works: a place in the world, a scale alone, or why neither."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pomona.adjustment.weights import Landmark
from pomona.progress import Progress
from pomona.stages.scale.report import Accuracy, MarkerResidual, PieceScale, SideTie
from pomona.stages.sfm.pieces import Piece
from pomona.values.cameras import Cameras, ScaleSource
from pomona.values.photos import side_in_words


@dataclass(frozen=True, eq=False)
class Adjusted:
    """Pieces adjusted together: their photos in order, with the lenses that these share, and what held them.

    `markers` by id, and `fruits`, both weighed as they were last.
    """

    cameras: Cameras
    markers: Mapping[int, Landmark]
    fruits: Sequence[Landmark] = ()

    def markers_in(self, cameras: Cameras) -> dict[int, Landmark]:
        """Return the markers as other cameras see them, which have all these photos, in another order."""
        index = {name: i for i, name in enumerate(cameras.photos)}
        here = np.array([index[name] for name in self.cameras.photos])
        return {i: replace(marker, photo_idx=here[marker.photo_idx]) for i, marker in self.markers.items()}


@dataclass
class Placement:
    """What is known so far of each piece, by its index.

    `in_world` holds the cameras of pieces that are in the world frame by measurement ("tied" in the report);
    `metres_per_unit` the scales known, whether or not the piece has a place; `scales` where both came from; `met` the
    pieces that were registered to each other by their fruits; `marker_names` what a person calls markers, by id, where
    that is not the number on a plate;
    `failures` why sources gave none; `ties` how sides agree on fruits that both see; `adjusted` what was adjusted on
    markers, and `accuracy` what that says of itself; `resected` photos of no such piece that markers and fruits placed;
    `contradictions` those of the `notes` that say that a check contradicts it.
    """

    pieces: Sequence[Piece]
    progress: Progress
    marker_names: Mapping[int, str] = field(default_factory=dict)
    in_world: dict[int, Cameras] = field(default_factory=dict)
    metres_per_unit: dict[int, float] = field(default_factory=dict)
    scales: dict[int, PieceScale] = field(default_factory=dict)
    met: set[int] = field(default_factory=set)
    failures: dict[int, list[str]] = field(default_factory=dict)
    markers: list[MarkerResidual] = field(default_factory=list)
    unseen_markers: tuple[int, ...] = ()
    notes: list[str] = field(default_factory=list)
    contradictions: list[str] = field(default_factory=list)
    ties: list[SideTie] = field(default_factory=list)
    accuracy: Accuracy | None = None
    adjusted: Adjusted | None = None
    resected: Cameras | None = None

    def warn(self, message: str) -> None:
        """Warn the person, and keep the message for the survey."""
        self.notes.append(message)
        self.progress.warn(message)

    def contradict(self, message: str) -> None:
        """Warn of a check that contradicts what the places, or the scale, were taken to be."""
        self.contradictions.append(message)
        self.warn(message)

    def add_failure(self, idx: int, reason: str) -> None:
        """Remember why a source gave a piece no scale or place."""
        self.failures.setdefault(idx, []).append(reason)

    def set_scale(
        self,
        idx: int,
        source: ScaleSource,
        metres_per_unit: float,
        rms_mm: float = float("nan"),
        scale_sd: float = float("nan"),
    ) -> None:
        """Remember a piece's scale, where it came from, and how exact it is."""
        piece = self.pieces[idx]
        self.metres_per_unit[idx] = metres_per_unit
        self.scales[idx] = PieceScale(piece.side, len(piece.cameras), source, metres_per_unit, rms_mm, scale_sd)

    def name(self, idx: int) -> str:
        """Name a piece for a person."""
        piece = self.pieces[idx]
        called = side_in_words(piece.side, begins=True)
        return f"{called}{'' if self.is_main(idx) else f', piece {idx + 1}'}"

    def marker_name(self, marker_id: int) -> str:
        """Name a marker, or a point that was clicked, for a person."""
        return self.marker_names.get(marker_id, f"marker {marker_id}")

    def name_with_photos(self, idx: int) -> str:
        """Name a piece, and its first and last photo, for a person."""
        photos = self.pieces[idx].cameras.photos
        return f"{self.name(idx)} ({photos[0]} to {photos[-1]})"

    def is_main(self, idx: int) -> bool:
        """Say whether a piece is the largest of its side (it comes first)."""
        return all(piece.side != self.pieces[idx].side for piece in self.pieces[:idx])

    def unscaled(self) -> list[int]:
        """The pieces without a scale, so far."""
        return [i for i in range(len(self.pieces)) if i not in self.metres_per_unit]
