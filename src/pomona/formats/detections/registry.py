"""All formats of annotations. A new one is a module with a `Format`, and its line here."""

from __future__ import annotations

from collections.abc import Mapping

from pomona.formats.detections import (
    coco_labels,
    coco_results,
    cvat,
    labelme,
    mat_masks,
    png_masks,
    supervision_sinks,
    via,
    via_csv,
    voc,
    yolo,
)
from pomona.formats.detections.content import FileContent
from pomona.formats.detections.format import Format

FORMATS: tuple[Format, ...] = (
    coco_labels.FORMAT,
    coco_results.FORMAT,
    via.FORMAT,
    via_csv.FORMAT,
    cvat.FORMAT,
    voc.FORMAT,
    labelme.FORMAT,
    yolo.FORMAT,
    png_masks.FORMAT,
    mat_masks.FORMAT,
    supervision_sinks.FORMAT,
)

FORMAT_OF: Mapping[str, Format] = {each.kind: each for each in FORMATS}
"""The formats by their kinds."""


def recognised(content: FileContent) -> Format | None:
    """Return the format of a file, None where it holds something else.

    Raises `MissingFileError`, and `FormatError` where it cannot be read, or is JSON or XML that is broken.
    """
    by_bytes_first = sorted(FORMATS, key=lambda each: not each.binary)
    return next((each for each in by_bytes_first if each.recognise(content)), None)
