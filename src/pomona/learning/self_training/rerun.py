"""`pomona run --adapt`: a survey whose segmenter learnt from it, and found its fruits again."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pomona.errors import InputError, MissingExtraError, MissingFileError, few
from pomona.evaluate.rates import written
from pomona.export.survey import SurveySource
from pomona.learning.marks import MarkedPhoto, read_marks
from pomona.learning.self_training.halves import agreement_of_halves
from pomona.learning.self_training.labels import FoundFruits
from pomona.learning.self_training.learnt import Learnt, read_learnt, taught, write_learnt
from pomona.learning.self_training.options import AdaptOptions
from pomona.pipeline import RunOptions, Summary
from pomona.pipeline import run as run_pipeline
from pomona.pipeline.given_tables import checked_options
from pomona.progress import Progress
from pomona.survey import SurveyFolder
from pomona.survey.events import EventLog

if TYPE_CHECKING:
    from pomona.learning.self_training.learn import Adapted


@dataclass(frozen=True)
class Rerun:
    """The end of a run that adapts: its summary, and of the learning, in words, what it `changed`."""

    summary: Summary
    changed: str


def found_fruits(survey: SurveySource) -> FoundFruits:
    """Return the fruits of a survey as corrected, and what saw them.

    Raises `MissingFileError` where no run got so far or none of its photos is found, and `FormatError` for damaged
    files.
    """
    if not any(photo.path.is_file() for photo in survey.photos):
        raise MissingFileError(f"{survey.folder}: none of its photos was found; learning needs them")
    if (both := survey.corrected()) is None:
        detections, observations = survey.detections, survey.observations
        by_hand, false_ids = frozenset[int](), frozenset[int]()
    else:
        corrected = both[1]
        detections, observations = corrected.detections, corrected.observations
        by_hand, false_ids = frozenset(corrected.how), corrected.false_ids
    return FoundFruits(
        survey.folder.name,
        survey.photos,
        survey.poses,
        detections,
        survey.fruits,
        observations,
        by_hand & frozenset(survey.fruits.ids.tolist()),
        false_ids,
        _marks_of(survey),
    )


def _marks_of(survey: SurveySource) -> dict[str, MarkedPhoto]:
    """Return the marked photos of a survey by its names; warns of those that it does not have."""
    marked = read_marks(survey.files.marks, survey.photos.names)
    if strangers := [name for name in marked if name not in survey.photos.names]:
        survey.progress.warn(
            f"{survey.files.marks}: marks of photos that the survey does not have were left out: {few(strangers)}"
        )
    return marked


def model_of(survey: SurveySource) -> Path | None:
    """Return the model file that a survey was made with; None: the usual shipped one.

    Raises `InputError` where its detections came from something that cannot learn.
    """
    options = survey.files.options or {}
    model = options.get("model")
    _check_can_learn(options.get("detections"), model, f"{survey.folder}: its ")
    used = model or RunOptions(fruit=options.get("fruit")).segmenter
    return None if used is None else Path(used)


def _check_can_learn(detections: object, model: str | None, whose: str = "") -> None:
    """Raise `InputError` where detections come from something that cannot learn."""
    if detections:
        raise InputError(f"{whose}`detections` were given, so that there is no model that could learn")
    if model is not None and Path(model).suffix != ".onnx":
        raise InputError(f"{whose}`model` is {model}, expected the shipped one or a .onnx")


def run_adapted(
    photos: Sequence[Path],
    out: Path,
    options: RunOptions,
    progress: Progress,
    *,
    overwrite: bool = False,
    on_stage: Callable[[str], None] = lambda name: None,
    adapting: AdaptOptions | None = None,
) -> Rerun:
    """Make a survey, let its segmenter learn from it, and find its fruits again with what was learnt.

    The results of before are kept in the survey's folder `before_adapting/`, and what came of it in `learnt.json`. A
    survey that was adapted already is made with its own segmenter at once, and learns on only where a person marked or
    corrected something since; where confirmed fruits in photos held out are found worse, or two halves of the photos
    agree less, its results stay as they are.

    Raises what `run` and `adapt` raise, before anything is made where the segmenter cannot learn, and
    `MissingExtraError` without the extra `train`.
    """
    learn = learning()
    checked_options(options, out, overwrite=overwrite)
    _check_can_learn(options.detections, options.model)  # before hours of work
    if options.model is not None:
        from pomona.learning.train.center import arch_of

        arch_of(Path(options.model))
    survey = None if overwrite else SurveyFolder.find(out)
    if survey is not None and survey.adapted_model.is_file():
        options = replace(options, model=str(survey.adapted_model))
        known = read_learnt(survey)
        if known.taught == taught(survey) if known else not survey.marks.is_file():
            summary = run_pipeline(photos, out, options, progress, on_stage=on_stage)
            return Rerun(summary, f"made with {survey.adapted_model.name}, which learnt from this survey before")
    first = run_pipeline(photos, out, options, progress, overwrite=overwrite, on_stage=on_stage)
    source = SurveySource(SurveyFolder.open(out), progress=progress)
    given = taught(source.files)
    # Until it is judged, the model is not where another run would take it from.
    target = source.files.unjudged_model
    with source.files.locked(), EventLog(source.files, progress, on_stage=on_stage) as log:
        log.stage("learn")
        outcome = learn([found_fruits(source)], target, model=model_of(source), options=adapting, progress=log)
    learnt, in_words = Learnt.of(outcome, given), _in_words(outcome)
    if outcome.path is None:
        write_learnt(source.files, learnt)
        return Rerun(first, f"nothing: {in_words}, so the results stay as they are")

    def made(with_options: RunOptions, until: str = "report") -> Summary:
        return run_pipeline(photos, out, with_options, progress, until=until, on_stage=on_stage)

    before, detections = _agreement(source, options), _count(source)
    source.files.keep_results()
    mine = replace(options, model=str(outcome.path))
    made(mine, until="select")
    again = SurveySource(SurveyFolder.open(out), progress=progress)
    after = _agreement(again, mine)
    learnt = replace(learnt, halves=(before, after), detections=(detections, _count(again)))
    in_words += f"; two halves of the photos agree on {_percent(before)} of their fruits, then on {_percent(after)}"
    # Halves without any fruit agree on nothing, which is less than whatever others do.
    if math.isnan(after) or after < before:
        source.files.drop_kept()
        write_learnt(source.files, learnt)
        return Rerun(made(options), f"nothing that holds: {in_words}, so the results are those of before")
    second = made(replace(options, model=str(source.files.take_adapted(outcome.path))))
    write_learnt(source.files, replace(learnt, kept=True, fruits=(first.fruits, second.fruits)))
    kept = source.files.before_adapting
    return Rerun(second, f"{first.fruits} fruits to {second.fruits}; {in_words}; the results of before are in {kept}")


def _percent(share: float) -> str:
    return "none" if math.isnan(share) else f"{100 * share:.0f} %"


def _in_words(outcome: Adapted) -> str:
    """What the learning changed on fruits in photos held out."""
    in_words = f"F1 {written(outcome.before.f1)} to {written(outcome.after.f1)} on confirmed fruits in photos held out"
    if outcome.by_hand is not None:
        before, after = outcome.by_hand
        in_words += f", {written(before.f1)} to {written(after.f1)} on the {before.fruits} of them marked by hand"
    return in_words


def _agreement(survey: SurveySource, options: RunOptions) -> float:
    """How far halves of the photos agree, with the detections that the survey has now, in its cameras."""
    detections = survey.detections.at_least(survey.least_score)
    return agreement_of_halves(detections, survey.photos, survey.cameras, options=options, progress=survey.progress)


def _count(survey: SurveySource) -> int:
    """How many detections count as fruit."""
    return sum(len(found.ids) for found in survey.detections.at_least(survey.least_score).values())


def learning() -> Callable[..., Adapted]:
    """Return `learn.adapt`; raises `MissingExtraError` without the extra `train`."""
    try:
        from pomona.learning.self_training.learn import adapt
    except ImportError as error:
        raise MissingExtraError(f"{error}: install it with pip install 'pomona[train]'") from None
    return adapt
