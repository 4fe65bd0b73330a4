"""`orchard.toml`: which surveys of which rows an orchard has, with their options, and what works on them."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from datetime import date, datetime
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args, get_type_hints

from pomona.basics.option_values import expect_kind, expect_kinds, without_none
from pomona.errors import FormatError, InputError, MissingFileError, few
from pomona.formats.files import from_home, resolved
from pomona.fruit.traits.packing import check_unit, packing_classes
from pomona.orchard.places import is_url
from pomona.pipeline.names import STAGES
from pomona.pipeline.options import COMMAND_NAMES, RunOptions, option_kinds
from pomona.stages.segment.load import located
from pomona.survey.digest import digest

# A row's name is part of a folder's name, on every system.
_NAME = re.compile(r"[^\W_](?:[\w .-]*[\w-])?")
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_LONGEST_NAME = 100


@dataclass(frozen=True, kw_only=True)
class WorkerOptions:
    """What works on the surveys.

    Local `processes` (None: as many as the machine has room for), each with so many `cores` and `memory_gb`, and with
    `resources` (tags, such as GPU: 1) of its own. A survey that failed for a reason that may pass is tried again
    `retries` times, after `retry_after_s` seconds, then after twice as many, and so on.
    """

    processes: int | None = None
    cores: int = 2
    memory_gb: float = 4.0
    resources: Mapping[str, float] = field(default_factory=dict)
    retries: int = 2
    retry_after_s: float = 5.0

    def __post_init__(self) -> None:
        expect_kinds(self)
        for name, least in (("processes", 1), ("cores", 1), ("retries", 0), ("retry_after_s", 0), ("memory_gb", 0.5)):
            value = getattr(self, name)
            if value is not None and value < least:
                raise InputError(f"[workers] {_said(name)}: expected {least} or more, found {value}")


@dataclass(frozen=True, kw_only=True)
class PlannedSurvey:
    """One survey of one row: its photos (paths or URLs) and options of a run by the names of `RunOptions`.

    `day` is when the photos were taken; None where the file does not say it, and the row then has one survey.
    Files that options name are paths or URLs, too.
    """

    row: str
    day: date | None
    photos: tuple[str, ...]
    options: Mapping[str, Any]

    @property
    def name(self) -> str:
        """The survey's folder: the row, with the day where there is one."""
        return self.row if self.day is None else f"{self.row}_{self.day}"

    @property
    def key(self) -> str:
        """A digest of what the file says of the survey."""
        return digest([self.name, self.photos, self.options])


@dataclass(frozen=True, kw_only=True)
class Orchard:
    """What an `orchard.toml` says: surveys in its order, where results go (`out`, a folder or URL), and workers.

    `resources` are tags that workers must have for single stages, such as {"segment": {"GPU": 1}}.
    """

    title: str
    out: str
    surveys: tuple[PlannedSurvey, ...]
    workers: WorkerOptions = field(default_factory=WorkerOptions)
    resources: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def comparisons(self) -> tuple[tuple[PlannedSurvey, PlannedSurvey], ...]:
        """The surveys of one row on two days, each with the next."""
        by_row: dict[str, list[PlannedSurvey]] = {}
        for survey in self.surveys:
            if survey.day is not None:
                by_row.setdefault(survey.row, []).append(survey)
        return tuple(
            pair for each in by_row.values() for pair in pairwise(sorted(each, key=lambda survey: str(survey.day)))
        )


def read_orchard(path: Path) -> Orchard:
    """Read an `orchard.toml`; paths in it are relative to its folder.

    Raises `MissingFileError`, and `FormatError` for what is no TOML, names something that does not exist, or has values
    of another kind: with the table and what was expected. Files and folders are looked for when a survey is made.
    """
    path = resolved(path)
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8-sig"))  # editors of Windows begin files with a mark
    except FileNotFoundError:
        raise MissingFileError(f"{path}: no such file; expected the orchard's rows, such as orchard.toml") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise FormatError(f"{path}: expected TOML, but {error}") from None
    try:
        return _orchard(path, values)
    except InputError as error:
        raise FormatError(f"{path}: {error}") from None


def _orchard(path: Path, values: Mapping[str, Any]) -> Orchard:
    known = ("title", "out", "defaults", "workers", "resources", "survey")
    _expect_known("The file", values, known)
    tables = values.get("survey")
    if not isinstance(tables, list) or not tables:
        raise InputError('expected a table [[survey]] for each survey, with `row = "…"` and `photos = ["…"]`')
    defaults = _options("[defaults]", _table(values, "defaults"), path.parent)
    surveys = tuple(_survey(number, table, defaults, path.parent) for number, table in enumerate(tables, 1))
    _expect_distinct(surveys)
    resources = {str(stage): _tags(f"[resources.{stage}]", tags) for stage, tags in _table(values, "resources").items()}
    if unknown := sorted(resources.keys() - set(STAGES)):
        raise InputError(f"[resources.{unknown[0]}]: expected a stage ({', '.join(STAGES)})")
    return Orchard(
        title=expect_kind("title", str, values.get("title", path.stem)),
        out=_place(expect_kind("out", str, values.get("out", path.stem)), path.parent),
        surveys=surveys,
        workers=_workers(_table(values, "workers")),
        resources=resources,
    )


def _survey(number: int, table: Any, defaults: Mapping[str, Any], folder: Path) -> PlannedSurvey:
    where = f"[[survey]] number {number}"
    if not isinstance(table, dict):
        raise InputError(f"{where}: expected a table, found {table!r}")
    row = table.get("row")
    if not isinstance(row, str) or not _NAME.fullmatch(row) or _RESERVED.fullmatch(row) or len(row) > _LONGEST_NAME:
        raise InputError(
            f"{where}: expected `row` with a name of letters, digits, spaces, dots and hyphens, at most "
            f"{_LONGEST_NAME} characters, that can be a folder's; found {row!r}"
        )
    where += f" (row {row})"
    day = table.get("date")
    if day is not None and (not isinstance(day, date) or isinstance(day, datetime)):
        raise InputError(f"{where}: expected `date` as a day without quotes, such as 2026-07-01, found {day!r}")
    photos = table.get("photos")
    photos = [photos] if isinstance(photos, str) else photos
    if not isinstance(photos, list) or not photos or not all(isinstance(each, str) and each for each in photos):
        raise InputError(f"{where}: expected `photos`, a list of folders or a video, found {table.get('photos')!r}")
    own = {name: value for name, value in table.items() if name not in ("row", "date", "photos")}
    options = {**defaults, **_options(where, own, folder)}
    _check_values(where, options)
    return PlannedSurvey(row=row, day=day, photos=tuple(_place(each, folder) for each in photos), options=options)


def _expect_distinct(surveys: Sequence[PlannedSurvey]) -> None:
    names = Counter(survey.name.casefold() for survey in surveys)
    if twice := sorted(name for name, count in names.items() if count > 1):
        raise InputError(
            f"[[survey]]: {few(twice)} {'is' if len(twice) == 1 else 'are'} there more than once: give the surveys of "
            "one row a `date` each"
        )
    counts = Counter(survey.row for survey in surveys)
    if undated := sorted({survey.row for survey in surveys if survey.day is None and counts[survey.row] > 1}):
        raise InputError(f"[[survey]]: {few(undated)}: several surveys of one row need a `date` each")


# ---- options ---------------------------------------------------------------------------------------------------------


def option_fields() -> dict[str, str]:
    """Return the options that a survey may have, as `pomona run` calls them without hyphens before, and their fields.

    They are those of `RunOptions` that are plain values; options of single stages are for `pomona.run`.
    """
    other = {_said(name): field_name for name, field_name in COMMAND_NAMES.items()}
    return {_said(name): name for name in sorted(_kinds()) if name not in other.values()} | other


@cache
def _kinds() -> dict[str, Any]:
    """What the values of the fields of `RunOptions` are that are plain."""
    kinds = {name: without_none(hint) for name, hint in option_kinds().items()}
    return {name: kind for name, kind in kinds.items() if not is_dataclass(kind)}


def _options(where: str, table: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return options by their fields, paths resolved."""
    names, kinds = option_fields(), _kinds()
    _expect_known(where, table, tuple(names))
    return {names[name]: _option(f"{where} {name}", kinds[names[name]], table[name], folder) for name in table}


def _option(where: str, kind: Any, value: Any, folder: Path) -> Any:
    if kind is Path:
        return _place(expect_kind(where, str, value), folder)
    parts = get_args(kind)
    if not parts:
        value = expect_kind(where, kind, value)
        # A model is a file or the name of one that is installed.
        return located(value, folder) if where.endswith(" model") else value
    if not isinstance(value, list) or (parts[-1] is not Ellipsis and len(value) != len(parts)):
        raise InputError(f"{where}: expected a list{_count(parts)}, found {value!r}")
    each = [parts[0]] * len(value) if parts[-1] is Ellipsis else parts
    return [expect_kind(where, part, item) for part, item in zip(each, value, strict=True)]


def _count(parts: Sequence[Any]) -> str:
    return "" if parts[-1] is Ellipsis else f" of {len(parts)}"


def _check_values(where: str, options: Mapping[str, Any]) -> None:
    """Say what can be said before any survey is made: files are looked for where it is made."""
    kinds = _kinds()
    values: dict[str, Any] = {name: Path(v) if kinds[name] is Path else v for name, v in options.items()}
    try:
        chosen = RunOptions(**values)
        if chosen.packing is not None:
            check_unit(packing_classes(chosen.packing))
    except (InputError, FormatError) as error:
        raise InputError(f"{where}: {error}") from None


def _workers(table: Mapping[str, Any]) -> WorkerOptions:
    hints = get_type_hints(WorkerOptions)
    names = {_said(f.name): f.name for f in fields(WorkerOptions)} | {"retry-after": "retry_after_s"}
    names.pop("retry-after-s")
    _expect_known("[workers]", table, tuple(names))
    values: dict[str, Any] = {}
    for said, value in table.items():
        name, where = names[said], f"[workers] {said}"
        is_tags = name == "resources"
        values[name] = _tags(where, value) if is_tags else expect_kind(where, without_none(hints[name]), value)
    return WorkerOptions(**values)


def _tags(where: str, value: Any) -> dict[str, float]:
    numbers = isinstance(value, dict) and all(
        isinstance(each, int | float) and not isinstance(each, bool) and each > 0 for each in value.values()
    )
    if not numbers:
        raise InputError(f"{where}: expected tags of workers with numbers, such as GPU = 1, found {value!r}")
    return {str(tag): float(amount) for tag, amount in value.items()}


# ---- values ----------------------------------------------------------------------------------------------------------


def _table(values: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = values.get(name, {})
    if not isinstance(table, dict):
        raise InputError(f"{name}: expected a table [{name}], found {table!r}")
    return table


def _expect_known(where: str, table: Mapping[str, Any], known: Sequence[str]) -> None:
    if unknown := sorted(set(table) - set(known)):
        meant = f"{_said(unknown[0])}, or others of " if _said(unknown[0]) in known else "some of "
        raise InputError(f"{where} has {unknown[0]!r}: expected {meant}{', '.join(known)}")


def _place(text: str, folder: Path) -> str:
    return text if is_url(text) else str(resolved(folder / from_home(text)))


def _said(name: str) -> str:
    return name.replace("_", "-")
