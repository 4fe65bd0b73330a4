"""Bar charts as inline SVG, coloured by the page's style sheet (light or dark)."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

WIDTH, HEIGHT = 400.0, 220.0
_HIGHEST = 260.0  # of a chart whose axes have one scale
_MOST_WITH_HINTS = 500  # discs: more would make pages slow
_SMALLEST_DISC = 1.2
_BROKEN = re.compile(r"-?\b\d+\.\d+\b")
_LEFT, _RIGHT, _TOP, _BOTTOM = 34.0, 14.0, 18.0, 36.0
_LABEL_WIDTH, _LABEL_HEIGHT = 40.0, 15.0  # room of a tick's number
_LETTER_WIDTH = 7.0  # no letter of a name is wider on average
# What is not a digit in a number, as wide as in the widest of usual fonts: a reader's language may have a long minus.
_DIGIT_WIDTH, _WIDTHS = 7.7, {".": 4.0, "-": 10.1, "+": 10.1}
_GAP = 6.0  # between the labels on the left and the chart


@dataclass(frozen=True)
class Bar:
    """One bar: how long, what it says when pointed at, and the style sheet's class of its colour."""

    value: float
    hint: str
    colour: str = ""


@dataclass(frozen=True)
class Dot:
    """A round thing at true scale: place, radius, what it says when pointed at, and the class of its colour."""

    x: float
    y: float
    radius: float
    hint: str
    colour: str = ""


@dataclass(frozen=True)
class Point:
    """A point of a scatter chart, and what it says when pointed at."""

    x: float
    y: float
    hint: str


@dataclass(frozen=True, kw_only=True)
class Axis:
    """The axis along the bars' feet: its name, and labels at places in bars (0: the first bar's left edge)."""

    name: str
    ticks: Sequence[tuple[float, str]] = ()


def nice_step(span: float, most_steps: int) -> float:
    """Return the smallest of 1, 2, 2.5 or 5 times a power of ten that divides `span` into at most `most_steps`."""
    raw = max(span, 1e-12) / most_steps
    power = 10.0 ** math.floor(math.log10(raw))
    return next(factor * power for factor in (1, 2, 2.5, 5, 10) if factor * power >= raw * (1 - 1e-9))


def number(value: float) -> str:
    """Return a tick's number without needless zeros."""
    text = f"{value:.6g}"
    return "0" if text == "-0" else text


def _left(labels: Sequence[str], least: float = _LEFT) -> float:
    """Where a chart begins, so that the labels on its left are not cut off."""
    widths = (sum(_WIDTHS.get(letter, _DIGIT_WIDTH) for letter in label) for label in labels)
    return max(least, _GAP + max(widths, default=0.0))


def column_chart(
    bars: Sequence[Bar],
    axis: Axis,
    *,
    mark: tuple[float, str] | None = None,
    outline: Sequence[float] = (),
    counts: bool = True,
) -> str:
    """Return upright bars, hanging ones for what is less than 0; `mark` is a place in bars and what a line there says.

    Axes of other things than `counts` may have steps below 1. `outline` are the heights of bars that only a line along
    their tops shows, one above each bar.
    """
    low, top, step = _two_sided([*(bar.value for bar in bars), *outline], 4, counts)
    steps = [i * step for i in range(round(low / step), round(top / step) + 1)]
    left = _left([number(value) for value in steps])
    width, height = WIDTH - left - _RIGHT, HEIGHT - _TOP - _BOTTOM

    def y_of(value: float) -> float:
        return _TOP + height * (top - value) / (top - low)

    pitch = width / max(len(bars), 1)
    gap = min(2.0, 0.15 * pitch)
    parts = []
    for value in steps:
        y = y_of(value)
        parts.append(f'<line class="grid" x1="{left:.1f}" x2="{WIDTH - _RIGHT:.1f}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(_text(left - _GAP, y + 4, number(value), "end"))
    for i, bar in enumerate(bars):
        upper, lower = y_of(max(bar.value, 0.0)), y_of(min(bar.value, 0.0))
        box = (left + i * pitch + gap / 2, upper, max(pitch - gap, 0.5), lower - upper)
        parts.append(_rect(box, bar))
    if outline:
        tops = "".join(f"V{y_of(value):.1f}h{pitch:.2f}" for value in outline)
        parts.append(f'<path class="outline" d="M{left:.1f} {y_of(0):.1f}{tops}V{y_of(0):.1f}"/>')
    parts += [_text(left + place * pitch, HEIGHT - _BOTTOM + 15, label) for place, label in axis.ticks]
    parts.append(_text(left + width / 2, HEIGHT - 5, axis.name))
    if mark is not None:
        x = left + mark[0] * pitch
        parts.append(f'<line class="mark" x1="{x:.1f}" x2="{x:.1f}" y1="{_TOP - 4:.1f}" y2="{_TOP + height:.1f}"/>')
        anchor = "end" if mark[0] > 0.6 * len(bars) else "start"
        parts.append(_text(x + (5 if anchor == "start" else -5), _TOP - 5, mark[1], anchor, "mark-label"))
    return _svg(parts, axis.name)


def row_chart(bars: Sequence[Bar], axis: Axis) -> str:
    """Return lying bars, the first at the bottom: for heights. `axis` is the upright one."""
    left = _left([label for _, label in axis.ticks], _LEFT + 8)
    width, height = WIDTH - left - _RIGHT, HEIGHT - _TOP - _BOTTOM + 8
    top, step = _scale([bar.value for bar in bars], 5)
    pitch = height / max(len(bars), 1)
    gap = min(2.0, 0.15 * pitch)
    parts = []
    for i in range(round(top / step) + 1):
        x = left + width * i * step / top
        parts.append(f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{_TOP:.1f}" y2="{_TOP + height:.1f}"/>')
        parts.append(_text(x, _TOP + height + 15, number(i * step)))
    for i, bar in enumerate(bars):
        y = _TOP + height - (i + 1) * pitch + gap / 2
        parts.append(_rect((left, y, width * bar.value / top, max(pitch - gap, 0.5)), bar))
    parts += [_text(left - _GAP, _TOP + height - place * pitch + 4, label, "end") for place, label in axis.ticks]
    parts.append(_text(2, 10, axis.name, "start"))
    return _svg(parts, axis.name)


def dot_chart(dots: Sequence[Dot], along: Axis, upward: Axis) -> str:
    """Return round things seen from the side, both axes at one scale; at most twice as wide as other charts."""
    left, right = min(d.x - d.radius for d in dots), max(d.x + d.radius for d in dots)
    low, high = min(d.y - d.radius for d in dots), max(d.y + d.radius for d in dots)

    def scale_from(start: float) -> float:
        return min((2 * WIDTH - start - _RIGHT) / max(right - left, 1e-9), _HIGHEST / max(high - low, 1e-9))

    step = nice_step(high - low, _steps_in(scale_from(_LEFT) * (high - low), _LABEL_HEIGHT, 5))
    heights = [i * step for i in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]
    start = _left([number(value) for value in heights])
    scale = scale_from(start)
    width, height = scale * (right - left), scale * (high - low)
    parts = []
    for value in heights:
        y = _TOP + height - scale * (value - low)
        parts.append(f'<line class="grid" x1="{start:.1f}" x2="{start + width:.1f}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(_text(start - _GAP, y + 4, number(value), "end"))
    foot = _TOP + height
    circles = [(start + scale * (d.x - left), foot - scale * (d.y - low), scale * d.radius) for d in dots]
    parts += _discs(circles, dots)
    step = nice_step(right - left, _steps_in(width, _LABEL_WIDTH, 12))
    for i in range(math.ceil(left / step - 1e-9), math.floor(right / step + 1e-9) + 1):
        parts.append(_text(start + scale * (i * step - left), _TOP + height + 16, number(i * step)))
    half_name = _LETTER_WIDTH * len(along.name) / 2
    middle = max(start + width / 2, half_name)
    parts += [_text(middle, _TOP + height + 32, along.name), _text(2, 10, upward.name, "start")]
    whole = max(start + width + _RIGHT, middle + half_name)
    # A long row has a line of the page to itself; a short one is no larger than the charts beside it.
    classes, most_px = ("plot map", 1.6 * whole) if whole > WIDTH else ("plot", whole)
    view = f'viewBox="0 0 {whole:.0f} {_TOP + height + _BOTTOM:.0f}" style="max-width:{most_px:.0f}px"'
    return f'<svg class="{classes}" {view} role="img" aria-label="{escape(along.name)}">{"".join(parts)}</svg>'


def _steps_in(length: float, label: float, most: int) -> int:
    """How many steps an axis has room for, so that their labels do not overlap."""
    return max(1, min(most, int(length / label)))


def _discs(circles: Sequence[tuple[float, float, float]], dots: Sequence[Dot]) -> list[str]:
    """Return discs x, y, radius of dots, each with its hint; where there are many, one shape of each colour without."""
    if len(dots) <= _MOST_WITH_HINTS:
        return [
            f'<circle class="{_classes(dot)}" cx="{x:.1f}" cy="{y:.1f}" r="{max(r, _SMALLEST_DISC):.1f}">'
            f"<title>{escape(dot.hint)}</title></circle>"
            for (x, y, r), dot in zip(circles, dots, strict=True)
        ]
    outlines: dict[str, list[str]] = {}
    for (x, y, radius), dot in zip(circles, dots, strict=True):
        r = max(radius, _SMALLEST_DISC)
        half = f"a{r:.1f} {r:.1f} 0 1 0"
        outlines.setdefault(_classes(dot), []).append(f"M{x - r:.1f} {y:.1f}{half} {2 * r:.1f} 0{half} {-2 * r:.1f} 0")
    return [f'<path class="{classes}" d="{"".join(each)}"/>' for classes, each in outlines.items()]


def _classes(dot: Dot) -> str:
    return f"dot {dot.colour}".strip()


def scatter_chart(points: Sequence[Point], along: Axis, upward: Axis) -> str:
    """Return points over two axes of one scale from 0, with the line on which both are equal."""
    side = HEIGHT - _TOP - _BOTTOM
    top, step = _scale([value for p in points for value in (p.x, p.y)], 4)
    steps = [i * step for i in range(round(top / step) + 1)]
    left = _left([number(value) for value in steps])
    foot, parts = _TOP + side, []
    for value in steps:
        at = side * value / top
        y, label = foot - at, number(value)
        parts.append(f'<line class="grid" x1="{left:.1f}" x2="{left + side:.1f}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts += [_text(left - _GAP, y + 4, label, "end"), _text(left + at, foot + 15, label)]
    parts.append(f'<line class="mark" x1="{left:.1f}" y1="{foot:.1f}" x2="{left + side:.1f}" y2="{_TOP:.1f}"/>')
    for point in points:
        place = f'cx="{left + side * point.x / top:.1f}" cy="{foot - side * point.y / top:.1f}"'
        parts.append(f'<circle class="dot" {place} r="4"><title>{escape(point.hint)}</title></circle>')
    parts += [_text(left + side / 2, HEIGHT - 5, along.name), _text(2, 10, upward.name, "start")]
    return _svg(parts, f"{upward.name} over {along.name}")


def _scale(values: Sequence[float], steps: int) -> tuple[float, float]:
    """The axis' end and its step; counts have whole steps."""
    largest = max([*values, 1.0])
    step = max(1.0, nice_step(largest, steps))
    step = float(math.ceil(step)) if step < 10 else step
    return step * math.ceil(largest / step - 1e-9), step


def _two_sided(values: Sequence[float], steps: int, counts: bool) -> tuple[float, float, float]:
    """The axis' ends, the lower one 0 where nothing is less, and its step."""
    above, below = max([*values, 0.0]), -min([*values, 0.0])
    if counts:
        _, step = _scale([above + below], steps)
    else:
        step = nice_step(above + below or 1.0, steps)
    low, top = -step * math.ceil(below / step - 1e-9), step * math.ceil(above / step - 1e-9)
    return low, top if top > low else step, step


def _rect(box: tuple[float, float, float, float], bar: Bar) -> str:
    x, y, width, height = box
    place = f'x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"'
    colour = f"bar {bar.colour}".strip()
    return f'<rect class="{colour}" {place} rx="1.5"><title>{escape(bar.hint)}</title></rect>'


def _text(x: float, y: float, text: str, anchor: str = "middle", kind: str = "") -> str:
    named = f' class="{kind}"' if kind else ""
    # Where a number is broken, its point may be a comma in the reader's language: the page's script writes it.
    words = _BROKEN.sub(r'<tspan data-value="\g<0>">\g<0></tspan>', escape(text))
    return f'<text{named} x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>'


def _svg(parts: Sequence[str], name: str) -> str:
    view = f"0 0 {WIDTH:g} {HEIGHT:g}"
    return f'<svg class="plot" viewBox="{view}" role="img" aria-label="{escape(name)}">{"".join(parts)}</svg>'


# The colours of the page's style sheet in the light, for a chart in a file of its own.
_STYLE = (
    "<style>text{font:12px system-ui,sans-serif;fill:#66706a}.bar{fill:#b8322a}.bar.leaf{fill:#4f7d5a}"
    ".bar.sky{fill:#5b7fa6}.grid{stroke:#e2ded2}.mark{stroke:#1f2723;stroke-dasharray:4 3}"
    ".mark-label{fill:#1f2723}</style>"
)


def standalone(chart: str) -> str:
    """Return a chart as a file of its own, with its colours."""
    start, _, rest = chart.partition(">")
    size = f' xmlns="http://www.w3.org/2000/svg" width="{2 * WIDTH:g}" height="{2 * HEIGHT:g}"'
    return f"{start}{size}>{_STYLE}{rest}\n"
