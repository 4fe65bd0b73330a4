"""Which tiles were cut from one photo, from their names, so that none is trained on while another is measured on."""

from __future__ import annotations

import re

# Roboflow: NAME_jpg.rf.HASH, a copy (augmented perhaps) of NAME.jpg.
_ROBOFLOW = re.compile(r"\.rf\.[0-9a-zA-Z]{8,}$")
_FORMER_SUFFIX = re.compile(r"[_.](?:jpe?g|png|tiff?|bmp|webp|heic)$", re.IGNORECASE)
# NAME_r0_c1, NAME_row0_col1, NAME-x512-y0, NAME_tile_3, NAME_patch12
_LETTERED = re.compile(
    r"[_\-.]+(?:(?:row|r|y)[_\-]?\d+[_\-]*(?:column|col|c|x)[_\-]?\d+|(?:column|col|c|x)[_\-]?\d+[_\-]*(?:row|r|y)[_\-]?\d+"
    r"|(?:tile|patch|crop|slice|part|sub)[_\-]?\d+(?:[_\-]\d+)*)$",
    re.IGNORECASE,
)
# SAHI: NAME_X0_Y0_X1_Y1; NAME_X_Y; NAME_K. Offsets and counters are written without leading zeros.
_PLAIN = r"(?:0|[1-9]\d{0,4})"
_FOUR = re.compile(rf"[_\-]{_PLAIN}[_\-]{_PLAIN}[_\-]{_PLAIN}[_\-]{_PLAIN}$")
_TWO = re.compile(rf"[_\-]{_PLAIN}[_\-]{_PLAIN}$")
_ONE = re.compile(r"_\d{1,3}$")
# Words after which cameras and programs count photos: the number is the photo's.
_COUNTED = re.compile(
    r"^(?:img|image|dsc[nf]?|_?mg|dji|gopr|pxl|mvi|p|sam|cimg|frame|photo|pic|rgb|vid|video|foto)[_\-]*$", re.IGNORECASE
)


def group_of(stem: str) -> str:
    """Return the photo that a file was cut or copied from: its name less what tiling and Roboflow have appended.

    In doubt more is taken off: that two photos count as one is no harm, that a photo is on both sides is.
    """
    stem = _FORMER_SUFFIX.sub("", _ROBOFLOW.sub("", stem))
    if match := _LETTERED.search(stem):
        return stem[: match.start()] or stem
    for pattern in (_FOUR, _TWO):
        if (match := pattern.search(stem)) and _names_a_photo(stem[: match.start()]):
            return stem[: match.start()]
    match = _ONE.search(stem)
    if match and any(letter.isdigit() for letter in stem[: match.start()]):
        return stem[: match.start()]
    return stem


def _names_a_photo(head: str) -> bool:
    """Whether what is left without two or four numbers is a photo's name, and not a word before its own number."""
    return bool(head) and not _COUNTED.match(head) and not head.isdigit()
