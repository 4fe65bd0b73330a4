"""What can be chosen about scoring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from pomona.errors import InputError

Match = Literal["auto", "centers", "boxes", "inside"]
Overlap = Literal["detection", "iou"]


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions:
    """Options of `evaluate`.

    `match`: "centers" pairs a found with a true fruit when their centres are at most `max_distance_diameters` true
    diameters apart; "boxes" when more than `min_overlap` of the found box ("detection"), or of both boxes' union
    ("iou"), is shared; "inside" when the found centre lies in the true box; "auto" takes boxes where the truth has
    them. A true fruit is visible when `visible_photos`
    photos show at least `visible_px` pixels of it.
    """

    match: Match = "auto"
    max_distance_diameters: float = 0.5
    overlap: Overlap = "detection"
    min_overlap: float = 0.5
    visible_px: int = 120
    visible_photos: int = 2

    def __post_init__(self) -> None:
        for name, known in (("match", get_args(Match)), ("overlap", get_args(Overlap))):
            if getattr(self, name) not in known:
                raise InputError(f"{name}: expected one of {', '.join(known)}, found {getattr(self, name)!r}")
        if not self.max_distance_diameters > 0:
            raise InputError(f"max_distance_diameters: expected a positive number, found {self.max_distance_diameters}")
        if not 0.5 <= self.min_overlap < 1:
            raise InputError(f"min_overlap: expected 0.5 to below 1, found {self.min_overlap}")
        if self.visible_px < 1 or self.visible_photos < 1:
            raise InputError("visible_px and visible_photos: expected at least 1")
