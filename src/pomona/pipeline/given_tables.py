"""The small tables that a survey was made with: it keeps copies, and goes on with these once the tables are gone."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from pomona.errors import InputError
from pomona.formats.files import is_there, resolved
from pomona.pipeline.options import FILES, TABLES, RunOptions
from pomona.survey import SurveyFolder
from pomona.survey.files import write_file


def keep_tables(survey: SurveyFolder, options: RunOptions) -> None:
    """Copy the tables of a run into its survey, in place of those of the run before."""
    for name in TABLES:
        table, kept = getattr(options, name), _kept(survey, name)
        if table is not None and kept is not None and table.samefile(kept):
            continue
        if kept is not None:
            kept.unlink()
        if table is not None and table.is_file():  # under its own name, which results speak of
            write_file(survey.work("given") / name / table.name, partial(_copy, table))


def set_aside_tables(survey: SurveyFolder) -> None:
    """Keep the copies of the run before beside those of this one, for `put_back_tables`."""
    kept, aside = survey.work("given"), survey.work("given_before")
    shutil.rmtree(aside, ignore_errors=True)
    if kept.is_dir():
        shutil.copytree(kept, aside)


def put_back_tables(survey: SurveyFolder) -> None:
    """Have the copies of the run before again in place of those of this one, whose options were refused."""
    kept, aside = survey.work("given"), survey.work("given_before")
    shutil.rmtree(kept, ignore_errors=True)
    if aside.is_dir():
        aside.rename(kept)


def drop_set_aside_tables(survey: SurveyFolder) -> None:
    """Remove the copies of the run before."""
    shutil.rmtree(survey.work("given_before"), ignore_errors=True)


def with_kept_tables(survey: SurveyFolder, options: RunOptions) -> RunOptions:
    """Return the options with the survey's copy of each table that it was made with, where that is gone."""
    before, found = survey.get("options") or {}, dict[str, Any]()
    for name in TABLES:
        table, kept = getattr(options, name), _kept(survey, name)
        if table is None or kept is None or is_there(table):
            continue
        if before.get(name) == table.as_posix():  # any other that is not there was mistaken
            found[name] = kept
    return replace(options, **found) if found else options


def checked_options(options: RunOptions, out: Path, *, overwrite: bool, places_photos: bool = True) -> RunOptions:
    """Return options with which a run of the survey in folder `out` can begin: those given, with the tables it kept.

    A run that places no photos needs no `cameras`. Nothing is written. Raises as `RunOptions.check_files` does, and
    `InputError` where `overwrite` would discard what the run is to be made with.
    """
    if not overwrite and (survey := SurveyFolder.find(out)) is not None:
        options = with_kept_tables(survey, options)
    (options if places_photos else replace(options, cameras=None)).check_files()
    if overwrite:
        _check_outlast(options, out)
    return options


def _check_outlast(options: RunOptions, out: Path) -> None:
    """Raise `InputError` for a file of the survey itself that is given to the run which begins it anew."""
    from pomona.stages.segment.load import files_of

    survey = SurveyFolder(resolved(out), {})
    if not survey.manifest_path.is_file():
        return
    given = [(name, path) for name in FILES if (path := getattr(options, name)) is not None]
    given += [("model", path) for path in files_of(options.model)] if options.model is not None else []
    for name, path in given:
        if survey.would_clear(path):
            raise InputError(
                f"`{name}`: {path} is part of what `overwrite` discards: copy it to another place and name that, or "
                "leave `overwrite` out, as a changed option makes again all that depends on it"
            )


def tables_gone(given: RunOptions, used: RunOptions) -> list[str]:
    """Return what is said of the tables in `given` in whose place a survey's copies are `used`."""
    gone = [(name, getattr(given, name)) for name in TABLES if getattr(given, name) != getattr(used, name)]
    return [f"`{name}`: {table} is no longer there: the survey's own copy of it is used" for name, table in gone]


def _kept(survey: SurveyFolder, name: str) -> Path | None:
    kept = sorted((survey.work_folder / "given" / name).glob("[!.]*"))
    return kept[0] if kept else None


def _copy(table: Path, path: Path) -> None:
    shutil.copyfile(table, path)
