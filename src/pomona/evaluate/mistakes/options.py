"""What can be chosen about the page of mistakes."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.errors import InputError


@dataclass(frozen=True, kw_only=True)
class MistakeOptions:
    """Options of `write_mistakes`.

    The `worst` fruits of each kind are shown (None: all): of missed and merged ones those that photos show best, of
    false and double ones those with the highest score. Each has up to `crops` crops of `crop_px` pixels a side, whose
    window is `around` times as wide as what it is about, and at least `least_window_px` of the photo.
    """

    worst: int | None = None
    crops: int = 6
    crop_px: int = 360
    around: float = 2.6
    least_window_px: int = 48
    jpeg_quality: int = 80

    def __post_init__(self) -> None:
        if self.worst is not None and self.worst < 1:
            raise InputError(f"worst: expected at least 1 fruit of each kind, found {self.worst}")
        for name, least in (("crops", 1), ("crop_px", 64), ("least_window_px", 8), ("around", 1)):
            if getattr(self, name) < least:
                raise InputError(f"MistakeOptions.{name}: expected at least {least}, found {getattr(self, name)}")
        if not 1 <= self.jpeg_quality <= 100:
            raise InputError(f"MistakeOptions.jpeg_quality: expected 1 to 100, found {self.jpeg_quality}")
