"""What is said of a photo while the photographer still stands there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pomona.live.options import WatchOptions
from pomona.photos import Photo

Matter = Literal["unreadable", "dark", "bright", "blurred", "gap"]


@dataclass(frozen=True)
class Hint:
    """A photo, what is the matter with it, and what to do, in words."""

    photo: str
    matter: Matter
    text: str


class Checks:
    """The photos of one side so far."""

    def __init__(self, options: WatchOptions) -> None:
        self._options = options
        self._sharpness: dict[str, float] = {}
        self._blurred: set[str] = set()

    def exposure(self, photo: Photo) -> list[Hint]:
        """Return what is to be said of the light; raises as `capture.read_pixels` does."""
        from pomona.capture import read_pixels
        from pomona.capture.quality import QualityOptions, clipped_shares

        dark, bright = clipped_shares(read_pixels(photo, max_side_px=QualityOptions.side_px))
        hints = []
        if dark > self._options.clipped:
            text = f"is dark: {dark:.0%} of it is black. Expose longer or wait for light; then take it again"
            hints.append(Hint(photo.name, "dark", text))
        if bright > self._options.clipped:
            text = f"is too bright: {bright:.0%} of it is white. Expose shorter or keep the sky out; then take it again"
            hints.append(Hint(photo.name, "bright", text))
        return hints

    def sharpness(self, photo: str, sharpness: float) -> list[Hint]:
        """Return which photos are blurred beside those around them, each once: the last, or one a little before."""
        self._sharpness[photo] = sharpness
        names = list(self._sharpness)[-2 * self._options.around - 1 :]
        if len(names) < 3:
            return []
        usual = float(np.median([self._sharpness[name] for name in names]))
        blurred = [
            name
            for name in names
            if self._sharpness[name] < self._options.blurred * usual and name not in self._blurred
        ]
        self._blurred |= set(blurred)
        return [
            Hint(
                name,
                "blurred",
                f"is blurred: it has {self._sharpness[name] / usual:.0%} of the usual sharpness. Hold still, walk more "
                "slowly or expose shorter; then take this place again",
            )
            for name in blurred
        ]

    def overlap(self, photo: str, shared: Mapping[str, int]) -> list[Hint]:
        """Return what is to be said where a photo shares few points with each of those before it: `shared`."""
        best = max(shared.values(), default=0)
        if len(self._sharpness) < 2 or best >= self._options.overlap:
            return []
        with_whom = f"only {best} points with {max(shared, key=lambda name: shared[name])}" if best else "nothing"
        text = (
            f"shares {with_whom} of the photos before it. Go back to where the last good one was taken, and go on from "
            "there in shorter steps: two thirds of each photo should be in the next"
        )
        return [Hint(photo, "gap", text)]
