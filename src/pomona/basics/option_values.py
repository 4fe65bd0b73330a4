"""Values of options are of the kinds that their dataclass declares: said at once, not by what fails later."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from pomona.errors import InputError

# What a value of a plain kind may be, and how a person would call it.
_PLAIN: dict[Any, tuple[tuple[type, ...], str]] = {
    str: ((str,), "a text"),
    bool: ((bool, np.bool_), "true or false"),
    int: ((Integral,), "a whole number"),
    float: ((Real,), "a number"),
    Path: ((str, PathLike), "a path"),
}


def expect_kinds(options: Any) -> None:
    """Raise `InputError` for the first field of a dataclass of options whose value is not what its annotation says."""
    cls: Any = type(options)
    for name, hint in _hints(cls).items():
        expect_kind(f"`{name}`", hint, getattr(options, name))


@cache
def _hints(cls: Any) -> Mapping[str, Any]:
    hints = get_type_hints(cls)
    return {field.name: hints[field.name] for field in fields(cls)}


def expect_kind(where: str, hint: Any, value: Any) -> Any:
    """Return `value` if it is what a hint such as `int`, `Path | None` or `tuple[int, int, float]` says.

    Raises `InputError`, which begins with `where`. Which of the values of a `Literal` it is, and what a mapping holds,
    is for others to say.
    """
    if not _is_of(hint, value):
        raise InputError(f"{where}: expected {_in_words(hint)}, found {value!r:.200}")
    return value


def without_none(hint: Any) -> Any:
    """Return the `T` of `T | None`."""
    parts = [part for part in get_args(hint) if part is not NoneType]
    return parts[0] if NoneType in get_args(hint) else hint


def _is_of(hint: Any, value: Any) -> bool:
    if value is None:
        return NoneType in get_args(hint)
    kind = without_none(hint)
    if kind in _PLAIN:
        # To Python, True is a number.
        return isinstance(value, _PLAIN[kind][0]) and (kind is bool or not isinstance(value, bool))
    origin, parts = get_origin(kind), get_args(kind)
    if origin is tuple:
        return isinstance(value, tuple | list) and _are_of(parts, value)
    return isinstance(value, str if origin is Literal else origin or kind)


def _are_of(parts: tuple[Any, ...], values: tuple[Any, ...] | list[Any]) -> bool:
    if parts[-1] is Ellipsis:
        return all(_is_of(parts[0], value) for value in values)
    return len(parts) == len(values) and all(map(_is_of, parts, values))


def _in_words(hint: Any) -> str:
    kind = without_none(hint)
    parts = get_args(kind)
    if kind in _PLAIN:
        said = _PLAIN[kind][1]
    elif get_origin(kind) is Literal:
        said = f"one of {', '.join(parts)}"
    elif get_origin(kind) is not tuple:
        said = (get_origin(kind) or kind).__name__
    elif parts[-1] is Ellipsis:
        said = f"a tuple, each of it {_in_words(parts[0])}"
    else:
        said = f"a tuple of {len(parts)} ({', '.join(map(_in_words, parts))})"
    return said if kind is hint else f"{said}, or None"
