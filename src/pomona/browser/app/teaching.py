"""Teaching a survey's network: fruits marked in photos, and what came of learning."""

from __future__ import annotations

import math
import threading
from functools import partial

from pomona.browser.app.contract import Equal, GivenMarks, LearntView, MarkCount, MarkedView, MarkView, Teaching
from pomona.browser.app.first_results import FirstResults
from pomona.corrections import read_corrections
from pomona.errors import InputError
from pomona.formats.detections.labelled import LabelledFruit
from pomona.learning.marks import MarkedPhoto, read_marks, write_marks
from pomona.learning.self_training.learnt import Learnt, read_learnt
from pomona.survey import SurveyFolder
from pomona.survey.files import disk_errors, write_file

_MOST_MARKS = 2000  # of a photo
_SMALLEST_PX = 3.0
_writing = threading.Lock()


def teaching(survey: SurveyFolder, equal: Equal | None) -> Teaching:
    """Return what a survey can learn from, and what it learnt; raises `FormatError` for damaged files."""
    marked = _marks(survey).values()
    learnt = read_learnt(survey)
    return Teaching(
        marks=[MarkCount(photo.name, len(photo.fruits), photo.complete) for photo in marked],
        corrections=len(read_corrections(survey.corrections).done),
        learnt=None if learnt is None else _view(learnt),
        equal=equal,
    )


def marked_view(survey: SurveyFolder, index: int) -> MarkedView:
    """Return a photo's marks and what was found in it; raises `MissingFileError` where there is no such photo."""
    results = FirstResults(survey)
    photo = results.photo(index)
    marked = _marks(survey).get(photo.name)
    return MarkedView(
        photo.name,
        photo.width_px,
        photo.height_px,
        complete=marked.complete if marked else False,
        marks=[_mark_view(fruit) for fruit in marked.fruits] if marked else [],
        found=[round(float(value), 1) for value in results.boxes(index).ravel()],
    )


def keep_marks(survey: SurveyFolder, index: int, given: GivenMarks) -> None:
    """Put marks of a photo in place of those that it has.

    Raises `InputError` for marks outside of the photo, and `SurveyError` where the disk is full.
    """
    photo = FirstResults(survey).photo(index)
    if len(given.marks) > _MOST_MARKS:
        raise InputError(f"{photo.name}: expected at most {_MOST_MARKS} marks, found {len(given.marks)}")
    size = photo.width_px, photo.height_px
    with _writing, disk_errors(survey.folder, then="mark the fruit again"):
        survey.check_there()
        known = _marks(survey)
        before = {_box(fruit): fruit for fruit in known[photo.name].fruits} if photo.name in known else {}
        drawn = [_fruit(mark, *size) for mark in given.marks]
        # Of a mark that stays, what another program gave besides its box stays, too.
        fruits = tuple(before.get(_box(fruit), fruit) for fruit in drawn)
        known[photo.name] = MarkedPhoto(photo.name, *size, fruits, given.complete)
        write_file(survey.marks, partial(write_marks, photos=list(known.values())))


def _marks(survey: SurveyFolder) -> dict[str, MarkedPhoto]:
    return read_marks(survey.marks, FirstResults(survey).names)


def _fruit(mark: MarkView, width_px: int, height_px: int) -> LabelledFruit:
    circle = mark.circle
    if len(mark.box) != 4 or (circle is not None and not (len(circle) == 3 and circle[2] > 0)):
        raise InputError(f"A mark: expected a box of four numbers, and a circle of three or none, found {mark}")
    x0, y0, x1, y1 = mark.box
    box = max(0.0, x0), max(0.0, y0), min(float(width_px), x1), min(float(height_px), y1)
    if min(box[2] - box[0], box[3] - box[1]) < _SMALLEST_PX:
        raise InputError(f"A mark: expected {_SMALLEST_PX:g} pixels or more inside the photo, found {mark.box}")
    return LabelledFruit(box, None, circle_px=None if circle is None else (circle[0], circle[1], circle[2]))


def _mark_view(fruit: LabelledFruit) -> MarkView:
    return MarkView(list(_box(fruit)), None if fruit.circle_px is None else [round(v, 2) for v in fruit.circle_px])


def _box(fruit: LabelledFruit) -> tuple[float, ...]:
    return tuple(round(value, 2) for value in fruit.box_px)


def _view(learnt: Learnt) -> LearntView:
    def known(pair: tuple[float | None, float | None] | None) -> list[float]:
        return [] if pair is None else [value for value in pair if value is not None and math.isfinite(value)]

    return LearntView(
        kept=learnt.kept,
        marked=learnt.marked,
        f1=known(learnt.f1),
        by_hand=learnt.by_hand,
        by_hand_f1=known(learnt.by_hand_f1),
        halves=known(learnt.halves),
        fruits=[int(value) for value in known(learnt.fruits)],
        detections=[int(value) for value in known(learnt.detections)],
    )
