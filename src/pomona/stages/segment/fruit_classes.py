"""Which of a network's classes are fruit: by name, or as the person says."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from pomona.errors import FormatError, InputError

_FRUIT = re.compile(
    r"\b(?:(?:apple|apricot|avocado|clementine|fig|fruit|fruitlet|grapefruit|guava|kiwi|kiwifruit|lemon|lime|litchi|lychee"
    r"|mandarin|mango|mangoe|nectarine|olive|orange|papaya|passionfruit|pear|persimmon|plum|pomegranate|quince|satsuma"
    r"|tangerine|tomatoe|tomato)s?|peach|peaches|cherry|cherries|citrus)\b"
)
_NOT_THE_FRUIT = re.compile(r"\b(?:tree|leaf|leave|flower|blossom|branch|branche|trunk|stem|bud|juice|crate|boxe?)s?\b")
COCO_80 = {47: "apple", 49: "orange"}
"""The fruits that hang on trees among COCO's 80 classes, counted from 0."""
COCO_91 = {53: "apple", 55: "orange"}
"""The same among COCO's 91 category ids."""


def fruit_columns(path: Path, count: int, names: Mapping[int, str], wanted: Sequence[str] = ()) -> list[int]:
    """Return which of `count` classes, called `names` where that is known, are fruit; at least one.

    Those `wanted`, by name or number; else the only class; else those whose names say fruit; without names, the apples
    and oranges of COCO where the number of classes is COCO's.

    Raises `InputError` for a wanted class that is not there and `FormatError` when none can be told to be fruit.
    """
    if wanted:
        return sorted({column for name in wanted for column in _named(path, count, names, name)})
    if count == 1:
        return [0]
    if not names:
        names = {80: COCO_80, 90: COCO_91}.get(count, {})
    fruits = [column for column in range(count) if _is_fruit(names.get(column, ""))]
    if not fruits:
        said = (
            f"it is not known which of its {count} classes are fruit" if not names else "none of its classes is a fruit"
        )
        raise FormatError(
            f"{path}: {said} (classes: {_listed(count, names)}). Say which: `model` '{path}:CLASS,CLASS', by name or "
            "number"
        )
    return fruits


def _named(path: Path, count: int, names: Mapping[int, str], wanted: str) -> list[int]:
    columns = [column for column, name in names.items() if name.strip().lower() == wanted.strip().lower()]
    if not columns and wanted.strip().isdecimal():
        columns = [int(wanted)]
    columns = [column for column in columns if column < count]
    if not columns:
        raise InputError(f"{path}: it has no class '{wanted.strip()}'; its classes are {_listed(count, names)}")
    return columns


def _is_fruit(name: str) -> bool:
    words = re.sub(r"[^a-z]+", " ", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower())
    return _FRUIT.search(words) is not None and _NOT_THE_FRUIT.search(words) is None


def _listed(count: int, names: Mapping[int, str]) -> str:
    if not names:
        return f"0 to {count - 1}, without names"
    listed = [f"{column} {name}" for column, name in sorted(names.items()) if column < count]
    return ", ".join(listed[:20]) + (f", … ({len(listed)} in all)" if len(listed) > 20 else "")
