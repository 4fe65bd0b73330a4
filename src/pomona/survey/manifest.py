"""`survey.json` read without trusting it: it may come from somebody else, or from a disk that failed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from pomona.errors import FormatError, InputError, SurveyError
from pomona.formats.json_file import load_json
from pomona.survey.record import StageRecord

FORMAT = "pomona-survey"
MANIFEST = "survey.json"
_ANEW = "use another folder, or begin this one anew with `overwrite`"


def read_manifest(path: Path) -> dict[str, Any]:
    """Return the content of `survey.json`.

    Raises `FormatError` naming the entry that is none that Pomona writes, and `SurveyError` where the file is of
    something else.
    """
    manifest = load_json(path, f"the manifest of a survey ({_ANEW})")
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise SurveyError(f"{path.parent} holds something else than a survey: its {MANIFEST} was not written by Pomona")
    try:
        _check(manifest)
    except (InputError, TypeError, ValueError) as error:
        raise FormatError(f"{path}: {error}: the file is damaged: {_ANEW}") from None
    return manifest


def _check(manifest: Mapping[str, Any]) -> None:
    _list_of(manifest, "sources", lambda entry: isinstance(entry, str), "paths")
    _list_of(manifest, "photos", _is_photo, "objects with name and side")
    _list_of(manifest, "skipped", _is_skipped, "objects with name and reason")
    for name in ("options", "stages"):
        if not isinstance(manifest.get(name, {}), dict):
            raise InputError(f"{name}: expected an object, found {_shown(manifest[name])}")
    if "stages" not in manifest:
        raise InputError("stages: expected an object, found nothing")
    for name, values in manifest["stages"].items():
        try:
            record = StageRecord.from_json(values)
        except (TypeError, ValueError, AttributeError) as error:
            raise InputError(f"stages: {name}: expected the record of a stage, but {error}") from None
        for output in record.outputs:
            if not is_inside(output):
                raise InputError(f"stages: {name}: outputs: expected files in the survey, found {_shown(output)}")


def _list_of(manifest: Mapping[str, Any], name: str, fits: Any, expected: str) -> None:
    entries = manifest.get(name, [])
    if not isinstance(entries, list):
        raise InputError(f"{name}: expected a list, found {_shown(entries)}")
    wrong = next((k for k, entry in enumerate(entries) if not fits(entry)), None)
    if wrong is not None:
        raise InputError(f"{name}[{wrong}]: expected {expected}, found {_shown(entries[wrong])}")


def _is_photo(entry: Any) -> bool:
    texts = ("name", "side", "digest")
    return isinstance(entry, dict) and "name" in entry and all(isinstance(entry.get(key, ""), str) for key in texts)


def _is_skipped(entry: Any) -> bool:
    return isinstance(entry, dict) and all(isinstance(entry.get(key), str) for key in ("name", "reason"))


def is_inside(name: str) -> bool:
    """Say whether a name in a file leads to something below a folder, on every system: no `..`, no root, no drive."""
    posix, windows = PurePosixPath(name), PureWindowsPath(name)
    absolute = posix.is_absolute() or windows.is_absolute() or bool(windows.drive or windows.root)
    return bool(name) and "\0" not in name and not absolute and ".." not in (*posix.parts, *windows.parts)


def _shown(value: Any) -> str:
    return f"{value!r:.60}"
