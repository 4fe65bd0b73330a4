"""Corrected masks as training data: COCO, with what a person did to each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pomona.corrections.corrected import Corrected, Found
from pomona.detections import Detections, SurveyDetections
from pomona.formats.detections.coco import write_coco
from pomona.photos import Photo, Photos


def write_training(path: Path, found: Found, corrected: Corrected) -> None:
    """Write the masks of all fruits in the photos that have a place.

    What a person deleted is not in the file, so that it is background. What became no fruit and nobody looked at may be
    one or not: it is a crowd, which training leaves out of its account. Each annotation has `attributes`: `fruit_id`
    (null for a crowd), `correction` ("none", "added", "split", "merged" or "moved") and `mask` ("detected", or
    "drawn", "divided" or "joined": not as a segmenter saw it).
    """
    wanted = {name: _of_photo(found, corrected, name) for name in found.cameras.photos if name in corrected.detections}
    photos = Photos(tuple(Photo(name, Path(name), d.width_px, d.height_px) for name, d in wanted.items()))
    write_coco(path, photos, SurveyDetections(wanted))
    content = json.loads(path.read_text(encoding="utf-8"))
    seen = corrected.observations
    fruit_of = dict(zip(seen.detection_id.tolist(), seen.fruit_id.tolist(), strict=True))
    for annotation in content["annotations"]:
        fruit = fruit_of.get(annotation["id"])
        made = corrected.made.get(annotation["id"])
        annotation["iscrowd"] = int(fruit is None)
        annotation["attributes"] = {
            "fruit_id": fruit,
            "correction": "none" if fruit is None else corrected.how.get(fruit, "none"),
            "mask": made.how if made else "detected",
        }
    path.write_text(_text(content), encoding="utf-8")


def _of_photo(found: Found, corrected: Corrected, photo: str) -> Detections:
    detections = corrected.detections[photo]
    false = np.isin(detections.ids, list(corrected.false_ids))
    of_fruit = np.isin(detections.ids, corrected.observations.detection_id)
    return detections[(of_fruit | (detections.scores >= found.least_score)) & ~false]


def _text(content: dict[str, Any]) -> str:
    """The content with an entry of a list a line."""
    parts = []
    for key, value in content.items():
        lines = [json.dumps(entry, separators=(",", ":")) for entry in value] if isinstance(value, list) else []
        parts.append(f'"{key}": ' + ("[\n" + ",\n".join(lines) + "\n]" if lines else json.dumps(value)))
    return "{\n" + ",\n".join(parts) + "\n}\n"
