"""Drawing into photos: one palette, in which a colour means the same in all pictures, and text, masks, spheres, boxes.

Pictures are uint8 (h, w, 3) RGB and are drawn into. Everything has a dark rim, so that it shows on any ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray, IntArray
from pomona.values.detections import Mask
from pomona.values.intrinsics import opencv_from_colmap_px

Rgb = tuple[int, int, int]

RIGHT: Rgb = (64, 220, 120)
"""Found, and a true fruit."""
FALSE: Rgb = (255, 72, 72)
"""Found where there is no true fruit."""
DOUBLE: Rgb = (80, 150, 255)
"""Found beside another found one of the same true fruit."""
MISSED: Rgb = (255, 214, 64)
"""A true fruit that was not found."""
DROPPED: Rgb = (214, 120, 255)
"""Found, and then dropped by the filter."""
UNUSED: Rgb = (170, 170, 170)
"""Neither right nor wrong: too weak to be used, or not scored."""
OWN: Rgb = (255, 255, 255)
"""What one fruit was made from: its detections."""
OTHER: Rgb = (120, 214, 255)
"""What belongs to others: detections of other fruits, fruits known from other photos."""
SEEN: Rgb = MISSED
"""A fruit that the photo saw, in pictures that know no truth: the colour that shows best among leaves."""
PAPER: Rgb = (24, 28, 26)
"""The ground of legends, what is outside a photo, and the rim of what is drawn."""
INK: Rgb = (232, 238, 234)
"""Text about the picture as a whole."""

KEY_PX = 30
"""The height of a strip that says what colours mean."""

_FONT = cv2.FONT_HERSHEY_SIMPLEX
# OpenCV draws at sixteenths of a pixel.
_SHIFT = 4
_CROSS_PX = 14
# A swatch of the key, the gap between it and its words, and that to the next.
_SWATCH_PX, _SWATCH_GAP_PX, _ENTRY_GAP_PX = 14, 8, 30


@dataclass(frozen=True)
class PictureFromPhoto:
    """How a photo becomes a picture: the top-left corner in the photo, and pixels of the picture per pixel of it."""

    left: float = 0.0
    top: float = 0.0
    scale: float = 1.0

    def at(self, xy_px: FloatArray) -> FloatArray:
        """Return pixels (n, 2) of the photo in the picture, in OpenCV's convention."""
        return opencv_from_colmap_px((np.asarray(xy_px, float) - [self.left, self.top]) * self.scale)


@dataclass(frozen=True)
class Square:
    """A square of a photo, perhaps partly outside: `left`, `top` and `side` in its pixels, shown as `size` × `size`."""

    left: int
    top: int
    side: int
    size: int

    @property
    def picture_from_photo(self) -> PictureFromPhoto:
        """How pixels of the photo become those of the square, shown at its size."""
        return PictureFromPhoto(self.left, self.top, self.size / self.side)


def cut(pixels: ByteArray, square: Square) -> ByteArray:
    """Return a square's pixels (side, side, 3), or at most `size` of them; what is outside the photo is dark."""
    result = np.full((square.side, square.side, 3), PAPER, np.uint8)
    rows = slice(max(square.top, 0), max(square.top + square.side, 0))
    columns = slice(max(square.left, 0), max(square.left + square.side, 0))
    part = pixels[rows, columns]
    left, top = columns.start - square.left, rows.start - square.top
    result[top : top + part.shape[0], left : left + part.shape[1]] = part
    if square.side > square.size:
        result = np.asarray(cv2.resize(result, (square.size, square.size), interpolation=cv2.INTER_AREA), np.uint8)
    return result


def write(picture: ByteArray, text: str, place: tuple[float, float], *, colour: Rgb = INK, size: float = 0.5) -> None:
    """Write `text` with its lower left corner at `place`, moved into the picture where it is partly outside.

    OpenCV's letters are ASCII alone: others become question marks.
    """
    text = text.encode("ascii", "replace").decode("ascii")
    (width, height), _ = cv2.getTextSize(text, _FONT, size, 1)
    x, y = round(place[0]), round(place[1])
    if not (-width < x < picture.shape[1] and 0 < y < picture.shape[0] + height):
        return
    x, y = max(min(x, picture.shape[1] - width - 2), 2), max(min(y, picture.shape[0] - 4), height + 2)
    for tone, thickness in ((PAPER, 3), (colour, 1)):
        cv2.putText(picture, text, (x, y), _FONT, size, tone, thickness, cv2.LINE_AA)


def draw_sphere(picture: ByteArray, outline: FloatArray, center: FloatArray, colour: Rgb, *, width: int) -> None:
    """Draw the outline (k, 2) of a fruit's sphere, in the picture's pixels; where it is NaN, a cross at the centre."""
    if np.isfinite(outline).all():
        corners = _fixed(outline)
        for tone, thickness in ((PAPER, _rim(width)), (colour, width)):
            cv2.polylines(picture, [corners], True, tone, thickness, cv2.LINE_AA, _SHIFT)
    else:
        place = round(float(center[0])), round(float(center[1]))
        cv2.drawMarker(picture, place, colour, cv2.MARKER_TILTED_CROSS, _CROSS_PX, 2, cv2.LINE_AA)


def label_sphere(
    picture: ByteArray, text: str, outline: FloatArray, center: FloatArray, *, colour: Rgb = INK, size: float = 0.5
) -> None:
    """Write `text` at the upper right of a sphere's outline (k, 2), or of the cross that stands for it."""
    half = np.nan_to_num(np.ptp(outline, axis=0) / 2, nan=_CROSS_PX / 2)
    x, y = center + 0.72 * half * [1, -1] + [2, -2]
    write(picture, text, (float(x), float(y)), colour=colour, size=size)


def draw_mask(
    picture: ByteArray, mask: Mask, picture_from_photo: PictureFromPhoto, colour: Rgb, *, width: int, tint: float = 0.0
) -> None:
    """Draw the edge of a mask, smooth where it is enlarged; `tint` is how much of the colour its pixels take on."""
    x0, y0, x1, y1 = mask.box_px
    corners = picture_from_photo.at(np.array([[x0, y0], [x1, y1]], float))
    # A pixel more on every side, or the edge of a mask that fills its box is not drawn whole.
    low = np.maximum(np.floor(corners[0]).astype(int) - 1, 0)
    high = np.minimum(np.ceil(corners[1]).astype(int) + 2, picture.shape[1::-1])
    if (low >= high).any():
        return
    first = picture_from_photo.at(np.array([[x0 + 0.5, y0 + 0.5]]))[0] - low
    moved = np.array([[picture_from_photo.scale, 0, first[0]], [0, picture_from_photo.scale, first[1]]])
    size = int(high[0] - low[0]), int(high[1] - low[1])
    inside = cv2.warpAffine(mask.pixels.astype(np.float32), moved, size, flags=cv2.INTER_LINEAR) > 0.5
    part = picture[low[1] : high[1], low[0] : high[0]]
    if tint:
        part[inside] = ((1 - tint) * part[inside] + tint * np.array(colour)).astype(np.uint8)
    edges, _ = cv2.findContours(inside.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    for tone, thickness in ((PAPER, _rim(width)), (colour, width)):
        cv2.drawContours(picture, edges, -1, tone, thickness, cv2.LINE_AA, offset=(int(low[0]), int(low[1])))


def draw_box(picture: ByteArray, box: FloatArray, colour: Rgb, *, width: int) -> None:
    """Draw the edges x0, y0, x1, y1 of a box, in the picture's pixels."""
    x0, y0, x1, y1 = (int(edge) for edge in np.round(box))
    for tone, thickness in ((PAPER, _rim(width)), (colour, width)):
        cv2.rectangle(picture, (x0, y0), (x1 - 1, y1 - 1), tone, thickness, cv2.LINE_AA)


def draw_dot(picture: ByteArray, place: FloatArray, colour: Rgb) -> None:
    """Draw a dot at a place (2,) in the picture's pixels."""
    x, y = (int(v) for v in _fixed(place))
    cv2.circle(picture, (x, y), 2 << _SHIFT, colour, -1, cv2.LINE_AA, _SHIFT)


def key(width: int, entries: Sequence[tuple[Rgb, str]], note: str = "") -> ByteArray:
    """Return a strip (`KEY_PX`, width or as wide as it needs, 3) that says what colours mean, and a note after them."""
    words = [text for _, text in entries] + [note] * bool(note)
    widths = [cv2.getTextSize(text, _FONT, 0.5, 1)[0][0] for text in words]
    needed = sum(widths) + len(widths) * (_SWATCH_PX + _SWATCH_GAP_PX + _ENTRY_GAP_PX)
    strip = np.full((KEY_PX, max(width, needed), 3), PAPER, np.uint8)
    left = 12
    for (colour, text), text_px in zip(entries, widths, strict=False):
        cv2.rectangle(strip, (left, 8), (left + _SWATCH_PX, 8 + _SWATCH_PX), colour, -1)
        left += _SWATCH_PX + _SWATCH_GAP_PX
        write(strip, text, (left, 20.0))
        left += text_px + _ENTRY_GAP_PX
    if note:
        write(strip, note, (left, 20.0))
    return strip


def jpeg(pixels: ByteArray, *, quality: int) -> bytes:
    """Return a picture as a JPEG."""
    done, encoded = cv2.imencode(".jpg", pixels[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return bytes(encoded.tobytes())


def _rim(width: int) -> int:
    """The width of a dark line below one of `width`: thin lines are not to be drowned in it."""
    return width + (2 if width > 1 else 1)


def _fixed(xy: FloatArray) -> IntArray:
    fixed: IntArray = np.round(np.asarray(xy) * 2**_SHIFT).astype(np.int32)
    return fixed
