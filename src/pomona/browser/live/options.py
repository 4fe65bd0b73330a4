"""Options of watching."""

from __future__ import annotations

from dataclasses import dataclass, field

from pomona.errors import InputError
from pomona.stages.capture.quality import QualityOptions


@dataclass(frozen=True, kw_only=True)
class WatchOptions:
    """When watching ends, and when something is said of a photo.

    `until`: so many photos are all (None: more may come). `idle_s`: so long without a photo is the end (None: never).
    `poll_s`: the folders are looked at so often; a file that did not change in between is whole.
    `first_photos`: fruits are looked for as soon as there are so many photos, which say how large they appear.
    `quality` says which photos are named as blurred, dark or bright.
    `overlap`: two photos that share fewer points than this hold together badly.
    `answer_s`: while more photos wait than can be kept up with, a count is made so often nevertheless.
    """

    until: int | None = None
    idle_s: float | None = None
    poll_s: float = 1.0
    first_photos: int = 4
    quality: QualityOptions = field(default_factory=QualityOptions)
    overlap: int = 40
    answer_s: float = 10.0

    def __post_init__(self) -> None:
        if self.until is not None and self.until < 3:
            raise InputError(f"`until`: expected at least 3 photos, found {self.until}")
        if self.idle_s is not None and not self.idle_s > 0:
            raise InputError(f"`idle`: expected more than 0 minutes, found {self.idle_s / 60:g}")
