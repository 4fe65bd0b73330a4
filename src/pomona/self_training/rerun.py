"""`pomona run --adapt`: a survey whose segmenter learnt from it, and found its fruits again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pomona.errors import InputError, MissingExtraError
from pomona.export.survey import SurveySource
from pomona.pipeline import RunOptions, Summary
from pomona.pipeline import run as run_pipeline
from pomona.progress import Progress
from pomona.self_training.halves import agreement_of_halves
from pomona.self_training.labels import FoundFruits
from pomona.self_training.options import AdaptOptions
from pomona.survey import SurveyFolder
from pomona.survey.events import EventLog

if TYPE_CHECKING:
    from pomona.self_training.learn import Adapted


@dataclass(frozen=True)
class Rerun:
    """The end of a run that adapts: its summary, and of the learning, in words, what it `changed`."""

    summary: Summary
    changed: str


def found_fruits(survey: SurveySource) -> FoundFruits:
    """Return the fruits of a survey as corrected, and what saw them.

    Raises `MissingFileError` where no run got so far, and `FormatError` for damaged files.
    """
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
    )


def model_of(survey: SurveySource) -> Path | None:
    """Return the model file that a survey was made with; None: the shipped one.

    Raises `InputError` where its detections came from something that cannot learn.
    """
    options = survey.files.get("options", {})
    if options.get("detections"):
        raise InputError(f"{survey.folder}: its `detections` were given, so that there is no model that could learn")
    model = options.get("model")
    if model is not None and Path(model).suffix != ".onnx":
        raise InputError(f"{survey.folder}: its `model` is {model}, expected the shipped one or a .onnx")
    return None if model is None else Path(model)


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

    The results of before are kept in the survey's folder `before_adapting/`. A survey that was adapted already is made
    with its own segmenter at once; where confirmed fruits in photos held out are found worse, or two halves of the
    photos agree less, its results stay as they are.

    Raises what `run` and `adapt` raise, and `MissingExtraError` without the extra `train`.
    """
    learn = learning()
    survey = SurveyFolder.create(out)
    if not overwrite and survey.adapted_model.is_file():
        mine = replace(options, model=str(survey.adapted_model))
        summary = run_pipeline(photos, out, mine, progress, on_stage=on_stage)
        return Rerun(summary, f"made with {survey.adapted_model.name}, which learnt from this survey before")
    first = run_pipeline(photos, out, options, progress, overwrite=overwrite, on_stage=on_stage)
    source = SurveySource(SurveyFolder.open(out), progress=progress)
    # Until it is judged, the model is not where another run would take it from.
    target = source.files.work("adapted.onnx")
    with EventLog(source.files, progress, on_stage=on_stage) as log:
        log.stage("learn")
        outcome = learn([found_fruits(source)], target, model=model_of(source), options=adapting, progress=log)
    in_words = f"F1 {outcome.before.f1:.3f} to {outcome.after.f1:.3f} on confirmed fruits in photos held out"
    if outcome.path is None:
        return Rerun(first, f"nothing: {in_words}, so the results stay as they are")
    before = _agreement(source, options)
    source.files.keep_results()
    mine = replace(options, model=str(outcome.path))
    run_pipeline(photos, out, mine, progress, until="select", on_stage=on_stage)
    after = _agreement(SurveySource(SurveyFolder.open(out), progress=progress), mine)
    in_words += f"; two halves of the photos agree on {100 * before:.0f} % of their fruits, then on {100 * after:.0f} %"
    if not after >= before:
        source.files.drop_kept()
        back = run_pipeline(photos, out, options, progress, on_stage=on_stage)
        return Rerun(back, f"nothing that holds: {in_words}, so the results are those of before")
    mine = replace(options, model=str(source.files.take_adapted(outcome.path)))
    second = run_pipeline(photos, out, mine, progress, on_stage=on_stage)
    kept = source.files.before_adapting
    return Rerun(second, f"{first.fruits} fruits to {second.fruits}; {in_words}; the results of before are in {kept}")


def _agreement(survey: SurveySource, options: RunOptions) -> float:
    """How far halves of the photos agree, with the detections that the survey has now, in its cameras."""
    detections = survey.detections.at_least(survey.least_score)
    return agreement_of_halves(detections, survey.photos, survey.cameras, options=options, progress=survey.progress)


def learning() -> Callable[..., Adapted]:
    """Return `learn.adapt`; raises `MissingExtraError` without the extra `train`."""
    try:
        from pomona.self_training.learn import adapt
    except ImportError as error:
        raise MissingExtraError(f"{error}: install it with pip install 'pomona[train]'") from None
    return adapt
