"""The report's tables as HTML: trees, photos that were lost. The viewer's script makes the table of fruits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from pomona.report.data import ReportData


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
