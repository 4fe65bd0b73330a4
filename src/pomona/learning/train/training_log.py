"""The log of a training as a table and as curves."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from pomona.stages.report.svg import nice_step, number

SCORES = ("ap50", "f1")
_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _BOTTOM = 720.0, 260.0, 52.0, 120.0, 28.0, 40.0
_COLOURS = ("#1b7837", "#762a83", "#d6604d", "#2166ac", "#8c510a")
_STYLE = "text{font:12px sans-serif;fill:#333}.grid{stroke:#ddd}.curve{fill:none;stroke-width:1.8}"


def write_log(path: Path, rows: Sequence[Mapping[str, str]]) -> None:
    """Write one row a check, losses first, then scores, as CSV."""
    part = path.with_suffix(".part")
    with part.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
    part.replace(path)


def write_curves(path: Path, rows: Sequence[Mapping[str, str]], losses: Sequence[str]) -> None:
    """Draw the losses and, below, the scores on photos held out, over the steps, as an SVG file of its own."""
    steps = [float(row["step"]) for row in rows]
    panels = [("losses", losses), ("scores on photos held out", SCORES)]
    drawn = []
    for k, (title, names) in enumerate(panels):
        series = {name: [float(row[name]) for row in rows] for name in names}
        drawn.append(f'<g transform="translate(0 {k * _HEIGHT:g})">{_panel(title, steps, series)}</g>')
    size = f'viewBox="0 0 {_WIDTH:g} {len(panels) * _HEIGHT:g}" width="{_WIDTH:g}"'
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}><style>{_STYLE}</style>'
        f'<rect width="100%" height="100%" fill="white"/>{"".join(drawn)}</svg>\n',
        encoding="utf-8",
    )


def _panel(title: str, steps: Sequence[float], series: Mapping[str, Sequence[float]]) -> str:
    """One chart; its axes begin at 0, and what could not be measured is left out."""
    highest = max((v for values in series.values() for v in values if math.isfinite(v)), default=1.0) or 1.0
    step_x, step_y = nice_step(max(steps), 6), nice_step(highest, 4)
    end_x, end_y = max(steps), step_y * math.ceil(highest / step_y - 1e-9)
    width, height = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM

    def x_of(step: float) -> float:
        return _LEFT + width * step / end_x

    def y_of(value: float) -> float:
        return _TOP + height * (1 - value / end_y)

    parts = [_text(_LEFT, _TOP - 10, title, "start"), _text(_LEFT + width / 2, _HEIGHT - 6, "steps", "middle")]
    for i in range(round(end_y / step_y) + 1):
        y = y_of(i * step_y)
        parts.append(f'<line class="grid" x1="{_LEFT:g}" x2="{_LEFT + width:g}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(_text(_LEFT - 6, y + 4, number(i * step_y), "end"))
    for i in range(int(end_x / step_x + 1e-9) + 1):
        parts.append(_text(x_of(i * step_x), _TOP + height + 16, number(i * step_x), "middle"))
    for k, (name, values) in enumerate(series.items()):
        colour = _COLOURS[k % len(_COLOURS)]
        points = [(x_of(s), y_of(v)) for s, v in zip(steps, values, strict=True) if math.isfinite(v)]
        parts.append(_curve(points, colour))
        parts.append(_text(_LEFT + width + 12, _TOP + 14 + 18 * k, name, "start", colour))
    return "".join(parts)


def _curve(points: Sequence[tuple[float, float]], colour: str) -> str:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    dots = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.2" fill="{colour}"/>' for x, y in points)
    return f'<polyline class="curve" stroke="{colour}" points="{path}"/>{dots}'


def _text(x: float, y: float, text: str, anchor: str, colour: str = "") -> str:
    fill = f' style="fill:{colour}"' if colour else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{fill}>{escape(text)}</text>'
