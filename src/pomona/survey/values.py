"""Values between stages as `.npz` files in `work/`: exact, quick, without pickles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pomona.basics.arrays import Array
from pomona.errors import FormatError
from pomona.formats.npz import read_npz, write_npz
from pomona.stages.fuse import Shown
from pomona.survey.files import write_file
from pomona.values.fruits import FruitCloud, Fruits, Observations

_Columns = TypeVar("_Columns", Fruits, Observations, FruitCloud, Shown)
Arrays = Mapping[str, Array]


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write named arrays to `path` (.npz), under a temporary name first."""
    write_file(path, lambda temporary: write_npz(temporary, arrays))


def read_arrays(path: Path) -> dict[str, Array]:
    """Read what `write_arrays` wrote; raises `FormatError` when it is damaged."""
    return read_npz(path, "arrays that Pomona wrote (where they are damaged, delete the file and run again)")


def arrays_of(value: Fruits | Observations | FruitCloud | Shown, prefix: str = "") -> dict[str, Array]:
    """Return the columns of a value as arrays, text as unicode arrays."""
    return {prefix + field.name: np.asarray(getattr(value, field.name)) for field in fields(value)}


def columns_from(kind: type[_Columns], arrays: Arrays, prefix: str = "") -> _Columns:
    """Return the value of which `arrays_of` gave the columns; raises `FormatError`."""
    texts = {"sides", "reasons", "photo"}
    # A column that an older version did not write is as where it is not known.
    wanted = [f.name for f in fields(kind) if prefix + f.name in arrays or f.default_factory is MISSING]
    try:
        columns: dict[str, Any] = {name: arrays[prefix + name] for name in wanted}
        columns |= {name: tuple(str(text) for text in columns[name]) for name in texts & columns.keys()}
        return kind(**columns)
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(f"expected the columns of {kind.__name__}, but {error!r}: run again") from None
