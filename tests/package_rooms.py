"""The rooms of the package as ARCHITECTURE.md names them: files and folders of `src/pomona/`, and those in groups."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "pomona"


def modules() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


@cache
def section() -> str:
    """What ARCHITECTURE.md says of rooms, with its table."""
    return (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").partition("## Rooms")[2].partition("\n## ")[0]


@cache
def groups() -> frozenset[str]:
    """The folders that group rooms: whatever they hold is a room of its own, such as `stages/sfm`."""
    return frozenset(re.findall(r"^- `(\w+)/`", section(), re.MULTILINE))


def room_named(*parts: str) -> str:
    """The room of a path in the package, given by its parts: the first, or in a group of rooms the first two."""
    return "/".join(parts[: 2 if parts[0] in groups() else 1])


def room_of(path: Path) -> str:
    return room_named(*path.relative_to(PACKAGE).with_suffix("").parts)


def rooms() -> set[str]:
    """All rooms; the first file of a group of rooms, which has a docstring alone, is none."""
    return {room_of(path) for path in modules()} - {"__init__", "__main__"} - {f"{name}/__init__" for name in groups()}
