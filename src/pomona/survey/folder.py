"""The one class that builds paths in a survey folder and writes its manifest."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from pomona import __version__
from pomona.errors import FormatError, MissingFileError, PomonaError, SurveyError, as_text
from pomona.formats.files import is_there, resolved
from pomona.survey.commands import command_line
from pomona.survey.digest import plain
from pomona.survey.files import disk_errors, part_of, write_file, write_text_file
from pomona.survey.locks import lock
from pomona.survey.manifest import FORMAT, MANIFEST, read_manifest
from pomona.survey.record import StageRecord, now

# The command that writes each, of a survey that was stopped before it.
_WRITERS = {
    "detections.json": "pomona segment PHOTOS --out {survey}",
    "cameras": "pomona reconstruct {survey}",
    "cloud.laz": "pomona measure {survey}",
    "fruits.csv": "pomona measure {survey}",
    "fruits.geojson": "pomona measure {survey}",
    "observations.csv": "pomona measure {survey}",
    "trees.csv": "pomona measure {survey}",
    "segments.csv": "pomona measure {survey}",
    "report.html": "pomona report {survey}",
    "report.pdf": "pomona report {survey} --pdf",
    "report-truth.html": "pomona report {survey} --truth FILE",
    "contact_sheet.jpg": "pomona report {survey}",
}
_KEPT = "before_adapting"  # in `work/`
# What file managers leave in any folder, and a run that was stopped at its very beginning: an empty one is empty for
# all that.
_IGNORED = frozenset({".DS_Store", "Thumbs.db", "desktop.ini", ".directory", part_of(Path(MANIFEST)).name})


class SurveyFolder:
    """One run's folder: its files by name, and `survey.json`, which is rewritten whole whenever something is noted.

    Make it with `create` (for a run: a new or empty folder, or a survey to go on with) or `open` (an existing one).
    """

    def __init__(self, folder: Path, manifest: dict[str, Any]) -> None:
        self.folder = folder
        self._manifest = manifest
        # Of a survey that was made here: the folders that were not there, the innermost first.
        self._made: tuple[Path, ...] | None = None

    @classmethod
    def create(cls, folder: Path, *, overwrite: bool = False) -> SurveyFolder:
        """Make a survey folder, or open the one that is there; with `overwrite`, one with a damaged manifest, too.

        Raises `SurveyError` when the folder holds something else or cannot be written to; nothing is touched then.
        """
        folder = resolved(folder)
        if as_text(str(folder)) != str(folder):
            raise SurveyError(f"{as_text(str(folder))}: expected a name in UTF-8 for `out`")
        with disk_errors(folder):
            return cls._create(folder, overwrite)

    @classmethod
    def _create(cls, folder: Path, overwrite: bool) -> SurveyFolder:
        if (file := next((place for place in (folder, *folder.parents) if place.is_file()), None)) is not None:
            raise SurveyError(f"{file} is a file: expected a new or empty folder, or a survey, for `out`")
        present = [p.name for p in folder.iterdir() if p.name not in _IGNORED] if folder.exists() else []
        if present and MANIFEST not in present:
            few = ", ".join(sorted(present)[:4]) + (" and more" if len(present) > 4 else "")
            raise SurveyError(
                f"{folder} holds something else than a survey ({few}): nothing was written. "
                "Choose a new or empty folder for `out`"
            )
        if present:  # a survey that is there may be another run's, which is known once it is locked
            try:
                return cls.open(folder)
            except FormatError:  # no run leaves such a manifest: none is at work here
                if not overwrite:
                    raise
        survey = cls(folder, _new_manifest())
        if MANIFEST not in present:
            survey._made = tuple(path for path in (folder, *folder.parents) if not path.exists())
        folder.mkdir(parents=True, exist_ok=True)
        survey._write(new=True)
        return survey

    @classmethod
    def open(cls, folder: Path) -> SurveyFolder:
        """Open an existing survey.

        Raises `MissingFileError` when there is none, `SurveyError` when `survey.json` is not one of Pomona's, and
        `FormatError` when it is damaged.
        """
        folder = resolved(folder)
        path = folder / MANIFEST
        if not is_there(folder):
            raise MissingFileError(f"{folder} does not exist: expected a survey, a folder that `pomona run` wrote")
        if not path.is_file():
            raise MissingFileError(f"{folder} is not a survey: expected a folder that `pomona run` wrote ({MANIFEST})")
        return cls(folder, read_manifest(path))

    @classmethod
    def find(cls, folder: Path) -> SurveyFolder | None:
        """Return the survey in a folder; None where there is none, or none that can be read: a run says why."""
        try:
            return cls.open(folder)
        except PomonaError:
            return None

    def need(self, *paths: Path) -> None:
        """Raise `MissingFileError` for the first of its files that is not there, naming the command that writes it."""
        for path in paths:
            if not path.exists():
                command = _WRITERS[path.name].format(survey=command_line([self.folder]))
                raise MissingFileError(f"{path} does not exist: `{command}` writes it")

    @property
    def manifest_path(self) -> Path:
        """`survey.json`."""
        return self.folder / MANIFEST

    @property
    def detections(self) -> Path:
        """`detections.json`: COCO."""
        return self.folder / "detections.json"

    @property
    def cameras(self) -> Path:
        """`cameras/`: a COLMAP text model in the world frame."""
        return self.folder / "cameras"

    @property
    def cloud(self) -> Path:
        """`cloud.laz`."""
        return self.folder / "cloud.laz"

    @property
    def fruits(self) -> Path:
        """`fruits.csv`."""
        return self.folder / "fruits.csv"

    @property
    def trees(self) -> Path:
        """`trees.csv`."""
        return self.folder / "trees.csv"

    @property
    def segments(self) -> Path:
        """`segments.csv`."""
        return self.folder / "segments.csv"

    @property
    def geojson(self) -> Path:
        """`fruits.geojson`."""
        return self.folder / "fruits.geojson"

    @property
    def observations(self) -> Path:
        """`observations.csv`."""
        return self.folder / "observations.csv"

    @property
    def corrections(self) -> Path:
        """`corrections.json`: what a person corrected. No run removes it."""
        return self.folder / "corrections.json"

    @property
    def marks(self) -> Path:
        """`marks.json`: the fruits that a person marked in photos. No run removes it."""
        return self.folder / "marks.json"

    @property
    def learnt(self) -> Path:
        """`learnt.json`: what came of learning from this survey, the last time."""
        return self.folder / "learnt.json"

    @property
    def report(self) -> Path:
        """`report.html`."""
        return self.folder / "report.html"

    @property
    def pdf(self) -> Path:
        """`report.pdf`, where it was asked for."""
        return self.folder / "report.pdf"

    @property
    def truth_report(self) -> Path:
        """`report-truth.html`: the report with scores against true fruits, where it was asked for."""
        return self.folder / "report-truth.html"

    @property
    def contact_sheet(self) -> Path:
        """`contact_sheet.jpg`."""
        return self.folder / "contact_sheet.jpg"

    @property
    def options(self) -> dict[str, Any] | None:
        """The options of the last run, as noted; a model that the survey learnt is where the survey is now.

        Where a learning was stopped before its model was judged, the model is that of before.
        """
        options: dict[str, Any] | None = self.get("options")
        if options and self.is_learning:
            kept = self.find(self.work_folder / _KEPT)
            before = str(self.adapted_model) if self.adapted_model.is_file() else None
            options = {**options, "model": (kept.get("options") or {}).get("model") if kept else before}
        model, learnt = (options or {}).get("model"), self.adapted_model
        if not isinstance(model, str) or Path(model).name != learnt.name or Path(model).is_file():
            return options
        return {**(options or {}), "model": str(learnt)} if learnt.is_file() else options

    @property
    def is_learning(self) -> bool:
        """Whether the last run was made with a model that is learnt and not yet judged (`unjudged_model`)."""
        model = (self.get("options") or {}).get("model")
        return isinstance(model, str) and Path(model).parts[-2:] == self.unjudged_model.parts[-2:]

    @property
    def unjudged_model(self) -> Path:
        """`work/adapted.onnx`: what was learnt from this survey, until it is judged."""
        return self.work_folder / self.adapted_model.name

    @property
    def adapted_model(self) -> Path:
        """`adapted.onnx`: the segmenter that learnt from this survey."""
        return self.folder / "adapted.onnx"

    @property
    def before_adapting(self) -> Path:
        """`before_adapting/`: the results as they were before the segmenter learnt."""
        return self.folder / "before_adapting"

    def keep_results(self) -> None:
        """Copy what is handed over, and the manifest, until `take_adapted` or `drop_kept` says what for."""
        with disk_errors(self.folder):
            self.drop_kept()
            self._kept.mkdir()
            for name in (*_WRITERS, MANIFEST):
                path = self.folder / name
                if path.is_dir():
                    shutil.copytree(path, self._kept / name)
                elif path.is_file():
                    shutil.copy2(path, self._kept)

    def drop_kept(self) -> None:
        """Remove the copy of the results."""
        with disk_errors(self.folder):
            shutil.rmtree(self._kept, ignore_errors=True)

    @property
    def _kept(self) -> Path:
        return self.work(_KEPT)

    def take_adapted(self, model: Path) -> Path:
        """Copy a model file to be this survey's own, whole or not at all; return where it is.

        The copy of the results becomes `before_adapting/`, in place of what was there.
        """

        def copy(path: Path) -> None:
            shutil.copyfile(model, path)

        with disk_errors(self.folder):
            if self._kept.is_dir():
                shutil.rmtree(self.before_adapting, ignore_errors=True)
                self._kept.rename(self.before_adapting)
            write_file(self.adapted_model, copy)
        return self.adapted_model

    @property
    def work_folder(self) -> Path:
        """`work/`: what stages keep for themselves and for runs that go on."""
        return self.folder / "work"

    @property
    def exports(self) -> Path:
        """`export/`: the survey in the formats of other programs, and compared with others."""
        return self.folder / "export"

    def work(self, name: str) -> Path:
        """A file or folder of `work/`, by which a stopped run goes on; `work/` itself exists then."""
        path = self.work_folder / name
        if not path.parent.is_dir():
            self.check_there()
            path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def check_there(self) -> None:
        """Raise `SurveyError` where the folder is no longer this survey: it is not to be made anew, as by halves.

        Where a disk was mounted there is a folder of the same name, on another disk.
        """
        if not self.manifest_path.is_file():
            raise SurveyError(
                f"{self.folder} is no longer there: expected the survey that was begun in it, found no {MANIFEST}. It "
                "was removed or renamed, or its disk was taken away; nothing was written in its place. When it is "
                "there again, do the same once more: it goes on where it was"
            )

    def get(self, key: str, default: Any = None) -> Any:
        """Return an entry of `survey.json`."""
        return self._manifest.get(key, default)

    def note(self, **entries: Any) -> None:
        """Set entries of `survey.json` and write it."""
        self._manifest.update(plain(entries))
        self._write()

    def check(self, **entries: Any) -> None:
        """Raise `SurveyError` where `survey.json` cannot hold these entries: names that are not UTF-8."""
        _manifest_text(plain(entries))

    def record_of(self, stage: str) -> StageRecord | None:
        """Return what is known of a stage, None where it never ran."""
        values = self._manifest["stages"].get(stage)
        return None if values is None else StageRecord.from_json(values)

    @property
    def records(self) -> Mapping[str, StageRecord]:
        """All stages that ran, in the order in which they were last computed."""
        return {name: StageRecord.from_json(values) for name, values in self._manifest["stages"].items()}

    def set_record(self, stage: str, record: StageRecord) -> None:
        """Keep what is known of a stage, and write it."""
        self._manifest["stages"].pop(stage, None)
        self._manifest["stages"][stage] = record.to_json()
        self._write()

    def forget_records_but(self, stages: Collection[str]) -> None:
        """Forget what is known of stages that are not among these: of another method, they say nothing of this one."""
        if others := self._manifest["stages"].keys() - set(stages):
            for stage in others:
                del self._manifest["stages"][stage]
            self._write()

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other runs out of the folder while this one works; raises `SurveyError` when one is there already.

        The manifest is read again then: another run may have written it in the meantime.
        """
        with self.work("lock").open("a", encoding="ascii") as file:
            if not lock(file):
                self._made = None  # by that run, and the same moment by this one
                raise SurveyError(f"Another run is working on {self.folder}: wait for it, or choose another `out`")
            file.truncate(0)  # only now: until then it says who else is working here
            file.write(str(os.getpid()))
            file.flush()
            self._manifest = read_manifest(self.manifest_path)
            yield

    def clear(self, *, but: Collection[str] = ()) -> None:
        """Remove what earlier runs wrote, and nothing else; of `work/` what `but` names stays, as the run needs it."""
        kept = {*but, "lock", "run.jsonl"}  # both are this run's by now
        work = [path for path in self.work_folder.glob("*") if path.name not in kept]
        for path in (*self._results, *work):
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
        self._manifest = _new_manifest()
        self._write()

    def would_clear(self, path: Path) -> bool:
        """Say whether `clear` removes a file or folder, which may be named through links."""
        return any(
            place.is_relative_to(result)
            for place in (path, path.resolve())
            for result in (*self._results, self.work_folder)
        )

    @property
    def _results(self) -> tuple[Path, ...]:
        """All that runs write, but for `work/` and the manifest."""
        written = (self.folder / name for name in _WRITERS)
        return (*written, self.adapted_model, self.before_adapting, self.learnt)

    def withdraw(self) -> None:
        """Leave nothing where nothing was: remove a survey that this run made, and that has no photos yet."""
        if self._made is None or self.get("sources"):
            return
        shutil.rmtree(self.work_folder, ignore_errors=True)
        with contextlib.suppress(OSError):  # something else came into them in the meantime
            self.manifest_path.unlink(missing_ok=True)
            for folder in self._made:
                folder.rmdir()

    def _write(self, *, new: bool = False) -> None:
        if not new:
            self.check_there()
        self._manifest["changed"] = now()
        self._manifest["pomona"] = __version__
        text = _manifest_text(self._manifest)
        write_text_file(self.manifest_path, text)


def _manifest_text(manifest: Mapping[str, Any]) -> str:
    text = json.dumps(manifest, indent=1, ensure_ascii=False) + "\n"
    if as_text(text) != text:
        line = next(line for line in text.splitlines() if as_text(line) != line)
        raise SurveyError(f"A file was given whose name is not UTF-8: rename it ({as_text(line).strip()})")
    return text


def _new_manifest() -> dict[str, Any]:
    return {"format": FORMAT, "pomona": __version__, "created": now(), "stages": {}}
