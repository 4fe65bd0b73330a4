"""Photos with what was found, what is false and what was missed, like Figure 7 of Gené-Mola et al. 2020."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pomona.arrays import BoolArray, ByteArray, FloatArray, IntArray
from pomona.capture import read_pixels
from pomona.detections import Detections, Mask
from pomona.errors import InputError, MissingFileError
from pomona.evaluate.detections.matching import PhotoMatch
from pomona.evaluate.detections.scores import DetectionScores, kinds
from pomona.evaluate.detections.truth import DetectionTruth, PhotoTruth
from pomona.photo_names import photos_named
from pomona.photos import Photo
from pomona.progress import Progress, Silent, track

Rgb = tuple[int, int, int]

RIGHT: Rgb = (64, 220, 120)
FALSE: Rgb = (255, 64, 64)
DOUBLE: Rgb = (80, 150, 255)
MISSED: Rgb = (255, 214, 64)
NEITHER: Rgb = (190, 190, 190)
_PAPER: Rgb = (24, 28, 26)
_INK: Rgb = (232, 238, 234)
_COLOURS = {"right": RIGHT, "false": FALSE, "double": DOUBLE, "neither": NEITHER}
_LEGEND_PX = 30
_LEGEND_WIDTH_PX = 900
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
            raise InputError(f"worst: expected at least 1 photo, found {self.worst}")
        if self.side_px < 100 or not 1 <= self.jpeg_quality <= 100:
            raise InputError(
                f"side_px: expected at least 100, jpeg_quality: 1 to 100; found {self.side_px}, {self.jpeg_quality}"
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
    are not in `photos`, by name, or cannot be read, are left out with a warning.
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
        done, encoded = cv2.imencode(
            ".jpg", np.ascontiguousarray(picture[:, :, ::-1]), [cv2.IMWRITE_JPEG_QUALITY, options.jpeg_quality]
        )
        assert done
        path.write_bytes(encoded.tobytes())
        written.append(path)
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
    """Return a picture (h + legend, w, 3) of a photo whose `pixels` (h, w, 3) RGB are at `scale` of its full size."""
    picture = pixels.copy()
    sure = found.scores >= confidence
    kind_of = kinds(match)
    assert found.boxes_px is not None
    if by_masks:
        for k in np.flatnonzero(sure & match.right):
            _fill(picture, found.masks[k], scale, RIGHT)
    for name in ("neither", "right", "double", "false"):
        for k in np.flatnonzero(sure & np.array([kind == name for kind in kind_of], bool)):
            if not (by_masks and name == "right"):
                _rectangle(picture, found.boxes_px[k] * scale, _COLOURS[name], 1 if name == "neither" else 2)
    missed = missed_fruits(match, confidence)
    for box in truth.boxes_px[missed]:
        _rectangle(picture, box * scale, MISSED, 2)
    counts = {name: int((sure & np.array([kind == name for kind in kind_of], bool)).sum()) for name in _COLOURS}
    return _with_legend(picture, counts, int(missed.sum()), confidence)


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
    longer = max(photo.width_px, photo.height_px)
    scale = min(_MOST_ENLARGED, options.side_px / longer)
    pixels = read_pixels(photo, max_side_px=max(1, round(scale * longer)) if scale < 1 else None)
    if scale > 1:
        pixels = np.asarray(cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC), np.uint8)
    return pixels, pixels.shape[1] / photo.width_px


def _fill(picture: ByteArray, mask: Mask, scale: float, colour: Rgb) -> None:
    """Tint the pixels of a mask and draw its outline."""
    x0, y0, x1, y1 = (round(edge * scale) for edge in mask.box_px)
    size = (max(1, x1 - x0), max(1, y1 - y0))
    inside = cv2.resize(mask.pixels.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    part = picture[y0 : y0 + size[1], x0 : x0 + size[0]]
    inside = inside[: part.shape[0], : part.shape[1]]
    part[inside > 0] = (0.65 * part[inside > 0] + 0.35 * np.array(colour)).astype(np.uint8)
    outlines, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, outlines, -1, colour, 1, cv2.LINE_AA, offset=(x0, y0))


def _rectangle(picture: ByteArray, box: FloatArray, colour: Rgb, thickness: int) -> None:
    """Draw the edges x0, y0, x1, y1 of a box, dark beside the colour, so that it shows on any ground."""
    x0, y0, x1, y1 = _rounded(box)
    cv2.rectangle(picture, (x0, y0), (x1 - 1, y1 - 1), _PAPER, thickness + 2, cv2.LINE_AA)
    cv2.rectangle(picture, (x0, y0), (x1 - 1, y1 - 1), colour, thickness, cv2.LINE_AA)


def _rounded(box: FloatArray) -> list[int]:
    edges: IntArray = np.round(box).astype(np.int64)
    return [int(edge) for edge in edges]


def _with_legend(picture: ByteArray, counts: Mapping[str, int], missed: int, confidence: float) -> ByteArray:
    """The picture, at least as wide as the legend, and the legend below it with the number of each."""
    width = max(picture.shape[1], _LEGEND_WIDTH_PX)
    sheet = np.full((picture.shape[0] + _LEGEND_PX, width, 3), _PAPER, np.uint8)
    sheet[: picture.shape[0], : picture.shape[1]] = picture
    entries: Sequence[tuple[Rgb, str]] = (
        (RIGHT, f"{counts['right']} right"),
        (FALSE, f"{counts['false']} false"),
        (DOUBLE, f"{counts['double']} double"),
        (MISSED, f"{missed} missed"),
        (NEITHER, f"{counts['neither']} not scored"),
    )
    strip, left = sheet[picture.shape[0] :], 10
    for colour, text in entries:
        cv2.rectangle(strip, (left, 8), (left + 14, 22), colour, -1)
        cv2.putText(strip, text, (left + 22, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, _INK, 1, cv2.LINE_AA)
        left += 140
    text = f"confidence {confidence:.2f} and more"
    cv2.putText(strip, text, (left + 10, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
    return sheet


def photos_beside(truth: Path, names: Sequence[str], folder: Path | None = None) -> dict[str, Photo]:
    """Return the photos of `names` in `folder`, or else in `images/` beside the truth, or beside it.

    Names that fit no photo are left out; raises `InputError` where none does.
    """
    from pomona.capture import load_photos

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
    raise InputError(
        f"The photos named in {truth} were not found in {', '.join(map(str, tried)) or place}: "
        "say where they are with --photos FOLDER"
    )
