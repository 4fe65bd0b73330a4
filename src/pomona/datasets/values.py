"""What a benchmark gives: what was found of a dataset, our figures beside printed ones, and what could not be made."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pomona.errors import InputError
from pomona.fruit.traits.size import DEFAULT_DIAMETER_M


@dataclass(frozen=True, kw_only=True)
class BenchmarkOptions:
    """Options of benchmarks; `registry.Dataset.options` says which of them count for a dataset.

    `model` is the segmenter (None: the shipped one), `trees` how many the row has where the files of true fruits do not
    say, `fruit_diameter_m` the typical fruit.
    """

    model: str | None = None
    trees: int = 11
    fruit_diameter_m: float = DEFAULT_DIAMETER_M

    def __post_init__(self) -> None:
        if self.trees < 1:
            raise InputError(f"`trees`: expected at least 1, found {self.trees}")


@dataclass(frozen=True)
class Figure:
    """One line of a table: the `printed` figure (None: none is known), and ours by column; NaN is undefined.

    Counts are `int`, and are shown so.
    """

    name: str
    ours: Mapping[str, float]
    printed: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Return it for JSON; None where undefined."""
        ours = {column: None if math.isnan(value) else round(value, 6) for column, value in self.ours.items()}
        return {"name": self.name, "printed": self.printed, "ours": ours}


@dataclass(frozen=True)
class ComparedTable:
    """A table: figures beside those that `source` printed ("": nobody did). `notes` say what they need be read with."""

    title: str
    figures: tuple[Figure, ...]
    source: str = ""
    notes: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of our columns, in order of first appearance."""
        return tuple(dict.fromkeys(column for figure in self.figures for column in figure.ours))

    def to_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "title": self.title,
            "source": self.source,
            "figures": [figure.to_json() for figure in self.figures],
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class BenchmarkResult:
    """What came of one dataset: the inputs `found`, the tables, and by name those that are `missing`, with why."""

    dataset: str
    found: tuple[str, ...]
    tables: tuple[ComparedTable, ...]
    missing: Mapping[str, str] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "dataset": self.dataset,
            "found": list(self.found),
            "tables": [table.to_json() for table in self.tables],
            "missing": dict(self.missing),
        }
