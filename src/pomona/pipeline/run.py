"""The whole job: photos in, a survey folder out; what is unchanged since an earlier run is kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from pomona.errors import FormatError, InputError, MissingFileError, PomonaError, SurveyError, few
from pomona.formats.files import is_there, resolved
from pomona.pipeline.given_tables import (
    checked_options,
    drop_set_aside_tables,
    keep_tables,
    put_back_tables,
    set_aside_tables,
    tables_gone,
)
from pomona.pipeline.names import STAGES
from pomona.pipeline.options import RunOptions, StageOptions
from pomona.pipeline.summary import Summary, summarise
from pomona.progress import Progress, Recorder, Silent, words_of
from pomona.survey import SurveyFolder
from pomona.survey.events import EventLog
from pomona.survey.files import disk_errors
from pomona.survey.photos import RUN_AGAIN
from pomona.values.photos import Photos

# Stages that look at photos one by one, wherever these were taken.
_OF_PHOTOS = ("segment", "select")
# What a person gave cannot be used: the same run again would fail again.
_REFUSED = (InputError, FormatError, MissingFileError)


def run(
    photos: Sequence[Path],
    out: Path,
    options: RunOptions | None = None,
    progress: Progress | None = None,
    *,
    until: str = "report",
    overwrite: bool = False,
    on_stage: Callable[[str], None] = lambda name: None,
) -> Summary:
    """Make or go on with the survey in folder `out` of the photos in `photos`, up to and with stage `until`.

    Stages whose options and inputs are the same as in an earlier run are kept; `overwrite` forgets all of them.
    `on_stage` is called with the name of each stage that has to be done. When it is stopped (Ctrl-C), the survey is
    whole, and the next run goes on with the stage that was stopped.

    Raises errors of `pomona.errors`: for photos and options that cannot be used, photos that cannot be placed, a
    folder that holds something else or a survey of entirely other photos, a full disk. Where photos cannot be used, no
    new folder is left, and a survey keeps its results, with `overwrite`, too.
    """
    options = options or RunOptions()
    if until not in STAGES:
        raise InputError(f"Stage '{until}': expected one of {', '.join(STAGES)}")
    used = checked_options(options, Path(out), overwrite=overwrite, places_photos=until not in _OF_PHOTOS)
    paths = [resolved(path) for path in photos]
    survey = SurveyFolder.create(Path(out), overwrite=overwrite)
    try:
        with disk_errors(survey.folder), survey.locked():
            log = EventLog(survey, progress or Silent(), on_stage=on_stage)
            with log, disk_errors(survey.folder):  # the log tells of a full disk in the same words
                return _run(paths, survey, options, used, log, words_of(progress or Silent()), until, overwrite)
    except PomonaError:
        survey.withdraw()
        raise


def _run(
    paths: Sequence[Path],
    survey: SurveyFolder,
    given: RunOptions,
    options: RunOptions,
    log: EventLog,
    words: Callable[[str], str],
    until: str,
    overwrite: bool,
) -> Summary:
    """Run with `options`: those `given`, which the survey notes, with its copies of tables that are gone.

    Messages are kept in the `words` of who listens.
    """
    # Imported here, as they bring the engines: `pomona --help` has to be quick.
    from pomona.corrections import read_corrections
    from pomona.pipeline.runner import Runner
    from pomona.pipeline.sources import sources_of
    from pomona.pipeline.stage import SurveyContext
    from pomona.pipeline.stages import stages_of

    recorder = Recorder(log, words)
    for table in tables_gone(given, options):
        recorder.warn(table)
    corrections = read_corrections(survey.corrections)  # a mistake in it is said before hours of work
    survey.check(sources=paths, options=given.to_json())
    log.stage("photos")
    of_stages = options.of_stages
    loaded, digests = _photos_for(survey, paths, of_stages, recorder, until=until)
    if overwrite:
        # Only now: photos that cannot be used are no reason to lose the results of others.
        frames = survey.work_folder / "frames"
        in_use = {frames.name} if any(photo.path.is_relative_to(frames) for photo in loaded) else set[str]()
        survey.clear(but={*in_use, "digests.json"})
    else:
        _check_same_row(survey, paths, loaded, digests, recorder)
    skipped = tuple((file.name, file.reason) for file in loaded.skipped)
    with _kept_unless_refused(survey):
        # Only now: a survey goes on with the photos and options that it has where these cannot be used.
        keep_tables(survey, options)
        survey.note(
            sources=paths,
            options=given.to_json(),
            photos=[{"name": p.name, "side": p.side, "digest": digests[p.name]} for p in loaded],
            skipped=[{"name": name, "reason": reason} for name, reason in skipped],
        )
        runner = Runner(
            SurveyContext(survey, loaded),
            of_stages,
            sources_of(loaded, digests, corrections),
            progress=recorder,
            on_stage=log.stage,
            warnings=recorder.warnings,
            words=words,
        )
        stages = stages_of(options.method, corrected=bool(corrections)).in_order
        survey.forget_records_but([stage.name for stage in stages])
        for stage in stages:
            runner.ensure(stage)
            if stage.name == until:
                break
    summary = summarise(
        survey,
        len(loaded),
        skipped,
        tuple(recorder.warnings),
        settled=runner.settled,
        ran=runner.ran,
        words=words,
    )
    survey.note(summary=summary.to_json(), warnings=summary.warnings)
    return summary


def _photos_for(
    survey: SurveyFolder, paths: Sequence[Path], options: StageOptions, progress: Progress, *, until: str
) -> tuple[Photos, Mapping[str, str]]:
    """Return the photos and their digests, once it is known that a run can do something with them."""
    from pomona.pipeline.sources import load_photos

    places_photos = until not in _OF_PHOTOS and options.run.cameras is None
    least = options.sfm.min_piece_photos if places_photos else 1
    photos, digests = load_photos(survey, paths, options.run, progress, min_photos=least)
    if places_photos:
        _check_sides(photos, least)
    return photos, digests


@contextmanager
def _kept_unless_refused(survey: SurveyFolder) -> Iterator[None]:
    """Let a run note its photos and options; where a stage refuses them, note those of the run before again.

    Commands that go on with the survey take its options: one that was refused would fail all of them.
    """
    before = {name: survey.get(name) for name in ("sources", "options", "photos", "skipped")}
    set_aside_tables(survey)
    try:
        yield
    except _REFUSED:
        if before["options"] is not None:
            survey.note(**before)
            put_back_tables(survey)
        raise
    finally:
        drop_set_aside_tables(survey)


def _check_sides(photos: Photos, least: int) -> None:
    """Raise `InputError` where no side of the row has enough photos to be placed, before any is looked at."""
    counts = {side: len(photos.of_side(side)) for side in photos.sides}
    if max(counts.values()) < least:
        found = ", ".join(f"{side} has {count}" for side, count in counts.items())
        raise InputError(
            f"Each side of a row is placed by itself, from {least} photos that overlap or more; found: {found}. Take "
            "more photos of a side, or, where all are of one side, use `sides` none"
        )


def _check_same_row(
    survey: SurveyFolder, paths: Sequence[Path], photos: Photos, digests: Mapping[str, str], progress: Progress
) -> None:
    """Raise `SurveyError` where a survey that has results shares no photo with this run, which would replace them.

    Photos are the same by their contents, wherever they lie and whatever they are called; those that were edited where
    they lie, by their names. A video is the same by its place: how its frames are chosen may have changed. Warns where
    photos are some of the survey's and others are left out, such as one side of two, or are no longer there.
    """
    before = {entry["name"]: entry["digest"] for entry in survey.get("photos") or () if entry.get("digest")}
    if not before or not any(record.finished for record in survey.records.values()):
        return
    in_place = [path.as_posix() for path in paths] == survey.get("sources")
    given = set(digests.values())
    if in_place and (photos.from_video or before.keys() & set(photos.names)):
        there = {*photos.names, *(file.name for file in photos.skipped)}
        gone = [name for name, digest in before.items() if name not in there and digest not in given]
        if gone and not photos.from_video:
            progress.warn(
                f"{len(gone)} of the {len(before)} photos that {survey.folder} was made of "
                f"{'is' if len(gone) == 1 else 'are'} no longer there ({few(gone, 2)}): its results become those of "
                "the others"
            )
        return
    if not set(before.values()) & given:
        raise SurveyError(
            f"{survey.folder} is a survey of other photos ({few([*before], 2)}): expected some of these, found "
            f"{few(photos.names, 2)}. Its results are kept: choose another `out`, or discard them with `overwrite`"
        )
    lacking = [name for name, digest in before.items() if digest not in given]
    if lacking and not in_place:
        progress.warn(
            f"{survey.folder} was made of {len(before)} photos, of which {len(lacking)} are not given now "
            f"({few(lacking, 2)}): its results become those of the others"
        )


def segment_only(
    photos: Sequence[Path],
    out: Path,
    progress: Progress | None = None,
    *,
    changed: Mapping[str, Any] | None = None,
    overwrite: bool = False,
    on_stage: Callable[[str], None] = lambda name: None,
) -> Summary:
    """Find the fruits in each photo with a segmenter, and no more; a survey in `out` keeps its other options.

    `changed` are options that are to be other than they were. Raises what `run` raises.
    """
    survey = None if overwrite else SurveyFolder.find(out)
    known = {} if survey is None else survey.options or {}
    # Masks that were given are not those of a segmenter.
    kept = RunOptions.from_json({**known, "detections": None, "classes": None})
    options = replace(kept, **(changed or {}))
    return run(photos, out, options, progress, until="select", overwrite=overwrite, on_stage=on_stage)


def go_on(
    folder: Path,
    progress: Progress | None = None,
    *,
    until: str = "report",
    changed: Mapping[str, Any] | None = None,
    on_stage: Callable[[str], None] = lambda name: None,
) -> Summary:
    """Go on with an existing survey up to stage `until`, with the photos and options it was made with.

    `changed` are options that are to be other than they were. Raises what `run` raises, and `MissingFileError` when
    there is no survey in `folder`, or its photos are not where it says.
    """
    survey = SurveyFolder.open(folder)
    sources, options = survey.get("sources"), survey.options
    if not sources or options is None:
        raise SurveyError(f"{survey.folder} does not say of which photos it is: use `pomona run PHOTOS --out` first")
    paths = [Path(source) for source in sources]
    for path in paths:
        if not is_there(path):
            raise MissingFileError(
                f"{path}, where {survey.folder.name} has its photos from, does not exist. {RUN_AGAIN}"
            )
    known = replace(RunOptions.from_json(options), **(changed or {}))
    return run(paths, survey.folder, known, progress, until=until, on_stage=on_stage)
