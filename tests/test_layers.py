"""The rooms import as ARCHITECTURE.md draws them: from rooms above their own line only, engines in their own room."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from package_rooms import PACKAGE, groups, modules, room_named, room_of, rooms, section

# Import names of the engines in the table's last column. What is not here (numpy, scipy, Pillow, rich) is a library
# that any room may use.
ENGINES = {
    "laspy": "laspy", "pyproj": "pyproj", "sqlite3": "sqlite3", "rerun": "rerun-sdk", "pycocotools": "pycocotools",
    "yaml": "PyYAML", "pillow_heif": "pillow-heif", "onnxruntime": "ONNX Runtime", "torchvision": "torchvision",
    "transformers": "transformers", "pycolmap": "pycolmap", "sklearn": "scikit-learn", "bpy": "bpy", "torch": "torch",
    "typer": "typer", "uvicorn": "uvicorn", "starlette": "Starlette", "pandas": "pandas", "geopandas": "GeoPandas",
    "cv2": "OpenCV", "pyarrow": "pyarrow", "distributed": "Dask distributed", "fsspec": "fsspec",
}  # fmt: skip


@cache
def rows() -> list[tuple[tuple[str, ...], tuple[str, ...]]]:
    """The rooms of each line of the table, bottom to top, and the names of its outside engines."""
    cells = [line.strip("|").split("|") for line in section().splitlines() if line.startswith("| `")]
    return [(tuple(re.findall(r"`([\w/]+)`", first)), engine_names(engines)) for first, _, engines in cells]


def engine_names(cell: str) -> tuple[str, ...]:
    """The names in a cell such as "OpenCV (ArUco, SQPnP), pyproj"; what is in brackets says what for."""
    names = re.sub(r"\([^)]*\)", "", cell).split(",")
    return tuple(name.strip() for name in names if name.strip())


def line_of(room: str) -> int:
    """The first line of the table that names a room; its rooms below (`formats/cameras/`) count as the room itself."""
    return next(k for k, (names, _) in enumerate(rows()) if room in [room_in_table(name) for name in names])


def room_in_table(name: str) -> str:
    return room_named(*name.strip("/").split("/"))


@cache
def imports(path: Path) -> tuple[str, ...]:
    """All names that a file imports, in functions too, but not for type checking alone."""

    def found(node: ast.AST) -> Iterator[str]:
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            return
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports are not used"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        for child in ast.iter_child_nodes(node):
            yield from found(child)

    return tuple(found(ast.parse(path.read_bytes())))


def imported_rooms(path: Path) -> set[str]:
    parts = [tuple(name.split(".")[1:]) for name in imports(path) if name.startswith("pomona.")]
    found = {room_named(*part) for part in parts if part[0] not in groups() or len(part) > 1}
    return found - {"__version__", room_of(path)}


def test_every_room_is_in_the_table() -> None:
    named = {room_in_table(name) for names, _ in rows() for name in names}
    assert rooms() == named


def test_groups_of_rooms_hold_nothing_but_rooms() -> None:
    assert groups()
    for group in groups():
        tree = ast.parse((PACKAGE / group / "__init__.py").read_bytes())
        assert len(tree.body) == 1
        assert ast.get_docstring(tree)


@pytest.mark.parametrize("room", sorted(rooms()))
def test_rooms_import_from_above_their_line(room: str) -> None:
    wrong = [
        f"{path.relative_to(PACKAGE)} imports {other}"
        for path in modules()
        if room_of(path) == room
        for other in sorted(imported_rooms(path))
        if line_of(other) > line_of(room)
    ]
    assert not wrong


def test_rooms_do_not_import_in_circles() -> None:
    above: dict[str, set[str]] = {}
    for path in modules():
        above.setdefault(room_of(path), set()).update(imported_rooms(path))
    placed: set[str] = set()
    while left := {room: rooms - placed for room, rooms in above.items() if room not in placed}:
        free = {room for room, waiting in left.items() if not waiting}
        assert free, f"These rooms import each other: {left}"
        placed |= free


def test_modules_do_not_import_in_circles() -> None:
    """By what runs when a module is loaded; imports in functions come later."""
    named = {".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts): path for path in modules()}
    graph = {name: {target for target in _loaded(path) if target in named} for name, path in named.items()}
    placed: set[str] = set()
    while left := {name: targets - placed - {name} for name, targets in graph.items() if name not in placed}:
        free = {name for name, waiting in left.items() if not waiting}
        assert free, f"These modules import each other: {left}"
        placed |= free


def _loaded(path: Path) -> set[str]:
    """The modules that a file imports at its top level; of a package, those that are asked for by name."""
    names: set[str] = set()
    for node in ast.parse(path.read_bytes()).body:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
    return names


@pytest.mark.parametrize("engine", sorted(ENGINES))
def test_an_outside_engine_is_imported_in_its_rooms_only(engine: str) -> None:
    allowed = {room_in_table(name) for names, engines in rows() if ENGINES[engine] in engines for name in names}
    importing = {room_of(path) for path in modules() if any(n.split(".")[0] == engine for n in imports(path))}
    assert importing, f"{engine} is imported nowhere"
    assert importing <= allowed


def test_an_engine_is_named_by_its_whole_name() -> None:
    assert engine_names(" torchvision (`mask_rcnn.py`, torch), OpenCV (SIFT) ") == ("torchvision", "OpenCV")
    assert engine_names("  ") == ()


def test_the_standard_library_is_no_engine() -> None:
    assert {name for name in ENGINES if name in sys.stdlib_module_names} == {"sqlite3"}
