"""The surveys that are known on this computer: where each is, and what a person asked for that has no folder yet."""

from __future__ import annotations

import json
import secrets
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pomona.browser.app.opened import opened
from pomona.errors import MissingFileError, SurveyError
from pomona.survey.files import disk_errors, write_text_file
from pomona.survey.record import now


@dataclass(frozen=True)
class Entry:
    """A survey: `created` is its manifest's, by which it is known again elsewhere ("": it has none yet).

    `asked` are the arguments of `pomona run` that make it; none of a survey that was made elsewhere.
    """

    id: str
    name: str
    folder: Path
    added: str
    created: str = ""
    asked: tuple[str, ...] = ()


class Catalogue:
    """A file of surveys, the newest first. What is in it is never deleted from disk by forgetting it here.

    The file is read whenever something is asked, as another Pomona may have changed it.

    A file that is damaged is kept aside, and the catalogue begins anew. Raises `SurveyError` where none can be read or
    written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.RLock()
        self._entries: list[Entry] = []

    @property
    def entries(self) -> tuple[Entry, ...]:
        """All surveys; of one that was moved beside where it was, or beside another one, its new place."""
        with self._lock:
            self._entries = self._read()
            found = [self._followed(entry) for entry in self._entries]
            if found != self._entries:
                self._entries = found
                self._write()
            return tuple(found)

    def find(self, survey_id: str) -> Entry:
        """Return a survey; raises `MissingFileError` where it is not known (any more)."""
        with self._lock:
            self._entries = self._read()
            for entry in self._entries:
                if entry.id == survey_id:
                    return entry
        raise MissingFileError("This survey is not in the list any more: load the page again")

    def add(self, name: str, folder: Path, asked: tuple[str, ...] = ()) -> Entry:
        """Add a survey, or return the one of that folder, with what is asked of it now."""
        folder = folder.expanduser().resolve()
        with self._lock:
            self._entries = self._read()
            known = next((entry for entry in self._entries if entry.folder == folder), None)
            if known is not None:
                entry = replace(known, name=name, asked=asked or known.asked)
                self._entries[self._entries.index(known)] = entry
            else:
                entry = Entry(secrets.token_hex(6), name, folder, now(), _created(folder), asked)
                self._entries.insert(0, entry)
            self._write()
            return entry

    def forget(self, survey_id: str) -> None:
        """Take a survey off the list; its folder stays."""
        with self._lock:
            entry = self.find(survey_id)
            self._entries.remove(entry)
            self._write()

    def _followed(self, entry: Entry) -> Entry:
        created = _created(entry.folder)
        if created:
            return replace(entry, created=created)
        if not entry.created:
            return entry
        taken = {other.folder for other in self._entries}
        near = dict.fromkeys(other.folder.parent for other in (entry, *self._entries))
        for parent in near:
            with suppress(OSError):
                for folder in sorted(parent.iterdir()):
                    if folder not in taken and _created(folder) == entry.created:
                        return replace(entry, folder=folder)
        return entry

    def _read(self) -> list[Entry]:
        try:
            return [_entry(values) for values in json.loads(self._path.read_text(encoding="utf-8"))["surveys"]]
        except FileNotFoundError:
            return []
        except OSError as error:
            raise SurveyError(f"{self._path}, the list of surveys, cannot be read: {error.strerror or error}") from None
        except (ValueError, KeyError, TypeError):
            with suppress(OSError):
                self._path.replace(self._aside())
            return []

    def _aside(self) -> Path:
        """Where a damaged file is kept, beside others that were."""
        names = (self._path.with_suffix(f".damaged{number}.json") for number in ("", *map(str, range(2, 100))))
        return next((path for path in names if not path.exists()), self._path.with_suffix(".damaged.json"))

    def _write(self) -> None:
        surveys = [{**vars(entry), "folder": str(entry.folder)} for entry in self._entries]
        text = json.dumps({"surveys": surveys}, indent=1, ensure_ascii=False) + "\n"
        with disk_errors(self._path.parent):
            write_text_file(self._path, text)


def _entry(values: Mapping[str, Any]) -> Entry:
    if not isinstance(values, dict):
        raise TypeError("expected an object")
    known = {name: values[name] for name in Entry.__dataclass_fields__ if name in values}
    texts = [value for name, value in known.items() if name != "asked"]
    if not all(isinstance(text, str) for text in (*texts, *values.get("asked", ()))):
        raise TypeError("expected texts")
    return Entry(**{**known, "folder": Path(values["folder"]), "asked": tuple(values.get("asked", ()))})


def _created(folder: Path) -> str:
    """When the survey in a folder was begun, which no other one has in common with it; "" where there is none."""
    survey = opened(folder)
    if survey is None:
        return ""
    return f"{survey.get('created', '')} {' '.join(survey.get('sources', ()))}".strip()
