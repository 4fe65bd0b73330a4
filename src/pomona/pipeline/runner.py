"""Runs declared stages in one survey: reads back what is still valid, computes and keeps the rest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from threadpoolctl import ThreadpoolController

from pomona.errors import FormatError, InputError, SurveyError
from pomona.pipeline.code import code_digest, engine_versions
from pomona.pipeline.stage import RUN_LOG, Fact, Input, RunLog, Source, Stage, SurveyContext
from pomona.progress import Progress, Recorder
from pomona.survey import StageRecord, SurveyFolder
from pomona.survey.digest import content_key, digest, file_digest
from pomona.survey.files import disk_errors, flush_name, flush_to_disk
from pomona.survey.record import Meter, now
from pomona.survey.unfinished import unfinished_in_words

if TYPE_CHECKING:
    from pomona.pipeline.options import StageOptions

T = TypeVar("T")


@dataclass(frozen=True)
class SourceValue:
    """What a source gives to the functions of stages, and the token that stands for it in their keys."""

    value: Any
    token: Any


@contextmanager
def _one_thread_of_libraries() -> Iterator[None]:
    """Have linear algebra and OpenCV take one thread each time they are called: stages share out the cores themselves.

    Sums of several threads have other last digits with each number of them, and OpenCV's cost a third more in all.
    """
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with _linear_algebra().limit(limits=1):
            yield
    finally:
        cv2.setNumThreads(before)


@cache
def _linear_algebra() -> ThreadpoolController:
    """Find the libraries of linear algebra: NumPy's, and SciPy's own, which must be there to be told."""
    import scipy.linalg  # noqa: F401

    return ThreadpoolController().select(user_api="blas")


class Runner:
    """One run of stages in one survey. Each stage is checked, and if need be computed, at most once.

    `finished` names stages that are taken as an earlier run left them, whatever they were made from: without the photos
    that cannot be known. `warnings` are those given outside of stages. `on_stage` is called with the name of each stage
    that is computed. `words` puts messages as who listens knows them.
    """

    def __init__(
        self,
        context: SurveyContext,
        options: StageOptions,
        sources: Mapping[Source, SourceValue],
        *,
        progress: Progress,
        on_stage: Callable[[str], None] = lambda name: None,
        warnings: Sequence[str] = (),
        finished: frozenset[str] = frozenset(),
        words: Callable[[str], str] = str,
    ) -> None:
        self._context, self._options, self._sources = context, options, sources
        self._progress, self._on_stage, self._warnings = progress, on_stage, warnings
        self._finished, self._words = finished, words
        self._records: dict[Stage[Any], StageRecord] = {}
        self._values: dict[Stage[Any], Any] = {}
        self.ran: set[str] = set()

    @property
    def settled(self) -> frozenset[str]:
        """The names of the stages whose results are there, as this run's photos and options make them."""
        return frozenset(stage.name for stage in self._records)

    @property
    def _survey(self) -> SurveyFolder:
        return self._context.survey

    def ensure(self, stage: Stage[Any]) -> StageRecord:
        """Make sure that the result of a stage with a store is there; return what the manifest keeps of it."""
        if stage not in self._records:
            record = self._valid_record(stage)
            if record is None or not self._intact(record, public_only=True):
                record = self._run(stage)
            self._records[stage] = record
        return self._records[stage]

    def value(self, stage: Stage[T]) -> T:
        """Return the value of a stage, read back or computed."""
        if stage in self._values:
            value: T = self._values[stage]
            return value
        if stage.store is None:
            self._values[stage] = stage.compute(**self._arguments(stage, self._progress))
            return self.value(stage)
        record = self.ensure(stage)
        if stage not in self._values:
            if stage.store.load is None:
                self._values[stage] = stage.compute(**self._arguments(stage, self._progress))
            elif self._intact(record, public_only=False):
                self._values[stage] = self._loaded(stage, record)
            else:
                self._records[stage] = self._run(stage)
        return self.value(stage)

    def _loaded(self, stage: Stage[Any], record: StageRecord) -> Any:
        assert stage.store is not None
        assert stage.store.load is not None
        try:
            return stage.store.load(record.info, self._context)
        except (KeyError, FormatError) as error:
            if stage.name in self._finished:
                raise self._lost(stage) from error
            raise

    def _token(self, source: Input) -> Any:
        """What stands for an input in the keys of the stages that take it."""
        if isinstance(source, Fact):
            return self.ensure(source.stage).info[source.name]
        if isinstance(source, Source):
            return self._sources[source].token if source.watched else None
        return self._fingerprint(source) if source.store is None else self.ensure(source).token

    def _input(self, source: Input) -> Any:
        if isinstance(source, Fact):
            return self.ensure(source.stage).info[source.name]
        if source == RUN_LOG:
            chosen = self._survey.get("options") or {}
            return RunLog(self._survey.folder.name, self._survey.records, self._warnings, chosen, self._words)
        return self._sources[source].value if isinstance(source, Source) else self.value(source)

    def _fingerprint(self, stage: Stage[Any]) -> str:
        return digest(
            [own_key(stage, self._options), {name: self._token(source) for name, source in stage.inputs.items()}]
        )

    def _made_from(self, stage: Stage[Any]) -> dict[str, str]:
        """What stands for the stages and facts that a stage takes, directly or through stages without a store."""
        found: dict[str, str] = {}
        for source in stage.inputs.values():
            if isinstance(source, Fact):
                found[f"{source.stage.name}: {source.name}"] = digest(self._token(source))
            elif isinstance(source, Stage):
                found |= self._made_from(source) if source.store is None else {source.name: self.ensure(source).token}
        return found

    def _arguments(self, stage: Stage[Any], progress: Progress) -> dict[str, Any]:
        given = {name: self._input(source) for name, source in stage.inputs.items()}
        if stage.options:
            given["options"] = stage.options(self._options)
        if "own_key" in stage.parameters:
            given["own_key"] = own_key(stage, self._options)
        if "work_dir" in stage.parameters:
            given["work_dir"] = self._survey.work(stage.name)
        if "progress" in stage.parameters:
            given["progress"] = progress
        return given

    def _valid_record(self, stage: Stage[Any]) -> StageRecord | None:
        record = self._survey.record_of(stage.name)
        if record is None or not record.finished:
            return None
        return record if stage.name in self._finished or record.fingerprint == self._fingerprint(stage) else None

    def _intact(self, record: StageRecord, *, public_only: bool) -> bool:
        work = self._survey.work_folder
        for name, expected in record.outputs.items():
            path = self._survey.folder / name
            if public_only and work in path.parents:
                continue
            if not path.exists() or file_digest(path) != expected:
                return False
        return True

    def _run(self, stage: Stage[Any]) -> StageRecord:
        if stage.name in self._finished:
            raise self._lost(stage)
        for earlier in stage.stages:  # before the clock starts
            self.value(earlier)
        fingerprint = self._fingerprint(stage)
        self._on_stage(stage.name)
        before = self._survey.record_of(stage.name)
        goes_on = before is not None and not before.finished and before.fingerprint == fingerprint
        earlier_s, earlier_used_s = (before.wall_s, before.processor_s) if before and goes_on else (0.0, 0.0)
        self._keep_edited(before)
        meter, recorder = Meter(), Recorder(self._progress)
        unfinished = StageRecord(
            fingerprint=fingerprint,
            finished=False,
            wall_s=earlier_s,
            processor_s=earlier_used_s,
            outputs=before.outputs if before else {},
            made_from=self._made_from(stage),
        )
        try:
            with disk_errors(self._survey.folder):
                self._survey.set_record(stage.name, unfinished)  # for a run that ends without a word
                value, outputs, info = self._computed(stage, recorder)
        except BaseException as error:
            spent_s, used_s = earlier_s + meter.wall_s, earlier_used_s + meter.processor_s
            stopped = replace(unfinished, wall_s=spent_s, processor_s=used_s)
            # What was given was refused before anything was written: the earlier result is as good as it was.
            refused = isinstance(error, InputError | FormatError) and before is not None and before.finished
            self._note_stopped(stage, before if before is not None and refused else stopped)
            raise
        done = StageRecord(
            fingerprint=fingerprint,
            wall_s=earlier_s + meter.wall_s,
            processor_s=earlier_used_s + meter.processor_s,
            peak_memory_mb=meter.peak_memory_mb,
            finished_at=now(),
            engines=engine_versions(stage.compute.__module__),
            warnings=tuple(recorder.warnings),
            outputs=outputs,
            info=info,
            made_from=unfinished.made_from,
        )
        with disk_errors(self._survey.folder):
            self._survey.set_record(stage.name, done)
        self.ran.add(stage.name)
        self._values[stage] = value
        return done

    def _computed(self, stage: Stage[T], progress: Progress) -> tuple[T, dict[str, str], Mapping[str, Any]]:
        """Compute and store a value; return it with the digests of the files written and the stage's facts."""
        assert stage.store is not None
        with _one_thread_of_libraries():
            value = stage.compute(**self._arguments(stage, progress))
        self._survey.check_there()
        context = replace(self._context, progress=progress)
        info = stage.store.save(value, context)
        if stage.store.rounds and stage.store.load is not None:
            value = stage.store.load(info, context)
        folder = self._survey.folder
        outputs = stage.store.outputs(self._survey)
        for path in outputs:  # before the manifest says that they are there: the power may fail in between
            flush_to_disk(path)
            flush_name(path)
        return value, {path.relative_to(folder).as_posix(): file_digest(path) for path in outputs}, info

    def _note_stopped(self, stage: Stage[Any], record: StageRecord) -> None:
        """Keep the time spent; on a full disk or one that is gone it cannot be, and it does not matter."""
        with suppress(OSError, SurveyError):
            self._survey.set_record(stage.name, record)

    def _keep_edited(self, before: StageRecord | None) -> None:
        """Move aside results that somebody changed since they were written: they are not ours to overwrite."""
        work = self._survey.work_folder
        for name, expected in (before.outputs if before else {}).items():
            path = self._survey.folder / name
            if work in path.parents or not path.exists() or file_digest(path) == expected:
                continue
            aside = _free_name(path)
            path.rename(aside)
            self._progress.warn(f"{path.name} was changed since Pomona wrote it: kept as {aside.name}")

    def _lost(self, stage: Stage[Any]) -> SurveyError:
        record = self._survey.record_of(stage.name)
        if record is not None and not record.finished:
            return SurveyError(unfinished_in_words(self._survey))
        return SurveyError(
            f"{self._survey.folder} lacks what stage '{stage.name}' keeps in work/, or it was changed, or written by "
            "another version of Pomona: use `pomona run` with the photos again, which makes it"
        )


def own_key(stage: Stage[Any], options: StageOptions) -> str:
    """Return a digest of what a stage depends on besides its inputs: its options, its code, the engines."""
    module = stage.compute.__module__
    chosen = content_key(stage.options(options)) if stage.options else None
    return digest([stage.name, chosen, code_digest(module), engine_versions(module)])


def _free_name(path: Path) -> Path:
    names = (f"{path.stem}.edited{number}{path.suffix}" for number in ("", *range(2, 1000)))
    return next(path.with_name(name) for name in names if not path.with_name(name).exists())
