"""Photos taken in one after the other as they arrive, with an answer so far; then the run that makes the survey."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pomona.browser.live.arrivals import Arrivals, Stamp
from pomona.browser.live.checks import Checks, Hint
from pomona.browser.live.options import WatchOptions
from pomona.browser.live.provisional import Provisional, provisional
from pomona.errors import FormatError, InputError, PomonaError
from pomona.formats.files import resolved
from pomona.pipeline import RunOptions, Summary
from pomona.pipeline import run as run_pipeline
from pomona.pipeline.runner import own_key
from pomona.pipeline.segment import SEGMENT, PhotoByPhoto
from pomona.pipeline.sfm import SFM
from pomona.pipeline.sources import load_photos
from pomona.progress import Progress, Silent
from pomona.stages.capture.quality import quality_of
from pomona.stages.report import ReportData
from pomona.stages.report.contract import WatchHint, WatchPhase, WatchState
from pomona.stages.sfm.features import extract
from pomona.stages.sfm.growing import GrowingSide
from pomona.stages.sfm.pieces import Piece
from pomona.stages.sfm.reconstruction import kept_features
from pomona.survey import SurveyFolder
from pomona.survey.files import disk_errors
from pomona.values.photos import Photo, Photos

# The page lists so many hints; all are printed.
_LISTED = 30
# Counting may take one of so many parts of the time, and one more.
_RESTS = 2.0


@dataclass
class _Side:
    growing: GrowingSide
    checks: Checks
    pieces: list[Piece] = field(default_factory=list)


class Watch:
    """One survey of photos that still arrive in a folder, or in two folders in it, the sides of the row.

    `follow` takes them in until there are no more, `finish` makes the survey: the very run of `pomona run`, which finds
    the detections and features of all photos kept. `on_state` is told what changed, from the thread of `follow`;
    `on_answer` what the photos show so far, numbered; `on_hint` what is the matter with a photo, at once.

    Raises `MissingFileError` and `InputError` for folders and options that cannot be used, `SurveyError` for a folder
    `out` that holds something else.
    """

    def __init__(
        self,
        folder: Path,
        out: Path,
        options: RunOptions,
        watching: WatchOptions | None = None,
        *,
        on_state: Callable[[WatchState], None] = lambda state: None,
        on_answer: Callable[[ReportData, int], None] = lambda data, revision: None,
        on_hint: Callable[[Hint], None] = lambda hint: None,
    ) -> None:
        if options.method != "object" or options.detections is not None or options.cameras is not None:
            raise InputError("Photos that arrive are watched by `method` object, without `detections` and `cameras`")
        options.check_files()
        self._options, self._watching = options, watching or WatchOptions()
        self._folder = resolved(folder)
        self._arrivals = Arrivals(self._folder, self._watching.poll_s)
        self._survey = SurveyFolder.create(Path(out))
        if self._survey.folder == self._folder:
            raise InputError(f"{self._folder} is the survey itself: give the folder of the photos")
        self._on_state, self._on_answer, self._on_hint = on_state, on_answer, on_hint
        self._stopping = threading.Event()
        self._photos = Photos(())
        self._taken: dict[str, str] = {}  # the side of each
        self._unusable: dict[str, Stamp] = {}  # as they were then: a copy may go on
        self._refused = False  # what is there now, as it does not go with the options
        self._waiting: list[Photo] = []  # for their fruits to be found
        self._digests: dict[str, str] = {}
        self._sides: dict[str, _Side] = {}
        self._hints: list[Hint] = []
        self._answer: Provisional | None = None
        self._revision = 0
        self._is_old = False  # the answer: of fewer photos than were looked at
        self._looked = False  # just now, at a photo
        self._count_s = 0.0
        self._answered = self._arrived = time.monotonic()

    @property
    def answer(self) -> Provisional | None:
        """The answer so far; None while there is none."""
        return self._answer

    @property
    def photos(self) -> Photos:
        """The photos so far that can be read."""
        return self._photos

    def stop(self) -> None:
        """Let `follow` end; from any thread."""
        self._stopping.set()

    def follow(self) -> None:
        """Take in photos until there are as many as asked for, none comes for as long as asked for, or `stop`."""
        stages = self._options.of_stages
        with disk_errors(self._survey.folder), self._survey.locked():
            work = self._survey.work
            self._kept = kept_features(work(SFM.name), stages.sfm, own_key(SFM, stages))
            self._detector = PhotoByPhoto(stages, own_key(SEGMENT, stages), work(SEGMENT.name))
            self._tell("waiting", "Waiting for photos")
            while not self._stopping.is_set():
                if not self._step() and self._has_all():
                    return

    def finish(self, progress: Progress, on_stage: Callable[[str], None] = lambda name: None) -> Summary:
        """Make the survey of all photos that are there, as `pomona run` does; raises what that raises."""

        def stage(name: str) -> None:
            self._tell("finishing", f"Making the survey: {name.replace('_', ' ')}")
            on_stage(name)

        summary = run_pipeline([self._folder], self._survey.folder, self._options, progress, on_stage=stage)
        self._tell("finished", str(self._survey.folder), fruits=summary.fruits)
        return summary

    def _step(self) -> bool:
        """Do one thing; False where there was nothing to do.

        Where photos come faster than they are worked on, looking at them and looking for fruits take turns, and a count
        is made now and then: more seldom where that takes longer, as for a long row.
        """
        new = self._new_photos()
        fruitless = bool(self._waiting) and len(self._taken) >= self._watching.first_photos
        rest_s = max(self._watching.answer_s, _RESTS * self._count_s)
        if self._is_old and (time.monotonic() - self._answered > rest_s or not (new or fruitless)):
            self._count()
        elif new and not (fruitless and self._looked):
            self._look(new[0])
        elif fruitless:
            self._detect(self._waiting[0])
        else:
            self._stopping.wait(self._watching.poll_s)
            return False
        return True

    def _has_all(self) -> bool:
        until, idle_s = self._watching.until, self._watching.idle_s
        if until is not None and len(self._taken) + len(self._unusable) >= until:
            return True
        return idle_s is not None and bool(self._taken) and time.monotonic() - self._arrived > idle_s

    def _new_photos(self) -> list[Photo]:
        """The photos that came since, in the order of a run."""
        if self._arrivals.look():
            stamps = self._arrivals.whole
            try:
                loaded, self._digests = load_photos(
                    self._survey, [self._folder], self._options, Silent(), min_photos=0, are_all=False
                )
            except (InputError, FormatError) as error:
                self._refuse(error)
                return []
            except PomonaError:  # taken away again
                return []
            self._refused = False
            before = self._photos.names
            for file in loaded.skipped:
                self._leave_out(self._folder / file.name, file.name, file.reason)
            whole = (photo for photo in loaded if photo.path in stamps)
            self._photos = Photos(tuple(p for p in whole if self._unusable.get(p.name) != stamps[p.path]))
            # One that was deleted since it was placed shows no fruits any more.
            there = self._photos.by_name()
            self._is_old |= any(name in self._taken and name not in there for name in before)
            self._waiting = [there[photo.name] for photo in self._waiting if photo.name in there]
            if any(self._taken.get(photo.name, photo.side) != photo.side for photo in self._photos):
                self._begin_anew()
        return [photo for photo in self._photos if photo.name not in self._taken]

    def _refuse(self, error: PomonaError) -> None:
        """Say that photos and options do not go together, once until they do; nothing at all where no photo is left."""
        if not self._refused and self._arrivals.whole:
            self._hint([Hint(self._folder.name, "unreadable", f"cannot be taken in as it is: {error}")])
            self._refused = True

    def _leave_out(self, path: Path, name: str, reason: str) -> None:
        """Say once that a file that is whole cannot be used, and again if it changed."""
        stamp = self._arrivals.whole.get(path)
        if stamp is not None and self._unusable.get(name) != stamp:
            self._unusable[name] = stamp
            self._hint([Hint(name, "unreadable", f"cannot be used: {reason}")])

    def _begin_anew(self) -> None:
        """Place all photos again, as they are of other sides than it seemed; nothing else has to be done again."""
        self._sides = {}
        for photo in self._photos:
            if photo.name in self._taken and (features := self._kept.get(photo)) is not None:
                self._taken[photo.name] = photo.side
                self._side(photo).growing.add(photo, features)
        for side in self._sides.values():
            side.pieces = side.growing.place()
        self._is_old = True

    def _side(self, photo: Photo) -> _Side:
        if photo.side not in self._sides:
            folder = self._survey.work("watch") / str(len(self._sides))
            growing = GrowingSide(folder, photo.side, self._options.of_stages.sfm)
            self._sides[photo.side] = _Side(growing, Checks(self._watching))
        return self._sides[photo.side]

    def _look(self, photo: Photo) -> None:
        """Say what is the matter with a photo, and place it."""
        side, self._looked = self._side(photo), True
        self._arrived = time.monotonic()
        self._tell("looking", f"Looking at {photo.name}")
        try:
            seen = quality_of(photo, options=self._watching.quality)
            badly_lit = side.checks.exposure(seen)
            self._hint(badly_lit)
            features = self._kept.get(photo)
            if features is None:
                features = extract(photo, self._options.of_stages.sfm)
                self._kept.keep(photo, features)
        except PomonaError as error:
            self._photos = Photos(tuple(other for other in self._photos if other.name != photo.name))
            self._leave_out(photo.path, photo.name, str(error))
            return
        self._taken[photo.name] = photo.side
        self._unusable.pop(photo.name, None)
        shared = side.growing.add(photo, features)
        # Photos that are lit badly are blurred and share nothing, for that reason.
        if not badly_lit:
            blurred = side.checks.sharpness(photo.name, seen.sharpness)
            self._hint(blurred)
            if not any(hint.photo == photo.name for hint in blurred):
                self._hint(side.checks.overlap(photo.name, shared))
        side.pieces = side.growing.place()
        self._waiting.append(photo)
        self._tell("looking", f"Placed {photo.name}")

    def _detect(self, photo: Photo) -> None:
        self._tell("looking", f"Looking for fruits in {photo.name}")
        taken = Photos(tuple(other for other in self._photos if other.name in self._taken))
        self._detector.detect(photo, self._digests[photo.name], taken, Silent())
        self._waiting.remove(photo)
        self._is_old, self._looked = True, False

    def _count(self) -> None:
        """Make the answer so far."""
        self._is_old, began = False, time.monotonic()
        there = self._photos.names  # without those deleted since they were placed
        placed = [piece for side in self._sides.values() for piece in side.pieces]
        pieces = [replace(piece, cameras=piece.cameras.of_photos(there)) for piece in placed]
        pieces = [piece for piece in pieces if len(piece.cameras)]
        if pieces:
            found = self._detector.segmented
            found = replace(found, detections=found.detections.of_photos(there))
            self._tell("looking", "Counting")
            # Photos may say nothing yet; the run says what is the matter, if anything is.
            with contextlib.suppress(PomonaError):
                self._answer = provisional(pieces, found, self._photos, self._options.of_stages)
                self._revision += 1
                data = self._answer.page_data(self._survey.folder.name, self._photos, self._options)
                self._on_answer(data, self._revision)
        self._answered = time.monotonic()
        self._count_s = self._answered - began
        self._tell("waiting", "Waiting for photos")

    def _hint(self, hints: Sequence[Hint]) -> None:
        for hint in hints:
            self._hints.append(hint)
            self._on_hint(hint)
        if hints:
            self._tell("looking", f"Looking at {hints[-1].photo}")

    def _tell(self, phase: WatchPhase, doing: str, *, fruits: int | None = None) -> None:
        answer = self._answer
        if fruits is None and answer is not None:
            fruits = len(answer.fruits)
        coverage = answer.coverage if answer else None
        # Without those that were deleted since.
        there, whole = set(self._photos.names), set(self._arrivals.whole.values())
        placed = [name for side in self._sides.values() for piece in side.pieces for name in piece.cameras.photos]
        self._on_state(
            WatchState(
                phase=phase,
                doing=doing,
                revision=self._revision,
                photos=len(there & set(self._taken)) + sum(stamp in whole for stamp in self._unusable.values()),
                placed=len(there & set(placed)),
                fruits=fruits,
                length=_known(coverage.length_m) if coverage else None,
                step=_known(coverage.step_m) if coverage else None,
                well_seen=_known(coverage.well_seen) if coverage else None,
                hints=[WatchHint(hint.photo, hint.matter, hint.text) for hint in reversed(self._hints[-_LISTED:])],
            )
        )


def _known(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 3)
