"""A part of a photo, enlarged, with true and found fruits and detections drawn into it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import cv2
import numpy as np

from pomona.arrays import ByteArray, FloatArray
from pomona.detections import Mask
from pomona.intrinsics import opencv_from_colmap_px

Rgb = tuple[int, int, int]

TRUE: Rgb = (255, 214, 64)
RIGHT: Rgb = (64, 220, 120)
FALSE: Rgb = (255, 72, 72)
DOUBLE: Rgb = (80, 150, 255)
DROPPED: Rgb = (214, 120, 255)
OWN: Rgb = (255, 255, 255)
OTHER: Rgb = (120, 216, 232)
WEAK: Rgb = (150, 150, 150)
_DARK: Rgb = (16, 20, 18)
_PAPER: Rgb = (24, 28, 26)
# Drawing at sixteenths of a pixel.
_SHIFT = 4
# A crop is dark where nine tenths of it are darker than this; its gamma is then at least the other.
_DARK_LEVEL, _LEAST_GAMMA = 0.3, 0.45


@dataclass(frozen=True)
class Window:
    """A square of a photo: `left`, `top` and `side` in its pixels, drawn as `size` × `size` pixels."""

    left: int
    top: int
    side: int
    size: int

    @property
    def scale(self) -> float:
        """Pixels of the crop per pixel of the photo."""
        return self.size / self.side

    def at(self, xy_px: FloatArray) -> FloatArray:
        """Return pixels (n, 2) of the photo in the crop, in OpenCV's convention."""
        return opencv_from_colmap_px((np.asarray(xy_px, float) - [self.left, self.top]) * self.scale)


@dataclass(frozen=True, eq=False)
class Outline:
    """A mask whose edge is drawn."""

    mask: Mask
    colour: Rgb
    thick: bool


class Drawable(Protocol):
    """A circle: `outline_px` (k, 2) and `center_px` (2,) in the photo. Thin ones are drawn where they are `seen`."""

    @property
    def outline_px(self) -> FloatArray:
        """Its outline; NaN where it has none."""

    @property
    def center_px(self) -> FloatArray:
        """Its centre; NaN where it is out of sight."""

    @property
    def colour(self) -> Rgb:
        """Its colour."""

    @property
    def seen(self) -> bool:
        """Whether the photo sees it."""

    @property
    def thick(self) -> bool:
        """Whether the crop is about it."""

    @property
    def label(self) -> str:
        """What is written beside it."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """What is drawn into a crop, in this order: outlines of masks, thin circles, thick circles."""

    outlines: Sequence[Outline] = field(default_factory=tuple)
    circles: Sequence[Drawable] = field(default_factory=tuple)


def legend() -> Mapping[str, tuple[Rgb, str]]:
    """Return what the colours mean: a name, the colour, and words."""
    return {
        "true": (TRUE, "true fruit (thin: what shows of it; others not found)"),
        "right": (RIGHT, "found, right"),
        "false": (FALSE, "found, false"),
        "double": (DOUBLE, "found, double"),
        "dropped": (DROPPED, "found, dropped by the filter"),
        "own": (OWN, "detection of this fruit"),
        "other": (OTHER, "other detection"),
        "weak": (WEAK, "detection too weak to be used"),
    }


def window_around(
    points_px: FloatArray, around: float, least_px: int, photo_size: tuple[int, int], size: int
) -> Window:
    """Return the square `around` times as large as the box of `points_px` (n, 2), moved into the photo (w, h)."""
    low, high = np.nanmin(points_px, axis=0), np.nanmax(points_px, axis=0)
    side = min(max(least_px, round(around * float((high - low).max()))), max(photo_size))
    left, top = (
        int(np.clip(round(float(middle) - side / 2), min(0, length - side), max(0, length - side)))
        for middle, length in zip((low + high) / 2, photo_size, strict=True)
    )
    return Window(left, top, side, size)


def cut(pixels: ByteArray, window: Window) -> ByteArray:
    """Return the window's pixels (side, side, 3), or at most `size` of them; what is outside the photo is dark."""
    square = np.full((window.side, window.side, 3), _PAPER, np.uint8)
    rows = slice(max(window.top, 0), min(window.top + window.side, pixels.shape[0]))
    columns = slice(max(window.left, 0), min(window.left + window.side, pixels.shape[1]))
    left, top = columns.start - window.left, rows.start - window.top
    part = pixels[rows, columns]
    square[top : top + part.shape[0], left : left + part.shape[1]] = part
    if window.side > window.size:
        square = np.asarray(cv2.resize(square, (window.size, window.size), interpolation=cv2.INTER_AREA), np.uint8)
    return square


def brightened(crop: ByteArray) -> tuple[ByteArray, bool]:
    """Return a crop in deep shade brighter, so that a person sees what is in it, and whether it was."""
    level = float(np.percentile(crop.max(axis=2), 90)) / 255
    if not 0 < level < _DARK_LEVEL:
        return crop, False
    gamma = max(_LEAST_GAMMA, np.log(0.5) / np.log(level))
    curve = np.round(255 * (np.arange(256) / 255) ** gamma).astype(np.uint8)
    return curve[crop], True


def enlarged(crop: ByteArray, window: Window) -> ByteArray:
    """Return a crop that `cut` gave at the size at which it is drawn into."""
    return np.asarray(cv2.resize(crop, (window.size, window.size), interpolation=cv2.INTER_CUBIC), np.uint8)


def draw(crop: ByteArray, window: Window, drawing: Drawing) -> ByteArray:
    """Return a copy of a crop (size, size, 3) with `drawing` in it."""
    picture = crop.copy()
    for outline in drawing.outlines:
        _outline(picture, outline, window)
    for circle in sorted(drawing.circles, key=lambda circle: circle.thick):
        if (circle.thick or circle.seen) and np.isfinite(circle.center_px).all():
            _circle(picture, circle, window)
    return picture


def _outline(picture: ByteArray, outline: Outline, window: Window) -> None:
    """Draw the edge of a mask: between its pixels, smooth where they are enlarged."""
    x0, y0, x1, y1 = outline.mask.box_px
    left, right = max(x0, window.left), min(x1, window.left + window.side)
    top, bottom = max(y0, window.top), min(y1, window.top + window.side)
    if left >= right or top >= bottom:
        return
    inside = np.zeros((window.side, window.side), np.float32)
    rows, columns = slice(top - window.top, bottom - window.top), slice(left - window.left, right - window.left)
    inside[rows, columns] = outline.mask.pixels[top - y0 : bottom - y0, left - x0 : right - x0]
    large = cv2.resize(inside, (window.size, window.size), interpolation=cv2.INTER_LINEAR) > 0.5
    edges, _ = cv2.findContours(large.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    width = 2 if outline.thick else 1
    for tone, extra in ((_DARK, 2 if outline.thick else 1), (outline.colour, 0)):
        cv2.drawContours(picture, edges, -1, tone, width + extra, cv2.LINE_AA)


def _circle(picture: ByteArray, circle: Drawable, window: Window) -> None:
    center = window.at(circle.center_px[None])[0]
    half = np.array([8.0, 8.0])
    if np.isfinite(circle.outline_px).all():
        corners = np.round(window.at(circle.outline_px) * 2**_SHIFT).astype(np.int32)
        half = np.ptp(corners, axis=0) / 2 ** (_SHIFT + 1)
        for tone, width in ((_DARK, 5 if circle.thick else 2), (circle.colour, 3 if circle.thick else 1)):
            cv2.polylines(picture, [corners], True, tone, width, cv2.LINE_AA, _SHIFT)
    else:
        place = round(float(center[0])), round(float(center[1]))
        cv2.drawMarker(picture, place, circle.colour, cv2.MARKER_TILTED_CROSS, 14, 2, cv2.LINE_AA)
    if circle.label:
        _write(picture, circle.label, center + 0.72 * half * [1, -1] + np.array([3, -3]), circle.colour)


def _write(picture: ByteArray, text: str, place: FloatArray, colour: Rgb) -> None:
    """Write a label, moved into the picture where it is only partly outside."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    x, y = (round(float(v)) for v in place)
    if not (-width < x < picture.shape[1] and 0 < y < picture.shape[0] + height):
        return
    x, y = min(max(x, 2), picture.shape[1] - width - 2), min(max(y, height + 2), picture.shape[0] - 4)
    for tone, thickness in ((_DARK, 4), (colour, 1)):
        cv2.putText(picture, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.5, tone, thickness, cv2.LINE_AA)
