"""Photos with what was found, what is false and what was missed, like Figure 7 of Gené-Mola et al. 2020."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pomona.basics.arrays import BoolArray, ByteArray
from pomona.errors import InputError, MissingFileError, few
from pomona.evaluate.detections.matching import PhotoMatch
from pomona.evaluate.detections.scores import DetectionScores, kinds
from pomona.evaluate.detections.truth import DetectionTruth, PhotoTruth
from pomona.progress import Progress, Silent, track
from pomona.stages.capture import read_pixels
from pomona.values.detections import Detections
from pomona.values.drawing import (
    DOUBLE,
    FALSE,
    MISSED,
    PAPER,
    RIGHT,
    UNUSED,
    PictureFromPhoto,
    draw_box,
    draw_mask,
    jpeg,
    key,
)
from pomona.values.photo_names import photos_named
from pomona.values.photos import Photo

_COLOURS = {"right": RIGHT, "false": FALSE, "double": DOUBLE, "neither": UNUSED}
# How much of its colour a mask takes on.
_TINT = 0.35
_KEY_WIDTH_PX = 900
_MOST_ENLARGED = 2.0


@dataclass(frozen=True, kw_only=True)
class PictureOptions:
    """What is drawn: detections of at least `confidence` (None: where F1 is best), of the `worst` photos (None: all).

    The worst photos have most missed fruits and false detections. A photo's longer side is at most `side_px`.
    """

    confidence: float | None = None
    worst: int | None = None
    side_px: int = 1600
    jpeg_quality: int = 90

    def __post_init__(self) -> None:
        if self.worst is not None and self.worst < 1:
            raise InputError(f"`worst`: expected at least 1 photo, found {self.worst}")
        if self.side_px < 100 or not 1 <= self.jpeg_quality <= 100:
            raise InputError(
                f"`side_px`: expected at least 100, `jpeg_quality`: 1 to 100; found {self.side_px}, {self.jpeg_quality}"
            )


def write_pictures(
    folder: Path,
    photos: Mapping[str, Photo],
    found: Mapping[str, Detections],
    truth: DetectionTruth,
    scores: DetectionScores,
    *,
    options: PictureOptions | None = None,
    progress: Progress | None = None,
) -> tuple[Path, ...]:
    """Write a JPEG of each photo that was scored into `folder`, and return the files, the worst photo first.

    Their names begin with the rank, 001 for the worst.
    Right detections are masks in colour (boxes, where the truth has boxes alone), the others rectangles. Photos that
    are not in `photos`, by name, or cannot be read, are left out with a warning. Pictures of an earlier evaluation
    stay, as nobody knows whose they are, and are warned of.
    """
    options, progress = options or PictureOptions(), progress or Silent()
    confidence = options.confidence
    if confidence is None:
        confidence = scores.best.confidence if scores.best else 0.0
    worst = sorted(scores.matches, key=lambda match: (-_wrong(match, confidence), match.photo))
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for rank, match in enumerate(track(worst[: options.worst], progress, "drawing detections"), start=1):
        if match.photo not in photos:
            progress.warn(f"{match.photo}: no picture, as the photo was not found")
            continue
        try:
            pixels, scale = _pixels(photos[match.photo], options)
        except (InputError, MissingFileError) as error:
            progress.warn(f"{match.photo}: no picture: {error}")
            continue
        picture = draw(pixels, scale, found[match.photo], truth[match.photo], match, scores.by_masks, confidence)
        path = folder / f"{rank:03}_{Path(match.photo).with_suffix('').as_posix().replace('/', '_')}.jpg"
        path.write_bytes(jpeg(picture, quality=options.jpeg_quality))
        written.append(path)
    if others := sorted({path.name for path in folder.glob("[0-9]*_*.jpg")} - {path.name for path in written}):
        progress.warn(
            f"{folder} has pictures of an earlier evaluation, too, which are no part of this one: {few(others)}"
        )
    return tuple(written)


def draw(
    pixels: ByteArray,
    scale: float,
    found: Detections,
    truth: PhotoTruth,
    match: PhotoMatch,
    by_masks: bool,
    confidence: float,
) -> ByteArray:
    """Return a picture (h + key, w, 3) of a photo whose `pixels` (h, w, 3) RGB are at `scale` of its full size."""
    picture = pixels.copy()
    sure = found.scores >= confidence
    kind_of = kinds(match)
    assert found.boxes_px is not None
    if by_masks:
        for k in np.flatnonzero(sure & match.right):
            draw_mask(picture, found.masks[k], PictureFromPhoto(scale=scale), RIGHT, width=1, tint=_TINT)
    for name in ("neither", "right", "double", "false"):
        for k in np.flatnonzero(sure & np.array([kind == name for kind in kind_of], bool)):
            if not (by_masks and name == "right"):
                width = 1 if name == "neither" else 2
                draw_box(picture, found.boxes_px[k] * scale, _COLOURS[name], width=width)
    missed = missed_fruits(match, confidence)
    for box in truth.boxes_px[missed]:
        draw_box(picture, box * scale, MISSED, width=2)
    counts = {name: int((sure & np.array([kind == name for kind in kind_of], bool)).sum()) for name in _COLOURS}
    return _with_key(picture, counts, int(missed.sum()), confidence)


def missed_fruits(match: PhotoMatch, confidence: float) -> BoolArray:
    """Say which true fruits (m,) are to be found and are no detection's of at least `confidence`."""
    met = match.true_idx[(match.scores >= confidence) & (match.true_idx >= 0)]
    missed = match.scored.copy()
    missed[met] = False
    return missed


def _wrong(match: PhotoMatch, confidence: float) -> int:
    false = (match.scores >= confidence) & (match.true_idx < 0)
    return int(missed_fruits(match, confidence).sum() + false.sum())


def _pixels(photo: Photo, options: PictureOptions) -> tuple[ByteArray, float]:
    """The photo's pixels, made smaller or, for a tile, larger, so that lines are thinner than fruits; and the scale."""
    scale = min(_MOST_ENLARGED, options.side_px / max(photo.width_px, photo.height_px))
    pixels = read_pixels(photo, max_side_px=photo.longer_side_px(scale) if scale < 1 else None)
    if scale > 1:
        pixels = np.asarray(cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC), np.uint8)
    return pixels, pixels.shape[1] / photo.width_px


def _with_key(picture: ByteArray, counts: Mapping[str, int], missed: int, confidence: float) -> ByteArray:
    """The picture, at least as wide as the key, and below it the key with the number of each."""
    strip = key(
        max(picture.shape[1], _KEY_WIDTH_PX),
        (
            (RIGHT, f"{counts['right']} right"),
            (FALSE, f"{counts['false']} false"),
            (DOUBLE, f"{counts['double']} double"),
            (MISSED, f"{missed} missed"),
            (UNUSED, f"{counts['neither']} not scored"),
        ),
        f"confidence {confidence:.2f} and more",
    )
    sheet = np.full((picture.shape[0] + len(strip), strip.shape[1], 3), PAPER, np.uint8)
    sheet[: picture.shape[0], : picture.shape[1]] = picture
    sheet[picture.shape[0] :] = strip
    return sheet


def photos_beside(
    truth: Path, names: Sequence[str], folder: Path | None = None, *, of: Path, elsewhere: Sequence[Path] = ()
) -> dict[str, Photo]:
    """Return the photos of `names` in `folder`, or else in `images/` beside the truth, or beside it.

    Names that fit no photo are left out; raises `InputError` where none does, which says whose photos they are (`of`)
    and that they were not found `elsewhere`, either.
    """
    from pomona.stages.capture import load_photos

    place = truth if truth.is_dir() else truth.parent
    around = [place / "images", place.parent / "images", place.parent.parent / "images"]
    holds_masks = any((of / "masks").is_dir() for of in (place, place / "truth"))
    if not holds_masks and (truth.is_file() or any(place.glob("*.json"))):  # masks are no photos
        around.append(place)
    tried = [folder] if folder else [f for f in around if f.is_dir()]
    for candidate in tried:
        try:
            photos = load_photos([candidate], sides="none", min_photos=1)
        except InputError:  # no photo in there
            continue
        if known := photos_named(photos, names):
            return known.by_name()
    places = dict.fromkeys(map(str, [*elsewhere, *(tried or [place])]))
    raise InputError(f"The photos of {of} were not found in {', '.join(places)}: say where they are with `photos`")
