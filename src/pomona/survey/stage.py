"""A stage of one run: read back where nothing it depends on has changed, else done again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from pomona.errors import SurveyError
from pomona.progress import Progress
from pomona.survey.digest import digest, file_digest
from pomona.survey.files import disk_errors
from pomona.survey.folder import Survey
from pomona.survey.record import Meter, StageRecord, now

T = TypeVar("T")


class _Listening:
    """Passes everything on, and remembers the warnings."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self.warnings: list[str] = []

    def start(self, label: str, total: int | None = None) -> None:
        self._progress.start(label, total)

    def advance(self, units: int = 1) -> None:
        self._progress.advance(units)

    def warn(self, message: str) -> None:
        if message not in self.warnings:
            self.warnings.append(message)
            self._progress.warn(message)


@dataclass(frozen=True, kw_only=True)
class StageWork(Generic[T]):
    """What a stage does: `compute` the value, `save` it (returning what to keep in the manifest), `load` it again.

    `outputs` are the files and folders that `save` writes. Those in `work/` may be missing as long as nobody asks for
    the value; the others belong to the result. `needs` are the stages whose values `compute` asks for: they run, where
    they have to, before this one's clock starts.
    """

    compute: Callable[[Progress], T]
    save: Callable[[T], Mapping[str, Any]]
    load: Callable[[Mapping[str, Any]], T]
    outputs: Sequence[Path]
    needs: Sequence[Stage[Any]] = ()


class Stage(Generic[T]):
    """One stage in one survey. `key` gives what its result depends on; it is asked for only when needed."""

    def __init__(
        self,
        survey: Survey,
        name: str,
        key: Callable[[], Any],
        work: StageWork[T],
        progress: Progress,
        on_start: Callable[[str], None],
    ) -> None:
        self.name = name
        self.ran = False
        self._survey, self._key, self._work, self._progress = survey, key, work, progress
        self._on_start = on_start
        self._value: list[T] = []
        self._record: StageRecord | None = None

    def ensure(self) -> StageRecord:
        """Make sure that the result is there; returns what the manifest keeps of it. Looked at once in a run."""
        if self._record is None:
            record = self._valid_record()
            usable = record is not None and self._intact(record, public_only=True)
            self._record = record if usable else self._run()
        assert self._record is not None
        return self._record

    @property
    def token(self) -> str:
        """What stands for the result in the keys of later stages."""
        return self.ensure().token

    @property
    def value(self) -> T:
        """The result, read back or worked out."""
        if not self._value:
            record = self.ensure()
            if not self._value and self._intact(record, public_only=False):
                self._value.append(self._work.load(record.info))
            elif not self._value:
                self._record = self._run()
        return self._value[0]

    def _fingerprint(self) -> str:
        return digest([self.name, self._key()])

    def _valid_record(self) -> StageRecord | None:
        record = self._survey.record_of(self.name)
        return record if record and record.finished and record.fingerprint == self._fingerprint() else None

    def _intact(self, record: StageRecord, *, public_only: bool) -> bool:
        work = self._survey.folder / "work"
        for name, expected in record.outputs.items():
            path = self._survey.folder / name
            if public_only and work in path.parents:
                continue
            if not path.exists() or file_digest(path) != expected:
                return False
        return True

    def _run(self) -> StageRecord:
        for earlier in self._work.needs:  # before the clock starts
            _ = earlier.value
        fingerprint = self._fingerprint()
        self._on_start(self.name)
        before = self._survey.record_of(self.name)
        earlier_s = before.wall_s if before and not before.finished and before.fingerprint == fingerprint else 0.0
        self._keep_edited(before)
        meter, listening = Meter(), _Listening(self._progress)
        unfinished = StageRecord(fingerprint=fingerprint, finished=False, outputs=before.outputs if before else {})
        try:
            with disk_errors(self._survey.folder):
                value = self._work.compute(listening)
                info = self._work.save(value)
        except BaseException:
            self._note_stopped(replace(unfinished, wall_s=earlier_s + meter.wall_s))
            raise
        outputs = {p.relative_to(self._survey.folder).as_posix(): file_digest(p) for p in self._work.outputs}
        done = StageRecord(
            fingerprint=fingerprint,
            wall_s=earlier_s + meter.wall_s,
            peak_memory_mb=meter.peak_memory_mb,
            finished_at=now(),
            warnings=tuple(listening.warnings),
            outputs=outputs,
            info=info,
        )
        with disk_errors(self._survey.folder):
            self._survey.set_record(self.name, done)
        self.ran = True
        self._value = [value]
        return done

    def _note_stopped(self, record: StageRecord) -> None:
        """Keep the time spent; on a full disk there is no room for that, and it does not matter."""
        try:
            self._survey.set_record(self.name, record)
        except OSError:
            return

    def _keep_edited(self, before: StageRecord | None) -> None:
        """Move aside results that somebody changed since they were written: they are not ours to overwrite."""
        work = self._survey.folder / "work"
        for name, expected in (before.outputs if before else {}).items():
            path = self._survey.folder / name
            if work in path.parents or not path.exists() or file_digest(path) == expected:
                continue
            names = (f"{path.stem}.edited{number}{path.suffix}" for number in ("", *range(2, 1000)))
            aside = next(path.with_name(name) for name in names if not path.with_name(name).exists())
            path.rename(aside)
            self._progress.warn(f"{path.name} was changed since Pomona wrote it: kept as {aside.name}")


class KeptStage(Stage[T]):
    """A stage as an earlier run left it: whether it is out of date is not asked, as that takes the photos."""

    def _valid_record(self) -> StageRecord | None:
        record = self._survey.record_of(self.name)
        return record if record and record.finished else None

    @property
    def value(self) -> T:
        """The result, read back; raises `SurveyError` where it is not there, or was written by another version."""
        try:
            return super().value
        except KeyError as error:
            raise self._lost() from error

    def _run(self) -> StageRecord:
        raise self._lost()

    def _lost(self) -> SurveyError:
        return SurveyError(
            f"{self._survey.folder} lacks what stage '{self.name}' keeps in work/, or it was changed, or written by "
            "another version of Pomona: use `pomona run` with the photos again, which makes it"
        )
