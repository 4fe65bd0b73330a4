"""JSON that another program wrote, field by field, so that an error can say which field it is about."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.errors import FormatError
from pomona.formats.json_file import load_json


@dataclass(frozen=True, eq=False)
class Field:
    """A value of a JSON file and the place where it is, such as `frames[3].file_path`."""

    path: Path
    place: str
    value: Any

    @classmethod
    def of_file(cls, path: Path, expected: str) -> Field:
        """Return the whole of a file that is to hold `expected`."""
        return cls(path, "", load_json(path, expected))

    def error(self, expected: str) -> FormatError:
        """Return the error that says what was expected here and what was found."""
        found = repr(self.value)
        found = found if len(found) <= 60 else found[:57] + "..."
        return FormatError(f"{self.path}: {self.place or 'the file'}: expected {expected}, found {found}")

    def at(self, key: str) -> Field:
        """Return an entry of an object that has to be there."""
        found = self.get(key)
        if found is None:
            raise FormatError(f"{self.path}: {self.place or 'the file'}: expected '{key}', which is not there")
        return found

    def get(self, key: str) -> Field | None:
        """Return an entry of an object, None where it is not there or null."""
        if not isinstance(self.value, dict):
            raise self.error(f"an object with '{key}'")
        value = self.value.get(key)
        return None if value is None else Field(self.path, f"{self.place}.{key}".lstrip("."), value)

    def items(self) -> Iterator[Field]:
        """The items of a list."""
        if not isinstance(self.value, list):
            raise self.error("a list")
        return (Field(self.path, f"{self.place}[{i}]", item) for i, item in enumerate(self.value))

    def entries(self) -> Iterator[tuple[str, Field]]:
        """The entries of an object."""
        if not isinstance(self.value, dict):
            raise self.error("an object")
        return ((key, Field(self.path, f"{self.place}.{key}".lstrip("."), value)) for key, value in self.value.items())

    def number(self) -> float:
        """Return a finite number."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            raise self.error("a number")
        try:
            number = float(self.value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.error("a finite number")
        return number

    def number_at(self, key: str, default: float | None = None) -> float:
        """Return the number of an entry; `default` where it is not there, which is an error if that is None."""
        field = self.at(key) if default is None else self.get(key)
        return field.number() if field is not None else float(default or 0.0)

    def whole(self, *, least: int = 0) -> int:
        """Return a whole number of at least `least`."""
        number = self.number()
        if number != int(number) or number < least:
            raise self.error(f"a whole number of at least {least}")
        return int(number)

    def positive(self) -> float:
        """Return a number above 0."""
        number = self.number()
        if not number > 0:
            raise self.error("a number above 0")
        return number

    def truth(self) -> bool:
        """Return true or false."""
        if not isinstance(self.value, bool):
            raise self.error("true or false")
        return self.value

    def text(self) -> str:
        """Return text that is not empty."""
        if not isinstance(self.value, str) or not self.value:
            raise self.error("text")
        return self.value

    def numbers(self, *shape: int) -> FloatArray:
        """Return finite numbers, lists within lists, of this shape."""
        wanted = " × ".join(map(str, shape))
        try:
            array = np.array(self.value, np.float64)
        except (ValueError, TypeError, OverflowError):
            raise self.error(f"{wanted} numbers") from None
        if array.shape != shape or not np.isfinite(array).all():
            raise self.error(f"{wanted} finite numbers")
        return array
