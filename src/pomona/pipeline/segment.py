"""Stage `segment`: the detections of every photo, by a segmenter or from a file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pomona.errors import PomonaError
from pomona.pipeline.stage import DIGESTS, PHOTOS, Stage, Store, SurveyContext
from pomona.progress import Progress
from pomona.survey.digest import digest, file_digest
from pomona.survey.files import write_file
from pomona.survey.sealed import is_sealed, seal
from pomona.values.detections import Detections, SurveyDetections
from pomona.values.photos import Photo, Photos

if TYPE_CHECKING:
    from pomona.pipeline.options import StageOptions
    from pomona.stages.segment.photo_detections import SegmentOptions
    from pomona.stages.segment.reading_scale import ReadingScales

_SCALES = ".scales"  # of files with the scales at which photos are read; those with their detections are `.json`


@dataclass(frozen=True, eq=False)
class Segmented:
    """All detections, weak ones too, and the score from which one counts in a single photo, as the model says.

    Those that a person gave have all been chosen: they count from 0 on.
    """

    detections: SurveyDetections
    score_threshold: float

    @property
    def were_given(self) -> bool:
        """Whether a person gave them: a model has a threshold."""
        return self.score_threshold == 0


@dataclass(frozen=True)
class ModelChoice:
    """A segmenter, by what a person said and the files which that means."""

    name: str | None
    files: tuple[Path, ...]

    @property
    def content_key(self) -> Any:
        """A plain file is known by its content alone, as it may be moved."""
        said = None if self.name is None or Path(self.name).is_file() else self.name
        return [said, [file_digest(path) for path in self.files]]


@dataclass(frozen=True)
class GivenMasks:
    """A file or folder of masks, with the files beside a folder that may name its classes."""

    path: Path

    @property
    def content_key(self) -> Any:
        """What is read of them."""
        from pomona.formats.detections.yolo import files_of_names_beside

        return [self.path, *(files_of_names_beside(self.path) if self.path.is_dir() else ())]


@dataclass(frozen=True, kw_only=True)
class SegmentChoice:
    """Who detects: a model with its options, or the masks in a file with the classes that are fruit; beside these,
    `model` is what a person named all the same.

    `lowest_score`: detections down to this are kept, where that is lower than what is kept anyway (None: it is not).
    `engines` are those that the model needs besides the usual ones, with their versions.
    """

    model: ModelChoice
    options: SegmentOptions
    lowest_score: float | None
    engines: Mapping[str, str]
    given: GivenMasks | None
    classes: tuple[str, ...] | None

    def kept_from(self, threshold: float) -> SegmentOptions:
        """Return the options of a segmenter whose score threshold is this."""
        if self.lowest_score is None:
            return self.options
        return replace(self.options, kept_share=self.lowest_score / threshold)


def _choice(options: StageOptions) -> SegmentChoice:
    from pomona.pipeline.code import version_of
    from pomona.stages.segment.load import engines_of, files_of

    run = options.run
    named = run.model if run.detections else run.segmenter
    return SegmentChoice(
        model=ModelChoice(named, files_of(named)),
        # The file keeps weak detections with their scores, so that another threshold needs no other file.
        options=replace(options.segment, score_threshold=None),
        lowest_score=None if run.detections else _lowest_score(options),
        engines={name: version_of(name) for name in engines_of(named)},
        given=None if run.detections is None else GivenMasks(run.detections),
        classes=run.classes,
    )


def _lowest_score(options: StageOptions) -> float | None:
    asked = options.run.score_threshold
    if asked is None:
        return None
    from pomona.stages.segment import load_segmenter

    usual = options.segment.kept_share * load_segmenter(options.run.segmenter).traits.score_threshold
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
        return _by_model(photos, digests, options, work_dir / own_key, progress)
    from pomona.formats.detections.read import read_detections

    if options.model.name is not None:
        progress.warn(f"`model` {options.model.name} looks at no photo: the fruits in them are those of `detections`")
    progress.start("reading the detections given")
    found = read_detections(options.given.path, photos, classes=options.classes, progress=progress)
    return Segmented(found, 0.0)


def _by_model(
    photos: Photos, digests: Mapping[str, str], options: SegmentChoice, folder: Path, progress: Progress
) -> Segmented:
    """Segment photo after photo; each is kept in its file at once, so that a stopped run goes on with the next."""
    from pomona.formats.detections.coco import write_coco
    from pomona.stages.segment import iter_detections, load_segmenter, scales_of

    folder.mkdir(parents=True, exist_ok=True)
    segmenter = load_segmenter(options.model.name, score_floor=options.lowest_score)
    chosen = options.kept_from(segmenter.traits.score_threshold)
    of_all = folder / f"{digest([(p.name, digests[p.name], p.side, p.lens_key) for p in photos])}{_SCALES}"
    scales = _read_scales(of_all, photos)
    if scales is None:
        scales = scales_of(photos, segmenter, chosen, progress)
        _keep_scales(of_all, scales)
    files = {photo.name: _file_of(folder, photo, digests[photo.name], scales.by_name[photo.name]) for photo in photos}
    done, found = _done(photos, files), dict[str, Detections]()
    by_name = photos.by_name()

    def keep(of_photo: Detections) -> None:
        _keep(write_coco, files[of_photo.photo], by_name[of_photo.photo], of_photo)

    for of_photo in iter_detections(
        photos, segmenter, options=chosen, progress=progress, done=done, scales=scales, keep=keep
    ):
        found[of_photo.photo] = of_photo
    return Segmented(SurveyDetections(_numbered(found)), segmenter.traits.score_threshold)


def _keep_scales(path: Path, scales: ReadingScales) -> None:
    """Keep the scales of all photos: to find them takes about a fifth of the stage's time in a short row."""

    def write(temporary: Path) -> None:
        temporary.write_text(json.dumps({"scales": dict(scales.by_name)}), encoding="utf-8")
        seal(temporary)

    write_file(path, write, folder_is_there=True)


def _read_scales(path: Path, photos: Photos) -> ReadingScales | None:
    """Return the scales that an earlier run found for the same photos; None where there are none, or damaged ones."""
    from pomona.stages.segment import ReadingScales

    if not is_sealed(path):
        return None
    kept = json.loads(path.read_text(encoding="utf-8"))["scales"]
    return ReadingScales({name: kept[name] for name in photos.names})


def _numbered(found: Mapping[str, Detections]) -> dict[str, Detections]:
    """Give detections the ids 1, 2, … in the photos' order: the same whichever of them an earlier run had kept."""
    ends = np.cumsum([len(of_photo) for of_photo in found.values()]).tolist()
    return {
        name: replace(of_photo, ids=np.arange(end - len(of_photo), end) + 1)
        for (name, of_photo), end in zip(found.items(), ends, strict=True)
    }


def _file_of(folder: Path, photo: Photo, content: str, scale: float) -> Path:
    """Where the detections of a photo are kept, by the digest of its content and the scale at which it was read."""
    return folder / f"{digest([photo.name, content, scale])}.json"


def _keep(write_coco: Any, path: Path, photo: Photo, found: Detections) -> None:
    of_one = SurveyDetections({photo.name: found})

    def write(temporary: Path) -> None:
        write_coco(temporary, Photos((photo,)), of_one)
        seal(temporary)

    # Not made anew: a survey that was removed, or whose disk was taken away, is told of at the next photo.
    write_file(path, write, folder_is_there=True)


def _done(photos: Photos, files: Mapping[str, Path]) -> dict[str, Detections]:
    """Detections that an earlier, stopped run kept; what is damaged is done again."""
    from pomona.formats.detections.coco import read_coco

    done: dict[str, Detections] = {}
    for photo in photos:
        if not is_sealed(files[photo.name]):
            continue
        try:
            done[photo.name] = read_coco(files[photo.name], Photos((photo,)))[photo.name]
        except (PomonaError, KeyError):
            continue
    return _numbered(done)


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


class PhotoByPhoto:
    """Detections of photos as they come in, each kept where a run with the same options finds it.

    At which scale photos are read is found out once for each side and camera, from the first photos that are there. A
    run of all photos that finds another one reads those photos again.
    """

    def __init__(self, options: StageOptions, own_key: str, work_dir: Path) -> None:
        from pomona.stages.segment import load_segmenter

        choice = _choice(options)
        self._folder = work_dir / own_key
        self._folder.mkdir(parents=True, exist_ok=True)
        self._segmenter = load_segmenter(choice.model.name, score_floor=choice.lowest_score)
        self._threshold = self._segmenter.traits.score_threshold
        self._options = choice.kept_from(self._threshold)
        self._scales: dict[tuple[str, tuple[str, int, int]], float] = {}
        self._found: dict[str, Detections] = {}  # their ids count from 1 in each photo

    @property
    def segmented(self) -> Segmented:
        """All that was found so far."""
        return Segmented(SurveyDetections(_numbered(self._found)), self._threshold)

    def detect(self, photo: Photo, content: str, photos: Photos, progress: Progress) -> None:
        """Find the fruits in a photo, by the digest of its content; `photos` are those to learn the reading scale from.

        A photo that cannot be read is warned of, and has no detections.
        """
        from pomona.formats.detections.coco import write_coco
        from pomona.stages.segment import iter_detections

        one, scales = Photos((photo,)), self._scales_for(photo, photos, progress)
        path = _file_of(self._folder, photo, content, scales.by_name[photo.name])
        done = _done(one, {photo.name: path})
        for found in iter_detections(
            one, self._segmenter, options=self._options, progress=progress, done=done, scales=scales
        ):
            self._found[photo.name] = found
            if photo.name not in done:
                _keep(write_coco, path, photo, found)

    def _scales_for(self, photo: Photo, photos: Photos, progress: Progress) -> ReadingScales:
        from pomona.stages.segment import ReadingScales, scales_of

        group = photo.side, photo.lens_key
        if group in self._scales:
            return ReadingScales({photo.name: self._scales[group]})
        alike = tuple(p for p in photos if (p.side, p.lens_key) == group)
        first = Photos(alike[: self._options.sample_photos])
        found = scales_of(first, self._segmenter, self._options, progress)
        self._scales[group] = found.by_name[alike[0].name]
        return ReadingScales({photo.name: self._scales[group]}, found.seen)
