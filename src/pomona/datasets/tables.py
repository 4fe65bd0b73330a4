"""What came of a benchmark, for people."""

from __future__ import annotations

import math

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from pomona.datasets.values import BenchmarkResult, ComparedTable


def result_tables(result: BenchmarkResult) -> Group:
    """Return what was found, the tables, and what could not be made of it, to be printed by `rich`."""
    parts: list[RenderableType] = [Text(f"{result.dataset}: found"), *(Text(f"  {line}") for line in result.found)]
    for table in result.tables:
        parts += [Text(""), Text(table.title, style="bold"), _table(table)]
        parts += [Text(f"  {note}") for note in table.notes]
        if table.source:
            parts.append(Text(f"  printed: {table.source}"))
    for name, why in result.missing.items():
        parts += [Text(""), Text(f"{name} could not be made: {why}")]
    return Group(*parts)


def _table(comparison: ComparedTable) -> Table:
    table = Table()
    table.add_column("")
    for column in comparison.columns:
        table.add_column(column, justify="right")
    if comparison.source:
        table.add_column("printed", justify="right")
    for figure in comparison.figures:
        cells = [_number(figure.ours.get(column)) for column in comparison.columns]
        table.add_row(figure.name, *cells, *([_number(figure.printed)] if comparison.source else []))
    return table


def _number(value: float | None) -> str:
    if value is None or math.isnan(value):
        return "–"
    return str(value) if isinstance(value, int) else f"{value:.3f}"
