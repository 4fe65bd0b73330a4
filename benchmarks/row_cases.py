"""What several benchmarks begin with: photos, cameras, detections and truth of a rendered row, or of a part of it."""

from dataclasses import dataclass, replace
from pathlib import Path

from pomona.evaluate.fruits import Truth, read_truth
from pomona.formats.cameras.colmap import read_colmap
from pomona.learning.synth.truth import RowFolder
from pomona.pipeline import RunOptions
from pomona.stages.capture import load_photos
from pomona.stages.segment import load_segmenter, segment_photos
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.photos import Photos
from train_filter import cameras_of, true_detections


@dataclass(frozen=True)
class RowCase:
    """Detections and cameras are of the photos that the case has; `photos` has all of the row."""

    photos: Photos
    cameras: Cameras
    detections: SurveyDetections
    truth: Truth


def row_case(
    folder: Path,
    *,
    true_masks: bool = False,
    survey: Path | None = None,
    side: str | None = None,
    every: int = 1,
) -> RowCase:
    """Return what the shipped segmenter finds in a row, or its true masks, as a survey goes on with it.

    Cameras are the true ones, or those of a `survey` of it. `side`: photos of this side alone, and the truth that they
    show; `every`: so many-th of the photos.
    """
    row, truth = RowFolder(folder), read_truth(folder)
    photos, segmenter = load_photos([row.root / "images"]), load_segmenter(None)
    cameras = read_colmap(survey / "cameras") if survey else cameras_of(row, photos)
    found = true_detections(row, photos) if true_masks else segment_photos(photos, segmenter)
    of_side = {photo.name for photo in photos if side in (None, photo.side)}
    names = [name for name in sorted(cameras.photos) if name in of_side][::every]
    least = RunOptions().of_stages.select.trusted_share * segmenter.traits.score_threshold
    detections = found.of_photos(names).at_least(least)
    return RowCase(photos, cameras.of_photos(names), detections, truth if side is None else _seen_in(truth, names))


def _seen_in(truth: Truth, names: list[str]) -> Truth:
    stems = {Path(name).stem for name in names}
    kept = [i for i, photo in enumerate(truth.seen_photo or ()) if Path(photo).stem in stems]
    photos = tuple((truth.seen_photo or ())[i] for i in kept)
    return replace(truth, seen_photo=photos, seen_id=truth.seen_id[kept], seen_px=truth.seen_px[kept])
