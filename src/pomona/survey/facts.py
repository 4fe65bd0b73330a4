"""Values of which the manifest holds the entries, as stages noted them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pomona.stages.scale.report import Accuracy, MarkerResidual, PieceScale, ScaleReport, SideTie
from pomona.stages.sfm.pieces import Unregistered
from pomona.values.cameras import WorldFrame


def frame_from(values: Mapping[str, Any]) -> WorldFrame:
    """Return the world frame of which `survey.json` holds the entries."""
    origin: Sequence[float] | None = values.get("origin")
    place = (float(origin[0]), float(origin[1]), float(origin[2])) if origin else None
    return WorldFrame(
        values["scale_source"], bool(values["approximate"]), bool(values["up_is_known"]), values.get("crs"), place
    )


def unregistered_from(entries: Sequence[Mapping[str, str]]) -> tuple[Unregistered, ...]:
    """Return the photos without a place of which the manifest holds the entries."""
    return tuple(Unregistered(**entry) for entry in entries)


def scale_report_from(values: Mapping[str, Any]) -> ScaleReport:
    """Return how metres were found, of which the manifest holds the entries; raises `KeyError` where one is missing."""
    return ScaleReport(
        source=values["source"],
        pieces=tuple(PieceScale(**_nan(entry)) for entry in values["pieces"]),
        markers=tuple(MarkerResidual(**_nan(entry)) for entry in values["markers"]),
        unseen_markers=tuple(values["unseen_markers"]),
        tied_pieces=int(values["tied_pieces"]),
        notes=tuple(values["notes"]),
        ties=tuple(SideTie(**_nan(entry)) for entry in values["ties"]),
        accuracy=Accuracy(**_nan(values["accuracy"])) if values["accuracy"] else None,
        contradictions=tuple(values["contradictions"]),
    )


def _nan(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {name: float("nan") if value is None else value for name, value in entry.items()}
