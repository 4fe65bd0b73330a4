"""The end of a run, for a person or as JSON, on stdout."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import typer

from pomona.basics.arrays import counted, to_digits
from pomona.cli.wording import all_with_options, with_options
from pomona.fruit.traits.kinds import fruit_kind
from pomona.pipeline import Summary
from pomona.pipeline.names import STAGE_WORDS

_SHORTEST_S = 0.05  # a stage that took less is "0.0 s", which nobody needs to read
_MOST_LISTED = 5  # of photos lost: `survey.json` and the report have all of them


def show(summary: Summary, *, as_json: bool = False, files: Sequence[Path] = ()) -> None:
    """Print the summary, and the names of further `files` that were written."""
    if as_json:
        values = all_with_options(summary.to_json())
        if files:
            values["files"] = [str(path) for path in files]  # names of files are printed as they are
        typer.echo(json.dumps(values, indent=1, ensure_ascii=False))
    else:
        typer.echo("\n".join([with_options(text_of(summary)), *map(str, files)]))


def text_of(summary: Summary) -> str:
    """Return the summary as lines of text."""
    lines = [_headline(summary)]
    lines += [f"  {name:11} {text}" for name, text in _entries(summary) if text]
    return "\n".join(lines)


def _headline(summary: Summary) -> str:
    if summary.fruits == 0:
        return "No fruit found"
    if summary.fruits is not None:
        of_kind = None if summary.fruit is None else fruit_kind(summary.fruit)
        return f"{of_kind.counted(summary.fruits) if of_kind else counted(summary.fruits, 'fruit')} found"
    if summary.photos_used is not None:
        return f"{summary.photos_used:,} of {counted(summary.photos, 'photo')} placed"
    return f"{counted(summary.detections or 0, 'detection')} in {counted(summary.photos, 'photo')}"


def _entries(summary: Summary) -> list[tuple[str, str]]:
    used = "" if summary.photos_used is None else f"{summary.photos_used:,} of {summary.photos:,} used"
    detections = "" if summary.detections is None else counted(summary.detections, "mask")
    return [
        ("photos", used),
        *_listed("not placed", summary.lost),
        *_listed("skipped", summary.skipped),
        ("detections", detections),
        ("all fruit", _crop(summary)),
        ("weight", _weight(summary)),
        ("corrections", summary.corrections or ""),
        ("scale", summary.scale or ""),
        ("sides", "; ".join(summary.sides)),
        ("time", _times(summary)),
        ("warnings", f"{len(summary.warnings)}, kept in survey.json" if summary.warnings else ""),
        ("report", str(summary.report) if summary.report else ""),
        ("folder", str(summary.survey)),
    ]


def _weight(summary: Summary) -> str:
    total = summary.weight
    if total is None:
        return ""
    middle, low, high = (to_digits(kg, 3) for kg in (total.kg, total.low_kg, total.high_kg))
    return f"{middle} kg ({low} to {high}, 95 %), estimated from {total.source}"


def _crop(summary: Summary) -> str:
    crop = summary.crop
    if crop is None:
        return ""
    every, along = crop.fruits, ""
    if crop.per_metre:
        middle, low, high = (
            to_digits(each, 3) for each in (crop.per_metre.value, crop.per_metre.low, crop.per_metre.high)
        )
        along = f"; {middle} a metre of row ({low} to {high})"
    return f"{every.value:,.0f} ({every.low:,.0f} to {every.high:,.0f}, 95 %{along}): {every.covers}"


def _listed(name: str, entries: tuple[tuple[str, str], ...]) -> list[tuple[str, str]]:
    lines = [(name if k == 0 else "", f"{photo} ({reason})") for k, (photo, reason) in enumerate(entries)]
    more = len(lines) - _MOST_LISTED
    return lines if more <= 0 else [*lines[:_MOST_LISTED], ("", f"and {more} more, see survey.json")]


def _times(summary: Summary) -> str:
    done = [stage for stage in summary.stages if not stage.kept]
    kept = [STAGE_WORDS[stage.name].lower() for stage in summary.stages if stage.kept]
    told = [stage for stage in done if stage.wall_s >= _SHORTEST_S]
    parts = [f"{STAGE_WORDS[stage.name].lower()} {seconds(stage.wall_s)}" for stage in told]
    text = f"{seconds(sum(stage.wall_s for stage in done))}" + (f" ({', '.join(parts)})" if parts else "")
    return text + (f"; kept from before: {', '.join(kept)}" if kept else "")


def seconds(value: float) -> str:
    """Return a duration as people say it."""
    if value < 90:
        return f"{value:.0f} s" if value >= 10 else f"{value:.1f} s"
    minutes, rest = divmod(round(value), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"
