"""Options of stage `report`."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError


@dataclass(frozen=True, kw_only=True)
class ContactSheetOptions:
    """How many photos, in how many columns, and how large.

    A photo is shown with its longer side at most `photo_side_px`; where the usual fruit would then be less than
    `fruit_px` wide, a part of the photo is shown larger, around the fruits seen in it.
    """

    photos: int = 6
    columns: int = 3
    photo_side_px: int = 1200
    fruit_px: int = 26
    jpeg_quality: int = 88

    def __post_init__(self) -> None:
        expect_kinds(self)
        for name in ("photos", "columns", "photo_side_px", "fruit_px", "jpeg_quality"):
            if getattr(self, name) < 1:
                raise InputError(f"ContactSheetOptions.{name}: expected at least 1, found {getattr(self, name)}")


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """What `report.html` carries, which makes its size, and the contact sheet.

    `max_points`: points of the scene and the fruits, 3.2 MB as text by default; `max_sightings`: observations, 9.6 MB.
    `crops_per_fruit` crops of photos of each fruit are in it, from at most `crop_photos` photos, of at most `crops_mb`
    together: of many fruits there are fewer of each.
    """

    max_points: int = 300_000
    max_sightings: int = 300_000
    crops_per_fruit: int = 3
    crop_photos: int = 120
    crops_mb: float = 15.0
    contact_sheet: ContactSheetOptions = ContactSheetOptions()

    def __post_init__(self) -> None:
        expect_kinds(self)
        for name, least in (("max_points", 1), ("max_sightings", 1), ("crops_per_fruit", 1), ("crop_photos", 0)):
            if getattr(self, name) < least:
                raise InputError(f"ReportOptions.{name}: expected at least {least}, found {getattr(self, name)}")
        if not self.crops_mb >= 0:
            raise InputError(f"ReportOptions.crops_mb: expected 0 or more, found {self.crops_mb}")
