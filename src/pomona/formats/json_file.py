"""Reading JSON that people and programs wrote, with errors that name the file and the place."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

from pomona.errors import FormatError
from pomona.formats.files import read_text

# Numbers of so many digits may be beyond 64 bits.
_LONG = 19


class _TwiceError(ValueError):
    pass


def load_json(path: Path, expected: str) -> Any:
    """Return the content of a JSON file that is to hold `expected`.

    Whole numbers beyond 64 bits are floats. Raises `MissingFileError`, and `FormatError` where it is empty, no JSON,
    gives a key of an object twice, or a number that is too large for a float.
    """
    text = read_text(path, expected)
    try:
        return json.loads(text, object_pairs_hook=_object, parse_int=_whole)
    except (_TwiceError, RecursionError) as error:
        raise FormatError(f"{path}: expected {expected}, but {error}") from None
    except ValueError as error:
        raise FormatError(f"{path}: expected {expected}, but it is no JSON: {error}") from None


def is_number(value: Any) -> bool:
    """Say whether a value of a JSON file is a finite number; texts and truth values are none."""
    # A whole number may be too large for any float, which `math.isfinite` raises an error for.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _whole(digits: str) -> int | float:
    if len(digits) < _LONG:
        return int(digits)
    number = float(digits)
    if math.isinf(number):
        raise ValueError(f"a number of {len(digits)} digits is too large")
    return number


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) != len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise _TwiceError(f"the key '{twice}' is there twice in one object")
    return result
