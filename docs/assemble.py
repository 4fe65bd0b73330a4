"""Put together the pages of the site: those of this folder, the command reference, two pages of the repository's root.

python docs/assemble.py FOLDER      FOLDER is made anew; `make docs` makes the site of it

The command reference is made from the command line's own help, so that it cannot be out of date.
"""

from __future__ import annotations

import html
import os
import re
import shutil
import sys
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
FROM_ROOT = ("ARCHITECTURE.md", "CHANGELOG.md")
COMMANDS_PAGE = "reference/commands.md"
COMMANDS_MARK = "<!-- commands -->"


def assemble(folder: Path) -> None:
    """Write all pages and images of the site into `folder`, in place of what is there."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(DOCS, folder, ignore=shutil.ignore_patterns("*.py", "__pycache__"))
    for page in folder.rglob("*.md"):
        page.write_text(_links_to_root_pages(page.read_text(encoding="utf-8"), page.parent, folder), encoding="utf-8")
    for name in FROM_ROOT:
        text = (DOCS.parent / name).read_text(encoding="utf-8")
        (folder / name).write_text(text.replace("](docs/", "]("), encoding="utf-8")
    commands = folder / COMMANDS_PAGE
    text = commands.read_text(encoding="utf-8")
    commands.write_text(text.replace(COMMANDS_MARK, command_reference()), encoding="utf-8")


def _links_to_root_pages(text: str, here: Path, folder: Path) -> str:
    for name in FROM_ROOT:
        text = re.sub(
            rf"\]\((?:\.\./)+{re.escape(name)}", f"]({Path(os.path.relpath(folder / name, here)).as_posix()}", text
        )
    return text


def command_reference() -> str:
    """Return every command with its arguments and options as Markdown."""
    import typer

    from pomona.cli.app import app

    return "\n\n".join(_sections("pomona", typer.main.get_command(app)))


def _sections(path: str, command: Any) -> list[str]:
    context = command.make_context(path.rsplit(" ", 1)[-1], [], resilient_parsing=True)
    parameters = [p for p in command.params if not getattr(p, "hidden", False) and "completion" not in (p.name or "")]
    children = getattr(command, "commands", {})
    usage = " ".join([path, *(piece for p in parameters for piece in _usage(p, context))])
    parts = [
        f"## `{path}`",
        (command.help or "").strip(),
        f"```text\n{usage}{' COMMAND …' if children else ''}\n```",
        _table(parameters, context),
    ]
    sections = ["\n\n".join(part for part in parts if part)] if path != "pomona" else []
    return sections + [text for name, child in children.items() for text in _sections(f"{path} {name}", child)]


def _usage(parameter: Any, context: Any) -> list[str]:
    if parameter.param_type_name == "argument":
        return [_term(parameter, context)]
    return [_term(parameter, context).split(", ")[-1]] if parameter.required else []


def _term(parameter: Any, context: Any) -> str:
    """Return `PHOTOS...` for an argument, `-o, --out SURVEY` for an option."""
    if parameter.param_type_name == "argument":
        return str(parameter.metavar or parameter.name.upper())
    return str(parameter.get_help_record(context)[0])


def _table(parameters: list[Any], context: Any) -> str:
    rows = [f"| <code>{_html(_term(p, context))}</code> | {_html(p.help or '')} | {_default(p)} |" for p in parameters]
    return "\n".join(["| option | | default |", "|---|---|---|", *rows]) if rows else ""


def _html(text: str) -> str:
    """Escape text for a cell of a table: a bar would end it, also within code."""
    return html.escape(text, quote=False).replace("|", "&#124;")


def _default(parameter: Any) -> str:
    default = parameter.default
    if parameter.required:
        return "required"
    if getattr(parameter, "is_flag", False) and parameter.secondary_opts:
        return f"`{(parameter.opts if default else parameter.secondary_opts)[0]}`"
    return f"`{default}`" if isinstance(default, str | int | float) and not isinstance(default, bool) else ""


if __name__ == "__main__":
    assemble(Path(sys.argv[1]))
