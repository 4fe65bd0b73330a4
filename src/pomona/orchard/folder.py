"""The one class that builds paths in an orchard's folder, which is a folder or a URL."""

from __future__ import annotations

import json
from dataclasses import dataclass

from pomona.errors import FormatError
from pomona.orchard.jobs import JobOutcome
from pomona.orchard.places import Place
from pomona.survey.manifest import MANIFEST

TABLES_OF_SURVEY = (MANIFEST, "fruits.csv", "trees.csv", "segments.csv")
"""The files of a survey that an orchard's tables are made of."""
LAYERS = ("rows", "trees", "fruits", "changes")
"""The tables of an orchard: layers of its GeoPackage, and a GeoParquet file each."""


@dataclass(frozen=True)
class OrchardFolder:
    """Where an orchard's surveys, comparisons, tables and report are."""

    root: Place

    def survey(self, name: str) -> Place:
        """`surveys/NAME/`: a survey, as `pomona run` writes it."""
        return self.root / "surveys" / name

    def comparison(self, name: str) -> Place:
        """`comparisons/NAME/`: two surveys of one row, as `pomona compare` writes it."""
        return self.root / "comparisons" / name

    @property
    def package(self) -> Place:
        """`orchard.gpkg`."""
        return self.root / "orchard.gpkg"

    def table(self, layer: str) -> Place:
        """`rows.parquet` and others."""
        return self.root / f"{layer}.parquet"

    @property
    def report(self) -> Place:
        """`report.html`."""
        return self.root / "report.html"

    def keep(self, kind: str, outcome: JobOutcome) -> None:
        """Write what became of a survey or comparison."""
        text = json.dumps(outcome.to_json(), indent=1, ensure_ascii=False) + "\n"
        self._outcome(kind, outcome.name).write_text(text)

    def outcome(self, kind: str, name: str) -> JobOutcome | None:
        """Return what became of a survey ("surveys") or comparison ("comparisons"); None where that is not known.

        Raises `FormatError` for a file that cannot be read.
        """
        place = self._outcome(kind, name)
        content = place.read_bytes()
        if content is None:
            return None
        try:
            outcome = JobOutcome.from_json(json.loads(content))
            outcome.to_json()  # what is nested too deeply could not be written again
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            raise FormatError(f"{place}: expected what became of {name}, but {error}: delete it") from None
        return outcome

    def _outcome(self, kind: str, name: str) -> Place:
        return self.root / "outcomes" / kind / f"{name}.json"
