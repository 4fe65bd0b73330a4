"""Which program's annotations a file holds, found from its content."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pomona.errors import FormatError, MissingFileError
from pomona.formats.detections.coco_file import is_coco, is_results
from pomona.formats.detections.cvat import is_cvat
from pomona.formats.detections.labelme import is_labelme
from pomona.formats.detections.mat_masks import is_mat
from pomona.formats.detections.via import is_via
from pomona.formats.detections.via_csv import is_via_csv
from pomona.formats.detections.voc import is_voc
from pomona.formats.detections.yolo import is_yolo
from pomona.formats.json_file import load_json, read_text
from pomona.formats.xml_file import load_xml

EXPECTED = "labels of photos"
_IMAGES = (b"\x89PNG\r\n\x1a\n", b"II*\x00", b"MM\x00*")  # PNG and TIFF, the ones that keep numbers as they are
_SINK = {"x_min", "y_min", "x_max", "y_max", "class_id", "confidence", "tracker_id"}


def kind_of(file: Path) -> str | None:
    """Return the format of a file of annotations; None where it holds something else.

    One of "masks" (an image of ids), "mat", and what `kind_of_text` returns. Raises `MissingFileError`, and
    `FormatError` where it cannot be read, or is JSON or XML that is broken.
    """
    try:
        with file.open("rb") as stream:
            head = stream.read(512)
    except FileNotFoundError:
        raise MissingFileError(f"{file}: expected {EXPECTED}, but there is no such file") from None
    except OSError as error:
        raise FormatError(f"{file}: expected {EXPECTED}, but it cannot be read: {error}") from None
    if head.startswith(_IMAGES):
        return "masks"
    if is_mat(head) or file.suffix.lower() == ".mat":  # version 4 has no header to know it by
        return "mat"
    if b"\x00" in head or head.startswith(b"\xff\xd8"):
        return None
    if not head.strip():
        return "yolo" if file.suffix.lower() == ".txt" else None
    return kind_of_text(file)


def kind_of_text(file: Path) -> str | None:
    """Return the format of a text file; None where it holds something else.

    One of "coco", "coco-results", "via", "via-csv", "labelme", "cvat", "voc", "yolo", "sink" (supervision's). Raises
    `FormatError` where it is empty, no text, or JSON or XML that is broken.
    """
    text = read_text(file, EXPECTED).lstrip()
    if text[0] in "{[":
        return _kind_of_json(load_json(file, EXPECTED))
    if text[0] == "<":
        root = load_xml(file, EXPECTED)
        return "cvat" if is_cvat(root) else "voc" if is_voc(root) else None
    if file.suffix.lower() == ".json":
        load_json(file, EXPECTED)  # says what is wrong with it
    head = text.partition("\n")[0]
    if is_via_csv(head):
        return "via-csv"
    if set(head.strip().split(",")) >= _SINK:
        return "sink"
    return "yolo" if is_yolo(text) else None


def _kind_of_json(content: Any) -> str | None:
    entries = content if isinstance(content, list) else []
    if entries and all(isinstance(entry, dict) and set(entry) >= _SINK for entry in entries):
        return "sink"
    kinds = {"coco": is_coco, "labelme": is_labelme, "via": is_via, "coco-results": is_results}
    return next((kind for kind, fits in kinds.items() if fits(content)), None)


def sink_error(file: Path) -> FormatError:
    """Return the error for a file of supervision's sinks, which has no masks and names no photos."""
    return FormatError(
        f"{file}: expected masks of the fruits in each photo, found boxes alone, of photos that are not named "
        "(supervision's CSVSink or JSONSink): write the masks with supervision's DetectionDataset.as_coco"
    )
