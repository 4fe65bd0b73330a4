"""The photos of a survey: what is known of each before a pixel is read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from pomona.basics.arrays import OneLine
from pomona.basics.data_frames import data_frame
from pomona.errors import InputError

PHOTO_SUFFIXES = frozenset({".jpg", ".jpeg", ".jpe", ".png", ".tif", ".tiff", ".heic", ".heif", ".webp", ".bmp"})
"""Suffixes, in lower case, of the files that are taken for photos."""

# A focal length whose source says nothing of how exact it is: as good as EXIF is in most cameras.
_USUAL_FOCAL_SD = 0.015


ONE_SIDE = "row"
"""What their side is called where photos are all of one."""


@dataclass(frozen=True)
class Gnss:
    """Where the camera says it was: WGS 84 degrees and metres above the ellipsoid or sea (EXIF does not say which).

    `sd_m` is the standard deviation of the place, where that is known.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None = None
    sd_m: float | None = None


@dataclass(frozen=True)
class Photo:
    """One photo, upright: `width_px` × `height_px` are after EXIF orientation has been applied.

    `name` is unique in the survey, a POSIX path such as `east/IMG_0001.JPG`; every file of the survey folder refers to
    the photo by it. `focal_px` is None where neither EXIF nor a sensor table gives it; `focal_sd_px` is the standard
    deviation of what they give, which is nominal and rounded. Photos with the same `camera_key` were taken with the
    same camera, lens, zoom and size, and share intrinsics. `file_state` is the size in bytes and the time of change
    (ns) of the file that all this was read from; None where it was not.
    """

    name: str
    path: Path
    width_px: int
    height_px: int
    side: str = ""
    focal_px: float | None = None
    camera_key: str = ""
    orientation: int = 1
    taken_at: datetime | None = None
    gnss: Gnss | None = None
    focal_sd_px: float | None = None
    file_state: tuple[int, int] | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if self.width_px <= 0 or self.height_px <= 0:
            raise InputError(f"Photo {self.name}: expected a positive size, found {self.width_px} × {self.height_px}")
        if self.focal_px is not None and not self.focal_px > 0:
            raise InputError(f"Photo {self.name}: expected a positive focal length, found {self.focal_px}")
        if self.focal_sd_px is not None and not self.focal_sd_px > 0:
            raise InputError(f"Photo {self.name}: expected a positive standard deviation, found {self.focal_sd_px}")

    def longer_side_px(self, scale: float) -> int:
        """Return the longer side of a copy of the photo at a scale, at least one pixel."""
        return max(1, round(scale * max(self.width_px, self.height_px)))

    @property
    def lens_key(self) -> tuple[str, int, int]:
        """What photos that share intrinsics have in common."""
        return self.camera_key, self.width_px, self.height_px

    @property
    def focal(self) -> tuple[float, float] | None:
        """The focal length and its standard deviation, in pixels; None where it is not known."""
        if self.focal_px is None:
            return None
        return self.focal_px, self.focal_sd_px or _USUAL_FOCAL_SD * self.focal_px


@dataclass(frozen=True)
class Skipped:
    """A file that was found among the photos and could not be used, and why, in words for a person."""

    name: str
    reason: str


@dataclass(frozen=True, repr=False)
class Photos(OneLine):
    """The photos of one survey, in order of capture within each side; names are unique."""

    _one = "photo"

    items: tuple[Photo, ...]
    skipped: tuple[Skipped, ...] = ()
    from_video: bool = False

    def __post_init__(self) -> None:
        names = [photo.name for photo in self.items]
        if len(set(names)) != len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise InputError(f"Photos: names must be unique, found twice: {', '.join(twice[:5])}")

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Photo]:
        return iter(self.items)

    @property
    def names(self) -> tuple[str, ...]:
        """The photos' names, in order."""
        return tuple(photo.name for photo in self.items)

    @property
    def sides(self) -> tuple[str, ...]:
        """The sides, in order of first appearance."""
        return tuple(dict.fromkeys(photo.side for photo in self.items))

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame`, a row a photo: name, side, size, focal length (pixels), time, place."""
        gnss = [photo.gnss for photo in self.items]
        columns = ("name", "side", "width_px", "height_px", "focal_px", "camera_key", "taken_at")
        return data_frame(
            {name: [getattr(photo, name) for photo in self.items] for name in columns}
            | {
                name: [None if place is None else getattr(place, name) for place in gnss]
                for name in ("latitude_deg", "longitude_deg", "altitude_m")
            }
        )

    def of_side(self, side: str) -> Photos:
        """Return the photos of one side."""
        return Photos(tuple(p for p in self.items if p.side == side), from_video=self.from_video)

    def by_name(self) -> dict[str, Photo]:
        """Return the photos keyed by name."""
        return {photo.name: photo for photo in self.items}


def side_in_words(side: str, *, begins: bool = False) -> str:
    """Return a side as messages name it: `side east`, or `the row` where photos are all of one; `begins` a sentence."""
    if side in ("", ONE_SIDE):
        return "The row" if begins else "the row"
    return f"{'Side' if begins else 'side'} {side}"
