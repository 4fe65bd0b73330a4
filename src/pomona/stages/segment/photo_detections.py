"""The stage: photos in, the detections of every photo out, one photo after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from threading import BoundedSemaphore

import numpy as np

from pomona.basics.arrays import ByteArray, counted
from pomona.basics.option_values import expect_kinds
from pomona.basics.threads import in_order
from pomona.errors import DamagedPhotoError, InputError, MissingFileError
from pomona.progress import Progress, Silent
from pomona.stages.segment.protocol import KEPT_SHARE, Segmenter, TileByTile
from pomona.stages.segment.reading_scale import MAX_ENLARGEMENT, ReadingScales, reading_scales
from pomona.stages.segment.resize import resized_detections, resized_pixels
from pomona.stages.segment.tiled_image import segment_tiled
from pomona.values.detections import Detections, SurveyDetections
from pomona.values.photos import Photo, Photos


@dataclass(frozen=True, kw_only=True)
class SegmentOptions:
    """Options of the stage; None: the segmenter's own wish, or worked out from the photos.

    Detections are kept from `kept_share` of the score threshold up: those below it do not count, but may be weighed
    against other photos; 1 keeps only those that count.
    `scale` is the scale at which photos are read (1: their full size); `sample_photos` how many photos of each side
    and camera are looked at first to find it.
    """

    score_threshold: float | None = None
    kept_share: float = KEPT_SHARE
    tile_px: int | None = None
    min_overlap_px: int | None = None
    scale: float | None = None
    sample_photos: int = 4

    def __post_init__(self) -> None:
        expect_kinds(self)
        if self.score_threshold is not None and not 0 <= self.score_threshold <= 1:
            raise InputError(f"`score_threshold`: expected 0 to 1, found {self.score_threshold}")
        if not 0 <= self.kept_share <= 1:
            raise InputError(f"`kept_share`: expected 0 to 1, found {self.kept_share}")
        if self.tile_px is not None and self.tile_px < 64:
            raise InputError(f"`tile_px`: expected at least 64, found {self.tile_px}")
        if self.scale is not None and not 0 < self.scale <= MAX_ENLARGEMENT:
            raise InputError(f"`scale`: expected over 0, up to {MAX_ENLARGEMENT:g}, found {self.scale}")
        if self.sample_photos < 1:
            raise InputError(f"`sample_photos`: expected at least 1, found {self.sample_photos}")


def segment_photos(
    photos: Photos, segmenter: Segmenter, *, options: SegmentOptions | None = None, progress: Progress | None = None
) -> SurveyDetections:
    """Return the detections of every photo, weak ones too; ids count from 1 in the photos' order.

    A photo that cannot be decoded is warned of and has no entry. No fruit in any photo is a valid result, with a
    warning.
    """
    options, progress = options or SegmentOptions(), progress or Silent()
    found = {d.photo: d for d in iter_detections(photos, segmenter, options=options, progress=progress)}
    result = SurveyDetections(found)
    if result.at_least(threshold_of(segmenter, options)).total == 0:
        progress.warn(f"No fruit was found in any of {counted(len(found), 'photo')}.")
    return result


def iter_detections(
    photos: Photos,
    segmenter: Segmenter,
    *,
    options: SegmentOptions | None = None,
    progress: Progress | None = None,
    done: Mapping[str, Detections] | None = None,
    scales: ReadingScales | None = None,
    keep: Callable[[Detections], None] | None = None,
) -> Iterator[Detections]:
    """Yield the detections of each photo, in the photos' order; ids count on from those in `done`.

    `keep` is called with those of each photo that is not in `done`, ids counting from 1, also of photos that were being
    segmented when something went wrong: to save them, so that a later run goes on from there.

    Photos in `done`, from an earlier run with the same options, are yielded as they are. `scales` are those of
    `scales_of`, where they are known already. As many photos are segmented at the same time as the segmenter
    wishes, while the next one is read.
    """
    options, progress, done = options or SegmentOptions(), progress or Silent(), done or {}
    if isinstance(segmenter, TileByTile) and segmenter.note:
        progress.warn(segmenter.note)
    todo = [photo for photo in photos if photo.name not in done]
    if scales is None:
        scales = scales_of(photos, segmenter, options, progress) if todo else ReadingScales({})
    next_id = 1 + max((int(d.ids.max()) for d in done.values() if len(d)), default=0)
    progress.start("segmenting", len(photos))
    turns = BoundedSemaphore(segmenter.traits.at_once)

    def look(photo: Photo) -> Detections | str:
        if photo.name in scales.seen:
            return scales.seen[photo.name]
        return _look(photo, scales.by_name[photo.name], segmenter, options, turns)

    def saved(found: Detections | str) -> None:
        if keep is not None and not isinstance(found, str):
            keep(found)

    def rescued(found: Detections | str) -> None:
        with suppress(OSError):  # what went wrong first says why
            saved(found)

    with closing(in_order(look, todo, segmenter.traits.at_once + 1, left=rescued)) as coming:
        for photo in photos:
            if photo.name in done:
                yield done[photo.name]
            elif isinstance(found := next(coming), str):
                progress.warn(f"{photo.name} is left out: {found}")
            else:
                saved(found)
                yield replace(found, ids=np.arange(len(found)) + next_id)
                next_id += len(found)
            progress.advance()


def segment_photo(
    pixels: ByteArray,
    segmenter: Segmenter,
    *,
    name: str = "",
    size_px: tuple[int, int] | None = None,
    options: SegmentOptions | None = None,
) -> Detections:
    """Return the detections of one photo whose pixels, uint8 (H, W, 3) RGB, are at the scale to segment at.

    `size_px` is the photo's full (width, height), to which masks are mapped; None: that of `pixels`.
    """
    options = options or SegmentOptions()
    found = segment_tiled(
        pixels,
        segmenter,
        score_threshold=options.kept_share * threshold_of(segmenter, options),
        tile_px=options.tile_px,
        min_overlap_px=options.min_overlap_px,
    )
    read_size = pixels.shape[1], pixels.shape[0]
    size_px = read_size if size_px is None else size_px
    found = resized_detections(found, read_size, size_px)
    return Detections(name, *size_px, found.masks, found.scores, np.arange(len(found)) + 1, found.boxes_px)


def scales_of(photos: Photos, segmenter: Segmenter, options: SegmentOptions, progress: Progress) -> ReadingScales:
    """Return the scale at which each photo is read: as asked for, or as the fruits in photos tell."""
    if options.scale is not None:
        return ReadingScales(dict.fromkeys(photos.names, options.scale))
    turns = BoundedSemaphore(segmenter.traits.at_once)
    return reading_scales(
        photos,
        segmenter,
        partial(_look, segmenter=segmenter, options=options, turns=turns),
        sample_photos=options.sample_photos,
        score_threshold=threshold_of(segmenter, options),
        progress=progress,
    )


def threshold_of(segmenter: Segmenter, options: SegmentOptions) -> float:
    """Return the score from which a detection counts: as asked for, or the segmenter's own."""
    return segmenter.traits.score_threshold if options.score_threshold is None else options.score_threshold


def _look(
    photo: Photo, scale: float, segmenter: Segmenter, options: SegmentOptions, turns: BoundedSemaphore
) -> Detections | str:
    """Return what is found in a photo read at a scale, once it is its turn; or why it cannot be read."""
    if isinstance(segmenter, TileByTile):
        segmenter, scale = segmenter.reading_at(scale)
    try:
        pixels = _pixels_at(photo, scale)
    except DamagedPhotoError as error:
        return error.reason
    except (InputError, MissingFileError) as error:
        return str(error)
    with turns:
        size_px = photo.width_px, photo.height_px
        return segment_photo(pixels, segmenter, name=photo.name, size_px=size_px, options=options)


def _pixels_at(photo: Photo, scale: float) -> ByteArray:
    from pomona.stages.capture import read_pixels

    width, height = max(1, round(photo.width_px * scale)), max(1, round(photo.height_px * scale))
    pixels = read_pixels(photo, max_side_px=max(width, height) if scale < 1 else None)
    return resized_pixels(pixels, width, height) if scale > 1 else pixels
