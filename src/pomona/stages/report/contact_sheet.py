"""A sheet of photos with the fruits projected into them, so that a person sees whether fruits lie on fruits."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import BoolArray, ByteArray, FloatArray, IntArray, counted
from pomona.errors import InputError, MissingFileError
from pomona.fruit.geometry.sphere_outlines import centers_px, sphere_outlines_px
from pomona.progress import Progress, Silent, track
from pomona.stages.capture import read_pixels
from pomona.stages.report.choose import choose_photos
from pomona.stages.report.options import ContactSheetOptions
from pomona.values.cameras import Cameras
from pomona.values.drawing import (
    OTHER,
    OWN,
    PAPER,
    SEEN,
    PictureFromPhoto,
    draw_dot,
    draw_sphere,
    jpeg,
    key,
    label_sphere,
    write,
)
from pomona.values.fruits import Fruits, Observations
from pomona.values.photos import Photo, Photos

_GAP_PX = 12
_CAPTION_PX = 34  # one line of text
_LEAST_WIDTH_PX = 900  # the key to the colours fits in


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
    cross: its size is not known. A photo that cannot be read any more is left out with a warning.
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
    path.write_bytes(jpeg(sheet, quality=options.jpeg_quality))


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
    pixels = read_pixels(photo, max_side_px=photo.longer_side_px(scale))
    scale = pixels.shape[1] / photo.width_px
    left, top = _window(pixels.shape[:2], drawn, scale, options.photo_side_px)
    side = options.photo_side_px
    picture = pixels[top : top + side, left : left + side].copy()  # what is read may be read-only
    _draw(picture, drawn, PictureFromPhoto(left / scale, top / scale, scale))
    caption = np.full((_CAPTION_PX, picture.shape[1], 3), PAPER, np.uint8)
    inside = np.isfinite(drawn.centers_px).all(axis=1) & _within(drawn.centers_px, photo)
    text = f"{photo.name}: {counted(len(drawn.seen), 'fruit')} seen, {int(inside.sum())} in view"
    write(caption, text, (8.0, 22.0), size=0.55)
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


def _draw(picture: ByteArray, drawn: _Drawn, picture_from_photo: PictureFromPhoto) -> None:
    """Draw into `picture`: fruits known from other photos, those seen here, dots where they were seen, and ids."""
    seen = np.array([int(i) in drawn.seen for i in drawn.ids], bool)
    visible = np.isfinite(drawn.centers_px).all(axis=1)
    for i in (*np.flatnonzero(visible & ~seen), *np.flatnonzero(visible & seen)):
        outline, center = picture_from_photo.at(drawn.outlines_px[i]), picture_from_photo.at(drawn.centers_px[i])
        draw_sphere(picture, outline, center, SEEN if seen[i] else OTHER, width=2 if seen[i] else 1)
    for place in picture_from_photo.at(drawn.sightings_px):
        draw_dot(picture, place, OWN)
    for i in np.flatnonzero(seen & visible):
        outline, center = picture_from_photo.at(drawn.outlines_px[i]), picture_from_photo.at(drawn.centers_px[i])
        label_sphere(picture, str(drawn.ids[i]), outline, center, size=0.38)


def _sheet(cells: list[ByteArray], options: ContactSheetOptions) -> ByteArray:
    """Lay the cells out in rows, each as high as its highest cell, with the key to the colours below."""
    columns = max(1, min(options.columns, len(cells)))
    rows = [cells[i : i + columns] for i in range(0, len(cells), columns)]
    width = max([sum(c.shape[1] + _GAP_PX for c in row) + _GAP_PX for row in rows], default=0)
    height = sum(max(c.shape[0] for c in row) + _GAP_PX for row in rows) + _GAP_PX
    strip = _key(max(width, _LEAST_WIDTH_PX), bool(cells))
    sheet = np.full((height + len(strip), strip.shape[1], 3), PAPER, np.uint8)
    top = _GAP_PX
    for row in rows:
        left = _GAP_PX
        for cell in row:
            sheet[top : top + cell.shape[0], left : left + cell.shape[1]] = cell
            left += cell.shape[1] + _GAP_PX
        top += max(c.shape[0] for c in row) + _GAP_PX
    sheet[height:] = strip
    return sheet


def _key(width: int, any_photo: bool) -> ByteArray:
    if not any_photo:
        return key(width, (), "No photo has a place, so that no fruit can be drawn.")
    seen, other = "thick: seen in this photo; the dot is the detection's centre", "thin: known from other photos"
    return key(width, ((SEEN, seen), (OTHER, other)), "cross: its size is not known")
