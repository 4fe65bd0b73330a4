"""Detections against the truth, photo by photo."""

from __future__ import annotations

from collections.abc import Mapping

from pomona.detections import Detections
from pomona.errors import FormatError, InputError
from pomona.evaluate.detections.matching import PhotoMatch, match_photo
from pomona.evaluate.detections.options import EvaluateDetectionsOptions
from pomona.evaluate.detections.scores import DetectionScores, score
from pomona.evaluate.detections.truth import DetectionTruth, PhotoTruth
from pomona.progress import Progress, Silent, track


def evaluate_detections(
    found: Mapping[str, Detections],
    truth: DetectionTruth,
    *,
    found_masks: bool = True,
    options: EvaluateDetectionsOptions | None = None,
    progress: Progress | None = None,
) -> DetectionScores:
    """Return the scores of the detections `found` in the photos of `truth`, both by the photo's name.

    `found_masks`: False where the detections' masks were made of boxes alone, and say nothing. A photo of `truth` that
    `found` lacks was not searched, and is left out.

    Raises `InputError` where masks are to decide and one side has none, or where no photo is in both, and `FormatError`
    where a photo's size differs.
    """
    options, progress = options or EvaluateDetectionsOptions(), progress or Silent()
    photos = [name for name in truth if name in found]
    if not photos:
        raise InputError(f"No photo has both truth ({len(truth)} photos) and detections ({len(found)} photos)")
    by_masks = _by_masks(truth, found_masks, options)
    matches = [
        _match(found[name], truth[name], found_masks, by_masks, options)
        for name in track(photos, progress, "comparing detections with the truth")
    ]
    return score(matches, by_masks=by_masks, options=options)


def _by_masks(truth: DetectionTruth, found_masks: bool, options: EvaluateDetectionsOptions) -> bool:
    if options.match == "masks" and not (truth.has_masks and found_masks):
        side = "the detections are" if truth.has_masks else "the truth is"
        raise InputError(f"match: expected masks on both sides, but {side} boxes alone: use boxes")
    return options.match != "boxes" and truth.has_masks and found_masks


def _match(
    found: Detections, truth: PhotoTruth, found_masks: bool, by_masks: bool, options: EvaluateDetectionsOptions
) -> PhotoMatch:
    if (found.width_px, found.height_px) != (truth.width_px, truth.height_px):
        turned = (found.height_px, found.width_px) == (truth.width_px, truth.height_px)
        hint = ": one of them is not upright, as EXIF says" if turned else ""
        raise FormatError(
            f"{truth.photo}: the truth is of {truth.width_px} × {truth.height_px} pixels, but the detections are of "
            f"{found.width_px} × {found.height_px}{hint}"
        )
    return match_photo(found, truth, by_masks=by_masks, compare_masks=found_masks, options=options)
