"""What a person corrects: each correction by the place of its fruits in the world, never by their numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from pomona.errors import InputError

_MOST_DIGITS = 15  # of a tree's number: what the page's numbers and those of the log can tell apart
Place = tuple[float, float, float]
"""x, y, z in the world frame, in metres (in its units where metres are not known)."""


@dataclass(frozen=True)
class Mark:
    """A click: the middle of a fruit in a photo, in pixels (COLMAP's convention)."""

    photo: str
    x_px: float
    y_px: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.x_px) and math.isfinite(self.y_px)):
            raise InputError(f"A place in {self.photo}: expected pixels, found {self.x_px}, {self.y_px}")


@dataclass(frozen=True, kw_only=True)
class Deleted:
    """The fruit at `at` is none. `made` is when the person said so (ISO 8601), as in the others."""

    at: Place
    made: str = ""


@dataclass(frozen=True, kw_only=True)
class Added:
    """There is a fruit at `at`, seen where the `marks` are; without `diameter_m` it is as large as the others."""

    at: Place
    diameter_m: float | None = None
    diameter_sd_m: float | None = None
    marks: tuple[Mark, ...] = ()
    made: str = ""


@dataclass(frozen=True, kw_only=True)
class Split:
    """The fruit at `at` is two, with their middles at the two `parts`, seen where the two `marks` are."""

    at: Place
    parts: tuple[Place, Place]
    marks: tuple[Mark, ...] = ()
    made: str = ""


@dataclass(frozen=True, kw_only=True)
class Merged:
    """The two fruits at `at` are one."""

    at: tuple[Place, Place]
    made: str = ""


@dataclass(frozen=True, kw_only=True)
class Moved:
    """The fruit at `at` hangs on the tree `tree_id` (0: on none that is known)."""

    at: Place
    tree_id: int
    made: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.tree_id < 10**_MOST_DIGITS:
            expected = f"expected a positive number of at most {_MOST_DIGITS} digits, or 0 for none"
            raise InputError(f"Tree: {expected}, found {self.tree_id}")


Correction = Deleted | Added | Split | Merged | Moved
KINDS: dict[str, type[Correction]] = {"delete": Deleted, "add": Added, "split": Split, "merge": Merged, "move": Moved}


@dataclass(frozen=True)
class Corrections:
    """The log: what is done, in order, and what was undone, the next to be redone last."""

    done: tuple[Correction, ...] = ()
    undone: tuple[Correction, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.done)

    def with_one(self, correction: Correction) -> Corrections:
        """Return the log with one correction more; what was undone before is forgotten."""
        return Corrections((*self.done, correction))

    def undo(self) -> Corrections:
        """Return the log without the last correction; raises `InputError` where there is none."""
        if not self.done:
            raise InputError("There is nothing to undo")
        return replace(self, done=self.done[:-1], undone=(*self.undone, self.done[-1]))

    def redo(self) -> Corrections:
        """Return the log with what was undone last; raises `InputError` where there is none."""
        if not self.undone:
            raise InputError("There is nothing to redo")
        return replace(self, done=(*self.done, self.undone[-1]), undone=self.undone[:-1])


def in_words(correction: Correction) -> str:
    """Return what a correction does, for a person."""
    match correction:
        case Deleted(at=at):
            return f"delete the fruit at {_at(at)}"
        case Added(at=at):
            return f"add a fruit at {_at(at)}"
        case Split(at=at):
            return f"split the fruit at {_at(at)}"
        case Merged(at=(one, other)):
            return f"merge the fruits at {_at(one)} and {_at(other)}"
        case Moved(at=at, tree_id=tree_id):
            return f"move the fruit at {_at(at)} to {f'tree {tree_id}' if tree_id else 'no tree'}"


def place_of(values: Sequence[float]) -> Place:
    """Return three numbers as a place, to the tenth of a millimetre; raises `InputError` for others."""
    if len(values) != 3 or not all(math.isfinite(value) for value in values):
        raise InputError(f"A place: expected x, y, z, found {list(values)}")
    x, y, z = (round(float(value), 4) + 0.0 for value in values)  # not -0.0
    return x, y, z


def _at(place: Place) -> str:
    return ", ".join(f"{value:.2f}" for value in place)
