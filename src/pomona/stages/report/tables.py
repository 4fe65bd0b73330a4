"""The report's tables as HTML: trees, photos that were lost. The viewer's script makes the table of fruits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

from pomona.stages.report.data import ReportData
from pomona.stages.report.html import Html, about, amount, as_html

_INTERVAL = "95\N{NO-BREAK SPACE}%"


def trees_table(data: ReportData) -> str:
    """Return fruits, size and weight of each tree with intervals; nothing where trees are not known."""
    trees = data.trees
    if not len(trees):
        return ""
    metric = data.cameras.frame.metric
    rows: list[Sequence[str]] = [
        (
            str(trees.ids[k]),
            amount(trees.fruits[k]),
            _span(trees.fruits_low[k], trees.fruits_high[k]),
            amount(trees.all_fruits[k]),
            _span(trees.all_low[k], trees.all_high[k]),
            amount(1000 * trees.diameters_m[k], 1) if metric else about(trees.diameters_m[k], 3),
            amount(trees.weights_kg[k], 1),
            _span(trees.weights_low_kg[k], trees.weights_high_kg[k], 1) if trees.weights_kg[k] > 0 else "–",
        )
        for k in range(len(trees))
    ]
    on_none = int((data.fruits.tree_ids == 0).sum())
    if on_none:
        rows.append(("none", amount(on_none), *("",) * 6))
    size = f"median diameter {'mm' if metric else 'units'}"
    heads = ("tree", data.fruit_words, _INTERVAL, "hidden ones too", _INTERVAL, size, "weight kg", _INTERVAL)
    note = "<p><small>The first interval is of what photos show; hidden fruits are in that of all.</small></p>"
    return f'<div class="sheet"><h2>Trees</h2>{plain_table(heads, rows)}{note}</div>'


def how_made(data: ReportData) -> str:
    """Return the settings of the run and the versions of what it ran with; nothing where they are not known."""
    if not data.settings:
        return ""
    settings = "".join(f"<dt>{escape(name)}</dt><dd>{escape(word)}</dd>" for name, word in data.settings.items())
    versions = ", ".join(f"{name} {version}" for name, version in data.engines.items())
    with_engines = f"<p class='note'>Pomona {escape(data.version)} with {escape(versions)}.</p>" if versions else ""
    return f'<div class="sheet"><h2>How it was made</h2><dl class="settings">{settings}</dl>{with_engines}</div>'


def _span(low: float, high: float, digits: int = 0) -> Html:
    return Html(f"{amount(low, digits)} to {amount(high, digits)}") if math.isfinite(low) else Html("–")


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
    """Return a table of texts, escaped unless they are `Html`; the first `numbers` columns but the first one are set
    as numbers."""

    def kind(i: int) -> str:
        return "number" if 0 < i <= numbers else "text"

    head = "".join(
        f'<th scope="col" data-kind="{kind(i)}"><span class="plain">{escape(text)}</span></th>'
        for i, text in enumerate(heads)
    )
    body = "".join(
        "<tr>"
        + "".join(
            f'<td class="{"text wide" if kind(i) == "text" else ""}">{as_html(text)}</td>' for i, text in enumerate(row)
        )
        + "</tr>"
        for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
