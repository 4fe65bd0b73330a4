"""The orchard's tables, survey by survey: a GeoPackage with all layers, and a GeoParquet file of each.

Each survey is read, written and forgotten but for its one line of figures, so that memory hardly depends on the number
of rows.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from pomona.errors import PomonaError
from pomona.formats.geoparquet import GeoParquet
from pomona.formats.gpkg import GeoPackage
from pomona.formats.layers import Layer
from pomona.orchard.folder import LAYERS, OrchardFolder
from pomona.orchard.plan import Orchard, PlannedSurvey
from pomona.orchard.rows import EMPTY_LAYERS, change_layer, row_without_survey, tables_of
from pomona.orchard.work import local_survey
from pomona.progress import Progress


class _Tables:
    """The files of the tables, open for writing in a folder."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._package = stack.enter_context(GeoPackage(folder / "orchard.gpkg", on_earth=True))
        self._files = {
            layer: stack.enter_context(GeoParquet(folder / f"{layer}.parquet", on_earth=True)) for layer in LAYERS
        }
        for layer in EMPTY_LAYERS:
            self.append(layer)

    def append(self, layer: Layer) -> None:
        self._package.append(layer)
        self._files[layer.name].append(layer)


def write_tables(orchard: Orchard, folder: OrchardFolder, into: Path, progress: Progress) -> None:
    """Write `orchard.gpkg` and the GeoParquet files of all surveys and comparisons to the folder `into`.

    A survey that cannot be read any more is a row that failed, with the reason; the newest of its row is then the one
    before.
    """
    progress.start("tables", len(orchard.surveys))
    with ExitStack() as stack:
        tables = _Tables(into, stack)
        pairs = {(before.name, after.name): (before, after) for before, after in orchard.comparisons}
        of_later = {after: pair for (_, after), pair in pairs.items()}
        rows = []
        for planned in orchard.surveys:
            row = _append_survey(tables, planned, folder)
            rows.append(row)
            pair = of_later.get(planned.name)
            if pair and all(is_done(folder, survey) for survey in pair):
                outcome = folder.outcome("comparisons", comparison_name(*pair))
                if outcome is not None:
                    tables.append(change_layer(pair, outcome, row.geometries[0]))
            progress.advance()
        for row in _newest_marked(orchard.surveys, rows):
            tables.append(row)


def comparison_name(before: PlannedSurvey, after: PlannedSurvey) -> str:
    """The name of what compares two surveys of one row."""
    return f"{before.name}_to_{after.day}"


def is_done(folder: OrchardFolder, survey: PlannedSurvey) -> bool:
    """Say whether the last that became of a survey is that it was made."""
    outcome = folder.outcome("surveys", survey.name)
    return outcome is not None and outcome.state == "done"


def _append_survey(tables: _Tables, planned: PlannedSurvey, folder: OrchardFolder) -> Layer:
    """Write the fruits and trees of one survey; return its row's line."""
    outcome = folder.outcome("surveys", planned.name)
    if outcome is None or outcome.state != "done":
        return row_without_survey(planned, outcome)
    try:
        with tempfile.TemporaryDirectory(prefix="pomona-") as scratch:
            of_survey = tables_of(local_survey(folder.survey(planned.name), Path(scratch)), planned)
    except (PomonaError, KeyError) as error:
        reason = str(error) if isinstance(error, PomonaError) else f"its survey.json lacks {error}: make it again"
        return row_without_survey(planned, replace(outcome, state="failed", reason=reason))
    tables.append(of_survey.trees)
    tables.append(of_survey.fruits)
    return of_survey.row


def _newest_marked(surveys: Sequence[PlannedSurvey], rows: Sequence[Layer]) -> Iterator[Layer]:
    """The surveys' lines with `newest` 1 for the last of each row that is done, 0 for all others."""
    newest: dict[str, PlannedSurvey] = {}
    for survey, row in zip(surveys, rows, strict=True):
        before = newest.get(survey.row)
        if row.rows[0]["state"] == "done" and (before is None or str(survey.day) > str(before.day)):
            newest[survey.row] = survey
    for survey, row in zip(surveys, rows, strict=True):
        yield replace(row, rows=[{**row.rows[0], "newest": int(newest.get(survey.row) is survey)}])
