"""The code that a stage runs: all modules that its own reaches by import, their data files, and the engines they use.

Imports are read from the source without running it, those inside functions too. A module under `if TYPE_CHECKING` is
not reached, since it does not run.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from pomona.pipeline.names import STAGES
from pomona.survey.digest import digest, file_digest

_PACKAGE = Path(__file__).parents[1]
_SOURCE = ".py"

# The distributions that bring a package which is not called as they are; the first one installed counts.
_DISTRIBUTIONS = {
    "PIL": ("pillow",),
    "cv2": ("opencv-python-headless", "opencv-python", "opencv-contrib-python-headless", "opencv-contrib-python"),
    "onnxruntime": ("onnxruntime", "onnxruntime-gpu"),
    "pillow_heif": ("pillow-heif",),
    "pycolmap": ("pycolmap", "pycolmap-cuda12"),
    "sklearn": ("scikit-learn",),
    "yaml": ("pyyaml",),
}
# The fields of statements that hold statements.
_BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")
# Packages of extras, which a run with the defaults never imports: whoever installs one keeps earlier results.
_OF_EXTRAS = frozenset({"bpy", "onnx", "pandas", "geopandas", "rerun", "torch", "torchvision", "transformers"})


@dataclass(frozen=True)
class Reach:
    """What running a module can run: files of the package, by their path in it, and outside packages by import name."""

    files: frozenset[Path]
    engines: frozenset[str]


@cache
def code_digest(module: str, package: Path = _PACKAGE) -> str:
    """Return a digest of all files that `module` reaches in `package`, the folder of Pomona's own."""
    files = sorted(reach(module, package).files)
    return digest({path.as_posix(): _file_digest(package / path) for path in files})


def engine_versions(module: str) -> dict[str, str]:
    """Return the versions of the outside packages that `module` reaches, without those of extras."""
    return {name: version_of(name) for name in sorted(reach(module, _PACKAGE).engines - _OF_EXTRAS)}


@cache
def version_of(engine: str) -> str:
    """Return the version of the distribution that brings a package, "not installed" where there is none."""
    for distribution in _DISTRIBUTIONS.get(engine, (engine,)):
        try:
            return version(distribution)
        except PackageNotFoundError:
            continue
    return "not installed"


@cache
def reach(module: str, package: Path) -> Reach:
    """Return what `module` (such as `pomona.pipeline.fuse`) reaches in the package in folder `package`."""
    root = package.name
    # Not followed: the packages that gather all there is, and the modules of other stages, whose results are inputs.
    left_out = {root, f"{root}.pipeline", *(f"{root}.pipeline.{name}" for name in (*STAGES, "correct"))} - {module}
    waiting, seen, engines = [module], set[Path](), set[str]()
    while waiting:
        name = waiting.pop()
        path = _file_of(name, package)
        if path is None or path in seen:
            continue
        seen.add(path)
        waiting += [parent for parent in _parents(name) if parent not in left_out]  # importing a module runs them
        for imported in _imports(path, name):
            if imported.partition(".")[0] == root:
                waiting += [] if imported in left_out else [imported]
            elif imported.partition(".")[0] not in sys.stdlib_module_names:
                engines.add(imported.partition(".")[0])
    files = {path.relative_to(package) for path in seen}
    folders = {path.parent for path in seen}
    files |= {data.relative_to(package) for folder in folders for data in _data_files(folder, package)}
    return Reach(frozenset(files), frozenset(engines))


def _parents(name: str) -> Iterator[str]:
    while "." in name:
        name = name.rpartition(".")[0]
        yield name


@cache
def _file_of(name: str, package: Path) -> Path | None:
    """The file of a module or package; None for what is neither, such as a function of a module."""
    path = package.joinpath(*name.split(".")[1:])
    for file in (path.with_suffix(_SOURCE), path / "__init__.py"):
        if file.is_file():
            return file
    return None


@cache
def _imports(path: Path, name: str) -> tuple[str, ...]:
    """The dotted names that a source file imports; for `from a import b` both `a` and `a.b`, as `b` may be a module."""
    found: list[str] = []
    waiting: list[ast.AST] = [ast.parse(path.read_bytes())]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            waiting += node.orelse
            continue
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative imports are not followed"
            origin = node.module or ""
            found += [origin, *(f"{origin}.{alias.name}" for alias in node.names)]
        elif isinstance(node, (ast.stmt, ast.Module, ast.excepthandler, ast.match_case)):  # no expression imports
            waiting += [inner for part in _BLOCKS for inner in getattr(node, part, ())]
    return tuple(found)


def _data_files(folder: Path, package: Path) -> Iterator[Path]:
    """Files beside the modules of a folder that are no code, and those in folders below that are no packages."""
    if folder == package:
        return
    for path in folder.iterdir():
        if path.is_dir() and not (path / "__init__.py").exists() and path.name != "__pycache__":
            yield from (file for file in path.rglob("*") if file.is_file())
        elif path.is_file() and path.suffix not in (_SOURCE, ".pyc"):
            yield path


@cache
def _file_digest(path: Path) -> str:
    return file_digest(path)
