"""The head of the report: totals, scale, warnings, time per stage."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from html import escape

import numpy as np

from pomona.stages.report.data import ReportData
from pomona.stages.report.html import Html, about, amount, amount_of, as_html
from pomona.stages.scale.report import ScaleReport
from pomona.values.cameras import METRES_FROM
from pomona.values.fruits import BOTH_SIDES

_BROUGHT_TOGETHER = {"markers": "", "gnss": "", "fruits": ", which brought the sides into one frame"}
# Spaces between a number and its unit or sign, at which a card breaks no line.
_BESIDE_NUMBERS = re.compile(r"(?<=[\d>]) (?=(?:%|mm|m|kg|g)(?![\w/]))|(?<=±) ")
_MOST_WARNINGS_SHOWN = 8  # more are folded away, so that the view stays on the first screen


def totals(data: ReportData) -> str:
    """Return the cards with the survey's figures."""
    return "".join(
        [
            _fruits(data),
            _crop(data),
            _weight(data),
            _diameter(data),
            _photos(data),
            _scale(data),
            _sides(data),
        ]
    )


def card(label: str, figure: str, more: str, kind: str = "") -> str:
    """A card; `figure` and `more` are HTML."""
    named = f"sheet total {kind}".strip()
    more = _BESIDE_NUMBERS.sub("\N{NO-BREAK SPACE}", more)
    return (
        f'<div class="{named}"><div class="label">{escape(label)}</div>'
        f'<div class="figure">{figure}</div><div class="more">{more}</div></div>'
    )


def _fruits(data: ReportData) -> str:
    parts = []
    if data.detections is not None:
        parts.append(f"from {amount_of(data.detections, 'detection')}")
    if len(data.fruits):
        each = " each" if len(data.fruits) > 1 else ""
        parts.append(f"seen {amount(float(data.fruits.views.mean()), 1)} times{each}")
    if data.corrections:
        parts.append(f"{amount_of(data.corrections, 'correction')} by hand")
    return card(data.fruit_words.capitalize(), amount(len(data.fruits)), ", ".join(parts), "main")


def _crop(data: ReportData) -> str:
    """All that hangs there with its interval; nothing where too little was found to say."""
    if data.crop is None:
        return ""
    every = data.crop.fruits
    parts = [f"{amount(every.low)} to {amount(every.high)} (95 %)"]
    if metre := data.crop.per_metre:
        ends = f"{about(metre.low, 3)} to {about(metre.high, 3)}"
        parts.append(f"{about(metre.value, 3)} a metre of row ({ends})")
    label = f"All {data.fruit_words}, hidden ones too"
    return card(label, amount(every.value), f"{', '.join(parts)}. {escape(every.covers.capitalize())}")


def _weight(data: ReportData) -> str:
    """The weight of all fruits with its interval; nothing where there is none."""
    total = data.weight
    if total is None:
        return ""
    digits = 1 if total.kg < 100 else 0
    parts = [f"{amount(total.low_kg, digits)} to {amount(total.high_kg, digits)} kg (95 %)"]
    parts.append(f"{amount(total.mean_g)} g each, estimated from {escape(total.source)}")
    if unweighed := len(data.fruits) - total.weighed:
        parts.append(f"{amount(unweighed)} not measured")
    return card("Weight", f"{amount(total.kg, digits)} <small>kg</small>", ", ".join(parts))


def _diameter(data: ReportData) -> str:
    sizes = data.fruits.diameters_m[np.isfinite(data.fruits.diameters_m)]
    if not len(sizes):
        return card("Median diameter", "–", "none measured")
    if not data.cameras.frame.metric:
        return card("Median diameter", f"{about(float(np.median(sizes)), 3)} <small>units</small>", "no scale is known")
    low, middle, high = 1000 * np.percentile(sizes, [10, 50, 90])
    more = f"80 % lie between {low:.0f} and {high:.0f} mm" if len(sizes) > 1 else "one fruit measured"
    if data.sizes is not None:
        low, all_middle, high = 1000 * np.array(data.sizes.crop)
        more = f"of the whole crop; 80 % lie between {low:.0f} and {high:.0f} mm. Measured: {amount(middle, 1)} mm"
        middle = all_middle
    return card("Median diameter", f"{amount(middle, 1)} <small>mm</small>", more)


def _photos(data: ReportData) -> str:
    given, used = data.usable_photos, len(data.cameras)
    parts = []
    if given > used:  # no reasons are known where no fruit was found, which needs no places
        without = f"{given - used} without a place"
        parts.append(f'<a href="#lost">{without}</a>' if data.lost else without)
    if skipped := len(data.photos.skipped):
        parts.append(f'<a href="#lost">{amount_of(skipped, "more file")} left out</a>')
    return card(
        "Photos used",
        f"{amount(used)} <small>of {amount(given)}</small>",
        ", ".join(parts) or "all of them have a place",
    )


def _scale(data: ReportData) -> str:
    frame = data.cameras.frame
    if not frame.metric:
        return card("Scale", '<span class="badge">not known</span>', "lengths are in arbitrary units")
    badge = '<span class="badge">approximate</span>' if frame.approximate else ""
    more: list[Html] = [as_html(scale_source(data))]
    if data.scale is not None:
        more += exactness(data.scale)
    if data.scale is not None and not data.scale.sides_are_tied:
        more.append(Html("sides are not tied to each other"))
    said = ", ".join(more)
    if data.scale is not None and data.scale.contradictions:
        doubt = f"contradicted by {len(data.scale.contradictions)} of the notes below"
        said = f'<strong style="color: var(--apple)">{said}; {doubt}</strong>'
    return card("Scale", f"metres {badge}".strip(), said)


def scale_source(data: ReportData) -> str:
    """Return where metres come from, in words; there must be metres."""
    return f"from {METRES_FROM[data.cameras.frame.scale_source]}"


def exactness(scale: ScaleReport) -> list[Html]:
    """Return how exact the cameras are, as HTML: by what was not fitted where that is known, else by the fit."""
    if scale.accuracy is not None:
        share, off_mm = about(100 * scale.accuracy.scale_sd), amount(scale.accuracy.position_sd_mm, 1)
        exact, check_mm = Html(f"± {share} %, positions ± {off_mm} mm"), scale.left_out_rms_mm
        checked = Html(f"markers left out in turn: {amount(check_mm, 1)} mm off")
        return [exact, *([checked] if math.isfinite(check_mm) else [])]
    return [Html(f"residual {amount(scale.markers_rms_mm, 1)} mm")] if math.isfinite(scale.markers_rms_mm) else []


def _sides(data: ReportData) -> str:
    """How well sides agree: by the pair that shares most fruits; nothing where there is no such pair."""
    ties = data.scale.ties if data.scale is not None else ()
    if not ties:
        return ""
    tie = max(ties, key=lambda tie: tie.fruits)
    seen_from_both = sum(side == BOTH_SIDES for side in data.fruits.sides)
    # Of the first fusion: of the fruits that there are now, a filter or a person may have taken some of them.
    more = f"{amount_of(tie.fruits, 'fruit')} placed by each side alone, {amount(seen_from_both)} seen from both"
    return card("Sides agree to", f"{tie.median_mm:.0f} <small>mm</small>", more + _BROUGHT_TOGETHER[tie.tied_by])


def notices(warnings: Sequence[str]) -> str:
    """Return the warnings in a box, the first few open to the eye; nothing where there are none."""
    if not warnings:
        return ""
    items = [f"<li>{escape(warning)}</li>" for warning in warnings]
    shown, folded = items[:_MOST_WARNINGS_SHOWN], items[_MOST_WARNINGS_SHOWN:]
    more = f"<details><summary>{len(folded)} more</summary><ul>{''.join(folded)}</ul></details>" if folded else ""
    return f'<section class="sheet notices"><h2>Please note</h2><ul>{"".join(shown)}</ul>{more}</section>'


def stage_times(data: ReportData) -> str:
    """Return the time of each stage as lying bars; nothing where no time is known."""
    if not data.stages:
        return ""
    longest = max(max(stage.wall_s for stage in data.stages), 1e-9)
    rows = []
    for stage in data.stages:
        memory = (
            f" <small>{amount(stage.peak_memory_mb / 1000, 1)} GB</small>" if stage.peak_memory_mb is not None else ""
        )
        track = f'<span class="track"><i style="width:{100 * stage.wall_s / longest:.1f}%"></i></span>'
        time = f'<span class="time">{duration(stage.wall_s)}{memory}</span>'
        rows.append(f"<span>{escape(stage.name)}</span>{track}{time}")
    peaks = [stage.peak_memory_mb for stage in data.stages if stage.peak_memory_mb is not None]
    memory = f", at most {amount(max(peaks) / 1000, 1)} GB of memory" if peaks else ""
    total = f'<p class="note">{duration(sum(stage.wall_s for stage in data.stages))} in all{memory}</p>'
    return f'<div class="sheet"><h2>Time per stage</h2>{total}<div class="stages">{"".join(rows)}</div></div>'


def duration(seconds: float) -> Html:
    """Return seconds as a person says them, as HTML: 3.2 s, 48 s, 5 min 07 s, 2 h 05 min."""
    if seconds < 9.95:
        return Html(f"{amount(seconds, 1)} s")
    whole = round(seconds)
    if whole < 60:
        return Html(f"{whole} s")
    if whole < 3600:
        return Html(f"{whole // 60} min {whole % 60:02d} s")
    return Html(f"{whole // 3600} h {whole % 3600 // 60:02d} min")
