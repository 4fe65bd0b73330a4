"""The mistakes of a survey as a table for people."""

from __future__ import annotations

from rich.table import Table

from pomona.evaluate.mistakes.stages import STAGES
from pomona.evaluate.mistakes.values import Mistakes


def mistakes_table(mistakes: Mistakes) -> Table:
    """Return how many fruits went wrong, by kind and by stage, as a `rich` table."""
    table = Table(title="What went wrong, and where")
    for column in ("kind", "likely stage"):
        table.add_column(column)
    table.add_column("visible fruits" if mistakes.label == "visible" else "fruits", justify="right")
    for kind, of in mistakes.counts().items():
        for k, (stage, number) in enumerate(of.items()):
            table.add_row(kind if k == 0 else "", STAGES[stage], str(number), end_section=k == len(of) - 1)
    return table
