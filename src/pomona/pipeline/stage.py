"""How a stage is declared: what it takes, what it computes, how its value is kept in the survey folder.

The function of a stage is called with what was declared and nothing else, and the key that says whether a stored result
is still valid is made of exactly that (`pipeline.runner`), so the two cannot differ.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from pomona.progress import Progress, Silent

if TYPE_CHECKING:
    from pomona.pipeline.options import StageOptions
    from pomona.survey import StageRecord, SurveyFolder
    from pomona.values.photos import Photos

T = TypeVar("T")


@dataclass(frozen=True)
class Source:
    """An input that no stage computes. `watched` is False for what is shown but never a reason to redo a stage."""

    name: str
    watched: bool = True


PHOTOS = Source("photos")
"""The photos, without those that were skipped: `Photos`, known by contents and metadata, wherever they lie."""
DIGESTS = Source("digests")
"""The digest of each photo's content, by name; none in a survey that is opened without its photos."""
SKIPPED = Source("skipped")
"""Files among the photos that cannot be used: a tuple of `Skipped`."""
SIDES = Source("sides")
"""The side of the row of each photo, by name."""
CORRECTIONS = Source("corrections")
"""The corrections of the survey that are in force: `Corrections`."""
RUN_LOG = Source("run log", watched=False)
"""What the run itself has to say so far: `RunLog`."""


@dataclass(frozen=True)
class RunLog:
    """The survey's name, the records of the stages so far, warnings outside of stages in this run, and its options.

    `words` puts messages, such as the warnings of stages, as who listens to the run knows them.
    """

    title: str
    records: Mapping[str, StageRecord]
    warnings: Sequence[str]
    options: Mapping[str, Any] = field(default_factory=dict)
    words: Callable[[str], str] = str


@dataclass(frozen=True)
class SurveyContext:
    """Where the values of one survey are kept, the photos that they are of, and who is told of what becomes of them."""

    survey: SurveyFolder
    photos: Photos
    progress: Progress = field(default_factory=Silent)


def _no_outputs(folder: SurveyFolder) -> tuple[Path, ...]:
    return ()


@dataclass(frozen=True, kw_only=True)
class Store(Generic[T]):
    """How a value is kept: `save` writes `outputs` and returns the stage's facts for the manifest, `load` reads it.

    Outputs in `work/` may be missing as long as nobody asks for the value; the others belong to the result. A store
    without `load` keeps the facts alone: the value is computed again from the inputs when it is asked for. `rounds`:
    the files hold less than the value, which is read back at once, so that later stages take the same whether or not
    the run was stopped in between.
    """

    save: Callable[[T, SurveyContext], Mapping[str, Any]]
    load: Callable[[Mapping[str, Any], SurveyContext], T] | None = None
    outputs: Callable[[SurveyFolder], tuple[Path, ...]] = _no_outputs
    rounds: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Stage(Generic[T]):
    """One stage. `inputs` names the parameters of `compute` that come from other stages, facts or sources.

    Besides those, `compute` may take `options` (what the callable `options` makes of the run's), `progress`, `work_dir`
    (a folder of the stage's own, kept between runs) and `own_key` (a digest of options, code and engines, but not of
    the inputs). A stage without a store is computed when it is asked for, and is not in the manifest.
    """

    name: str
    compute: Callable[..., T]
    inputs: Mapping[str, Input] = field(default_factory=dict)
    options: Callable[[StageOptions], Any] | None = None
    store: Store[T] | None = None

    def __post_init__(self) -> None:
        declared = {*self.inputs, *({"options"} if self.options else ())}
        extra = self.parameters - declared - {"progress", "work_dir", "own_key"}
        assert declared <= self.parameters, f"Stage {self.name} declares {declared - self.parameters}, and takes it not"
        assert not extra, f"Stage {self.name} takes {extra}, which it does not declare"

    @cached_property
    def parameters(self) -> frozenset[str]:
        """The names of what `compute` takes."""
        return frozenset(inspect.signature(self.compute).parameters)

    @property
    def stages(self) -> tuple[Stage[Any], ...]:
        """The stages whose values it takes."""
        return tuple(source for source in self.inputs.values() if isinstance(source, Stage))


@dataclass(frozen=True)
class Fact:
    """An entry of what a stage notes in the manifest, as the input of another: cheaper than the stage's value."""

    stage: Stage[Any]
    name: str


Input = Stage[Any] | Fact | Source
