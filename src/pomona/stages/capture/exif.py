"""What EXIF says about a photo, read without trusting it: any tag may be missing, zero or nonsense."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from pomona.stages.capture.sensors import sensor_width_mm, usual_width_mm
from pomona.values.photos import Gnss

_MAKE, _MODEL, _ORIENTATION, _DATE_TIME = 0x010F, 0x0110, 0x0112, 0x0132
_DATE_ORIGINAL, _SUBSEC_ORIGINAL = 0x9003, 0x9291
_FOCAL_MM, _FOCAL_35MM, _DIGITAL_ZOOM = 0x920A, 0xA405, 0xA404
_PIXEL_X, _PIXEL_Y, _PLANE_X, _PLANE_Y, _PLANE_UNIT = 0xA002, 0xA003, 0xA20E, 0xA20F, 0xA210
_LENS_MODEL, _SERIAL = 0xA434, 0xA431
# By the value of FocalPlaneResolutionUnit.
_MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
_WIDTH_35MM_MM = 36.0
_DIAGONAL_35MM_MM = math.hypot(_WIDTH_35MM_MM, 24.0)
# Of GPSAltitudeRef: below the sea, or the ellipsoid (1), and since Exif 3.0 below the sea by name (3).
_BELOW = (1, 3, b"\x01", b"\x03")
_HIGHEST_M = 20_000.0  # of a photo's place, above the sea or below: more is no altitude
# How far lenses are from their nominal focal length, and a sensor's imaged part from its nominal width: a share.
_NOMINAL = 0.01
# Sides of a photo in another proportion than EXIF has them, by more than rounding and a raw file's margin: cropped.
_SAME_SHAPE = 0.02
# The usual sensor of a family of compact cameras is among its smallest: as a share of it, none is smaller.
_LEAST_OF_USUAL = 0.85


@dataclass(frozen=True)
class Exif:
    """The tags that Pomona uses; None where a tag is missing or makes no sense. Pixel sizes are before rotation."""

    orientation: int = 1
    make: str = ""
    model: str = ""
    lens: str = ""
    serial: str = ""
    focal_mm: float | None = None
    focal_35mm: float | None = None
    digital_zoom: float | None = None
    plane_width_mm: float | None = None
    size_px: tuple[float, float] | None = None
    taken_at: datetime | None = None
    gnss: Gnss | None = None

    @property
    def camera(self) -> str:
        """The camera's name without a repeated maker, "" where EXIF does not say."""
        if self.make and self.model.lower().startswith(self.make.split()[0].lower()):
            return self.model
        return f"{self.make} {self.model}".strip()


def parse_exif(base: Mapping[int, Any], details: Mapping[int, Any], gps: Mapping[int, Any]) -> Exif:
    """Return the tags of the base, Exif and GPS directories as values that make sense."""
    orientation = base.get(_ORIENTATION)
    return Exif(
        orientation=orientation if isinstance(orientation, int) and 1 <= orientation <= 8 else 1,
        make=_text(base.get(_MAKE)),
        model=_text(base.get(_MODEL)),
        lens=_text(details.get(_LENS_MODEL)),
        serial=_text(details.get(_SERIAL)),
        focal_mm=_positive(details.get(_FOCAL_MM)),
        focal_35mm=_positive(details.get(_FOCAL_35MM)),
        digital_zoom=_positive(details.get(_DIGITAL_ZOOM)),
        plane_width_mm=_plane_width_mm(details),
        size_px=_size_px(details),
        taken_at=_time(details.get(_DATE_ORIGINAL) or base.get(_DATE_TIME), details.get(_SUBSEC_ORIGINAL)),
        gnss=_gnss(gps),
    )


def focal_px(exif: Exif, width_px: int, height_px: int) -> tuple[float, float] | None:
    """Return the focal length of a photo of this size and its standard deviation, in pixels, or None.

    A known sensor width gives the most exact value, then the sensor width that the camera itself writes (focal plane
    resolution), then the one that is usual in its family, then the 35 mm equivalent, which is rounded to whole
    millimetres. The equivalent overrules the others where they disagree by more than 10 %: it alone knows of digital
    zoom, crops and a phone's other lenses.
    Photos may have been resized, so millimetres are related to the longer side or, for the 35 mm equivalent, to the
    diagonal, by which CIPA's guideline DCG-001 defines it. None where EXIF does not lead to a focal length, as where
    photos were cropped: EXIF is of the whole.
    """
    if was_cropped(exif, width_px, height_px):
        return None
    equivalent = None
    if exif.focal_35mm is not None and _is_of_a_lens(exif.focal_35mm):
        focal = exif.focal_35mm / _DIAGONAL_35MM_MM * math.hypot(width_px, height_px)
        equivalent = focal, focal * _sd(exif.focal_35mm)
    if exif.focal_mm is not None:
        for sensor_mm in _sensor_widths_mm(exif):
            if sensor_mm is None or not _is_of_a_lens(exif.focal_mm / sensor_mm * _WIDTH_35MM_MM):
                continue
            focal = exif.focal_mm / sensor_mm * max(width_px, height_px)
            if equivalent is None and not _zoomed(exif):
                return focal, focal * _sd(exif.focal_mm)
            if equivalent is not None and abs(focal / equivalent[0] - 1) < 0.1:
                return focal, focal * _sd(exif.focal_mm)
    return equivalent


def _sensor_widths_mm(exif: Exif) -> tuple[float | None, ...]:
    """What is known of the sensor's width, the most trusted first.

    Known cameras are not asked: some write nonsense (Canon's EOS 6D Mark II 23.7 mm, for 36), and programs that make
    photos smaller change their size in EXIF, but not the resolution, so that sensors seem smaller, too.
    """
    written_mm, usual_mm = exif.plane_width_mm, usual_width_mm(exif.make, exif.model)
    if written_mm is not None and usual_mm is not None and written_mm < _LEAST_OF_USUAL * usual_mm:
        written_mm = None
    return sensor_width_mm(exif.make, exif.model), written_mm, usual_mm


def was_cropped(exif: Exif, width_px: int, height_px: int) -> bool:
    """Say whether a photo of this size is only a part of what the camera took, by the shape that EXIF has."""
    if exif.size_px is None:
        return False
    shapes = [max(sides) / min(sides) for sides in (exif.size_px, (width_px, height_px))]
    return abs(shapes[0] / shapes[1] - 1) > _SAME_SHAPE


def _sd(focal_mm: float) -> float:
    """The standard deviation of a focal length, as a share of it: lenses are not quite what they are called, and EXIF
    rounds to whole, tenths or hundredths of millimetres."""
    step_mm = next((step for step in (1.0, 0.1, 0.01) if abs(focal_mm / step - round(focal_mm / step)) < 1e-6), 0.0)
    return math.hypot(_NOMINAL, step_mm / math.sqrt(12) / focal_mm)


def _is_of_a_lens(focal_35mm: float) -> bool:
    """Whether there are lenses of this 35 mm equivalent: 65535, 1 and the like stand for one that is not known."""
    return 4.0 <= focal_35mm <= 4000.0


def _zoomed(exif: Exif) -> bool:
    return exif.digital_zoom is not None and exif.digital_zoom > 1.01


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        value = value.decode("latin-1")
    return " ".join(str(value).replace("\0", " ").split()) if value else ""


def _positive(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0 else None


def _plane_width_mm(details: Mapping[int, Any]) -> float | None:
    """The sensor's longer side from the focal plane resolution and the size in pixels that it was written for."""
    sides = []
    for pixels_tag, resolution_tag in ((_PIXEL_X, _PLANE_X), (_PIXEL_Y, _PLANE_Y)):
        pixels, resolution = _positive(details.get(pixels_tag)), _positive(details.get(resolution_tag))
        if pixels is None or resolution is None:
            return None
        sides.append(pixels / resolution * _MM_PER_UNIT.get(details.get(_PLANE_UNIT, 2), 25.4))
    longer = max(sides)
    # Anything else than 4 to 60 mm is a wrong unit or a size that was rewritten by an editor.
    return longer if 4.0 < longer < 60.0 else None


def _size_px(details: Mapping[int, Any]) -> tuple[float, float] | None:
    width, height = _positive(details.get(_PIXEL_X)), _positive(details.get(_PIXEL_Y))
    return None if width is None or height is None else (width, height)


def _time(value: Any, subsec: Any) -> datetime | None:
    try:
        time = datetime.strptime(_text(value)[:19].replace("-", ":"), "%Y:%m:%d %H:%M:%S")
    except ValueError:
        return None
    digits = _text(subsec)[:6]  # microseconds; more nines would be the next second, which there may be none of
    return time + timedelta(seconds=float(f"0.{digits}")) if digits.isdecimal() and digits.isascii() else time


def _gnss(gps: Mapping[int, Any]) -> Gnss | None:
    """The place where the photo was taken; None for missing, impossible and never-fixed (0, 0) positions."""
    latitude, longitude = _degrees(gps.get(2)), _degrees(gps.get(4))
    if latitude is None or longitude is None or (latitude == 0 and longitude == 0):
        return None
    latitude = -latitude if _text(gps.get(1)).upper().startswith("S") else latitude
    longitude = -longitude if _text(gps.get(3)).upper().startswith("W") else longitude
    if abs(latitude) > 90 or abs(longitude) > 180:
        return None
    try:
        altitude = float(gps[6])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return Gnss(latitude, longitude)
    below = gps.get(5) in _BELOW
    known = math.isfinite(altitude) and abs(altitude) <= _HIGHEST_M
    return Gnss(latitude, longitude, (-altitude if below else altitude) if known else None)


def _degrees(value: Any) -> float | None:
    try:
        parts = [float(part) for part in value]
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    if not parts or not all(math.isfinite(part) for part in parts):
        return None
    return sum(part / 60.0**power for power, part in enumerate(parts))
