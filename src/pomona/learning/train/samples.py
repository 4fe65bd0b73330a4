"""What the network learns from: photos with a box and a label image each, and their split."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from pomona.basics.arrays import ByteArray, FloatArray
from pomona.errors import FormatError

Labels = npt.NDArray[np.int16]
"""A label image (h, w): 0 is not fruit, k ≥ 1 is the k-th fruit, −1 is doubtful and teaches nothing."""

IGNORED = -1
RENDERED = "rendered"
"""The source of rendered rows: their masks are exact."""


# Which tiles were cut from one photo, from their names: none may be trained on while another is measured on.
# Roboflow: NAME_jpg.rf.HASH, a copy (augmented perhaps) of NAME.jpg.
_ROBOFLOW = re.compile(r"\.rf\.[0-9a-zA-Z]{8,}$")
_FORMER_SUFFIX = re.compile(r"[_.](?:jpe?g|png|tiff?|bmp|webp|heic)$", re.IGNORECASE)
# NAME_r0_c1, NAME_row0_col1, NAME-x512-y0, NAME_tile_3, NAME_patch12
_LETTERED = re.compile(
    r"[_\-.]+(?:(?:row|r|y)[_\-]?\d+[_\-]*(?:column|col|c|x)[_\-]?\d+|(?:column|col|c|x)[_\-]?\d+[_\-]*(?:row|r|y)[_\-]?\d+"
    r"|(?:tile|patch|crop|slice|part|sub)[_\-]?\d+(?:[_\-]\d+)*)$",
    re.IGNORECASE,
)
# SAHI: NAME_X0_Y0_X1_Y1; NAME_X_Y; NAME_K. Offsets and counters are written without leading zeros: row1_001 is a photo
# of its own. But Fuji-SfM has tiles _MG_8067_01: after the four digits of a camera's own counter, two are a tile's.
_PLAIN = r"(?:0|[1-9]\d{0,4})"
_FOUR = re.compile(rf"[_\-]{_PLAIN}[_\-]{_PLAIN}[_\-]{_PLAIN}[_\-]{_PLAIN}$")
_TWO = re.compile(rf"[_\-]{_PLAIN}[_\-]{_PLAIN}$")
_ONE = re.compile(r"_(?:0|[1-9]\d{0,2})$|(?<=\D\d{4})_0\d$")
# Words after which cameras and programs count photos: the number is the photo's.
_COUNTED = re.compile(
    r"^(?:img|image|dsc[nf]?|_?mg|dji|gopr|pxl|mvi|p|sam|cimg|frame|photo|pic|rgb|vid|video|foto)[_\-]*$", re.IGNORECASE
)


@dataclass(frozen=True)
class Sample:
    """A photo on disk, or a part of one, with its fruits.

    `boxes_px` (n, 4) x0, y0, x1, y1; `labels` is a PNG of int16 stored as uint16 with −1 as 65535. `group` names the
    photo that it was cut from, so that splits respect it; `photo` the labelled photo in its set, where `image` is a
    part of it. `weak`: boxes say more than masks, which were made from them or do not fill them. `part` is "training",
    "validation" or "test" where the set says so.
    `circles_px` (n, 3) are the whole fruits' centres and radii, hidden parts and all; None or NaN where unknown.
    `ignored_px` (m, 4) are boxes of what is doubtful: what is found there is neither right nor wrong.
    """

    image: Path
    labels: Path
    boxes_px: FloatArray
    group: str
    source: str
    weak: bool = False
    photo: str = ""
    part: str = ""
    circles_px: FloatArray | None = None
    ignored_px: FloatArray | None = None

    @property
    def name(self) -> str:
        """The labelled photo, as its set calls it."""
        return self.photo or self.image.name

    def pixels(self) -> ByteArray:
        """Read the photo, uint8 (h, w, 3) RGB."""
        bgr = cv2.imread(str(self.image), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        if bgr is None:
            raise FormatError(f"{self.image}: expected a photo that can be read")
        return np.ascontiguousarray(bgr[:, :, ::-1])

    def label_image(self) -> Labels:
        """Read the label image, int16 (h, w)."""
        stored = cv2.imread(str(self.labels), cv2.IMREAD_UNCHANGED)
        if stored is None:
            raise FormatError(f"{self.labels}: expected a label image that can be read")
        return np.asarray(stored).view(np.int16)


def boxes_of(labels: Labels, count: int) -> FloatArray:
    """Return the boxes (count, 4) of labels 1 … count; NaN where a label is not in the image."""
    boxes = np.full((count, 4), np.nan)
    rows, columns = np.nonzero(labels > 0)
    of = labels[rows, columns].astype(np.int64) - 1
    for axis, values in ((0, columns), (1, rows)):
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(low, of, values)
        np.maximum.at(high, of, values + 1)
        seen = np.isfinite(low)
        boxes[seen, axis], boxes[seen, axis + 2] = low[seen], high[seen]
    return boxes


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


def split(samples: Sequence[Sample], held_out: float) -> tuple[list[Sample], list[Sample]]:
    """Return (training, validation) samples; all samples of a group go to one side, chosen by the group's name.

    Neither side is empty where there are two groups or more.
    """
    place = {sample.group: zlib.crc32(sample.group.encode()) % 1000 for sample in samples}
    order = sorted(place, key=lambda group: (place[group], group))
    held = [group for group in order if place[group] < 1000 * held_out]
    if len(order) > 1 and not held:
        held = order[:1]
    elif len(order) > 1 and len(held) == len(order):
        held = order[:-1]
    return [s for s in samples if s.group not in held], [s for s in samples if s.group in held]


def write_split(path: Path, training: Sequence[Sample], validation: Sequence[Sample]) -> None:
    """Write which photos were trained on and which held out, so that others can measure on the same ones."""
    names = {
        side: sorted({f"{s.source}/{s.name}" for s in samples})
        for side, samples in (("training", training), ("validation", validation))
    }
    path.write_text(json.dumps(names, indent=0) + "\n", encoding="utf-8")
