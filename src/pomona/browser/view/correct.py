"""Corrections that the page asks for: checked, applied, and written to the survey's log at once."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pomona.basics.arrays import FloatArray, counted
from pomona.browser.view.corrected import with_corrections
from pomona.browser.view.reading import page_data
from pomona.browser.view.truth import comparison_with
from pomona.corrections import Applier, Corrected, Correction, Corrections, read_corrections, write_corrections
from pomona.corrections.clicks import diameter_from_edges, lines_in_photos, place_at_depth, place_from_marks
from pomona.corrections.log import Added, Deleted, Mark, Merged, Moved, Split, in_words, place_of
from pomona.errors import InputError, SurveyError
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.pipeline.reopen import LastFound, last_found
from pomona.stages.report import ReportData
from pomona.stages.report.axes import sightings_idx
from pomona.stages.report.contract import (
    CorrectionAnswer,
    CorrectionRequest,
    CorrectionState,
    PhotoMark,
    SightLines,
    TruthData,
)
from pomona.survey import SurveyFolder
from pomona.survey.digest import digest
from pomona.survey.files import disk_errors, write_file
from pomona.survey.reader import SurveyReader

# Fruits are looked for a little nearer and farther than the survey's are.
_NEARER, _FARTHER = 0.8, 1.25


class StaleError(InputError):
    """The survey is not any more what the page shows."""


class Corrector:
    """One survey that is being corrected: its log, and its data as corrected.

    `data` are the survey's as they were read; `compare` says how fruits compare with the truth, where that is known.
    """

    def __init__(
        self, survey: SurveyFolder, data: ReportData, compare: Callable[[ReportData], TruthData] | None = None
    ) -> None:
        self._survey, self._read, self._compare = survey, data, compare
        self._lock = threading.Lock()
        self._log = read_corrections(survey.corrections)
        self._found = _found(survey)
        self._corrected: Corrected | None = None
        self.changed = False
        self.data = data
        self.truth = compare(data) if compare else None
        self.note = self._why_not()

    @classmethod
    def of(cls, survey: SurveyReader, truth: Path | None = None, truth_crs: str | None = None) -> Corrector:
        """Return the corrector of an open survey, with the true fruits of a table, in `truth_crs`, beside its own."""
        data = page_data(survey)
        compare = None if truth is None else comparison_with(truth, data.cameras.frame, truth_crs)
        return cls(survey.files, data, compare=compare)

    def _why_not(self) -> str:
        """Why nothing can be corrected; "" where it can."""
        record = self._survey.record_of("results")
        try:
            if record is None:
                raise SurveyError("This survey was not made by a run of Pomona: nothing can be corrected")
            if self._log or "corrections" in record.info:
                self._show(self._log)
        except SurveyError as error:
            return str(error)
        return ""

    @cached_property
    def _last(self) -> LastFound:
        return last_found(self._survey)

    @cached_property
    def _applier(self) -> Applier:
        return Applier(self._last.found)

    @property
    def state(self) -> CorrectionState:
        """The corrections as the page shows them."""
        how = self._corrected.how if self._corrected else {}
        outcomes = self._corrected.outcomes if self._corrected else ()
        return CorrectionState(
            revision=self._revision(self._log),
            done=[in_words(correction) for correction in self._log.done],
            undone=[in_words(correction) for correction in self._log.undone],
            lost=[outcome.warning() for outcome in outcomes if outcome.problem],
            fruits=[how.get(id_, "") for id_ in self.data.fruits.ids.tolist()] if how else [],
            usual_diameter=_usual(self._read),
            note=self.note,
        )

    def do(self, request: CorrectionRequest) -> CorrectionAnswer:
        """Do what the page asks for and write the log.

        Raises `StaleError` where the page is of another log (it is read again then) or of another run, `SurveyError`
        where the survey was made anew since it was opened, and `InputError` for what makes no sense; nothing is changed
        then.
        """
        with self._lock:
            self._survey.check_there()
            if _found(SurveyFolder.open(self._survey.folder)) != self._found:
                raise SurveyError(f"{self._survey.folder} was made anew since it was opened: open it again")
            log = read_corrections(self._survey.corrections)
            if self._revision(log) != request.revision:
                self._show(log)
                raise StaleError("The survey was changed elsewhere meanwhile: look at it, then do it again")
            before = set(self.data.fruits.ids.tolist())
            log, made = self._next(log, request)
            corrected = self._applier.to(log.done)
            fruits = corrected.outcomes[-1].fruits if made else ()
            if made and (problem := corrected.outcomes[-1].problem):
                raise InputError(f"This cannot be done: {problem}")
            if isinstance(made, Added) and before.issuperset(fruits):
                raise InputError(f"Fruit {fruits[0]} is there already")
            with disk_errors(self._survey.folder):
                write_file(self._survey.corrections, lambda path: write_corrections(path, log))
            self._show(log)
            self.changed = True
            return CorrectionAnswer(True, _said(request, fruits, len(self.data.fruits)), fruits[0] if fruits else 0)

    def lines(self, mark: PhotoMark) -> SightLines:
        """Return where other photos may show what was clicked in one. Raises `InputError`."""
        cameras, clicked = self.data.cameras, self._mark(mark)
        nearest, farthest = fruit_distances(self.data, mark.photo)
        found = lines_in_photos(cameras, clicked, (_NEARER * nearest, _FARTHER * farthest))
        return SightLines([i for i, _ in found], [line.round(1).ravel().tolist() for _, line in found])

    def _revision(self, log: Corrections) -> str:
        return digest([log.done, log.undone, self._found])

    def _show(self, log: Corrections) -> None:
        """Make the page's data those of a log."""
        corrected = self._applier.to(log.done)
        self._log, self._corrected = log, corrected
        self.data = with_corrections(self._read, corrected, self._last)
        self.truth = self._compare(self.data) if self._compare else None

    def _next(self, log: Corrections, request: CorrectionRequest) -> tuple[Corrections, Correction | None]:
        if request.kind == "undo":
            return log.undo(), None
        if request.kind == "redo":
            return log.redo(), None
        from pomona.survey.record import now

        made = replace(self._correction(request), made=now())
        return log.with_one(made), made

    def _correction(self, request: CorrectionRequest) -> Correction:
        if request.kind == "add":
            return self._added(request)
        wanted = 2 if request.kind == "merge" else 1
        if len(set(request.fruits)) != wanted:
            raise InputError("Choose two different fruits to merge" if wanted == 2 else "Choose one fruit first")
        centers = [self._center(id_) for id_ in request.fruits]
        match request.kind:
            case "delete":
                return Deleted(at=place_of(centers[0].tolist()))
            case "move":
                return Moved(at=place_of(centers[0].tolist()), tree_id=request.tree)
            case "merge":
                return Merged(at=(place_of(centers[0].tolist()), place_of(centers[1].tolist())))
            case _:
                return self._split(request, centers[0])

    def _added(self, request: CorrectionRequest) -> Added:
        cameras, usual = self.data.cameras, self._applier.found.size.diameter_m
        marks = tuple(self._mark(mark) for mark in request.marks)
        place = place_from_marks(cameras, marks, usual)
        diameter = diameter_from_edges(cameras, [self._mark(m) for m in request.size], place) if request.size else None
        return Added(
            at=place_of(place.tolist()),
            diameter_m=round(diameter[0], 4) if diameter else None,
            diameter_sd_m=round(diameter[1], 4) if diameter else None,
            marks=marks,
        )

    def _split(self, request: CorrectionRequest, center: FloatArray) -> Split:
        cameras, usual = self.data.cameras, self._applier.found.size.diameter_m
        marks = tuple(self._mark(mark) for mark in request.marks)
        if len(marks) != 2 or marks[0].photo != marks[1].photo:
            raise InputError("Click the middles of the two fruits, in one photo")
        one, other = (place_at_depth(cameras, mark, center) for mark in marks)
        if np.linalg.norm(one - other) < usual / 4:
            raise InputError("The two clicks are at the same place: click the middles of the two fruits")
        if max(np.linalg.norm(one - center), np.linalg.norm(other - center)) > 1.5 * usual:
            raise InputError(f"Click the two fruits that were taken for fruit {request.fruits[0]}: that is elsewhere")
        return Split(
            at=place_of(center.tolist()), parts=(place_of(one.tolist()), place_of(other.tolist())), marks=marks
        )

    def _center(self, fruit_id: int) -> FloatArray:
        idx = np.flatnonzero(self.data.fruits.ids == fruit_id)
        if not len(idx):
            raise InputError(f"There is no fruit {fruit_id}")
        center: FloatArray = self.data.fruits.centers_in_world[idx[0]]
        return center

    def _mark(self, mark: PhotoMark) -> Mark:
        cameras = self.data.cameras
        if not 0 <= mark.photo < len(cameras):
            raise InputError(f"There is no photo {mark.photo}")
        lens = cameras.intrinsics_of(mark.photo)
        if not (0 <= mark.x <= lens.width_px and 0 <= mark.y <= lens.height_px):
            raise InputError(f"{mark.x:.0f}, {mark.y:.0f} is outside the photo")
        # As the log has it, so that what is read from it is the same.
        return Mark(cameras.photos[mark.photo], round(mark.x, 2), round(mark.y, 2))


def fruit_distances(data: ReportData, photo: int) -> tuple[float, float]:
    """Return the least and the greatest distance of fruits from the cameras that saw them, without the odd ones.

    Of all fruits of a long row, nearly none are as near to one photo as those that it shows. Where none was seen, it is
    how far the known points are from a photo, by its index. Raises `InputError` where nothing is known at all.
    """
    eyes, fruits = data.cameras.centers_in_world, data.fruits.centers_in_world
    _, fruit, camera = sightings_idx(data)
    if len(fruit):
        sights = fruits[fruit] - eyes[camera]
    else:
        places = (fruits, data.cloud.points_in_world, data.cameras.points_in_world)
        sights = next((points for points in places if len(points)), np.zeros((0, 3))) - eyes[photo]
    if not len(sights):
        raise InputError("Nothing is known of how far away fruits are: the survey has neither fruits nor points")
    nearest, farthest = np.percentile(np.linalg.norm(sights, axis=1), (1, 99))
    return float(nearest), float(farthest)


def request_from(values: Any) -> CorrectionRequest:
    """Return a request that came as JSON; raises `InputError` for anything that is none."""
    try:
        kind = values["kind"]
        if kind not in ("delete", "add", "split", "merge", "move", "undo", "redo"):
            raise InputError(f"kind: found {kind!r}")
        return CorrectionRequest(
            kind=kind,
            revision=str(values["revision"]),
            fruits=[_whole(id_) for id_ in values["fruits"]],
            marks=_marks(values["marks"]),
            size=_marks(values["size"]),
            tree=_whole(values["tree"]),
        )
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"This is no request for a correction: {error}") from None


def _marks(values: Sequence[Any]) -> list[PhotoMark]:
    return [PhotoMark(_whole(mark["photo"]), _real(mark["x"]), _real(mark["y"])) for mark in values]


def _real(value: Any) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        raise InputError(f"expected a number, found {value!r}")
    return float(value)


def _whole(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise InputError(f"expected a whole number, found {value!r}")
    return value


def _found(survey: SurveyFolder) -> str:
    """What tells the fruits that a run found, and their numbers, from those of another run."""
    record = survey.record_of("measure")
    return record.token if record else ""


def _usual(data: ReportData) -> float | None:
    size = size_of_fruits(data.fruits.diameters_m, FruitSize())
    return size.diameter_m if size.source == "fruits" else None


def _said(request: CorrectionRequest, fruits: Sequence[int], count: int) -> str:
    """What was done, in words."""
    names = " and ".join(str(id_) for id_ in fruits)
    given = " and ".join(str(id_) for id_ in request.fruits)
    done = {
        "delete": f"Fruit {given} deleted",
        "add": f"Fruit {names} added",
        "split": f"Fruit {given} split into {names}",
        "merge": f"Fruits {given} merged to {names}",
        "move": f"Fruit {given} moved to {f'tree {request.tree}' if request.tree else 'no tree'}",
        "undo": "Undone",
        "redo": "Done again",
    }[request.kind]
    return f"{done}. {counted(count, 'fruit')}"
