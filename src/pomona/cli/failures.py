"""Errors become a message that says what to do and an exit status, never a bare traceback."""

from __future__ import annotations

import functools
import os
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn, ParamSpec, TypeVar

import typer
from rich.console import Console
from rich.text import Text

from pomona.cli import STOPPED
from pomona.cli.wording import with_options
from pomona.errors import PomonaError
from pomona.survey.files import disk_error

P = ParamSpec("P")
R = TypeVar("R")

WRONG_INPUT, OUR_MISTAKE = 1, 3


class Stopped(KeyboardInterrupt):
    """Ctrl-C, with what to tell the person."""


def stopped_learning(kept: Path) -> Stopped:
    """Return what is said where learning was stopped, whose state is in the folder `kept`, if it came so far."""
    if kept.is_dir():
        return Stopped(f"what was learnt is kept in {kept}; the same command goes on.")
    return Stopped("nothing had been learnt yet; the same command begins again.")


def reporting_errors(command: Callable[P, R]) -> Callable[P, R]:
    """Return `command`, which prints its errors and warnings as messages and exits with their status."""

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except PomonaError as error:
            say("Error", "bold red", with_options(str(error)))
            raise typer.Exit(WRONG_INPUT) from None
        except KeyboardInterrupt as error:
            say("Stopped", "bold yellow", str(error) or "nothing was lost.")
            raise typer.Exit(STOPPED) from None
        except (typer.Exit, typer.Abort, typer.BadParameter):
            raise
        except Exception as error:
            if (said := disk_error(error)) is None or os.environ.get("POMONA_DEBUG"):
                _tell_of_our_mistake(error)
            say("Error", "bold red", with_options(said))
            raise typer.Exit(WRONG_INPUT) from None

    return wrapped


def say(kind: str, style: str, message: str) -> None:
    """Print a message on stderr, its first word coloured where that can be seen."""
    console = Console(stderr=True, highlight=False)
    console.print(Text.assemble((f"{kind}: ", style), message), soft_wrap=not console.is_terminal)


def _tell_of_our_mistake(error: Exception) -> NoReturn:
    if os.environ.get("POMONA_DEBUG"):
        raise error
    happened = "".join(traceback.format_exception(error))
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", prefix="pomona-error-", suffix=".txt", delete=False
        ) as file:
            file.write(happened)
        account, happened = str(Path(file.name)), ""
    except OSError:  # the disk for temporary files is full, too, or there is none
        account = "what follows"
    text = f"{type(error).__name__}: {error}".rstrip(": ")
    say(
        "Error",
        "bold red",
        f"{text}\nThis is a mistake in Pomona, not yours. Please report it with {account}, which says where it "
        f"happened. What was finished is kept: the same command goes on from there.\n{happened}".rstrip(),
    )
    raise typer.Exit(OUR_MISTAKE) from None
