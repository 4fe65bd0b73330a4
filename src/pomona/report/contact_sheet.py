"""A sheet of photos with the fruits projected into them, so that a person sees whether fruits lie on fruits."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pomona.cameras import Cameras
from pomona.errors import InputError
from pomona.fruits import Fruits, Observations
from pomona.photos import Photos
from pomona.progress import Progress, Silent


@dataclass(frozen=True, kw_only=True)
class ContactSheetOptions:
    """How many photos, in how many columns, and how wide each is on the sheet."""

    photos: int = 6
    columns: int = 2
    photo_width_px: int = 1200
    jpeg_quality: int = 88

    def __post_init__(self) -> None:
        for name in ("photos", "columns", "photo_width_px"):
            if getattr(self, name) < 1:
                raise InputError(f"ContactSheetOptions.{name}: expected at least 1, found {getattr(self, name)}")


def write_contact_sheet(
    photos: Photos,
    cameras: Cameras,
    fruits: Fruits,
    observations: Observations,
    path: Path,
    *,
    options: ContactSheetOptions | None = None,
    progress: Progress | None = None,
) -> None:
    """Write a JPEG of a few photos with every fruit in front of the camera drawn as the circle that it projects to."""
    options, progress = options or ContactSheetOptions(), progress or Silent()
    raise NotImplementedError("contact sheet")
