"""The summary at the end of a run, which `survey.json` keeps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pomona.basics.arrays import counted
from pomona.survey import StageRecord, SurveyFolder
from pomona.survey.digest import plain
from pomona.survey.facts import scale_report_from
from pomona.values.cameras import METRES_FROM, WorldFrame
from pomona.values.crop import Crop
from pomona.values.fruits import TotalWeight
from pomona.values.photos import side_in_words


@dataclass(frozen=True)
class SettledStage:
    """How long a stage took (seconds), its peak memory (MB), and whether it was kept from an earlier run."""

    name: str
    wall_s: float
    peak_memory_mb: float | None
    kept: bool


@dataclass(frozen=True)
class Summary:
    """The end of a run. What a partial run did not come to is None.

    `fruit` is the kind that the person named; `crop` is all that hangs there, hidden fruits too; `sides` says how well
    the sides of the row agree, or that they are not joined, `corrections` how many were applied; `lost` are
    photo names with reasons.
    """

    survey: Path
    photos: int
    detections: int | None
    photos_used: int | None
    fruits: int | None
    fruit: str | None
    weight: TotalWeight | None
    crop: Crop | None
    corrections: str | None
    scale: str | None
    approximate: bool | None
    sides: tuple[str, ...]
    lost: tuple[tuple[str, str], ...]
    skipped: tuple[tuple[str, str], ...]
    stages: tuple[SettledStage, ...]
    warnings: tuple[str, ...]
    report: Path | None

    def to_json(self) -> dict[str, Any]:
        """Return it as `pomona run --json` prints it."""
        values: dict[str, Any] = plain(self)
        return values


def summarise(
    survey: SurveyFolder,
    photos: int,
    skipped: tuple[tuple[str, str], ...],
    warnings: tuple[str, ...],
    *,
    settled: Set[str],
    ran: Set[str],
    words: Callable[[str], str] = str,
) -> Summary:
    """Return the summary of what `survey.json` knows of the stages that a run `settled`; those in `ran` it computed.

    Warnings are in the `words` of who listens to the run.
    """
    records = {name: record for name, record in survey.records.items() if name in settled}
    scale = records.get("scale")
    results = records.get("results")
    lost = _lost(scale, "lost") if scale else _lost(records.get("sfm"), "unregistered")
    of_stages = (words(warning) for record in records.values() for warning in record.warnings)
    all_warnings = dict.fromkeys([*warnings, *of_stages])
    return Summary(
        survey=survey.folder,
        photos=photos,
        detections=records["select"].info["detections"] if "select" in records else None,
        photos_used=int(scale.info["photos"]) if scale else None,
        fruits=int(results.info["fruits"]) if results else None,
        weight=TotalWeight.from_json(results.info.get("weight")) if results else None,
        crop=Crop.from_json(results.info.get("crop")) if results else None,
        fruit=(survey.get("options") or {}).get("fruit"),
        corrections=_corrections(results.info) if results else None,
        scale=_scale(scale.info) if scale else None,
        approximate=bool(scale.info["frame"]["approximate"]) if scale else None,
        sides=_sides(scale.info["report"]) if scale else (),
        lost=tuple(lost),
        skipped=skipped,
        stages=tuple(
            SettledStage(name, record.wall_s, record.peak_memory_mb, name not in ran)
            for name, record in records.items()
        ),
        warnings=tuple(all_warnings),
        report=survey.report if "report" in records else None,
    )


def _corrections(info: Mapping[str, Any]) -> str | None:
    numbers = info.get("corrections")
    if numbers is None:
        return None
    lost = f"; {numbers['lost']} match no fruit any more" if numbers["lost"] else ""
    return f"{numbers['all'] - numbers['lost']} applied{lost}"


def _lost(record: StageRecord | None, entry: str) -> list[tuple[str, str]]:
    photos = record.info[entry] if record else []
    return [(photo["photo"], f"{photo['reason']}: {photo['advice']}") for photo in photos]


def _scale(info: Mapping[str, Any]) -> str:
    frame = WorldFrame(info["frame"]["scale_source"], bool(info["frame"]["approximate"]))
    text = f"metres from {METRES_FROM[frame.scale_source]}" if frame.metric else "unknown"
    residuals = [m["residual_mm"] for m in info["report"]["markers"] if m["used"] and m["residual_mm"] is not None]
    accuracy = info["report"]["accuracy"]
    if accuracy:
        scale_percent, position_mm = 100 * accuracy["scale_sd"], accuracy["position_sd_mm"]
        text += f" (scale ± {scale_percent:.2g} %, positions ± {position_mm:.1f} mm)"
    elif frame.scale_source in ("markers", "control-points") and residuals:
        rms_mm = math.sqrt(sum(r * r for r in residuals) / len(residuals))
        text += f" (residual {rms_mm:.1f} mm)"
    if contradictions := len(info["report"]["contradictions"]):
        text += f"; contradicted by {contradictions} of the warnings"
    return text + (", approximate" if frame.approximate and frame.metric else "")


def _sides(report: Mapping[str, Any]) -> tuple[str, ...]:
    """How well sides agree that are in one frame, and which are in none."""
    agree = [_tie(entry) for entry in report["ties"]]
    if scale_report_from(report).sides_are_tied:
        return tuple(agree)
    sides = [*dict.fromkeys(piece["side"] for piece in report["pieces"])]
    if len(sides) == 1:
        apart = f"pieces of {side_in_words(sides[0])} are not joined: they were set beside each other"
    else:
        parts = "some pieces of " if report["tied_pieces"] > 1 else ""
        apart = f"{parts}{' and '.join(sides)} are not joined: fruits seen from both are counted twice"
    return (*agree, apart)


def _tie(entry: Mapping[str, Any]) -> str:
    one, other = entry["side"], entry["other"]
    names = f"{one} and {other}" if one != other else f"pieces of {side_in_words(one)}"
    fruits = counted(entry["fruits"], "fruit")
    return f"{names} agree to {entry['median_mm']:.0f} mm (median of {fruits} that each sees alone)"
