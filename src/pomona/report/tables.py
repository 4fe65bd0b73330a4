"""The report's tables as HTML: fruits (sorted by the viewer's script), trees, photos that were lost."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape

import numpy as np

from pomona.fruits import Fruits
from pomona.report.data import ReportData


@dataclass(frozen=True)
class _Column:
    """A heading, its unit, and the text of each fruit's cell ("" where it was not measured)."""

    label: str
    unit: str
    cell: Callable[[int], str]
    numeric: bool = True


def fruits_table(data: ReportData) -> str:
    """Return the table of fruits, one row each, or a line that says there are none."""
    fruits = data.fruits
    if not len(fruits):
        return (
            '<p class="empty">No fruit was found in these photos.</p>'
            '<table id="fruits" hidden><thead><tr></tr></thead><tbody></tbody></table>'
        )
    columns = _columns(data)
    head = "".join(_heading(column) for column in columns)
    rows = "".join(_row(fruits, columns, i) for i in range(len(fruits)))
    table = f'<table id="fruits"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
    return f'<div class="scroll" tabindex="0" role="region" aria-label="Table of fruits">{table}</div>'


def _columns(data: ReportData) -> list[_Column]:
    """Those columns that have anything to tell."""
    fruits = data.fruits
    length, size, factor = ("m", "mm", 1000.0) if data.cameras.frame.metric else ("", "", 1.0)
    digits = 1 if data.cameras.frame.metric else 4
    columns = [_Column("id", "", lambda i: str(fruits.ids[i]))]
    columns += [_Column(name, length, partial(_coordinate, fruits, axis)) for axis, name in enumerate("xyz")]
    columns.append(_Column("diameter", size, lambda i: _number(fruits.diameters_m[i] * factor, digits)))
    if np.isfinite(fruits.diameter_sds_m).any():
        columns.append(_Column("±", size, lambda i: _number(fruits.diameter_sds_m[i] * factor, digits)))
    columns.append(_Column("score", "", lambda i: _number(fruits.scores[i], 2)))
    columns.append(_Column("photos", "", lambda i: str(fruits.views[i])))
    if np.isfinite(fruits.visibilities).any():
        columns.append(_Column("visible", "", lambda i: _number(fruits.visibilities[i], 2)))
    if np.isfinite(fruits.weights_g).any():
        columns.append(_Column("weight", "g", lambda i: _number(fruits.weights_g[i], 0)))
    if fruits.tree_ids.any():
        columns.append(_Column("tree", "", lambda i: str(fruits.tree_ids[i] or "")))
    if any(fruits.sides):
        columns.append(_Column("side", "", lambda i: fruits.sides[i], numeric=False))
    if any(fruits.reasons):
        columns.append(_Column("not measured because", "", lambda i: fruits.reasons[i], numeric=False))
    return columns


def _heading(column: _Column) -> str:
    unit = f" <small>{column.unit}</small>" if column.unit else ""
    label = escape(f"{column.label}, {column.unit}" if column.unit else column.label)
    kind = "number" if column.numeric else "text"
    button = f'<button type="button">{escape(column.label)}{unit}</button>'
    return f'<th scope="col" data-kind="{kind}" data-label="{label}">{button}</th>'


def _row(fruits: Fruits, columns: Sequence[_Column], i: int) -> str:
    cells = []
    for column in columns:
        text = column.cell(i)
        if column.label == "id":
            # A button, so that keyboards and screen readers reach the fruit; the script makes one of them a tab stop.
            cells.append(f'<td><button type="button" tabindex="-1" aria-label="Fruit {text}">{text}</button></td>')
        elif column.numeric:
            missing = f'<td class="none" title="{escape(fruits.reasons[i] or "not measured")}">–</td>'
            cells.append(f"<td>{text}</td>" if text else missing)
        else:
            cells.append(f'<td class="text{" wide" if len(text) > 20 else ""}">{escape(text)}</td>')
    return f'<tr data-id="{fruits.ids[i]}">{"".join(cells)}</tr>'


def _coordinate(fruits: Fruits, axis: int, i: int) -> str:
    return _number(float(fruits.centers_in_world[i, axis]), 3)


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else ""


def trees_table(data: ReportData) -> str:
    """Return fruits and median diameter of each tree; nothing where trees are not known."""
    fruits = data.fruits
    if not fruits.tree_ids.any():
        return ""
    factor, unit = (1000.0, "mm") if data.cameras.frame.metric else (1.0, "")
    rows = []
    for tree in np.unique(fruits.tree_ids):
        mine = fruits.tree_ids == tree
        sizes = fruits.diameters_m[mine & np.isfinite(fruits.diameters_m)] * factor
        median = f"{np.median(sizes):.1f}" if len(sizes) else "–"
        rows.append((str(tree) if tree else "none", str(int(mine.sum())), median))
    heads = ("tree", "fruits", f"median diameter {unit}".strip())
    return f'<div class="sheet"><h2>Trees</h2>{plain_table(heads, rows)}</div>'


def photos_table(data: ReportData) -> str:
    """Return the photos that were lost or could not be read, why, and what to do; nothing where all were used."""
    rows = [(photo.photo, photo.side, photo.reason, photo.advice) for photo in data.lost]
    rows += [(file.name, "", file.reason, "") for file in data.photos.skipped]
    if not rows:
        return ""
    heads = ("photo", "side", "why it was not used", "what to do")
    title = f"<h2>Photos not used ({len(rows)})</h2>"
    return f'<section class="sheet" id="lost">{title}{plain_table(heads, rows, numbers=0)}</section>'


def plain_table(heads: Sequence[str], rows: Iterable[Sequence[str]], *, numbers: int = 99) -> str:
    """Return a table of texts, all escaped; the first `numbers` columns but the first one are set as numbers."""

    def kind(i: int) -> str:
        return "number" if 0 < i <= numbers else "text"

    head = "".join(
        f'<th scope="col" data-kind="{kind(i)}"><span class="plain">{escape(text)}</span></th>'
        for i, text in enumerate(heads)
    )
    body = "".join(
        "<tr>"
        + "".join(
            f'<td class="{"text wide" if kind(i) == "text" else ""}">{escape(text)}</td>' for i, text in enumerate(row)
        )
        + "</tr>"
        for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
