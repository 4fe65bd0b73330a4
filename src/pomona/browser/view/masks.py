"""A survey's detections, those of a photo decoded when it is looked at: a big survey's take half a minute."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pomona.errors import FormatError, SurveyError
from pomona.formats.detections.coco import detections_by_image
from pomona.formats.detections.coco_file import coco_of
from pomona.formats.json_file import load_json
from pomona.stages.capture.images import file_state
from pomona.values.detections import Detections


class MasksByPhoto(Mapping[str, Detections]):
    """The detections of a survey's `detections.json` of at least a score, by photo.

    The file is read with the first look at it, which raises `FormatError` where it is damaged; so does a photo's. Where
    a run has written it anew in the meantime, that is a `SurveyError`: its masks are not those of the fruits shown.
    """

    def __init__(self, path: Path, least_score: float) -> None:
        self._path, self._least_score = path, least_score
        self._state = file_state(path)
        self._lock = threading.Lock()
        self._read: dict[str, dict[str, Any]] | None = None
        self._decoded: dict[str, Detections] = {}

    def __getitem__(self, photo: str) -> Detections:
        contents = self._contents()
        if photo not in self._decoded:
            ((_, found),) = detections_by_image(coco_of(self._path, contents[photo]))
            self._decoded[photo] = found[found.scores >= self._least_score]
        return self._decoded[photo]

    def __iter__(self) -> Iterator[str]:
        return iter(self._contents())

    def __len__(self) -> int:
        return len(self._contents())

    def _contents(self) -> dict[str, dict[str, Any]]:
        """What the file says of each photo, as a COCO file of that photo alone."""
        with self._lock:
            if self._read is None:
                content = load_json(self._path, "a COCO file")
                if file_state(self._path) != self._state:
                    raise SurveyError(f"{self._path} was written anew since the survey was opened: open it again")
                self._read = _by_photo(self._path, content)
            return self._read


def _by_photo(path: Path, content: Any) -> dict[str, dict[str, Any]]:
    entries = content.get("annotations") if isinstance(content, dict) else None
    whole = {**content, "annotations": []} if isinstance(entries, list) else content
    of_image: dict[int, list[Any]] = {image.id: [] for image in coco_of(path, whole).images}
    for k, entry in enumerate(entries or ()):
        image_id = entry.get("image_id") if isinstance(entry, dict) else None
        if image_id not in of_image:
            raise FormatError(f"{path}: annotations[{k}]: expected an image_id of one of the images, found {image_id}")
        of_image[image_id].append(entry)
    return {
        image["file_name"]: {**whole, "images": [image], "annotations": of_image[image["id"]]}
        for image in whole["images"]
    }
