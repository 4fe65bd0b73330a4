"""What the page and its server tell each other: dataclasses that become JSON, and TypeScript types written from them.

`python -m pomona.browser.app.typescript` prints `viewer/src/app/contract.ts`; a test holds the two together. Times are
ISO 8601 in UTC, days such as 2026-08-12; texts are what Pomona says in English, `code` in backticks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

SurveyState = Literal["new", "queued", "running", "stopping", "stopped", "failed", "finished", "missing"]
"""`missing`: its folder is not where it was."""
StageState = Literal["waiting", "now", "done", "kept"]
"""`kept`: from an earlier run, as nothing that it depends on has changed."""
Metres = Literal["nothing", "gnss", "markers", "scale-bar"]
"""Where metres come from: positions in the photos are used in any case, where there are some."""


@dataclass(frozen=True)
class StageView:
    """A stage of the run that is shown, in order; `seconds` is what it took, in an earlier run or so far."""

    name: str
    state: StageState
    seconds: float | None


@dataclass(frozen=True)
class RunView:
    """How far a survey's run is: the present step, and how many seconds the run will take yet, about.

    `by_other`: another program works on the survey, which it must be stopped in. `message` is why the run failed.
    """

    stages: list[StageView]
    label: str
    done: int
    total: int | None
    left_s: float | None
    warnings: list[str]
    message: str
    log: list[str]
    by_other: bool


@dataclass(frozen=True)
class SurveyView:
    """A survey in the list. `day` is when its photos were taken, "" where they do not say; None: not known yet.

    `version` changes whenever pictures of the survey would. `learnt`: its segmenter learnt from it. `corrected`: its
    fruits were corrected since they were counted and weighed.
    """

    id: str
    name: str
    folder: str
    state: SurveyState
    day: str
    changed: str
    photos: int | None
    fruits: int | None
    fruit: str
    weight_kg: float | None
    learnt: bool
    corrected: bool
    version: str
    run: RunView | None


@dataclass(frozen=True)
class FruitChoice:
    """A kind of fruit to choose, and how wide it usually is."""

    name: str
    diameter_mm: float


@dataclass(frozen=True)
class Facts:
    """What does not change while the server runs: where surveys go, kinds of fruit, forms of exports.

    `roots` are the folders below which one may choose, `home` is the one to begin with.
    """

    version: str
    home: str
    roots: list[str]
    surveys_folder: str
    fruits: list[FruitChoice]
    exports: list[str]
    can_learn: bool


@dataclass(frozen=True)
class Everything:
    """The list of surveys, told again whenever something in it changes; `facts` come with it."""

    facts: Facts
    surveys: list[SurveyView]


@dataclass(frozen=True)
class Place:
    """A folder, or a file that is asked for, in a list to choose from; `photos` are those directly in it."""

    name: str
    path: str
    photos: int
    videos: int
    is_folder: bool
    is_survey: bool


@dataclass(frozen=True)
class Listing:
    """What is in a folder; `parent` is "" where one may not go further up."""

    path: str
    parent: str
    photos: int
    videos: int
    places: list[Place]


@dataclass(frozen=True)
class NewSurvey:
    """What a person says of a row. Empty texts and None: not said. `photos` are folders (two: sides) or a video.

    With `metres` "markers", `markers` is a table of their places; with "scale-bar", `scale_bar` has two numbers of
    markers and the metres between them.
    """

    name: str
    photos: list[str]
    one_side: bool
    fruit: str
    diameter_mm: float | None
    metres: Metres
    markers: str
    scale_bar: list[float]
    tree_spacing_m: float | None
    learn: bool


@dataclass(frozen=True)
class Equal:
    """The same as a command and as lines of Python."""

    command: str
    python: str


@dataclass(frozen=True)
class SideView:
    """A side of the row, and how many photos there are of it."""

    name: str
    photos: int


@dataclass(frozen=True)
class PhotoProblem:
    """A photo that may not be of use: "blurred", "dark", "bright", or "gap": too little of the one before is in it."""

    photo: str
    kind: Literal["blurred", "dark", "bright", "gap"]


@dataclass(frozen=True)
class PhotoCheck:
    """What was found in photos before a run; `looked_at` of them were opened, all headers were read."""

    photos: int
    looked_at: int
    sides: list[SideView]
    positions: int
    focal_lengths: int
    day: str
    warnings: list[str]
    problems: list[PhotoProblem]


@dataclass(frozen=True)
class PhotoSoFar:
    """A photo of a run, and how many fruits may be in it; None: not looked at yet."""

    name: str
    found: int | None


@dataclass(frozen=True)
class SceneSoFar:
    """Cameras, some points and fruits as far as a run has come: x, y, z in metres, z up, one after the other.

    `colours` are those of the points, red, green and blue in the bytes of a number; `fruits` has a diameter after each
    place.
    """

    points: list[float]
    colours: list[int]
    cameras: list[float]
    fruits: list[float]


@dataclass(frozen=True)
class TreeRow:
    """A tree of a survey; None: not known."""

    id: int
    fruits: int
    low: int | None
    high: int | None
    diameter_mm: float | None
    weight_kg: float | None


@dataclass(frozen=True)
class MarkView:
    """A fruit that a person marked: a box x0, y0, x1, y1, and where a circle was drawn x, y, radius; in pixels."""

    box: list[float]
    circle: list[float] | None


@dataclass(frozen=True)
class MarkedView:
    """A photo to mark fruits in: `marks` so far, whether they are `complete`, and boxes of what was `found` in it.

    `found` are x0, y0, x1, y1 one after the other.
    """

    name: str
    width: int
    height: int
    complete: bool
    marks: list[MarkView]
    found: list[float]


@dataclass(frozen=True)
class MarkCount:
    """How many fruits are marked in a photo, and whether these are all."""

    photo: str
    marks: int
    complete: bool


@dataclass(frozen=True)
class GivenMarks:
    """What a person marked in a photo, in place of what was there."""

    complete: bool
    marks: list[MarkView]


@dataclass(frozen=True)
class LearntView:
    """What came of learning, the last time; pairs are before and after. Without `kept` nothing was changed.

    `f1` is of fruits in photos that were not learnt from, `byHandF1` of the `byHand` fruits in those of them in which
    all were marked; `halves` is the share of fruits on which two halves of the photos agree. Empty: not known.
    """

    kept: bool
    marked: int
    f1: list[float]
    by_hand: int
    by_hand_f1: list[float]
    halves: list[float]
    fruits: list[int]
    detections: list[int]


@dataclass(frozen=True)
class Teaching:
    """What a survey's network learns from, and what it learnt; None: it has not learnt."""

    marks: list[MarkCount]
    corrections: int
    learnt: LearntView | None
    equal: Equal | None


@dataclass(frozen=True)
class Refusal:
    """Why something was not done, and what to do."""

    message: str
