"""What is said of a photo while the photographer still stands there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from pomona.browser.live.options import WatchOptions
from pomona.stages.capture.quality import PhotoQuality, shares_of_usual

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

    def exposure(self, seen: PhotoQuality) -> list[Hint]:
        """Return what is to be said of the light."""
        hints = []
        if seen.dark > self._options.quality.clipped:
            text = f"is dark: {seen.dark:.0%} of it is black. Expose longer or wait for light; then take it again"
            hints.append(Hint(seen.photo, "dark", text))
        if seen.bright > self._options.quality.clipped:
            share = f"{seen.bright:.0%}"
            text = f"is too bright: {share} of it is white. Expose shorter or keep the sky out; then take it again"
            hints.append(Hint(seen.photo, "bright", text))
        return hints

    def sharpness(self, photo: str, sharpness: float) -> list[Hint]:
        """Return which photos are blurred beside those around them, each once: the last, or one a little before."""
        self._sharpness[photo] = sharpness
        quality = self._options.quality
        shares = shares_of_usual(list(self._sharpness.values()), quality.around)
        blurred = {
            name: share
            for name, share in zip(self._sharpness, shares.tolist(), strict=True)
            if share < quality.blurred and name not in self._blurred
        }
        self._blurred |= set(blurred)
        return [
            Hint(
                name,
                "blurred",
                f"is blurred: it has {100 * share:.0f} % of the usual sharpness. Hold still, walk more "
                "slowly or expose shorter; then take this place again",
            )
            for name, share in blurred.items()
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
