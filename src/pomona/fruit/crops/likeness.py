"""A photo's pixels with a fourth channel: how much their colours are like those of this survey's fruits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import ByteArray, IntArray, among, set_checked
from pomona.fruit.traits.colours import ColourCounts, FruitColours
from pomona.values.detections import SurveyDetections
from pomona.values.label_image import paint_labels

# What is known of the survey's colours counts as so many pixels beside those of the photo itself, whose light may
# differ.
_SURVEY_PIXELS = 1000.0
_MOST_NATS = 4.0


@dataclass(frozen=True, eq=False)
class SeenFruits:
    """The detections of a survey, and the ids (n,) of those that are of fruits, which it sorts."""

    detections: SurveyDetections
    fruit_detection_ids: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "fruit_detection_ids", np.unique(self.fruit_detection_ids))
        set_checked(self, "fruit_detection_ids", (None,), np.int64)

    def colours_in(self, photo: str, pixels: ByteArray) -> ColourCounts:
        """Count the colours of a photo, of which `pixels` (h, w, 3) is a copy of any scale."""
        found = self.detections.get(photo)
        if found is None:
            nothing = np.zeros(pixels.shape[:2], bool)
            return ColourCounts.of(pixels, nothing, ~nothing)
        label = paint_labels(found, pixels.shape[1], pixels.shape[0])
        of_fruit = np.concatenate([[False], among(found.ids, self.fruit_detection_ids)])
        return ColourCounts.of(pixels, of_fruit[label], label == 0)


def with_likeness(pixels: ByteArray, of_photo: ColourCounts, of_survey: ColourCounts) -> ByteArray:
    """Return a photo (h, w, 3) with a fourth channel, 128 where colours are as likely on fruit as elsewhere."""
    counts = of_photo + of_survey.worth(_SURVEY_PIXELS)
    nats = FruitColours.of_counts(counts.smoothed()).of(pixels)
    channel = 128 + 127 / _MOST_NATS * np.clip(nats, -_MOST_NATS, _MOST_NATS)
    return np.dstack([pixels, channel.astype(np.uint8)])
