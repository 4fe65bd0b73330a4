"""The whole job: photos in, a survey folder out; what is unchanged since an earlier run is kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pomona.errors import InputError, SurveyError
from pomona.pipeline.context import Context, load_photos
from pomona.pipeline.options import RunOptions
from pomona.pipeline.summary import Summary, summarise
from pomona.progress import Progress, Silent
from pomona.survey import Stage, Survey
from pomona.survey.files import disk_errors

STAGES = ("segment", "sfm", "scale", "fuse", "filter", "measure", "dense", "results", "report")
_STAGES_OF_PAPER = ("segment", "sfm", "scale", "dense", "fuse", "filter", "measure", "results", "report")


def run(
    sources: Sequence[Path],
    out: Path,
    options: RunOptions | None = None,
    progress: Progress | None = None,
    *,
    until: str = "report",
    overwrite: bool = False,
    on_stage: Callable[[str], None] = lambda name: None,
) -> Summary:
    """Make or go on with the survey in folder `out` of the photos in `sources`, up to and with stage `until`.

    Stages whose options and inputs are the same as in an earlier run are kept; `overwrite` forgets all of them.
    `on_stage` hears the name of each stage that has to be done. When it is stopped (Ctrl-C), the survey is whole, and
    the next run goes on with the stage that was stopped.

    Raises errors of `pomona.errors`: for photos and options that cannot be used, photos that cannot be placed, a
    folder that holds something else, a full disk.
    """
    from pomona.corrections import read_corrections

    options, listening = options or RunOptions(), _Kept(progress or Silent())
    if until not in STAGES:
        raise InputError(f"Stage '{until}': expected one of {', '.join(STAGES)}")
    options.check_files()
    paths = [Path(source).expanduser().resolve() for source in sources]
    survey = Survey.create(Path(out))
    with disk_errors(survey.folder), survey.locked():
        if overwrite:
            survey.clear()
        read_corrections(survey.corrections)  # a mistake in it is told of before hours of work
        survey.note(sources=paths, options=options.to_json())
        on_stage("photos")
        least = 1 if until == "segment" else 2
        photos, digests = load_photos(survey, paths, options.sides, listening, min_photos=least)
        skipped = tuple((file.name, file.reason) for file in photos.skipped)
        survey.note(
            photos=[{"name": p.name, "side": p.side, "digest": digests[p.name]} for p in photos],
            skipped=[{"name": name, "reason": reason} for name, reason in skipped],
        )
        context = Context(
            survey=survey,
            photos=photos,
            digests=digests,
            options=options,
            progress=listening,
            on_stage=on_stage,
            warnings=listening.warnings,
        )
        stages = make_stages(context)
        for name, stage in stages.items():
            stage.ensure()
            if name == until:
                break
        ran = {name for name, stage in stages.items() if stage.ran}
        summary = summarise(survey, len(photos), skipped, ran, tuple(listening.warnings))
        survey.note(summary=summary.to_json(), warnings=summary.warnings)
        return summary


def go_on(
    folder: Path,
    progress: Progress | None = None,
    *,
    until: str = "report",
    changed: dict[str, Any] | None = None,
    on_stage: Callable[[str], None] = lambda name: None,
) -> Summary:
    """Go on with an existing survey up to stage `until`, with the photos and options it was made with.

    `changed` are options that are to be other than they were. Raises what `run` raises, and `MissingFileError` when
    there is no survey in `folder`.
    """
    survey = Survey.open(folder)
    sources, options = survey.get("sources"), survey.get("options")
    if not sources or options is None:
        raise SurveyError(f"{survey.folder} does not say of which photos it is: use `pomona run PHOTOS --out` first")
    known = RunOptions.from_json({**options, **(changed or {})})
    return run([Path(p) for p in sources], survey.folder, known, progress, until=until, on_stage=on_stage)


def make_stages(context: Context) -> dict[str, Stage[Any]]:
    """Return all stages of a run by name, in order, each knowing those it depends on."""
    # Imported here, as they bring the engines: `pomona --help` has to be quick.
    from pomona.pipeline.correcting import Correcting
    from pomona.pipeline.fruits import dense_stage, filter_stage, fuse_stage, measure_stage, sphere_cloud_stage
    from pomona.pipeline.placing import scale_stage, sfm_stage
    from pomona.pipeline.results import report_stage, results_stage
    from pomona.pipeline.seeing import segment_stage

    segment = segment_stage(context)
    sfm = sfm_stage(context, segment)
    scale = scale_stage(context, segment, sfm)
    paper = context.options.method == "paper"
    cloud = dense_stage(context, segment, scale) if paper else None
    fuse = fuse_stage(context, segment, scale, cloud)
    filtered = filter_stage(context, segment, scale, fuse)
    measured = measure_stage(context, segment, scale, filtered)
    shown = measured if cloud else sphere_cloud_stage(context, segment, scale, measured)
    correcting = Correcting(context, segment, scale, shown)
    results = results_stage(context, scale, shown, correcting)
    report = report_stage(context, segment, sfm, scale, results, correcting)
    if cloud:
        found = (segment, sfm, scale, cloud, fuse, filtered, measured, results, report)
        return dict(zip(_STAGES_OF_PAPER, found, strict=True))
    return dict(zip(STAGES, (segment, sfm, scale, fuse, filtered, measured, shown, results, report), strict=True))


class _Kept:
    """Passes everything on, and keeps the warnings that are told outside of stages, such as on reading photos."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self.warnings: list[str] = []

    def start(self, label: str, total: int | None = None) -> None:
        self._progress.start(label, total)

    def advance(self, units: int = 1) -> None:
        self._progress.advance(units)

    def warn(self, message: str) -> None:
        self.warnings.append(message)
        self._progress.warn(message)
