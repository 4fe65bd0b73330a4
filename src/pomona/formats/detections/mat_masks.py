"""Masks as the paper's authors' code reads them: a MATLAB file a photo, with `mask` and `scores`.

`mask` (h, w) is 0 where there is no fruit, else the fruit's label from 1; place k of `scores` is of label k. A
label may have no pixel, where other fruits' masks cover its own.
Source: https://github.com/GRAP-UdL-AT/SfM_3D_fruit_detection, main_SfM_3D_fruit_detection.m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import Array, FloatArray, IntArray, set_checked
from pomona.errors import FormatError, InputError
from pomona.formats.detections.format import Format
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto, check_size
from pomona.formats.detections.photo_source import Sources, named_as
from pomona.formats.detections.png_masks import masks_of_ids
from pomona.formats.files import read_head
from pomona.formats.mat_file import NotNumbers, read_mat
from pomona.values.detections import Mask

EXPECTED = "a MATLAB file with mask (a label image) and scores (one a label)"
_ENDINGS = ("_mask", "_masks")
_HEADER_BYTES = 1024  # the signature of HDF5 follows a block of MATLAB's own, of 512 bytes
_HDF5 = b"\x89HDF\r\n\x1a\n"
_MOST_LABELS = 65535  # as the authors' code, which keeps label images in 16 bits


@dataclass(frozen=True, eq=False)
class MatMasks:
    """The n fruits of one file, in the order of their `labels` (n,); `scores` (n,) in [0, 1], None if it has none."""

    width_px: int
    height_px: int
    labels: IntArray
    masks: tuple[Mask, ...]
    scores: FloatArray | None

    def __post_init__(self) -> None:
        set_checked(self, "labels", (len(self.masks),), np.int64)
        if self.scores is not None:
            set_checked(self, "scores", (len(self.masks),), np.float64)


def is_mat(head: bytes) -> bool:
    """Say whether a file that begins so is MATLAB's, of any version with a header."""
    return head.startswith(b"MATLAB ") or head.startswith(_HDF5)


def read_mat_masks(path: Path) -> MatMasks:
    """Read the masks and scores of one photo, of MATLAB's versions 4 to 7; the photo is the one of the same name.

    Raises `MissingFileError`, and `FormatError` naming the file, the variable and what was expected.
    """
    variables = _variables(path)
    if "mask" not in variables:
        raise FormatError(f"{path}: expected {EXPECTED}, but there is no variable mask")
    try:
        ids = _label_image(variables["mask"])
        of_label = _scores(variables["scores"], int(ids.max())) if "scores" in variables else None
    except InputError as error:
        raise FormatError(f"{path}: {error}") from None
    found = list(masks_of_ids(ids))
    labels = np.array([label for label, _ in found], np.int64)
    masks = tuple(mask for _, mask in found)
    return MatMasks(ids.shape[1], ids.shape[0], labels, masks, None if of_label is None else of_label[labels - 1])


def read_mats_found(files: Sequence[Path], folder: Path, sources: Sources) -> list[LabelledPhoto]:
    """Read MATLAB files below `folder`, each of the photo of its name; raises what `read_mat_masks` raises."""
    result = []
    for file in files:
        photo = sources(file).find(*named_as(file, folder, _ENDINGS))
        if photo is None:
            continue
        found = read_mat_masks(file)
        try:
            check_size((found.width_px, found.height_px), photo)
        except InputError as error:
            raise FormatError(f"{file}: mask: {error}") from None
        scores = [None] * len(found.masks) if found.scores is None else found.scores.tolist()
        fruits = [LabelledFruit.from_mask(mask, None, s) for mask, s in zip(found.masks, scores, strict=True)]
        result.append(LabelledPhoto.of(photo, fruits))
    return result


def _variables(path: Path) -> dict[str, Array | NotNumbers]:
    head = read_head(path, EXPECTED, _HEADER_BYTES)
    if head.startswith(b"MATLAB 7.3") or _HDF5 in head:
        raise FormatError(
            f"{path}: expected a MATLAB file of version 7 or older, found one of 7.3 (HDF5): "
            "save it again with save(file, 'mask', 'scores', '-v7')"
        )
    return read_mat(path, ("mask", "scores"), EXPECTED)


def _label_image(value: Array | NotNumbers) -> IntArray:
    if isinstance(value, NotNumbers) or value.ndim != 2 or value.size == 0:
        raise InputError(f"mask: expected a label image of height × width numbers, found {_what(value)}")
    with np.errstate(invalid="ignore"):
        ids = value.astype(np.int64)
    if not np.array_equal(ids, value) or ids.min() < 0 or ids.max() > _MOST_LABELS:
        raise InputError(f"mask: expected whole numbers from 0 to {_MOST_LABELS}, found {_first_other(value)}")
    return ids


def _scores(value: Array | NotNumbers, labels: int) -> FloatArray:
    """The scores of labels 1, 2, …; there may be more than labels, not fewer."""
    if isinstance(value, NotNumbers) or value.size not in (0, *value.shape):
        raise InputError(f"scores: expected a row or a column of numbers, found {_what(value)}")
    scores: FloatArray = value.ravel().astype(np.float64)
    if len(scores) < labels:
        raise InputError(f"scores: expected one for each label up to {labels}, found {len(scores)}")
    if len(wrong := np.flatnonzero(~((scores >= 0) & (scores <= 1)))):
        raise InputError(f"scores({wrong[0] + 1}): expected a number from 0 to 1, found {scores[wrong[0]]:g}")
    return scores


def _what(value: Array | NotNumbers) -> str:
    if isinstance(value, NotNumbers):
        return f"{value.what} (sparse ones: give full(mask))" if "sparse" in value.what else value.what
    return f"an array of {' × '.join(map(str, value.shape))}, {value.dtype}"[:80]


def _first_other(value: Array) -> str:
    other = value[~((value >= 0) & (value <= _MOST_LABELS) & (np.round(value) == value))]
    return f"{other[0]:g}"


FORMAT = Format(
    kind="mat",
    title="MATLAB masks",
    recognise=lambda content: is_mat(content.head) or content.suffix == ".mat",  # version 4 has no header
    read=lambda given: read_mats_found(given.files, given.folder, given.sources),
    binary=True,
)
