"""The documentation is true of the repository: links, paths, commands and options that it names exist."""

from __future__ import annotations

import ast
import doctest
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from conftest import REPOSITORY
from pomona.cli.app import app

DOCS = REPOSITORY / "docs"
FROM_ROOT = ("ARCHITECTURE.md", "CHANGELOG.md")  # pages of the site as well (docs/assemble.py)
PAGES = sorted([*(REPOSITORY / name for name in ("README.md", "CONTRIBUTING.md", *FROM_ROOT)), *DOCS.rglob("*.md")])
TEXTS = sorted(
    path
    for folder in ("src", "tests", "benchmarks", "viewer/src")
    for path in (REPOSITORY / folder).rglob("*")
    if path.suffix in {".py", ".md", ".ts", ".html"}
)
ROOMS = {path.name for path in (REPOSITORY / "src/pomona").iterdir() if path.is_dir()}
OTHER_MODULES = {"red_things.py"}  # of the example of a detector
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)(?: \"[^\"]*\")?\)")
SHELL = re.compile(
    r"^(?P<indent> *)```(?:bash|sh|console|shell)\n(?P<code>.*?)^(?P=indent)```", re.MULTILINE | re.DOTALL
)


def name(path: Path) -> str:
    return path.relative_to(REPOSITORY).as_posix()


def without_code(text: str) -> str:
    text = re.sub(r"^( *)```.*?^\1```", "", text, flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"`[^`\n]*`", lambda span: span.group().replace("(", " ").replace("[", " "), text)


def anchors(text: str) -> set[str]:
    """Return the anchors of a page's headings: those that GitHub and MkDocs make alike."""
    found: set[str] = set()
    for heading in re.findall(
        r"^#+ +(.+?) *$", re.sub(r"^( *)```.*?^\1```", "", text, flags=re.M | re.S), re.MULTILINE
    ):
        given = re.search(r"\{#([\w-]+)\}$", heading)
        slug = re.sub(r"[^\w\s-]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)).strip().lower()
        found.add(given.group(1) if given else re.sub(r"\s", "-", slug))
    return {anchor for anchor in found if anchor == re.sub(r"-+", "-", anchor)}


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_resolve(page: Path) -> None:
    broken = []
    for link in LINK.findall(without_code(page.read_text(encoding="utf-8"))):
        target, _, anchor = link.partition("#")
        if re.match(r"[a-z]+:", link):
            continue
        path = (page.parent / target).resolve() if target else page
        if not path.exists():
            broken.append(f"{link}: no such file")
        elif anchor and anchor not in anchors(path.read_text(encoding="utf-8")):
            broken.append(f"{link}: no such heading")
    assert not broken


def test_every_page_is_in_the_navigation() -> None:
    listed = set(re.findall(r"[\w./-]+\.md", (REPOSITORY / "mkdocs.yml").read_text(encoding="utf-8")))
    assert listed == {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")} | set(FROM_ROOT)


def test_pages_named_in_code_exist() -> None:
    named = {
        (path, page)
        for path in TEXTS
        for page in re.findall(r"(?<![\w./])docs/[\w./-]+\.(?:md|png|jpg)", path.read_text(encoding="utf-8"))
    }
    assert len(named) > 5
    assert not sorted(f"{name(path)}: {page}" for path, page in named if not (REPOSITORY / page).is_file())


def test_scripts_named_in_pages_exist() -> None:
    missing = [
        f"{name(page)}: {script}"
        for page in PAGES
        for script in re.findall(r"\b(?:benchmarks|tests)/[\w/]+\.(?:py|m)\b", page.read_text(encoding="utf-8"))
        if not (REPOSITORY / script).is_file()
    ]
    assert not missing


def test_modules_named_in_pages_exist() -> None:
    """`fuse/object/voting.py` and `fuse/object/` are paths in src/pomona; a bare `voting.py` is any module's name."""
    modules = {path.name for path in (REPOSITORY / "src").rglob("*.py")}
    missing = []
    for page in PAGES:
        for named in re.findall(r"`((?:[a-z_]+/)+(?:[a-z_]+\.py)?|[a-z_]+\.py)`", page.read_text(encoding="utf-8")):
            known = (REPOSITORY / "src/pomona" / named).exists() if "/" in named else named in modules | OTHER_MODULES
            if not known and named.split("/")[0] in ROOMS | {named}:
                missing.append(f"{name(page)}: {named}")
    assert not missing


def resolve(named: str) -> object:
    """Return a module, or what a module has under that name; raises `AttributeError` or `ModuleNotFoundError`."""
    parent, _, last = named.rpartition(".")
    try:
        return getattr(importlib.import_module(parent), last)
    except AttributeError:
        return importlib.import_module(named)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_imports_in_pages_resolve(page: Path) -> None:
    for block in re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
        code = "".join(example.source for example in doctest.DocTestParser().get_examples(block)) or block
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pomona"):
                for alias in node.names:
                    resolve(f"{node.module}.{alias.name}")


@pytest.mark.parametrize("named", re.findall(r"^::: ([\w.]+)", (DOCS / "reference/api.md").read_text(), re.MULTILINE))
def test_names_of_the_api_page_exist(named: str) -> None:
    resolve(named)


def calls(text: str) -> Iterator[str]:
    """Yield each call of `pomona` in a page's shell blocks, one string a call, without comments."""
    for block in SHELL.finditer(text):
        for line in re.sub(r"\\\n\s*", " ", block["code"]).splitlines():
            for command in re.split(r"\s(?:&&|;|\|)\s", re.sub(r"(^|\s)#.*", "", line)):
                if called := re.match(r"\s*(?:\$ )?(?:\S*/)?pomona\s+(.*)", command):
                    yield " ".join(called.group(1).split())


def options(command: Any) -> set[str]:
    return {"--help", *(opt for parameter in command.params for opt in (*parameter.opts, *parameter.secondary_opts))}


def unknown(call: str) -> str | None:
    command: Any = typer.main.get_command(app)
    words = call.split()
    while getattr(command, "commands", None):
        if words and words[0].startswith("-"):
            break
        if words and words[0] not in command.commands and (default := getattr(command, "default", None)):
            words.insert(0, default)  # pomona orchard FILE is pomona orchard run FILE
        if not words or words[0] not in command.commands:
            return f"pomona {call}: no command '{words[0] if words else ''}'"
        command = command.commands[words.pop(0)]
    wrong = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", " ".join(words))) - options(command)
    return f"pomona {call}: no option {', '.join(sorted(wrong))}" if wrong else None


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_commands_exist(page: Path) -> None:
    assert not [wrong for call in calls(page.read_text(encoding="utf-8")) if (wrong := unknown(call))]


def test_what_the_tests_above_see() -> None:
    text = (
        "```bash\n$ pomona run a \\\n  --nothing   # why\npomona nothing | cat\npomona benchmark wgisd --root x\n```\n"
    )
    assert [unknown(call) for call in calls(text)] == [
        "pomona run a --nothing: no option --nothing",
        "pomona nothing: no command 'nothing'",
        None,
    ]
    assert anchors("# `--method x`\n## A *b*, c?\n## corrections.json\n") == {"a-b-c", "correctionsjson"}
    assert sum(1 for page in PAGES for _ in calls(page.read_text(encoding="utf-8"))) >= 2
