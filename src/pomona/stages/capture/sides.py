"""The two sides of a row: known from folders, from file names, or by patterns that a person gives."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import PurePosixPath

from pomona.errors import InputError

_LEAST_PHOTOS = 3  # of a side: a word that fewer names have is a slip, or a photo of something else

# Words that name a side wherever they stand in a file name, in pairs.
_SIDE_WORDS = tuple(
    set(pair.split("/"))
    for pair in (
        "east/west", "north/south", "left/right", "front/back", "e/w", "n/s", "l/r", "a/b", "est/oest", "este/oeste",
        "est/ouest", "ost/west", "osten/westen", "nord/sud", "nord/süd", "norden/süden", "norte/sur",
        "links/rechts", "vorne/hinten", "izquierda/derecha", "izq/der", "izda/dcha", "gauche/droite", "sinistra/destra",
        "sx/dx", "esquerda/direita", "leste/oeste",
    )
)  # fmt: skip
# Words with which cameras, phones and programs begin every name: a change of camera is no change of side.
_CAMERA_WORDS = frozenset([
    "img", "dsc", "dscn", "dscf", "pxl", "p", "mvi", "mov", "gopr", "gp", "gx", "go", "dji", "imgp", "sam", "pict",
    "pic", "cimg", "hpim", "mg", "imag", "image", "images", "photo", "photos", "picture", "frame", "f", "wp", "vid",
    "screenshot", "snapshot", "video", "export", "edit", "burst", "portrait", "pano", "hdr", "whatsapp", "tree",
])  # fmt: skip


def sides_by_names(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the side of each photo from its name (n,), or None where the names show no two sides.

    There are two sides where a word of every name takes exactly two values, each in at least three photos: known pairs
    such as east and west anywhere in the name, any other pair at its beginning (except words that cameras begin with).
    """
    tokens = [_words(PurePosixPath(name).stem) for name in names]
    for position in range(min((len(t) for t in tokens), default=0)):
        words = [t[position] for t in tokens]
        counts = Counter(words)
        if len(counts) != 2 or min(counts.values()) < _LEAST_PHOTOS or not all(w.isalpha() for w in counts):
            continue
        if set(counts) in _SIDE_WORDS or (position == 0 and not _CAMERA_WORDS & set(counts)):
            return tuple(words)
    return None


def are_known_pair(sides: Sequence[str]) -> bool:
    """Say whether two names have a pair of words such as east and west, rather than just any two."""
    one, other = (set(_words(side)) for side in sides)
    return any({word, against} in _SIDE_WORDS for word in one for against in other)


def _words(name: str) -> list[str]:
    """The words and numbers in a name, in lower case, however its accents are encoded."""
    return re.findall(r"[^\W\d_]+|\d+", unicodedata.normalize("NFC", name).casefold())


def check_option(option: str) -> None:
    """Raise `InputError` where `sides` has none of the values that exist."""
    if option in ("auto", "none"):
        return
    globs = _globs(option) if isinstance(option, str) else []  # what a damaged survey says is anything
    if len(globs) != 2 or not all(globs) or not any(c in option for c in "*?["):
        raise InputError(
            f"`sides`: expected auto, none, or two patterns such as 'east_*,west_*' (in quotes), found {option!r}"
        )


def _globs(option: str) -> list[str]:
    return [part.strip() for part in option.split(",")]


def sides_by_globs(names: Sequence[str], option: str, *, are_all: bool = True) -> tuple[str, ...]:
    """Return the side of each photo (n,) by two patterns `GLOB,GLOB`, each named after its literal part.

    A pattern is held against the photo's whole name and against its file name, without regard to case.

    Raises `InputError` when `option` is not two patterns, when a photo matches neither or both, or when no photo
    matches one of them, where these `are_all`.
    """
    check_option(option)
    globs = _globs(option)
    labels = _labels(globs)
    sides, unclear = [], []
    for name in names:
        matching = [label for label, glob in zip(labels, globs, strict=True) if _matches(name, glob)]
        sides.append(matching[0] if matching else "")
        if len(matching) != 1:
            unclear.append((name, "both patterns" if matching else "neither pattern"))
    if unclear:
        examples = "; ".join(f"{name} matches {how}" for name, how in unclear[:5])
        raise InputError(
            f"`sides` {option}: every photo must match exactly one pattern, and {len(unclear)} of {len(names)} do not: "
            f"{examples}"
        )
    missing = [glob for glob, label in zip(globs, labels, strict=True) if label not in sides]
    if missing and are_all:
        raise InputError(f"`sides` {option}: no photo matches {missing[0]}; photos are named like {names[0]}")
    return tuple(sides)


def _matches(name: str, glob: str) -> bool:
    folded = glob.casefold()
    return fnmatchcase(name.casefold(), folded) or fnmatchcase(PurePosixPath(name).name.casefold(), folded)


def _labels(globs: Sequence[str]) -> list[str]:
    """Name each side after what is literal in its pattern: `E_*.jpg` is E, `*west*` is west."""
    labels = []
    for glob in globs:
        literal = re.sub(r"\.(jpe?g|png|tiff?|hei[cf])$", "", glob, flags=re.IGNORECASE)
        parts = [part.strip("_-. /") for part in re.split(r"\[[^]]*\]|[*?]+", literal)]
        labels.append("_".join(part.replace("/", "_") for part in parts if part) or glob)
    return labels if labels[0] != labels[1] else list(globs)
