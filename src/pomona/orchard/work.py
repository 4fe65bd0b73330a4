"""What a worker does: one survey or one comparison, wherever its photos are and its results go."""

from __future__ import annotations

import json
import os
import socket
import tempfile
import time
import traceback
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from pomona import __version__
from pomona.errors import InputError, MissingFileError, PomonaError, SurveyError
from pomona.orchard.folder import TABLES_OF_SURVEY
from pomona.orchard.jobs import Attempt, ComparisonJob, JobOutcome, SurveyJob
from pomona.orchard.places import Place, Sender, is_url
from pomona.pipeline import STAGES, RunOptions, run
from pomona.pipeline.code import code_digest, engine_versions
from pomona.progress import Silent
from pomona.survey import SurveyFolder
from pomona.survey.digest import digest
from pomona.survey.manifest import MANIFEST
from pomona.survey.record import now

_FIGURES = "comparison.json"


def do_job(job: SurveyJob | ComparisonJob, scratch: Path) -> JobOutcome:
    """Make a survey or a comparison and say what became of it: nothing that goes wrong with one stops the others.

    `scratch` is a local folder for copies of what is not on this machine.
    """
    began, start = now(), time.monotonic()
    try:
        if job.version != __version__:
            raise InputError(f"Pomona is {__version__} here and {job.version} where the orchard was started: use one")
        with tempfile.TemporaryDirectory(dir=scratch, prefix="pomona-") as folder:
            here = Path(folder)
            outcome = _survey(job, here) if isinstance(job, SurveyJob) else _comparison(job, here)
    except PomonaError as error:
        may_pass = isinstance(error, SurveyError)
        outcome = JobOutcome(name=job.name, state="failed", reason=job.words(str(error)), may_pass=may_pass)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".rstrip(": ")
        details = "".join(traceback.format_exception(error))
        outcome = JobOutcome(name=job.name, state="failed", reason=reason, may_pass=True, details=details)
    worker = f"{socket.gethostname()} {os.getpid()}"
    return replace(outcome, attempts=(Attempt(worker, began, round(time.monotonic() - start, 3), outcome.reason),))


# ---- surveys ---------------------------------------------------------------------------------------------------------


def _survey(job: SurveyJob, scratch: Path) -> JobOutcome:
    out = Place(job.out)
    made_from = _made_from(job)
    if job.left.get("from") == made_from and _is_as_left(out, job.left.get("manifest")):
        return JobOutcome(name=job.name, state="done", kept=True, left=job.left)
    photos = [Place(each).bring(scratch / f"photos-{k}") for k, each in enumerate(job.photos)]
    options = RunOptions.from_json(_with_files_here(job.options, scratch))
    folder = scratch / "survey" / out.name if out.is_remote else out.path
    send = _brought(out, folder).send if out.is_remote else lambda: None
    # What a stage has finished is there for another worker once the next one begins.
    summary = run(photos, folder, options, Silent(job.words), until=job.until, on_stage=lambda name: send())
    send()
    kept = all(stage.kept for stage in summary.stages)
    return JobOutcome(name=job.name, state="done", kept=kept, left={"from": made_from, "manifest": _mark(out)})


def _brought(out: Place, folder: Path) -> Sender:
    """Copy in what earlier attempts made of a survey; return what copies out what changes from here on."""
    folder.mkdir(parents=True)
    sender = Sender(folder, out, MANIFEST)
    if out.exists():
        out.bring(folder.parent)
        sender.know()
    return sender


def _with_files_here(options: Mapping[str, Any], scratch: Path) -> dict[str, Any]:
    """Return options with local copies in place of URLs."""
    urls = {name: Place(value) for name, value in options.items() if isinstance(value, str) and is_url(value)}
    return {**options, **{name: str(place.bring(scratch / f"option-{name}")) for name, place in urls.items()}}


def _made_from(job: SurveyJob) -> str:
    """A digest of all that decides what a survey is, without reading photos: names, sizes, times, options, code."""
    corrections = Place(job.out) / "corrections.json"
    named = [value for value in job.options.values() if isinstance(value, str) and _is_there(value)]
    named += [str(file) for file in _files_named_otherwise(job.options)]
    return digest(
        [
            _code(),
            job.parts[-1].until,
            job.options,
            [(place, Place(place).listing()) for place in (*job.photos, *named)],
            corrections.listing() if corrections.exists() else {},
        ]
    )


def _files_named_otherwise(options: Mapping[str, Any]) -> tuple[Path, ...]:
    """Return files here that options mean and do not name: of a model with classes, and beside a file of cameras."""
    from pomona.formats.cameras.read import find_cameras
    from pomona.stages.segment.load import files_of

    model, cameras = options.get("model"), options.get("cameras")
    files = files_of(model) if isinstance(model, str) and not is_url(model) else ()
    if isinstance(cameras, str) and not is_url(cameras) and Path(cameras).is_file():
        files = (*files, *find_cameras(Path(cameras)).files)
    return files


def _is_there(value: str) -> bool:
    """Whether an option's text is a file or folder: those that name one were made absolute."""
    place = Place(value)
    return place.is_remote or (Path(value).is_absolute() and place.exists())


@cache
def _code(*modules: str) -> str:
    """A digest of what the keys of stages say of code and engines: of some modules, or of all stages."""
    modules = modules or tuple(f"pomona.pipeline.{name}" for name in (*STAGES, "correct"))
    return digest([(module, code_digest(module), engine_versions(module)) for module in modules])


def _is_as_left(out: Place, manifest: str | None) -> bool:
    """Say whether nothing touched a survey since it was left so: the manifest is the same, and its files are there."""
    content = (out / MANIFEST).read_bytes()
    if content is None or manifest != _digest_of(content):
        return False
    stages: Mapping[str, Any] = json.loads(content)["stages"]
    outputs = [name for record in stages.values() for name in record["outputs"] if not name.startswith("work/")]
    return all((out / name).exists() for name in outputs)


def _mark(out: Place) -> str:
    return _digest_of((out / MANIFEST).read_bytes())


# ---- comparisons -----------------------------------------------------------------------------------------------------


def _comparison(job: ComparisonJob, scratch: Path) -> JobOutcome:
    import pomona

    out = Place(job.out)
    surveys = [Place(job.before), Place(job.after)]
    code = _code(), _code("pomona.change.surveys", "pomona.change.page")
    made_from = digest([code, [day.isoformat() for day in job.days], [_results_of(survey) for survey in surveys]])
    figures = (out / _FIGURES).read_bytes()
    if figures is not None and job.left.get("from") == made_from:
        return JobOutcome(name=job.name, state="done", kept=True, left=job.left, figures=json.loads(figures))
    before, after = (survey.bring(scratch, leave=("work",)) for survey in surveys)
    folder = scratch / "comparison" if out.is_remote else out.path
    found = pomona.compare(before, after, out=folder, dates=job.days, progress=Silent(job.words))
    if out.is_remote:
        Sender(folder, out, _FIGURES).send()
    return JobOutcome(name=job.name, state="done", left={"from": made_from}, figures=found.to_json())


def _results_of(survey: Place) -> list[str]:
    """The digests of what a comparison reads of a survey."""
    return [_digest_of((survey / name).read_bytes()) for name in TABLES_OF_SURVEY]


def _digest_of(content: bytes | None) -> str:
    return "" if content is None else digest(content.decode(errors="replace"))


def local_survey(survey: Place, scratch: Path) -> SurveyFolder:
    """Return a finished survey, of one at a URL only its manifest and tables; raises `MissingFileError`."""
    if not survey.is_remote:
        return SurveyFolder.open(survey.path)
    folder = scratch / survey.name
    folder.mkdir(parents=True, exist_ok=True)
    for name in TABLES_OF_SURVEY:
        content = (survey / name).read_bytes()
        if content is None:
            raise MissingFileError(f"{survey / name} does not exist")
        (folder / name).write_bytes(content)
    return SurveyFolder.open(folder)
