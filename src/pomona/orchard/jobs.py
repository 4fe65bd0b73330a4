"""What a worker is given and what it gives back: plain values that travel between machines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from typing import Any, Literal, Protocol, Self

from pomona import __version__
from pomona.survey.digest import plain

State = Literal["done", "failed"]


@dataclass(frozen=True)
class Part:
    """Stages of a survey that are one task: up to and with `until`, on workers that have the tags `resources`."""

    until: str
    resources: Mapping[str, float] = field(default_factory=dict)


class Job(Protocol):
    """Something that a worker does whole; `parts` of it are done one after the other, each by any worker.

    `words`, a function that workers can import, words messages for who reads them.
    """

    @property
    def name(self) -> str:
        """Unique among the jobs that are done together."""
        ...

    @property
    def parts(self) -> tuple[Part, ...]:
        """At least one."""
        ...

    @property
    def words(self) -> Callable[[str], str]:
        """By default as they are."""
        ...

    def at(self, part: int) -> Self:
        """Return what does that part."""
        ...


@dataclass(frozen=True, kw_only=True)
class SurveyJob:
    """A survey to be made: `photos`, files in `options` and `out`, its folder, are paths or URLs.

    `left` is what an earlier outcome says of it, by which a survey that nothing changed is known without its photos.
    """

    name: str
    photos: tuple[str, ...]
    options: Mapping[str, Any]
    out: str
    parts: tuple[Part, ...] = (Part("report"),)
    part: int = 0
    left: Mapping[str, str] = field(default_factory=dict)
    words: Callable[[str], str] = str
    version: str = __version__

    def at(self, part: int) -> SurveyJob:
        """Return what does that part."""
        return replace(self, part=part)

    @property
    def until(self) -> str:
        """The last stage of the part."""
        return self.parts[self.part].until


@dataclass(frozen=True, kw_only=True)
class ComparisonJob:
    """Two surveys of one row to be compared: `before`, `after` and `out` are folders or URLs, `days` their dates."""

    name: str
    before: str
    after: str
    days: tuple[date, date]
    out: str
    left: Mapping[str, str] = field(default_factory=dict)
    version: str = __version__
    parts: tuple[Part, ...] = (Part("comparison"),)
    words: Callable[[str], str] = str

    def at(self, part: int) -> ComparisonJob:
        """Return what does that part: it has one."""
        return self


@dataclass(frozen=True)
class Attempt:
    """One try of a job: on which worker, from when (UTC), for how long, and why it failed ("" where it did not)."""

    worker: str
    began: str
    wall_s: float
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class JobOutcome:
    """What became of a job; `outcomes/NAME.json` keeps it.

    `kept`: nothing had to be computed. `may_pass`: it failed for a reason that another try may not meet. `details` is
    where a mistake of Pomona's happened. `left` says what it was made from and how it was left, `figures` are those of
    a comparison. `plan` is the digest of what the orchard's file said of it.
    """

    name: str
    state: State
    reason: str = ""
    kept: bool = False
    may_pass: bool = False
    details: str = ""
    left: Mapping[str, str] = field(default_factory=dict)
    figures: Mapping[str, Any] = field(default_factory=dict)
    attempts: tuple[Attempt, ...] = ()
    plan: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return it as its file holds it."""
        values: dict[str, Any] = plain(self)
        return values

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> JobOutcome:
        """Return the outcome that `to_json` gave; entries of other versions are ignored."""
        known = {name: values[name] for name in cls.__dataclass_fields__ if name in values}
        return cls(**{**known, "attempts": tuple(Attempt(**each) for each in values.get("attempts", ()))})
