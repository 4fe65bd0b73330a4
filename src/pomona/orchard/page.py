"""`report.html` of an orchard: totals, a map of rows, tables of surveys and of changes; it fetches nothing.

The page is written from the orchard's GeoPackage, line by line, so that memory does not depend on the number of rows.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from itertools import chain
from pathlib import Path
from string import Template
from typing import Any, TextIO
from urllib.parse import quote

import numpy as np

from pomona import __version__
from pomona.basics.arrays import FloatArray, to_digits
from pomona.formats.gpkg import read_layer
from pomona.orchard.plan import Orchard
from pomona.progress import Progress
from pomona.stages.report.html import NUMBERS_SCRIPT, Html, amount, as_html, script_digest
from pomona.stages.report.svg import nice_step, number
from pomona.stages.report.totals import card
from pomona.values.cameras import METRES_FROM

_PAGE = files("pomona.orchard") / "page.html"
_BODY = "<!-- body -->"
_COLOURS = ("#440154", "#3b528b", "#21918c", "#5ec962", "#fde725")  # viridis: few to many
_WIDTH, _MARGIN = 1000.0, 60.0
_LEAST_WIDTH = 460.0
_LEAST_HEIGHT, _MOST_HEIGHT = 160.0, 620.0
_MOST_NAMES = 60  # rows whose names are written on the map
_MOST_LETTERS = 30  # of such a name
_LETTER, _LINE = 8.0, 14.0  # the room of a letter of it
_DEGREE_M = 111_195.0  # of latitude
_MOST_COUNTED = 20_000  # rows that the classes of colour are found from

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Totals:
    """Figures of all rows, each by its newest finished survey; `surveys` and those that `failed` or are `missing`.

    `all_fruits` are hidden ones too, of the `rows_estimated` where that could be estimated; the ends are the sums of
    those of rows, as errors of one orchard's surveys are alike. `length_m` is that of the `rows_measured`. Of the
    `fruits` found, `fruits_on_trees` are on trees that are known, and `fruits_weighed` in rows that have a weight.
    """

    rows: int
    surveys: int
    failed: int
    missing: int
    photos: int
    trees: int
    fruits: int
    all_fruits: float
    all_low: float
    all_high: float
    weight_kg: float
    length_m: float
    rows_estimated: int
    rows_measured: int
    fruits_on_trees: int
    fruits_weighed: int

    @property
    def of_rows(self) -> str:
        """Say of how many rows `all_fruits` are; nothing where they are of all."""
        return "" if self.rows_estimated == self.rows else f", of {self.rows_estimated:,} of the rows"


def write_page(orchard: Orchard, package: Path, page: Path, progress: Progress) -> Totals:
    """Write the page of the orchard whose tables are in `package`, and return the totals."""
    progress.start("report")
    totals = _totals(package)
    head, tail = _template(orchard, totals).split(_BODY)
    with page.open("w", encoding="utf-8") as file:
        file.write(head)
        _write_map(file, package)
        _write_changes(file, package)
        _write_surveys(file, package)
        file.write(tail)
    return totals


def _template(orchard: Orchard, totals: Totals) -> str:
    done = totals.surveys - totals.failed - totals.missing
    failed = f", {_said(totals.failed)} failed" if totals.failed else ""
    return Template(_PAGE.read_text(encoding="utf-8")).substitute(
        title=escape(orchard.title),
        version=escape(__version__),
        subtitle=f"{_said(done)} of {_said(totals.surveys)} surveys done{failed}",
        totals=_cards(totals),
        script=NUMBERS_SCRIPT,
        digest=script_digest(NUMBERS_SCRIPT),
    )


def _totals(package: Path) -> Totals:
    names = ("photos", "trees", "fruits", "all_fruits", "all_low", "all_high", "weight_kg", "length_m")
    sums = dict.fromkeys(names, 0.0)
    counts = {"rows": 0, "surveys": 0, "failed": 0, "missing": 0}
    known = {"rows_estimated": 0, "rows_measured": 0, "fruits_on_trees": 0, "fruits_weighed": 0}
    for row in read_layer(package, "rows"):
        counts["surveys"] += 1
        counts["rows"] += row["newest"]
        if row["state"] in counts:
            counts[row["state"]] += 1
        if row["newest"]:
            sums = {name: value + (row[name] or 0) for name, value in sums.items()}
            known["rows_estimated"] += row["all_fruits"] is not None
            known["rows_measured"] += row["length_m"] is not None
            known["fruits_on_trees"] += row["fruits_on_trees"] or 0
            known["fruits_weighed"] += row["fruits"] if row["weight_kg"] is not None else 0
    return Totals(
        **counts,
        **known,
        photos=round(sums["photos"]),
        trees=round(sums["trees"]),
        fruits=round(sums["fruits"]),
        all_fruits=round(sums["all_fruits"], 1),
        all_low=round(sums["all_low"], 1),
        all_high=round(sums["all_high"], 1),
        weight_kg=round(sums["weight_kg"], 3),
        length_m=round(sums["length_m"], 2),
    )


def _cards(totals: Totals) -> str:
    length = "of unknown length"
    if totals.length_m:
        of_rows = "" if totals.rows_measured == totals.rows else f", of {_said(totals.rows_measured)} of them"
        length = f"{_said(totals.length_m)} m{of_rows}"
    cards = [
        card("Rows", _said(totals.rows), length),
        card("Fruits found", _said(totals.fruits), "by the newest survey of each row", "main"),
    ]
    if totals.all_fruits:
        of_rows = f", of {_said(totals.rows_estimated)} of the rows" if totals.of_rows else ""
        span = f"{_said(totals.all_low)} to {_said(totals.all_high)}: the rows' 95 % intervals, added{of_rows}"
        cards.append(card("All fruits, hidden ones too", _said(totals.all_fruits), span))
    if totals.weight_kg:
        kilograms, each_g = totals.weight_kg, 1000 * totals.weight_kg / max(totals.fruits_weighed, 1)
        in_tonnes = kilograms > 2000
        weight = _said(kilograms / 1000, 2) if in_tonnes else _said(kilograms, 1)
        unweighed = totals.fruits - totals.fruits_weighed
        without = f", without {_said(unweighed)} in rows that have no weight" if unweighed else ""
        figure = f"{weight} <small>{'t' if in_tonnes else 'kg'}</small>"
        cards.append(card("Weight of those found", figure, f"{_said(each_g)} g each{without}"))
    if totals.trees:
        on_each = totals.fruits_on_trees / totals.trees
        cards.append(card("Trees", _said(totals.trees), f"{_said(on_each, int(on_each < 10))} fruits found on each"))
    cards.append(card("Photos", _said(totals.photos), ""))
    return "".join(cards)


# ---- map -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Map:
    """From longitude and latitude to places on the page, north up; `unit_m` is a metre in units of the page, `left` the
    westernmost place."""

    west: float
    north: float
    squeeze: float
    unit_m: float
    left: float
    width: float
    height: float

    def at(self, places: FloatArray) -> FloatArray:
        east_m = (places[:, 0] - self.west) * self.squeeze * _DEGREE_M
        south_m = (self.north - places[:, 1]) * _DEGREE_M
        return np.column_stack([east_m, south_m]) * self.unit_m + [self.left, _MARGIN]


def _write_map(file: TextIO, package: Path) -> None:
    """Write the newest survey of each row as a line, coloured by fruits a metre; what has no place is said."""
    extent, density, placed, letters = _extent(package)
    file.write('<section class="sheet"><h2>Map</h2>')
    if extent is None:
        none = '<p class="note">No survey is finished.</p>'
        file.write(f"{_not_on_map(package) or none}</section>\n")
        return
    named = placed <= _MOST_NAMES
    shown = _map_of(extent, max(_MARGIN, 14 + _LETTER * min(letters, _MOST_LETTERS)) if named else _MARGIN)
    classes = np.percentile(density, np.linspace(0, 100, len(_COLOURS) + 1)) if len(density) else np.zeros(0)
    size = f'viewBox="0 0 {shown.width:.0f} {shown.height:.0f}" style="--wide:{shown.width:.0f}px"'
    file.write(f'<div class="map"><svg {size} role="img" aria-label="Map of the rows">\n')
    names = _Names()
    for row in _newest(package):
        if row["places"] is not None:
            file.write(_line(row, shown, classes) + (names.beside(row, shown) if named else "") + "\n")
    file.write(_scale_bar(shown) + "</svg></div>")
    if len(classes) and classes[0] < classes[-1]:
        digits = max(0, 2 - math.floor(math.log10(classes[-1])))
        ends = [_said(end, digits) for end in classes]
        entries = (
            f'<li><i style="background:{colour}"></i>{ends[k]} to {ends[k + 1]}</li>'
            for k, colour in enumerate(_COLOURS)
        )
        file.write(f'<ul class="legend"><li>Fruits a metre of row, hidden ones too:</li>{"".join(entries)}</ul>')
    file.write(f"{_not_on_map(package)}</section>\n")


def _not_on_map(package: Path) -> str:
    """Say how many rows the map lacks, and why; nothing where it has all."""
    on_earth = Counter(bool(row["crs"]) for row in _newest(package) if row["places"] is None)
    reasons = (
        (False, "no place on Earth, which photos with GNSS, markers with a coordinate system or control points give"),
        (True, "a place on Earth, but no line: too few fruits were found, or sides are not joined"),
    )
    return "".join(
        f'<p class="note">{_said(on_earth[known])} row{"s have" if on_earth[known] > 1 else " has"} {reason}.</p>'
        for known, reason in reasons
        if on_earth[known]
    )


def _newest(package: Path) -> Iterator[dict[str, Any]]:
    return (row for row in read_layer(package, "rows") if row["newest"])


def _extent(package: Path) -> tuple[FloatArray | None, FloatArray, int, int]:
    """West, south, east, north of all rows (None: none has a place), fruits a metre, rows with a place, and letters of
    the longest name."""
    extent, placed, letters = np.array([np.inf, np.inf, -np.inf, -np.inf]), 0, 0
    density: list[float] = []
    for row in _newest(package):
        if row["places"] is None:
            continue
        placed += 1
        letters = max(letters, len(row["row"]))
        extent[:2] = np.minimum(extent[:2], row["places"].min(0))
        extent[2:] = np.maximum(extent[2:], row["places"].max(0))
        if row["all_per_metre"] is not None and len(density) < _MOST_COUNTED:
            density.append(row["all_per_metre"])
    return (extent if np.isfinite(extent).all() else None), np.array(density), placed, letters


def _map_of(extent: FloatArray, room: float) -> _Map:
    """The map of an extent, with so much room for names on its left."""
    west, south, east, north = extent.tolist()
    squeeze = math.cos(math.radians((south + north) / 2))
    width_m = max((east - west) * squeeze * _DEGREE_M, 1.0)
    height_m = max((north - south) * _DEGREE_M, 1.0)
    unit_m = min((_WIDTH - room - _MARGIN) / width_m, (_MOST_HEIGHT - 2 * _MARGIN) / height_m)
    across = width_m * unit_m + room + _MARGIN
    width = max(_LEAST_WIDTH, across)
    left = room + (width - across) / 2
    return _Map(west, north, squeeze, unit_m, left, width, max(_LEAST_HEIGHT, height_m * unit_m + 2 * _MARGIN))


def _line(row: Row, shown: _Map, classes: FloatArray) -> str:
    (x0, y0), (x1, y1) = shown.at(row["places"])
    value = row["all_per_metre"]
    colour = ' class="bare"'
    if value is not None and len(classes):
        k = min(int(np.searchsorted(classes[1:-1], value, side="right")), len(_COLOURS) - 1)
        colour = f' stroke="{_COLOURS[k]}"'
    # No mark between thousands: no script writes it.
    fruits = f"{row['fruits']} fruit{'s' * (row['fruits'] != 1)}"
    said = f"{row['row']} {row['date']}".strip() + f": {fruits} found"
    said += f", {to_digits(value, 3, mark='')} a metre with hidden ones" if value is not None else ""
    return (
        f'<line{colour} stroke-width="4" x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}">'
        f"<title>{escape(said)}</title></line>"
    )


class _Names:
    """Names of rows beyond their western ends; where they would lie over each other, the first is written."""

    def __init__(self) -> None:
        self._written: list[tuple[float, float, float]] = []  # left, right and foot

    def beside(self, row: Row, shown: _Map) -> str:
        x, y = min(shown.at(row["places"]).tolist())
        name = row["row"] if len(row["row"]) <= _MOST_LETTERS else row["row"][: _MOST_LETTERS - 1] + "…"
        left, right, foot = x - 8 - _LETTER * len(name), x - 8, y + 4
        if any(left < other[1] and other[0] < right and abs(foot - other[2]) < _LINE for other in self._written):
            return ""
        self._written.append((left, right, foot))
        return f'<text x="{right:.1f}" y="{foot:.1f}" text-anchor="end">{escape(name)}</text>'


def _scale_bar(shown: _Map) -> str:
    end = shown.width - _MARGIN
    length_m = nice_step((end - _MARGIN) / shown.unit_m, 6)
    x, y = end - length_m * shown.unit_m, shown.height - 10
    return (
        f'<line class="scale" stroke-width="2" x1="{x:.1f}" x2="{end:.1f}" y1="{y:.1f}" y2="{y:.1f}"/>'
        f'<text x="{(x + end) / 2:.1f}" y="{y - 6:.1f}" text-anchor="middle">{_in_drawing(length_m)} m</text>'
    )


# ---- tables ----------------------------------------------------------------------------------------------------------


def _write_surveys(file: TextIO, package: Path) -> None:
    heads = ("row", "date", "state", "photos", "fruits", "all, hidden ones too", "95 %", "trees", "length m",
             "weight kg", "diameter mm", "metres from", "why")  # fmt: skip
    _begin_table(file, "Surveys", heads)
    for row in read_layer(package, "rows"):
        name = escape(row["row"])
        if row["state"] == "done":
            name = f'<a href="surveys/{quote(row["survey"])}/report.html">{name}</a>'
        used = "" if row["photos"] is None else Html(f"{_said(row['photos_used'])} of {_said(row['photos'])}")
        span = "" if row["all_low"] is None else Html(f"{_said(row['all_low'])} to {_said(row['all_high'])}")
        cells = [
            row["date"], row["state"], used, _said(row["fruits"]), _said(row["all_fruits"]), span, _said(row["trees"]),
            _said(row["length_m"], 1), _said(row["weight_kg"], 1), _said(row["diameter_mm"], 1),
            METRES_FROM.get(row["scale"], ""),
        ]  # fmt: skip
        _write_row(file, row["state"], name, cells, row["reason"])
    _end_table(file)


def _write_changes(file: TextIO, package: Path) -> None:
    changes = read_layer(package, "changes")
    first = next(changes, None)
    if first is None:
        return
    heads = ("row", "from", "to", "in both", "not found again", "really gone, about", "new", "growth mm", "95 %",
             "mm a day", "note")  # fmt: skip
    _begin_table(file, "Changes", heads)
    for row in chain([first], changes):
        name = escape(row["row"])
        if row["state"] == "done":
            folder = f"{row['row']}_{row['before']}_to_{row['after']}"
            name = f'<a href="comparisons/{quote(folder)}/comparison.html">{name}</a>'
        ends = row["growth_low_mm"], row["growth_high_mm"]
        span = "" if ends[0] is None else Html(f"{_said(ends[0], 1)} to {_said(ends[1], 1)}")
        cells = [
            row["before"], row["after"], _said(row["same"]), _said(row["gone"]), _said(row["really_gone"]),
            _said(row["new"]), _said(row["growth_mm"], 1), span, _said(row["growth_mm_per_day"], 2),
        ]  # fmt: skip
        _write_row(file, row["state"], name, cells, row["reason"])
    _end_table(file)


def _begin_table(file: TextIO, title: str, heads: tuple[str, ...]) -> None:
    columns = "".join(f'<th scope="col"{_kind(k, len(heads))}>{escape(head)}</th>' for k, head in enumerate(heads))
    file.write(f'<section class="sheet"><h2>{title}</h2><div class="scroll"><table><thead><tr>{columns}</tr></thead>')
    file.write("<tbody>\n")


def _write_row(file: TextIO, state: str, name: str, cells: list[str], reason: str) -> None:
    texts = "".join(f"<td>{as_html(cell)}</td>" for cell in cells)
    file.write(f'<tr class="{escape(state)}"><td>{name}</td>{texts}<td class="text">{escape(reason)}</td></tr>\n')


def _end_table(file: TextIO) -> None:
    file.write("</tbody></table></div></section>\n")


def _kind(k: int, count: int) -> str:
    return ' class="text"' if k == count - 1 else ""


def _said(value: float | None, digits: int = 0) -> Html:
    """A number as HTML, which the page's script writes as the reader's language does, where languages differ."""
    if value is None:
        return Html("")
    return Html(f"{value:.0f}") if digits == 0 and abs(value) < 999.5 else amount(value, digits)


def _in_drawing(value: float) -> str:
    text = number(value)
    _, _, fraction = text.partition(".")
    return f'<tspan data-digits="{len(fraction)}" value="{text}">{text}</tspan>' if fraction else text
