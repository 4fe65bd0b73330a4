"""What the page can ask for, without HTTP: surveys listed, begun, stopped and looked at."""

from __future__ import annotations

import secrets
import shutil
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pomona import __version__, api
from pomona.browser.app.catalogue import Catalogue, Entry
from pomona.browser.app.checks import check_photos
from pomona.browser.app.contract import (
    Equal,
    Everything,
    Facts,
    FruitChoice,
    NewSurvey,
    PhotoCheck,
    RunView,
    SurveyState,
    SurveyView,
    Teaching,
    TreeRow,
)
from pomona.browser.app.first_results import FirstResults
from pomona.browser.app.folders import Folders
from pomona.browser.app.jobs import WORKING, Jobs, QueuedRun
from pomona.browser.app.opened import opened
from pomona.browser.app.progress_view import run_view
from pomona.browser.app.request import begun_with, equal_of_survey, equal_to, folder_name, options_of, run_arguments
from pomona.browser.app.teaching import teaching
from pomona.browser.app.wire import as_json
from pomona.corrections import read_corrections
from pomona.errors import InputError, PomonaError, SurveyError
from pomona.export import EXPORT_FORMATS, export_format
from pomona.formats.files import resolved
from pomona.fruit.traits.kinds import FRUIT_KINDS
from pomona.survey import SurveyFolder
from pomona.survey.events import RunStatus, run_status
from pomona.survey.photos import photo_of
from pomona.survey.record import StageRecord

_LEARN = "--adapt"
_PACE_S = 0.7  # so often the page is told what changed


@dataclass(frozen=True)
class Homes:
    """Where the program keeps things: its list of surveys, new surveys, and photos that were dropped on the page."""

    catalogue: Path
    surveys: Path
    dropped: Path

    @classmethod
    def usual(cls, surveys: Path | None = None) -> Homes:
        """Return those of this person on this computer; `surveys` is another folder for new ones."""
        from platformdirs import user_data_path, user_documents_path

        place = resolved(surveys or user_documents_path() / "Pomona")
        return cls(user_data_path("pomona", appauthor=False) / "surveys.json", place, place / "photos")


class Service:
    """Surveys and their runs, for one page or several. `publish` is told the list, as JSON, whenever it changes."""

    def __init__(self, homes: Homes, folders: Folders, publish: Callable[[str], None] = lambda text: None) -> None:
        self.homes = homes
        self.folders = Folders([*folders.roots, homes.surveys])
        self._catalogue = Catalogue(homes.catalogue)
        self._publish, self._published = publish, ""
        self._days: dict[str, str] = {}
        self._news = threading.Event()
        self._closed = False
        self._jobs = Jobs(self._news.set)
        self._ticker = threading.Thread(target=self._tell, name="news", daemon=True)
        self._ticker.start()

    def close(self) -> None:
        """Stop the run that is at work; what it finished is kept."""
        self._closed = True
        self._news.set()
        self._jobs.close()

    def everything(self) -> Everything:
        """Return the list of surveys, the newest first."""
        return Everything(self._facts(), [self._view(entry) for entry in self._catalogue.entries])

    def view(self, survey_id: str) -> SurveyView:
        """Return one survey of the list; raises `MissingFileError` where it is not in it."""
        return self._view(self._catalogue.find(survey_id))

    def check(self, photos: list[str], *, one_side: bool) -> PhotoCheck:
        """Look at photos before a run. Raises errors of `pomona.errors` for folders that cannot be used."""
        return check_photos([self.folders.allowed(Path(photo)) for photo in photos], one_side=one_side)

    def equal(self, asked: NewSurvey) -> Equal:
        """Return the command and the Python that do what is asked; raises as `begin` does."""
        photos, options = options_of(asked, self.folders)
        return equal_to(photos, self._place_of(asked.name), options, adapt=asked.learn)

    def begin(self, asked: NewSurvey) -> str:
        """Add a new survey and queue its run; return its id.

        Raises `InputError` and others of `pomona.errors` for what cannot be used, and `SurveyError` where there is a
        survey of that name.
        """
        photos, options = options_of(asked, self.folders)
        place = self._place_of(asked.name)
        taken = place.exists() and (not place.is_dir() or any(place.iterdir()))
        if taken or self._is_to_come(place):
            raise SurveyError(f"There is a survey '{place.name}' already: choose another name")
        arguments = run_arguments(photos, place, options, adapt=asked.learn)
        entry = self._catalogue.add(asked.name.strip(), place, arguments)
        self._jobs.put(entry.id, arguments)
        return entry.id

    def _is_to_come(self, place: Path) -> bool:
        """Say whether a survey that waits for its run, and may have no folder yet, is to be made there."""
        jobs = [self._jobs.of(entry.id) for entry in self._catalogue.entries if entry.folder == place.resolve()]
        return any(job is not None and job.state in WORKING for job in jobs)

    def add(self, folder: str) -> str:
        """Add a survey that was made elsewhere; return its id. Raises `MissingFileError` where there is none."""
        place = self.folders.allowed(Path(folder))
        SurveyFolder.open(place)
        entry = self._catalogue.add(place.name, place)
        self._news.set()
        return entry.id

    def sample(self) -> str:
        """Begin a survey of the bundled sample, or return that which is there."""
        sample, place = api.sample_folder(), self.homes.surveys / "Sample"
        arguments = ("run", str(sample / "east"), str(sample / "west"), "--out", str(place))
        entry = self._catalogue.add("Sample", place, (*arguments, "--markers", str(sample / "markers.csv")))
        if not (place / "report.html").is_file():
            self._jobs.put(entry.id, entry.asked)
        self._news.set()
        return entry.id

    def go_on(self, survey_id: str, *, learn: bool = False) -> None:
        """Queue a run that goes on with a survey, or that learns from it; one that was to learn goes on with that, too.

        Raises `SurveyError` where a run is at work.
        """
        entry = self._catalogue.find(survey_id)
        view = self._view(entry)
        if view.run is not None and view.run.by_other:
            raise SurveyError(f"Another run is working on {entry.folder}: wait for it, or stop it where it was begun")
        learn = learn or (view.state in ("stopped", "failed") and self._was_to_learn(entry))
        self._jobs.put(survey_id, self._arguments(entry, learn=learn))

    def _was_to_learn(self, entry: Entry) -> bool:
        """Whether the last run of a survey, which did not come to its end, was to learn from it."""
        job, survey = self._jobs.of(entry.id), opened(entry.folder)
        if job is not None and job.state in ("stopped", "failed"):
            return _LEARN in job.arguments
        if survey is None:
            return False
        status = run_status(survey)
        asked = _LEARN in entry.asked and not survey.learnt.is_file()
        return asked or survey.is_learning or (status is not None and status.stage == "learn")

    def stop(self, survey_id: str) -> None:
        """Stop a survey's run, or take it out of the queue."""
        self._catalogue.find(survey_id)
        self._jobs.stop(survey_id)

    def forget(self, survey_id: str) -> None:
        """Take a survey off the list; its folder stays. Raises `SurveyError` while a run is at work."""
        job = self._jobs.of(survey_id)
        if job is not None and job.state in WORKING:
            raise SurveyError("The survey's run is at work, or waits: stop it first")
        self._catalogue.forget(survey_id)
        self._news.set()

    def equal_of(self, survey_id: str) -> Equal:
        """Return the command and the Python for a survey of the list."""
        entry = self._catalogue.find(survey_id)
        return equal_of_survey(SurveyFolder.open(entry.folder))

    def first_results(self, survey_id: str) -> FirstResults:
        """Return what a survey's run has found so far; raises `MissingFileError` where it has no folder yet."""
        return FirstResults(self.survey(survey_id))

    def results_before(self, survey_id: str) -> FirstResults:
        """Return what was found before the survey learnt; raises `MissingFileError` where it has not."""
        survey = self.survey(survey_id)
        return FirstResults(survey, found_by=SurveyFolder.open(survey.before_adapting))

    def teaching(self, survey_id: str) -> Teaching:
        """Return what a survey can learn from, and what it learnt."""
        survey = self.survey(survey_id)
        try:
            equal = equal_to(*begun_with(survey), adapt=True)
        except PomonaError:  # made elsewhere: it cannot be made again here
            equal = None
        return teaching(survey, equal)

    def survey(self, survey_id: str) -> SurveyFolder:
        """Return a survey's folder; raises `MissingFileError` where it is not there (yet, or any more)."""
        return SurveyFolder.open(self._catalogue.find(survey_id).folder)

    def trees(self, survey_id: str) -> list[TreeRow]:
        """Return a survey's trees."""
        trees = api.open(self.survey(survey_id).folder).trees
        return [
            TreeRow(
                id=int(trees.ids[k]),
                fruits=int(trees.fruits[k]),
                low=_whole(trees.fruits_low[k]),
                high=_whole(trees.fruits_high[k]),
                diameter_mm=_known(1000 * trees.diameters_m[k]),
                weight_kg=_known(trees.weights_kg[k]),
            )
            for k in range(len(trees))
        ]

    def export(self, survey_id: str, kind: str) -> Path:
        """Write a survey in the format `kind` into its folder `export/`; return the file, a .zip of a folder."""
        survey, chosen = self.survey(survey_id), export_format(kind)
        target = survey.exports / chosen.file_name
        shutil.rmtree(target, ignore_errors=True) if chosen.is_folder else target.unlink(missing_ok=True)
        written = api.open(survey.folder).export(kind, target)
        return Path(shutil.make_archive(str(written), "zip", written)) if chosen.is_folder else written

    def compare(self, before_id: str, after_id: str) -> Path:
        """Compare two surveys of one row; return the page. Raises `InputError` where they have nothing in common."""
        if before_id == after_id:
            raise InputError("Choose two different surveys of the row")
        before, after = self.survey(before_id), self.survey(after_id)
        page = comparison_page(before, after)
        api.compare(before.folder, after.folder, out=page.parent)
        return page

    def new_drop(self) -> str:
        """Return the name of a new folder for photos that are dropped on the page."""
        return f"{datetime.now(UTC):%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"

    def _place_of(self, name: str) -> Path:
        place = self.homes.surveys / folder_name(name)
        if place == self.homes.dropped:
            raise InputError(f"'{name}' is where dropped photos are kept: choose another name")
        return place

    def _arguments(self, entry: Entry, *, learn: bool) -> tuple[str, ...]:
        """How a run goes on: with the survey's own options where it has some, else as it was asked for."""
        survey = opened(entry.folder)
        if survey is not None and survey.get("sources"):
            try:
                return run_arguments(*begun_with(survey), adapt=learn)
            except InputError:
                if learn:
                    raise
                return ("report", str(entry.folder))
        if not entry.asked:
            raise SurveyError(f"{entry.folder} does not say of which photos it is: begin a new survey with them")
        return entry.asked

    def _facts(self) -> Facts:
        return Facts(
            version=__version__,
            home=str(self.folders.roots[0]),
            roots=[str(root) for root in self.folders.roots],
            surveys_folder=str(self.homes.surveys),
            fruits=[FruitChoice(kind.name, round(1000 * kind.diameter_m, 1)) for kind in FRUIT_KINDS.values()],
            exports=list(EXPORT_FORMATS),
            can_learn=find_spec("torch") is not None,
        )

    def _view(self, entry: Entry) -> SurveyView:
        survey = opened(entry.folder)
        try:
            return self._view_of(entry, survey)
        except (KeyError, TypeError, ValueError, AttributeError, IndexError):  # a manifest that holds something else
            return self._view_of(entry, None)

    def _view_of(self, entry: Entry, survey: SurveyFolder | None) -> SurveyView:
        job = self._jobs.of(entry.id)
        status = run_status(survey) if survey else None
        if job is not None and status is not None and job.state not in WORKING and status.began > job.ended:
            job = None  # the survey went on elsewhere since
        records = {name: record for name, record in survey.records.items() if record.finished} if survey else {}
        results = records.get("results")
        state = _state(entry, survey, job, status, "report" in records)
        options: dict[str, Any] = (survey.get("options") or {}) if survey else {}
        summary: dict[str, Any] = (survey.get("summary") or {}) if survey else {}
        photos: list[Any] | None = survey.get("photos") if survey else None
        weight = results.info.get("weight") if results else None
        return SurveyView(
            id=entry.id,
            name=entry.name,
            folder=str(entry.folder),
            state=state,
            day=self._day(entry, survey),
            changed=survey.get("changed", entry.added) if survey else entry.added,
            photos=len(photos) if photos is not None else None,
            fruits=int(results.info["fruits"]) if results else None,
            fruit=options.get("fruit") or "",
            weight_kg=_known(weight.get("kg")) if weight else _known((summary.get("weight") or {}).get("kg")),
            learnt=survey.adapted_model.is_file() if survey else False,
            corrected=_is_corrected_since(survey, results) if survey and results else False,
            version=f"{len(records)}-{survey.get('changed', '') if survey else ''}",
            run=self._run(survey, job, status, records),
        )

    def _run(
        self,
        survey: SurveyFolder | None,
        job: QueuedRun | None,
        status: RunStatus | None,
        records: dict[str, Any],
    ) -> RunView | None:
        if survey is None and job is None:
            return None
        mine = job is not None and job.state != "queued"
        by_other = status is not None and status.state == "running" and (job is None or job.state not in WORKING)
        message = job.error if job is not None and not by_other else ""
        shown = status
        if job is not None and job.state == "queued":
            shown = None
        elif status is not None and job is not None and job.state == "stopped":
            # Stopped while packages were read in, a run may end with an error.
            shown = replace(status, state="stopped", message="")
        photos = survey.get("photos") if survey else None
        log = list(job.log) if job is not None and mine else []
        finished = {name: round(record.wall_s, 1) for name, record in records.items()}
        count = len(photos) if photos else 0
        return run_view(shown, finished, photos=count, log=log, message=message, by_other=by_other)

    def _day(self, entry: Entry, survey: SurveyFolder | None) -> str:
        """When the first photo was taken; "" where it does not say."""
        if survey is None or not survey.get("photos"):
            return ""
        if entry.id not in self._days:
            self._days[entry.id] = ""
            with suppress(PomonaError, OSError):
                first = photo_of(survey, survey.get("photos")[0]["name"])
                self._days[entry.id] = first.taken_at.date().isoformat() if first.taken_at else ""
        return self._days[entry.id]

    def _tell(self) -> None:
        while not self._closed:
            with suppress(PomonaError, OSError):  # a folder is replaced at this moment
                text = as_json(self.everything())
                if text != self._published:
                    self._published = text
                    self._publish(text)
            self._news.wait(_PACE_S)
            self._news.clear()


def _state(
    entry: Entry, survey: SurveyFolder | None, job: QueuedRun | None, status: RunStatus | None, reported: bool
) -> SurveyState:
    if job is not None and job.state in WORKING:
        return job.state
    if status is not None and status.state == "running":
        return "running"
    if job is not None and job.state in ("failed", "stopped"):
        return job.state
    if survey is None:
        return "missing" if entry.created else "new"
    if status is not None and status.state != "finished":
        return status.state
    return "finished" if reported else "stopped"


def _is_corrected_since(survey: SurveyFolder, results: StageRecord) -> bool:
    """Whether the log has other corrections than the results, as far as their number says."""
    try:
        if survey.corrections.stat().st_mtime < datetime.fromisoformat(results.finished_at).timestamp():
            return False
        done = len(read_corrections(survey.corrections).done)
    except (OSError, PomonaError, ValueError):
        return False
    counted = results.info.get("corrections") or {"all": 0}
    return done != int(counted["all"])


def comparison_page(before: SurveyFolder, after: SurveyFolder) -> Path:
    """Return where the page is that compares a survey with an earlier one of the row, once it is written."""
    return after.exports / f"since-{before.folder.name}" / "comparison.html"


def _known(value: Any) -> float | None:
    return None if value is None or value != value else float(value)


def _whole(value: Any) -> int | None:
    known = _known(value)
    return None if known is None else round(known)
