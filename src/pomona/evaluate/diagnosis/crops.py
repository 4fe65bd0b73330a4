"""Crops of photos around the fruits that went wrong: each photo is read once, and never two at a time."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray, IntArray
from pomona.errors import InputError, MissingFileError, few
from pomona.evaluate.diagnosis.mistakes import Mistake, MistakeOptions, MistakeView, SurveyResult
from pomona.evaluate.diagnosis.spheres import Circle, DrawnSpheres
from pomona.formats.detections.png_masks import read_ids
from pomona.fruit.geometry.sphere_outlines import centers_px
from pomona.progress import Progress, track
from pomona.stages.capture import read_pixels
from pomona.stages.capture.images import write_jpeg
from pomona.values.detections import Mask
from pomona.values.drawing import MISSED, OTHER, OWN, UNUSED, Rgb, Square, cut, draw_mask, draw_sphere, label_sphere
from pomona.values.photos import Photo

# In radii: so near is what a crop shows whole of the fruits that this one was mistaken for; and so far beside the photo
# that shows it a fruit may project.
_NEAR_RADII, _BESIDE_RADII = 2.5, 4.0
# In pixels of a crop: so far beside it may lie what has a part of its edge or label in it.
_BESIDE_CROP_PX = 100
# A crop is dark where nine tenths of it are darker than this share of white; its gamma is then at least the other.
_DARK_LEVEL, _LEAST_GAMMA = 0.3, 0.45


@dataclass(frozen=True)
class CropFiles:
    """Two files beside the page, a crop and the same with what is drawn into it, and what the photo shows."""

    photo: str
    note: str
    plain: str
    drawn: str


@dataclass(frozen=True, eq=False)
class Outline:
    """A mask whose edge is drawn, thick where the crop is about it."""

    mask: Mask
    colour: Rgb
    thick: bool


class CropCutter:
    """Cuts crops out of photos into `folder`; `true_ids` are images of true fruit ids, by photo."""

    def __init__(
        self,
        survey: SurveyResult,
        spheres: DrawnSpheres,
        true_ids: Mapping[str, Path],
        folder: Path,
        options: MistakeOptions,
    ) -> None:
        self._survey, self._spheres, self._true_ids = survey, spheres, true_ids
        self._folder, self._options = folder, options

    def cut(self, mistakes: Sequence[Mistake], progress: Progress) -> dict[str, tuple[CropFiles, ...]]:
        """Write the crops of `mistakes` and return them by the mistakes' keys.

        Photos that cannot be read, or have not the size that their camera has, are left out with a warning.
        """
        by_photo: dict[str, list[tuple[Mistake, int]]] = defaultdict(list)
        for mistake in mistakes:
            for number, view in enumerate(mistake.views):
                by_photo[view.photo].append((mistake, number))
        crops: dict[str, dict[int, CropFiles]] = {mistake.key: {} for mistake in mistakes}
        astray: list[str] = []
        for photo in track(sorted(by_photo), progress, "cutting crops out of photos"):
            try:
                for mistake, number, crop in self._of_photo(photo, by_photo[photo], astray):
                    crops[mistake.key][number] = crop
            except (InputError, MissingFileError) as error:
                progress.warn(f"{photo}: no crops: {error}")
        if astray:
            progress.warn(
                f"Crops left out, as the fruit does not project into the photo that shows it: {few(astray, 3)}. "
                "Are survey and truth in one frame, from the same markers?"
            )
        return {key: tuple(of[number] for number in sorted(of)) for key, of in crops.items()}

    def _of_photo(
        self, name: str, wanted: Sequence[tuple[Mistake, int]], astray: list[str]
    ) -> Iterator[tuple[Mistake, int, CropFiles]]:
        photo, photo_idx = self._survey.photos[name], self._survey.cameras.index_of(name)
        assert photo_idx is not None
        self._check_size(photo, photo_idx)
        pixels, circles = read_pixels(photo), self._spheres.circles(photo_idx)
        ids = read_ids(self._true_ids[name]) if name in self._true_ids else None
        for mistake, number in wanted:
            view = mistake.views[number]
            here = [circle.about(mistake.truth_id, mistake.fruit_ids) for circle in circles]
            window = self._window(mistake, view, here, photo, photo_idx)
            if window is None:
                astray.append(f"{mistake.name} in {name}")
                continue
            plain, brighter = brightened(cut(pixels, window))
            outlines = [outline for outline in self._masks(view) if _reaches(outline.mask.box_px, window)]
            around = [circle for circle in here if _reaches(circle.box_px, window)]
            drawn = _drawn(plain, window, (*outlines, *_visible(ids, mistake, window)), around)
            yield mistake, number, self._write(f"{mistake.key}-{number + 1}", view, plain, drawn, brighter)

    def _check_size(self, photo: Photo, photo_idx: int) -> None:
        lens = self._survey.cameras.intrinsics_of(photo_idx)
        if (photo.width_px, photo.height_px) != (lens.width_px, lens.height_px):
            raise InputError(
                f"expected {lens.width_px} × {lens.height_px} pixels, as its camera has, found {photo.width_px} × "
                f"{photo.height_px} in {photo.path}"
            )

    def _write(self, name: str, view: MistakeView, plain: ByteArray, drawn: ByteArray, brighter: bool) -> CropFiles:
        files = CropFiles(
            view.photo, view.note + (" (brightened)" if brighter else ""), f"{name}.jpg", f"{name}-drawn.jpg"
        )
        write_jpeg(self._folder / files.plain, plain, quality=self._options.jpeg_quality)
        write_jpeg(self._folder / files.drawn, drawn, quality=self._options.jpeg_quality)
        return files

    def _masks(self, view: MistakeView) -> Iterator[Outline]:
        """The outlines of all detections, those of this fruit last."""
        found = self._survey.detections.get(view.photo)
        if found is None:
            return
        own = np.isin(found.ids, view.detection_ids)
        for k in np.argsort(own, kind="stable"):
            weak = found.scores[k] < self._survey.least_score
            colour = UNUSED if weak else OWN if own[k] else OTHER
            yield Outline(found.masks[k], colour, bool(own[k]))

    def _window(
        self, mistake: Mistake, view: MistakeView, circles: Sequence[Circle], photo: Photo, photo_idx: int
    ) -> Square | None:
        """The part of the photo around the fruit, the detections of it, and what near it was mistaken for it.

        None where the fruit does not project into the photo.
        """
        cameras, options = self._survey.cameras, self._options
        place = np.array(mistake.center_in_world)
        center = centers_px(cameras, photo_idx, place[None])[0]
        distance = max(float(np.linalg.norm(cameras.centers_in_world[photo_idx] - place)), 1e-6)
        radius_px = cameras.intrinsics_of(photo_idx).focal_px * self._spheres.usual_diameter_m / 2 / distance
        size_px = np.array([photo.width_px, photo.height_px])
        beside_px, near_px = _BESIDE_RADII * radius_px, _NEAR_RADII * radius_px
        if not ((center > -beside_px) & (center < size_px + beside_px)).all():  # nor if it is NaN
            return None
        points: list[FloatArray] = [center + radius_px * np.array([[-1.0, -1], [1, 1]])]
        points += [c.outline_px for c in circles if c.thick and np.linalg.norm(c.center_px - center) < near_px]
        points += [np.array(outline.mask.box_px, float).reshape(2, 2) for outline in self._masks(view) if outline.thick]
        return window_around(
            np.concatenate(points), options.around, options.least_window_px, (photo.width_px, photo.height_px),
            options.crop_px,
        )  # fmt: skip


def _visible(ids: IntArray | None, mistake: Mistake, window: Square) -> Iterator[Outline]:
    """The outline of what the photo shows of the true fruit, inside the window."""
    if ids is None or not mistake.truth_id:
        return
    left, top = max(window.left, 0), max(window.top, 0)
    pixels = ids[top : window.top + window.side, left : window.left + window.side] == mistake.truth_id
    if pixels.any():
        yield Outline(Mask.from_pixels(pixels, left, top), MISSED, False)


def _reaches(box_px: tuple[float, float, float, float], window: Square) -> bool:
    """Whether what has this box in the photo may be seen in the window: of a photo of hundreds of fruits, a few do."""
    x0, y0, x1, y1 = box_px
    beyond = _BESIDE_CROP_PX * window.side / window.size
    left, top = window.left - beyond, window.top - beyond
    right, bottom = window.left + window.side + beyond, window.top + window.side + beyond
    return x1 > left and x0 < right and y1 > top and y0 < bottom


def window_around(
    points_px: FloatArray, around: float, least_px: int, photo_size: tuple[int, int], size: int
) -> Square:
    """Return the square `around` times as large as the box of `points_px` (n, 2), moved into the photo (w, h)."""
    low, high = np.nanmin(points_px, axis=0), np.nanmax(points_px, axis=0)
    side = min(max(least_px, round(around * float((high - low).max()))), max(photo_size))
    left, top = (
        int(np.clip(round(float(middle) - side / 2), min(0, length - side), max(0, length - side)))
        for middle, length in zip((low + high) / 2, photo_size, strict=True)
    )
    return Square(left, top, side, size)


def brightened(crop: ByteArray) -> tuple[ByteArray, bool]:
    """Return a crop in deep shade brighter, so that a person sees what is in it, and whether it was."""
    level = float(np.percentile(crop.max(axis=2), 90)) / 255
    if not 0 < level < _DARK_LEVEL:
        return crop, False
    gamma = max(_LEAST_GAMMA, np.log(0.5) / np.log(level))
    curve = np.round(255 * (np.arange(256) / 255) ** gamma).astype(np.uint8)
    return curve[crop], True


def _drawn(crop: ByteArray, window: Square, outlines: Sequence[Outline], circles: Sequence[Circle]) -> ByteArray:
    """The crop enlarged to its size, with outlines of masks, then thin circles, then thick ones."""
    picture_from_photo = window.picture_from_photo
    picture = np.asarray(cv2.resize(crop, (window.size, window.size), interpolation=cv2.INTER_CUBIC), np.uint8)
    for outline in outlines:
        draw_mask(picture, outline.mask, picture_from_photo, outline.colour, width=2 if outline.thick else 1)
    for circle in sorted(circles, key=lambda circle: circle.thick):
        if (circle.thick or circle.seen) and np.isfinite(circle.center_px).all():
            edge, center = picture_from_photo.at(circle.outline_px), picture_from_photo.at(circle.center_px)
            draw_sphere(picture, edge, center, circle.colour, width=3 if circle.thick else 1)
            label_sphere(picture, circle.label, edge, center, colour=circle.colour)
    return picture
