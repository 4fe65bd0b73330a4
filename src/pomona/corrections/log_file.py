"""`corrections.json`: read with errors that say where, written so that it can be read and changed by a person."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pomona.corrections.log import (
    KINDS,
    Added,
    Correction,
    Corrections,
    Deleted,
    Mark,
    Merged,
    Moved,
    Place,
    Split,
    place_of,
)
from pomona.errors import FormatError, InputError
from pomona.formats.json_file import load_json

_FORMAT, _VERSION = "pomona-corrections", 1


def read_corrections(path: Path) -> Corrections:
    """Read the log; without a file there are no corrections.

    Raises `FormatError` naming the entry and what was expected.
    """
    if not path.exists():
        return Corrections()
    content = load_json(path, "corrections of a survey")
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise FormatError(f'{path}: expected corrections of a survey ("format": "{_FORMAT}")')
    if content.get("version") != _VERSION:
        raise FormatError(f"{path}: version: expected {_VERSION}, found {content.get('version')!r}: update Pomona")
    return Corrections(_entries(path, content, "corrections"), _entries(path, content, "undone"))


def write_corrections(path: Path, corrections: Corrections) -> None:
    """Write the log, one correction a line."""
    parts = [f'"format": "{_FORMAT}"', f'"version": {_VERSION}']
    for name, entries in (("corrections", corrections.done), ("undone", corrections.undone)):
        lines = [json.dumps(_to_json(entry), ensure_ascii=False) for entry in entries]
        parts.append(f'"{name}": [' + ",".join(f"\n  {line}" for line in lines) + ("\n ]" if lines else "]"))
    path.write_text("{\n " + ",\n ".join(parts) + "\n}\n", encoding="utf-8")


def _entries(path: Path, content: Mapping[str, Any], name: str) -> tuple[Correction, ...]:
    entries = content.get(name, [])
    if not isinstance(entries, list):
        raise FormatError(f"{path}: {name}: expected a list, found {type(entries).__name__}")
    found = []
    for k, entry in enumerate(entries):
        try:
            found.append(_from_json(entry))
        except (InputError, KeyError, TypeError, ValueError, OverflowError) as error:
            said = f"'{error.args[0]}' is missing" if isinstance(error, KeyError) else str(error)
            raise FormatError(f"{path}: {name}[{k}]: {said}: mend or remove this entry") from None
    return tuple(found)


def _to_json(correction: Correction) -> dict[str, Any]:
    kind = next(name for name, type_ in KINDS.items() if isinstance(correction, type_))
    values: dict[str, Any] = {"kind": kind, "at": correction.at}
    match correction:
        case Added(diameter_m=diameter_m, diameter_sd_m=diameter_sd_m):
            values |= {"diameter_m": diameter_m, "diameter_sd_m": diameter_sd_m}
        case Split(parts=parts):
            values["parts"] = parts
        case Moved(tree_id=tree_id):
            values["tree_id"] = tree_id
    if isinstance(correction, Added | Split):
        values["marks"] = [{"photo": m.photo, "x_px": m.x_px, "y_px": m.y_px} for m in correction.marks]
    return {**values, "made": correction.made}


def _from_json(entry: Any) -> Correction:
    if not isinstance(entry, dict):
        raise InputError(f"expected an object, found {type(entry).__name__}")
    kind = entry.get("kind")
    read = _READERS.get(str(kind))
    if read is None:
        raise InputError(f"kind: expected one of {', '.join(_READERS)}, found {kind!r}")
    return read(entry)


def _place(value: Any) -> Place:
    if not isinstance(value, list) or not all(_is_number(v) for v in value):
        raise InputError(f"expected a place [x, y, z], found {value!r}")
    return place_of(value)


def _two(value: Any) -> tuple[Place, Place]:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"expected two places, found {value!r}")
    return _place(value[0]), _place(value[1])


def _size(entry: Mapping[str, Any], name: str) -> float | None:
    value = entry.get(name)
    if value is not None and not (_is_number(value) and value > 0):
        raise InputError(f"{name}: expected a positive number or null, found {value!r}")
    return None if value is None else float(value)


def _marks(entry: Mapping[str, Any]) -> tuple[Mark, ...]:
    marks = entry.get("marks", [])
    if not isinstance(marks, list):
        raise InputError(f"marks: expected a list, found {marks!r}")
    return tuple(Mark(str(m["photo"]), float(m["x_px"]), float(m["y_px"])) for m in marks)


def _tree(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise InputError(f"tree_id: expected a whole number, found {value!r}")
    return value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _made(entry: Mapping[str, Any]) -> str:
    return str(entry.get("made", ""))


_READERS: dict[str, Callable[[Mapping[str, Any]], Correction]] = {
    "delete": lambda e: Deleted(at=_place(e["at"]), made=_made(e)),
    "add": lambda e: Added(
        at=_place(e["at"]),
        diameter_m=_size(e, "diameter_m"),
        diameter_sd_m=_size(e, "diameter_sd_m"),
        marks=_marks(e),
        made=_made(e),
    ),
    "split": lambda e: Split(at=_place(e["at"]), parts=_two(e["parts"]), marks=_marks(e), made=_made(e)),
    "merge": lambda e: Merged(at=_two(e["at"]), made=_made(e)),
    "move": lambda e: Moved(at=_place(e["at"]), tree_id=_tree(e["tree_id"]), made=_made(e)),
}
