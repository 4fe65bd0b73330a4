"""Dataclasses of the contract as JSON, with names as TypeScript has them, and back."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pomona.errors import InputError
from pomona.formats.json_file import is_number
from pomona.stages.report.contract import camel_case

T = TypeVar("T")


def as_json(value: Any) -> str:
    """Return a value of the contract, or a list of them, as JSON in one line; what is NaN becomes null."""
    return json.dumps(_plain(value), separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def from_json(kind: type[T], values: Any) -> T:
    """Return the dataclass that JSON values stand for; raises `InputError` naming what is missing or wrong."""
    if not isinstance(values, dict):
        raise InputError(f"Expected an object ({kind.__name__}), found {values!r:.80}")
    hints = get_type_hints(kind)
    found: dict[str, Any] = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        name = camel_case(field.name)
        if name not in values:
            raise InputError(f"Expected '{name}' in {kind.__name__}")
        found[field.name] = _value(hints[field.name], values[name], name)
    return kind(**found)


def _value(hint: Any, value: Any, name: str) -> Any:
    origin = get_origin(hint)
    if origin is Literal:
        fits = value in get_args(hint)
    elif dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return from_json(hint, value)
    elif origin is list and isinstance(value, list):
        return [_value(get_args(hint)[0], item, name) for item in value]
    elif origin is Union or type(hint).__name__ == "UnionType":
        if value is None:
            return None
        return _value(next(kind for kind in get_args(hint) if kind is not type(None)), value, name)
    elif hint is float:
        fits = is_number(value)
        value = float(value) if fits else value
    else:
        fits = type(value) is hint
    if not fits:
        raise InputError(f"'{name}': expected {hint}, found {value!r:.80}")
    return value


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {camel_case(field.name): _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
