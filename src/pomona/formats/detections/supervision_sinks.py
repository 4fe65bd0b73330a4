"""Files of supervision's sinks (CSVSink, JSONSink): no masks and no names of photos, so recognised to be refused."""

from __future__ import annotations

from pomona.formats.detections.content import FileContent
from pomona.formats.detections.format import AnnotationFiles, Format
from pomona.formats.detections.labelled import LabelledPhoto

_COLUMNS = {"x_min", "y_min", "x_max", "y_max", "class_id", "confidence", "tracker_id"}


def is_sink(content: FileContent) -> bool:
    """Say whether a file is a table of a CSVSink or a list of a JSONSink."""
    entries = content.json if isinstance(content.json, list) else []
    if entries:
        return all(isinstance(entry, dict) and set(entry) >= _COLUMNS for entry in entries)
    return set(content.first_line.strip().split(",")) >= _COLUMNS


def _read(given: AnnotationFiles) -> list[LabelledPhoto]:
    raise AssertionError(f"{given.given}: such a file is refused before it is read")


FORMAT = Format(
    kind="sink",
    title="a file of supervision's sinks",
    recognise=is_sink,
    read=_read,
    refusal="expected masks of the fruits in each photo, found boxes alone, of photos that are not named "
    "(supervision's CSVSink or JSONSink): write the masks with supervision's DetectionDataset.as_coco",
)
