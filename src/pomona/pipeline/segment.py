"""Stage `segment`: the detections of every photo, by a segmenter or from a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pomona.detections import Detections, SurveyDetections
from pomona.errors import PomonaError
from pomona.photos import Photo, Photos
from pomona.pipeline.stage import DIGESTS, PHOTOS, Stage, Store, SurveyContext
from pomona.progress import Progress
from pomona.survey.digest import digest, file_digest
from pomona.survey.files import write_file

if TYPE_CHECKING:
    from pomona.pipeline.options import StageOptions
    from pomona.segment.photo_detections import SegmentOptions


@dataclass(frozen=True, eq=False)
class Segmented:
    """All detections, weak ones too, and the score from which one counts in a single photo, as the model says."""

    detections: SurveyDetections
    score_threshold: float


@dataclass(frozen=True)
class Model:
    """A segmenter, by what a person said and the files which that means."""

    name: str | None
    files: tuple[Path, ...]

    @property
    def content_key(self) -> Any:
        """A plain file is known by its content alone, as it may be moved."""
        said = None if self.name is None or Path(self.name).is_file() else self.name
        return [said, [file_digest(path) for path in self.files]]


@dataclass(frozen=True, kw_only=True)
class SegmentChoice:
    """Who detects: a model with its options, or the masks in a file with the classes that are fruit.

    `lowest_score`: detections down to this are kept, where that is lower than what is kept anyway (None: it is not).
    `engines` are those that the model needs besides the usual ones, with their versions.
    """

    model: Model
    options: SegmentOptions
    lowest_score: float | None
    engines: Mapping[str, str]
    given: Path | None
    classes: tuple[str, ...] | None


def _choice(options: StageOptions) -> SegmentChoice:
    from pomona.pipeline.code import version_of
    from pomona.segment.load import engines_of, files_of

    run = options.run
    return SegmentChoice(
        model=Model(run.model, files_of(run.model)),
        # The file keeps weak detections with their scores, so that another threshold needs no other file.
        options=replace(options.segment, score_threshold=None),
        lowest_score=None if run.detections else _lowest_score(options),
        engines={name: version_of(name) for name in engines_of(run.model)},
        given=run.detections,
        classes=run.classes,
    )


def _lowest_score(options: StageOptions) -> float | None:
    asked = options.run.score_threshold
    if asked is None:
        return None
    from pomona.segment import load_segmenter

    usual = options.segment.kept_share * load_segmenter(options.run.model).traits.score_threshold
    return asked if asked < usual else None


def _segment(
    photos: Photos,
    digests: Mapping[str, str],
    *,
    options: SegmentChoice,
    own_key: str,
    work_dir: Path,
    progress: Progress,
) -> Segmented:
    if options.given is None:
        folder = work_dir / own_key
        files = {photo.name: folder / f"{digest([photo.name, digests[photo.name]])}.json" for photo in photos}
        return _by_model(photos, options, files, progress)
    from pomona.formats.detections.read import read_detections

    progress.start("reading the detections given")
    found = read_detections(options.given, photos, classes=options.classes, progress=progress)
    return Segmented(found, 0.0)  # who gives detections has chosen them


def _by_model(photos: Photos, options: SegmentChoice, files: Mapping[str, Path], progress: Progress) -> Segmented:
    """Segment photo after photo; each is kept in its file at once, so that a stopped run goes on with the next."""
    from pomona.formats.detections.coco import write_coco
    from pomona.segment import iter_detections, load_segmenter

    segmenter = load_segmenter(options.model.name)
    threshold = segmenter.traits.score_threshold
    chosen = options.options
    if options.lowest_score is not None:
        chosen = replace(chosen, kept_share=options.lowest_score / threshold)
    done, found = _done(photos, files), dict[str, Detections]()
    by_name = photos.by_name()
    for of_photo in iter_detections(photos, segmenter, options=chosen, progress=progress, done=done):
        found[of_photo.photo] = of_photo
        if of_photo.photo not in done:
            _keep(write_coco, files[of_photo.photo], by_name[of_photo.photo], of_photo)
    return Segmented(SurveyDetections(found), threshold)


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


def _save(segmented: Segmented, context: SurveyContext) -> Mapping[str, Any]:
    from pomona.formats.detections.coco import write_coco

    found = segmented.detections
    write_file(context.survey.detections, lambda path: write_coco(path, context.photos, found))
    return {"all_detections": found.total, "photos": len(found), "model_threshold": segmented.score_threshold}


def _load(info: Mapping[str, Any], context: SurveyContext) -> Segmented:
    from pomona.formats.detections.coco import read_coco

    return Segmented(read_coco(context.survey.detections, context.photos), float(info["model_threshold"]))


SEGMENT = Stage(
    name="segment",
    inputs={"photos": PHOTOS, "digests": DIGESTS},
    options=_choice,
    compute=_segment,
    store=Store(save=_save, load=_load, outputs=lambda survey: (survey.detections,)),
)
"""Writes `detections.json`."""
