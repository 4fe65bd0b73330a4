"""A sheet of photos with the fruits projected into them, so that a person sees whether fruits lie on fruits."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pomona.arrays import BoolArray, ByteArray, FloatArray, IntArray
from pomona.cameras import Cameras
from pomona.capture import read_pixels
from pomona.errors import InputError, MissingFileError
from pomona.fruits import Fruits, Observations
from pomona.intrinsics import opencv_from_colmap_px
from pomona.photos import Photo, Photos
from pomona.progress import Progress, Silent, track
from pomona.report.choose import choose_photos
from pomona.sphere_outlines import centers_px, sphere_outlines_px

Rgb = tuple[int, int, int]

SEEN: Rgb = (255, 214, 64)
UNSEEN: Rgb = (120, 200, 255)
_DOT: Rgb = (255, 255, 255)
_PAPER: Rgb = (24, 28, 26)
_INK: Rgb = (232, 238, 234)
_GAP_PX = 12
_CAPTION_PX = 34
# Drawing at sixteenths of a pixel.
_SHIFT = 4


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
        for name in ("photos", "columns", "photo_side_px", "fruit_px", "jpeg_quality"):
            if getattr(self, name) < 1:
                raise InputError(f"ContactSheetOptions.{name}: expected at least 1, found {getattr(self, name)}")


@dataclass(frozen=True, eq=False)
class _Drawn:
    """The fruits in one photo, in its pixels: outlines (n, k, 2), centres (n, 2), ids (n,), and sightings (m, 2)."""

    outlines_px: FloatArray
    centers_px: FloatArray
    ids: IntArray
    seen: frozenset[int]
    sightings_px: FloatArray


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
    """Write a JPEG of a few photos with every fruit in front of the camera drawn as the outline of its sphere.

    Thick: the photo saw the fruit, as a detection whose centre is the dot. Thin: known from other photos alone. A
    photo that cannot be read any more is left out with a warning.
    """
    options, progress = options or ContactSheetOptions(), progress or Silent()
    by_name = photos.by_name()
    chosen = choose_photos(photos, cameras, observations, options.photos)
    cells = []
    for name in track(chosen, progress, "drawing fruits into photos"):
        drawn = _fruits_in(name, cameras, fruits, observations)
        try:
            cells.append(_cell(by_name[name], drawn, options))
        except (InputError, MissingFileError) as error:
            progress.warn(f"The contact sheet lacks a photo: {error}")
    sheet = _sheet(cells, options)
    done, encoded = cv2.imencode(
        ".jpg", np.ascontiguousarray(sheet[:, :, ::-1]), [cv2.IMWRITE_JPEG_QUALITY, options.jpeg_quality]
    )
    assert done
    path.write_bytes(encoded.tobytes())


def _fruits_in(photo: str, cameras: Cameras, fruits: Fruits, observations: Observations) -> _Drawn:
    idx = cameras.index_of(photo)
    assert idx is not None
    here = np.array([name == photo for name in observations.photo], bool)
    return _Drawn(
        sphere_outlines_px(cameras, idx, fruits.centers_in_world, fruits.diameters_m),
        centers_px(cameras, idx, fruits.centers_in_world),
        fruits.ids,
        frozenset(int(i) for i in observations.fruit_id[here]),
        observations.xy_px[here],
    )


def _cell(photo: Photo, drawn: _Drawn, options: ContactSheetOptions) -> ByteArray:
    """One photo, or the part of it that shows most, with fruits and a caption."""
    scale = _scale(photo, drawn, options)
    pixels = read_pixels(photo, max_side_px=max(1, round(scale * max(photo.width_px, photo.height_px))))
    scale = pixels.shape[1] / photo.width_px
    left, top = _window(pixels.shape[:2], drawn, scale, options.photo_side_px)
    side = options.photo_side_px
    picture = pixels[top : top + side, left : left + side].copy()  # what is read may be read-only
    _draw(picture, drawn, scale, np.array([left, top]))
    caption = np.full((_CAPTION_PX, picture.shape[1], 3), _PAPER, np.uint8)
    inside = np.isfinite(drawn.centers_px).all(axis=1) & _within(drawn.centers_px, photo)
    text = f"{photo.name}: {len(drawn.seen)} fruits seen, {int(inside.sum())} in view"
    _write(caption, text, (8.0, 22.0), 0.55)
    return np.concatenate([picture, caption])


def _within(xy_px: FloatArray, photo: Photo) -> BoolArray:
    with np.errstate(invalid="ignore"):
        inside: BoolArray = ((xy_px >= 0) & (xy_px <= [photo.width_px, photo.height_px])).all(axis=1)
    return inside


def _scale(photo: Photo, drawn: _Drawn, options: ContactSheetOptions) -> float:
    whole = min(1.0, options.photo_side_px / max(photo.width_px, photo.height_px))
    widths = np.ptp(drawn.outlines_px, axis=1).max(axis=1, initial=0)[_within(drawn.centers_px, photo)]
    widths = widths[np.isfinite(widths) & (widths > 0)]
    return max(whole, min(1.0, options.fruit_px / float(np.median(widths)))) if len(widths) else whole


def _window(shape: tuple[int, ...], drawn: _Drawn, scale: float, side: int) -> tuple[int, int]:
    """The left top of the part shown: around the middle of the fruits seen, inside the photo."""
    height, width = shape
    focus = np.median(drawn.sightings_px, axis=0) * scale if len(drawn.sightings_px) else np.array([width, height]) / 2
    left = int(np.clip(round(focus[0] - side / 2), 0, max(width - side, 0)))
    top = int(np.clip(round(focus[1] - side / 2), 0, max(height - side, 0)))
    return left, top


def _draw(picture: ByteArray, drawn: _Drawn, scale: float, corner_px: IntArray) -> None:
    """Draw into `picture`, whose top-left pixel is `corner_px` of the photo resized by `scale`."""

    def at(xy_px: FloatArray) -> IntArray:
        fixed: IntArray = np.round((opencv_from_colmap_px(xy_px * scale) - corner_px) * 2**_SHIFT).astype(np.int64)
        return fixed

    seen = np.array([int(i) in drawn.seen for i in drawn.ids], bool)
    for i in sorted(range(len(drawn.ids)), key=lambda i: bool(seen[i])):
        center, colour = drawn.centers_px[i], SEEN if seen[i] else UNSEEN
        if not np.isfinite(center).all():
            continue
        outline = drawn.outlines_px[i]
        if np.isfinite(outline).all():
            corners = at(outline).astype(np.int32)
            cv2.polylines(picture, [corners], True, colour, 2 if seen[i] else 1, cv2.LINE_AA, _SHIFT)
        else:
            place = tuple(int(v) for v in at(center[None])[0] >> _SHIFT)
            cv2.drawMarker(picture, place, colour, cv2.MARKER_TILTED_CROSS, 12, 1, cv2.LINE_AA)
    for xy in at(drawn.sightings_px):
        cv2.circle(picture, (int(xy[0]), int(xy[1])), 2 << _SHIFT, _DOT, -1, cv2.LINE_AA, _SHIFT)
    for i in np.flatnonzero(seen & np.isfinite(drawn.centers_px).all(axis=1)):
        half = np.nan_to_num(np.ptp(drawn.outlines_px[i], axis=0) / 2 * scale, nan=6.0)
        x, y = (drawn.centers_px[i] * scale - corner_px) + [0.75 * half[0] + 1, -0.75 * half[1] - 1]
        _write(picture, str(drawn.ids[i]), (float(x), float(y)), 0.38)


def _write(picture: ByteArray, text: str, place: tuple[float, float], size: float) -> None:
    """Light letters with a dark rim; OpenCV's letters are ASCII only."""
    text = text.encode("ascii", "replace").decode("ascii")
    at = (round(place[0]), round(place[1]))
    for colour, thickness in ((_PAPER, 3), (_INK, 1)):
        cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, thickness, cv2.LINE_AA)


def _sheet(cells: list[ByteArray], options: ContactSheetOptions) -> ByteArray:
    """Lay the cells out in rows, each as high as its highest cell, with the key to the colours below."""
    columns = max(1, min(options.columns, len(cells)))
    rows = [cells[i : i + columns] for i in range(0, len(cells), columns)]
    width = max([sum(c.shape[1] + _GAP_PX for c in row) + _GAP_PX for row in rows], default=900)
    height = sum(max(c.shape[0] for c in row) + _GAP_PX for row in rows) + _GAP_PX + _CAPTION_PX
    sheet = np.full((height, max(width, 900), 3), _PAPER, np.uint8)
    top = _GAP_PX
    for row in rows:
        left = _GAP_PX
        for cell in row:
            sheet[top : top + cell.shape[0], left : left + cell.shape[1]] = cell
            left += cell.shape[1] + _GAP_PX
        top += max(c.shape[0] for c in row) + _GAP_PX
    _key(sheet[top:], bool(cells))
    return sheet


def _key(strip: ByteArray, any_photo: bool) -> None:
    if not any_photo:
        _write(strip, "No photo has a place, so that no fruit can be drawn.", (_GAP_PX + 8.0, 20.0), 0.55)
        return
    for x, colour, thickness, text in (
        (24, SEEN, 2, "seen in this photo; the dot is the detection's centre"),
        (524, UNSEEN, 1, "known from other photos"),
    ):
        cv2.circle(strip, (x, 15), 8, colour, thickness, cv2.LINE_AA)
        _write(strip, text, (x + 16.0, 20.0), 0.5)
