"""`pairs.csv`: fruits that a person measured with callipers and weighed."""

from __future__ import annotations

from pathlib import Path

from pomona.errors import FormatError, InputError
from pomona.formats.small_table import read_small_table
from pomona.stages.measure.allometry import Allometry, fit_allometry


def read_allometry(path: Path) -> Allometry:
    """Fit the pairs of a table with the columns `diameter_mm,weight_g`.

    Raises `MissingFileError`, and `FormatError` naming the file and what was expected of it.
    """
    table = read_small_table(path, ("diameter_mm", "weight_g"), "`weights`", "pair")
    diameters_mm, weights_g = table.numbers("diameter_mm"), table.numbers("weight_g")
    try:
        return fit_allometry(diameters_mm, weights_g, source=f"{len(table)} pairs in {path.name}")
    except InputError as error:
        raise FormatError(f"`weights` {path}: {error}") from None
