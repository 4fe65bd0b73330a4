"""A run's status as the page shows it: the stages in order, and how long it will take yet."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from pomona.browser.app.contract import RunView, StageView
from pomona.pipeline import STAGES
from pomona.survey.events import RunStatus

# How long stages take beside each other, on two cores: the bundled sample, and 34 photos of 1 megapixel.
_SHARES = {
    "photos": 0.01, "segment": 0.33, "sfm": 0.42, "scale": 0.16, "fuse": 0.015, "second_look": 0.035, "scene": 0.12,
}  # fmt: skip
_SMALL_SHARE = 0.005


def run_view(
    status: RunStatus | None,
    finished: Mapping[str, float],
    *,
    photos: int = 0,
    log: Collection[str] = (),
    message: str = "",
    by_other: bool = False,
) -> RunView:
    """Return what is shown of a run.

    `photos` is how many there are (0: not known yet). `finished` are the stages whose results the survey has, and how
    many seconds each took; `log` is what a run of this program said, `message` why it failed (the status knows that of
    a run that got as far as the folder).
    """
    taken = {stage.name: stage.seconds for stage in status.stages} if status else {}
    present = status.stage if status and status.state != "finished" else ""
    names = ["photos", *STAGES]
    if "learn" in taken:
        names.append("learn")
    return RunView(
        stages=[_stage(name, taken, present, finished) for name in names],
        label=status.label if status else "",
        done=status.done if status else 0,
        total=status.total if status else None,
        left_s=seconds_left(status, photos),
        warnings=list(status.warnings) if status else [],
        message=message or (status.message if status else ""),
        log=list(log),
        by_other=by_other,
    )


def seconds_left(status: RunStatus | None, photos: int) -> float | None:
    """Return about how long a run will take yet; None where nothing is known.

    The stages that are done say how fast this computer is; before that, the photos in which fruits were looked for.
    """
    if status is None or status.state != "running" or not status.stages:
        return None
    *done, present = status.stages
    later = STAGES[STAGES.index(present.name) + 1 :] if present.name in STAGES else STAGES
    if present.name not in ("photos", *STAGES):
        return status.step_left_s
    step_left_s = status.step_left_s
    shares = sum(_share(stage.name) for stage in done)
    if shares > _SHARES["photos"]:
        whole_s = sum(stage.seconds for stage in done) / shares
    elif step_left_s is not None and present.name == "segment" and status.total == photos:
        whole_s = (present.seconds + step_left_s) / _share(present.name)
    else:
        return None
    here_s = max(step_left_s or 0.0, _share(present.name) * whole_s - present.seconds)
    return here_s + whole_s * sum(_share(name) for name in later)


def _share(stage: str) -> float:
    return _SHARES.get(stage, _SMALL_SHARE)


def _stage(name: str, taken: Mapping[str, float], present: str, finished: Mapping[str, float]) -> StageView:
    if name == present:
        return StageView(name, "now", round(taken[name], 1))
    if name in taken:
        return StageView(name, "done", round(taken[name], 1))
    # Photos are looked at in every run, which is no result that is kept.
    kept = name in finished or (name == "photos" and len(finished) > 0)
    return StageView(name, "kept" if kept else "waiting", finished.get(name))
