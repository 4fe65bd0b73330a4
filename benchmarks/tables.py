"""Tables of figures, as the pages of docs/lab have them."""

from collections.abc import Iterable


def table_head(titles: str) -> str:
    """Return the two lines above a table, of titles with ` | ` between them."""
    return f"| {titles} |\n" + "|---" * len(titles.split(" | ")) + "|"


def table_row(cells: Iterable[object]) -> str:
    return f"| {' | '.join(map(str, cells))} |"
