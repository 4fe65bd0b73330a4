"""What a comparison is written as: tables, figures, a plot, and the second survey's page with the first in it."""

from __future__ import annotations

import json
import math
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from pomona.basics.arrays import counted
from pomona.change.comparison import Comparison, Interval
from pomona.errors import SurveyError
from pomona.formats.tables import write_table
from pomona.stages.report.contract import F32, U8, EarlierFruits, packed
from pomona.stages.report.data import ReportData
from pomona.stages.report.html import Html, about, amount
from pomona.stages.report.page import Sections, note_of, page_html
from pomona.stages.report.plots import bars_of, bin_edges, caption, framed, ticks_at
from pomona.stages.report.scene import SceneOptions, origin_of, survey_data
from pomona.stages.report.svg import Axis, Bar, column_chart, standalone
from pomona.stages.report.tables import plain_table
from pomona.stages.report.totals import card, notices
from pomona.survey.files import disk_errors, write_file, write_text_file

PAGE = "comparison.html"
FIGURES = "comparison.json"
_DIGITS = {"x_m": 4, "y_m": 4, "z_m": 4, "growth_mm_per_day": 4}


def write_comparison(found: Comparison, after: ReportData, names: tuple[str, str], folder: Path) -> Path:
    """Write `comparison.html`, `comparison.json`, `fruits.csv`, `trees.csv` and `growth.svg` to a folder; return it.

    `after` is what the second survey's report shows, `names` are those of the surveys. The folder is new or empty, or
    holds an earlier comparison. Raises `SurveyError` where it holds something else or cannot be written to.
    """
    present = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    if folder.exists() and (not folder.is_dir() or (present and PAGE not in present)):
        raise SurveyError(f"{folder} holds something else: choose a new or empty folder")
    figures = {"before": names[0], "after": names[1], **found.to_json()}
    texts = {
        FIGURES: json.dumps(figures, indent=1, ensure_ascii=False) + "\n",
        "growth.svg": standalone(_growth_chart(found)),
        PAGE: comparison_html(found, after, names),
    }
    with disk_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        _write_table(folder / "fruits.csv", found.columns())
        _write_table(folder / "trees.csv", found.tree_columns())
        for name, text in texts.items():
            write_text_file(folder / name, text)
    return folder


def comparison_html(found: Comparison, after: ReportData, names: tuple[str, str]) -> str:
    """Return the page of the second survey, with what changed since the first in place of its own figures."""
    scene = SceneOptions(source="report", earlier=_earlier(found, after), photos_note=note_of("report"))
    sections = Sections(
        subtitle=escape(f"{names[1]} compared with {names[0]}" + _days_later(found)),
        totals=_totals(found),
        notices=notices(found.warnings),
        colour_choices=Sections.of(after).colour_choices,
        plots=framed([_growth_figure(found), _sizes_figure(found), _trees_figure(found)]),
        tables=_trees_table(found),
    )
    return page_html(after, survey_data(after, scene), sections=sections)


def _earlier(found: Comparison, after: ReportData) -> EarlierFruits:
    """The first survey's fruits in the frame and the unit of the second one's page."""
    unit = _unit_of_page(found, after)
    later = np.full(len(found.before), -1)
    later[found.pairs[:, 0]] = found.pairs[:, 1]
    growth = np.full(len(found.after), np.nan)
    growth[found.pairs[:, 1]] = found.growth_m
    sizes = found.before.diameters_m
    sizes = np.where(np.isfinite(sizes), sizes, np.nanmedian(sizes))
    return EarlierFruits(
        centers=F32(packed(unit * found.before.centers_in_world - origin_of(after), "<f4")),
        diameters=F32(packed(unit * sizes, "<f4")),
        later=later.tolist(),
        in_view=U8(packed(found.before_in_view, "u1")),
        growth=F32(packed(unit * growth, "<f4")),
    )


def _unit_of_page(found: Comparison, after: ReportData) -> float:
    """What a metre of the comparison is in the second survey, whose metres may be the worse ones."""
    mine, theirs = found.after.centers_in_world, after.fruits.centers_in_world
    return float(np.linalg.norm(theirs - theirs[0]) / np.linalg.norm(mine - mine[0]))


# ---- figures ---------------------------------------------------------------------------------------------------------


def _days_later(found: Comparison) -> str:
    if not math.isfinite(found.days):
        return ""
    return f", {counted(round(abs(found.days)), 'day')} {'later' if found.days > 0 else 'earlier'}"


def _unit_of(found: Comparison) -> tuple[str, float]:
    """The unit of sizes, and how many of it a metre is; surveys without a scale are in units of the second one."""
    return ("mm", 1000.0) if found.metric else ("units", 1.0)


def _size(value_m: float, found: Comparison, digits: int = 1) -> Html:
    """A size as a number in that unit: to `digits` of a millimetre, or to three figures of what may be anything."""
    value = _unit_of(found)[1] * value_m
    return amount(round(value, digits) + 0.0, digits) if found.metric else about(value, 3)  # no -0.0


def _span(growth: Interval, found: Comparison) -> Html:
    """The 95 % interval of growth; a dash where there are too few fruits for one."""
    ends = _size(growth.low, found), _size(growth.high, found)
    return Html(f"{ends[0]} to {ends[1]}") if math.isfinite(growth.low) else Html("–")


def _growth_card(found: Comparison) -> str:
    growth, (unit, _) = found.growth(), _unit_of(found)
    if not math.isfinite(growth.value):
        return card("Growth", "–", _NO_GROWTH)
    interval = math.isfinite(growth.low)
    parts = [f"{_span(growth, found)} {unit} (95 %)" if interval else "of too few fruits for an interval"]
    if math.isfinite(found.days):
        parts.append(f"{_size(growth.value / found.days, found, 2)} {unit} a day")
    return card("Growth", f"{_size(growth.value, found)} <small>{unit}</small>", ", ".join(parts))


def _totals(found: Comparison) -> str:
    before, after = found.states
    gone = found.gone()
    unit, _ = _unit_of(found)
    apart = _size(float(np.median(found.apart_m)), found, 0)
    missed = before.count("out of view")
    ends = f"{amount(gone.low)} to {amount(gone.high)}"
    return "".join(
        [
            card(
                "In both", amount(len(found.pairs)), f"of {amount(len(before))} and {amount(len(after))} fruits", "main"
            ),
            _growth_card(found),
            card("Not found again", amount(before.count("gone")), f"and {amount(missed)} where no photo looks"),
            card("Really gone, about", amount(gone.value), f"{ends} (95 %); {_HIDDEN}"),
            card("New", amount(after.count("new")), "fruits that the first survey lacks"),
            card("Aligned to", f"{apart} <small>{unit}</small>", "median of pairs"),
        ]
    )


_HIDDEN = "others may only be hidden"
_NO_GROWTH = "no fruit was measured in both surveys"


def _growth_figure(found: Comparison) -> str:
    return caption("Growth", _days_later(found).strip(", ")) + _growth_chart(found)


def _growth_chart(found: Comparison) -> str:
    unit, factor = _unit_of(found)
    values = factor * found.growth_m[np.isfinite(found.growth_m)]
    if not len(values):
        return column_chart([], Axis(name=_NO_GROWTH))
    edges = bin_edges(values)
    middle = float(np.median(values))
    mark = ((middle - edges[0]) / (edges[1] - edges[0]), f"median {middle:z.3g} {unit}")
    return column_chart(
        bars_of(values, edges, unit, "leaf"), Axis(name=f"growth, {unit}", ticks=ticks_at(edges)), mark=mark
    )


def _sizes_figure(found: Comparison) -> str:
    """How large fruits were, and how much they grew since: the medians of classes of size."""
    unit, factor = _unit_of(found)
    sizes, growth = factor * found.before.diameters_m[found.pairs[:, 0]], factor * found.growth_m
    known = np.isfinite(growth)
    if known.sum() < 3:
        return ""
    edges = bin_edges(sizes[known], 8)
    group = np.digitize(sizes[known], edges) - 1
    bars = []
    for k, low in enumerate(edges[:-1]):
        mine = growth[known][group == k]
        value = float(np.median(mine)) if len(mine) else 0.0
        bars.append(Bar(value, f"from {low:.4g} {unit}: {value:z.3g} {unit}, {counted(len(mine), 'fruit')}", "leaf"))
    title = caption("Growth by size before", f"median, {unit}")
    return title + column_chart(bars, Axis(name=f"diameter before, {unit}", ticks=ticks_at(edges)), counts=False)


def _trees_figure(found: Comparison) -> str:
    """How many fruits of each tree were not found again."""
    table = found.tree_columns()
    if not len(table["id"]):
        return ""
    bars = [
        Bar(float(gone), f"tree {tree}: {gone} of {before} not found again")
        for tree, gone, before in zip(table["id"], table["gone"], table["fruits_before"], strict=True)
    ]
    step = max(1, len(bars) // 10)
    ticks = [(i + 0.5, str(table["id"][i])) for i in range(0, len(bars), step)]
    return caption("Not found again, by tree") + column_chart(bars, Axis(name="tree", ticks=ticks))


def _trees_table(found: Comparison) -> str:
    table = found.tree_columns()
    if not len(table["id"]):
        return ""
    heads = (
        "tree",
        "before",
        "after",
        "in both",
        "not found again",
        "out of view",
        "new",
        f"growth {_unit_of(found)[0]}",
        "95 %",
    )
    names = ("id", "fruits_before", "fruits_after", "same", "gone", "out_of_view", "new")
    rows = [
        (
            *(str(table[name][k]) for name in names),
            _size(growth.value, found),
            _span(growth, found),
        )
        for k, growth in enumerate(found.tree_growth().values())
    ]
    return f'<div class="sheet"><h2>Trees</h2>{plain_table(heads, rows)}</div>'


# ---- files -----------------------------------------------------------------------------------------------------------


def _write_table(path: Path, columns: dict[str, Any]) -> None:
    """Write columns as CSV; what is not known is an empty cell."""

    def cell(name: str, value: Any) -> object:
        if isinstance(value, float):
            return f"{value:z.{_DIGITS.get(name, 2)}f}" if math.isfinite(value) else ""
        return "" if name.endswith("_id") and value == 0 else value

    lists = [[cell(name, value) for value in np.asarray(values).tolist()] for name, values in columns.items()]

    write_file(path, lambda part: write_table(part, tuple(columns), zip(*lists, strict=True)))
