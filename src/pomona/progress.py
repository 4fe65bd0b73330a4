"""Progress and warnings of a stage, whoever listens."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sized
from typing import Protocol, TypeVar

T = TypeVar("T")


class Progress(Protocol):
    """What a stage may say while it works. Implemented by the command line; silent by default."""

    def start(self, label: str, total: int | None = None) -> None:
        """Begin a step of `total` units (None: unknown), replacing the step before it."""

    def advance(self, units: int = 1) -> None:
        """Say that `units` more of the present step are done."""

    def warn(self, message: str) -> None:
        """Tell the person something they should know: shown at once, and kept in `survey.json`."""


class Silent:
    """A `Progress` that says nothing and remembers the warnings (for libraries and tests).

    `words` are those for who reads the survey later; see `words_of`.
    """

    def __init__(self, words: Callable[[str], str] = str) -> None:
        self.warnings: list[str] = []
        self.words = words

    def start(self, label: str, total: int | None = None) -> None:
        """Ignore the step."""

    def advance(self, units: int = 1) -> None:
        """Ignore the advance."""

    def warn(self, message: str) -> None:
        """Remember the warning."""
        self.warnings.append(message)


def words_of(listener: Progress) -> Callable[[str], str]:
    """Return what words messages for who listens: its method `words`, where it has one.

    Messages name parameters of Python; a person at the command line knows its options.
    """
    words: Callable[[str], str] = getattr(listener, "words", str)
    return words


class Recorder:
    """A `Progress` that passes everything on, each warning once and in `words`, and remembers the warnings."""

    def __init__(self, progress: Progress, words: Callable[[str], str] = str) -> None:
        self._progress, self._words = progress, words
        self.warnings: list[str] = []

    def start(self, label: str, total: int | None = None) -> None:
        """Pass the step on."""
        self._progress.start(label, total)

    def advance(self, units: int = 1) -> None:
        """Pass the advance on."""
        self._progress.advance(units)

    def warn(self, message: str) -> None:
        """Remember the warning and pass it on, the first time."""
        message = self._words(message)
        if message not in self.warnings:
            self.warnings.append(message)
            self._progress.warn(message)


def track(items: Iterable[T], progress: Progress, label: str, total: int | None = None) -> Iterator[T]:
    """Yield `items`, advancing `progress` after each one has been used."""
    if total is None and isinstance(items, Sized):
        total = len(items)
    progress.start(label, total)
    for item in items:
        yield item
        progress.advance()
