"""The masks of a survey's fruits as training data: COCO, with each one's fruit and what a person did to it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pomona.corrections.corrected import Corrected, Found, How, MadeMask
from pomona.formats.detections.coco import write_coco
from pomona.values.detections import Detections, SurveyDetections
from pomona.values.fruits import Observations
from pomona.values.photos import Photo, Photos


@dataclass(frozen=True, eq=False, kw_only=True)
class LabelledMasks:
    """The masks of the `photos` that have a place, and which fruits they are of by `observations`.

    Those below `least_score` can become no fruit. `made`, `how` and `false_ids` are as in `Corrected`; nothing of a
    survey that nobody corrected.
    """

    photos: tuple[str, ...]
    detections: SurveyDetections
    observations: Observations
    least_score: float
    made: Mapping[int, MadeMask] = field(default_factory=dict)
    how: Mapping[int, How] = field(default_factory=dict)
    false_ids: frozenset[int] = frozenset()

    @classmethod
    def of(cls, found: Found, corrected: Corrected) -> LabelledMasks:
        """Return the masks of fruits as a person corrected them."""
        return cls(
            photos=found.cameras.photos,
            detections=corrected.detections,
            observations=corrected.observations,
            least_score=found.least_score,
            made=corrected.made,
            how=corrected.how,
            false_ids=corrected.false_ids,
        )


def write_training(path: Path, masks: LabelledMasks) -> None:
    """Write the masks of all fruits in the photos that have a place.

    What a person deleted is not in the file, so that it is background, and neither is what no segmenter was sure enough
    of to become a fruit. What became no fruit and nobody looked at may be one or not: it is a crowd, which training
    leaves out of its account. Each annotation has `attributes`: `fruit_id` (null for a crowd), `correction` ("none",
    "added", "split", "merged" or "moved") and `mask` ("detected", or "drawn", "divided" or "joined": not as a segmenter
    saw it).
    """
    wanted = {name: _of_photo(masks, name) for name in masks.photos if name in masks.detections}
    photos = Photos(tuple(Photo(name, Path(name), d.width_px, d.height_px) for name, d in wanted.items()))
    write_coco(path, photos, SurveyDetections(wanted))
    content = json.loads(path.read_text(encoding="utf-8"))
    seen = masks.observations
    fruit_of = dict(zip(seen.detection_id.tolist(), seen.fruit_id.tolist(), strict=True))
    for annotation in content["annotations"]:
        fruit = fruit_of.get(annotation["id"])
        made = masks.made.get(annotation["id"])
        annotation["iscrowd"] = int(fruit is None)
        annotation["attributes"] = {
            "fruit_id": fruit,
            "correction": "none" if fruit is None else masks.how.get(fruit, "none"),
            "mask": made.how if made else "detected",
        }
    path.write_text(_text(content), encoding="utf-8")


def _of_photo(masks: LabelledMasks, photo: str) -> Detections:
    detections = masks.detections[photo]
    false = np.isin(detections.ids, list(masks.false_ids))
    of_fruit = np.isin(detections.ids, masks.observations.detection_id)
    return detections[(of_fruit | (detections.scores >= masks.least_score)) & ~false]


def _text(content: dict[str, Any]) -> str:
    """The content with an entry of a list a line."""
    parts = []
    for key, value in content.items():
        lines = [json.dumps(entry, separators=(",", ":")) for entry in value] if isinstance(value, list) else []
        parts.append(f'"{key}": ' + ("[\n" + ",\n".join(lines) + "\n]" if lines else json.dumps(value)))
    return "{\n" + ",\n".join(parts) + "\n}\n"
