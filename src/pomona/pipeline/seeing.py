"""Detections of every photo: by a segmenter, photo after photo, or from a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pomona.detections import Detections, SurveyDetections
from pomona.errors import PomonaError
from pomona.photos import Photo, Photos
from pomona.pipeline.context import Context, code_digest
from pomona.pipeline.options import RunOptions
from pomona.progress import Progress
from pomona.survey import Stage, Survey
from pomona.survey.digest import digest, file_digest
from pomona.survey.files import write_file
from pomona.survey.stage import StageWork


def segment_stage(context: Context) -> Stage[SurveyDetections]:
    """Return the stage that writes `detections.json`."""
    path = context.survey.detections

    thresholds: list[float] = []

    def compute(progress: Progress) -> SurveyDetections:
        if context.options.detections:
            thresholds.append(0.0)  # who gives detections has chosen them
            return _given(context, progress)
        detections, threshold = _segmented(context, progress)
        thresholds.append(threshold)
        return detections

    def save(detections: SurveyDetections) -> Mapping[str, Any]:
        from pomona.formats.detections.coco import write_coco

        threshold = thresholds.pop()
        write_file(path, lambda temporary: write_coco(temporary, context.photos, detections))
        total = detections.at_least(threshold).total
        return {"detections": total, "photos": len(detections), "score_threshold": threshold}

    def load(info: Mapping[str, Any]) -> SurveyDetections:
        from pomona.formats.detections.coco import read_coco

        return read_coco(path, context.photos)

    work = StageWork(compute=compute, save=save, load=load, outputs=(path,))
    return context.stage("segment", lambda: _key(context), work, rooms=("segment",))


def counted(segment: Stage[SurveyDetections]) -> SurveyDetections:
    """Return the detections that count as fruit in their photo; the file has weaker ones too."""
    return segment.value.at_least(float(segment.ensure().info["score_threshold"]))


def trusted(segment: Stage[SurveyDetections], options: RunOptions) -> SurveyDetections:
    """Return the detections that may become fruit when all photos are looked at together."""
    return segment.value.at_least(options.least_score(float(segment.ensure().info["score_threshold"])))


def least_score_in(survey: Survey) -> float:
    """Return the score from which a survey's detections could become fruit; 0 where the survey does not say."""
    record = survey.record_of("segment")
    threshold = record.info.get("score_threshold") if record else None
    return 0.0 if threshold is None else RunOptions.from_json(survey.get("options", {})).least_score(float(threshold))


def _key(context: Context) -> Any:
    options = context.options
    if options.detections is not None:
        details = [[photo.name, photo.width_px, photo.height_px] for photo in context.photos]
        code = code_digest("formats/detections")
        return ["given", file_digest(options.detections), options.classes, details, code]
    return [_model_key(context), dict(context.digests), list(context.photos.sides)]


def _model_key(context: Context) -> Any:
    from pomona.segment.load import files_of

    model = context.options.model
    # A plain file is known by its content alone: it may be moved.
    said = None if model is None or Path(model).is_file() else str(model)
    return [said, [file_digest(path) for path in files_of(model)], context.options.segment]


def _given(context: Context, progress: Progress) -> SurveyDetections:
    from pomona.formats.detections.read import read_detections

    options = context.options
    assert options.detections is not None
    progress.start("reading the detections given")
    return read_detections(options.detections, context.photos, classes=options.classes, progress=progress)


def _segmented(context: Context, progress: Progress) -> tuple[SurveyDetections, float]:
    """Return the detections, and the score from which one counts in a single photo.

    Segments photo after photo; each is kept in `work/` at once, so that a stopped run goes on with the next.
    """
    from pomona.formats.detections.coco import write_coco
    from pomona.segment import iter_detections, load_segmenter
    from pomona.segment.stage import threshold_of

    folder = context.survey.work("segment") / digest([_model_key(context), code_digest("segment")])
    files = {p.name: folder / f"{digest([p.name, context.digests[p.name]])}.json" for p in context.photos}
    done = _done(context.photos, files)
    segmenter = load_segmenter(context.options.model)
    found: dict[str, Detections] = {}
    by_name = context.photos.by_name()
    options = context.options.segment
    for of_photo in iter_detections(context.photos, segmenter, options=options, progress=progress, done=done):
        found[of_photo.photo] = of_photo
        if of_photo.photo not in done:
            _keep(write_coco, files[of_photo.photo], by_name[of_photo.photo], of_photo)
    detections = SurveyDetections(found)
    threshold = threshold_of(segmenter, options)
    if detections.at_least(threshold).total == 0:
        progress.warn(
            f"No fruit was found in any of {len(found)} photos: the result is empty. If there is fruit in them, try "
            "another --model, a lower --score-threshold, or give --detections"
        )
    return detections, threshold


def _keep(write_coco: Any, path: Path, photo: Photo, found: Detections) -> None:
    of_one = SurveyDetections({photo.name: found})
    write_file(path, lambda temporary: write_coco(temporary, Photos((photo,)), of_one))


def _done(photos: Photos, files: Mapping[str, Path]) -> dict[str, Detections]:
    """Detections that an earlier, stopped run kept; what is damaged, or has ids that clash, is done again."""
    from pomona.formats.detections.coco import read_coco

    done: dict[str, Detections] = {}
    ids: set[int] = set()
    for photo in photos:
        if not files[photo.name].is_file():
            continue
        try:
            found = read_coco(files[photo.name], Photos((photo,)))[photo.name]
        except (PomonaError, KeyError):
            continue
        of_photo = set(found.ids.tolist())
        if not of_photo & ids:
            done[photo.name] = found
            ids |= of_photo
    return done
