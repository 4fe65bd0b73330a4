"""The contract's values as bytes: JSON, and behind it the columns of numbers, which a page reads without a copy.

Four bytes say how long the JSON is (little-endian), then it follows, padded with blanks to a multiple of 8 with those
four. A column stands in the JSON as `{"column": TYPE, "at": BYTES, "count": NUMBERS}`, where TYPE is u1, u2, u4 or f4,
and `at` counts from the end of the JSON. `viewer/src/columns.ts` reads this.
"""

from __future__ import annotations

import base64
import dataclasses
import json
from typing import Any

import numpy as np

from pomona.stages.report.contract import camel_case

_ALIGNED = 8  # bytes: a typed array of a browser begins at a multiple of its items' size


def as_bytes(value: Any) -> bytes:
    """Return a contract's dataclass as bytes."""
    columns: list[bytes] = []
    text = json.dumps(_plain(value, columns), separators=(",", ":"), allow_nan=False).encode("utf-8")
    text += b" " * (-(4 + len(text)) % _ALIGNED)
    return b"".join([len(text).to_bytes(4, "little"), text, *columns])


def as_base64(value: Any) -> str:
    """Return the same bytes as text that can stand in a script element."""
    return base64.b64encode(as_bytes(value)).decode("ascii")


def _plain(value: Any, columns: list[bytes]) -> Any:
    """JSON values, names in camelCase; columns are moved to the end of `columns`, each padded."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {camel_case(f.name): _plain(getattr(value, f.name), columns) for f in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        content = value.tobytes()
        entry = {"column": value.dtype.str[1:], "at": sum(map(len, columns)), "count": value.size}
        columns.append(content + b"\0" * (-len(content) % _ALIGNED))
        return entry
    if isinstance(value, list) and value and dataclasses.is_dataclass(value[0]):
        return [_plain(item, columns) for item in value]
    return value
