"""What the manifest keeps of each stage, and how time and memory are measured."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pomona.survey.digest import digest, plain

if sys.platform != "win32":
    import resource

    _UNIT_BYTES = 1 if sys.platform == "darwin" else 1024


@dataclass(frozen=True, kw_only=True)
class StageRecord:
    """A stage that ran: from what (`fingerprint` of options and inputs), what it wrote (path in the folder → digest).

    `token` stands for the result in the fingerprints of later stages. `info` are the stage's facts, `engines` the
    versions of the outside packages it ran with. `made_from` has the tokens of the stages, and digests of the facts
    ("stage: fact"), that it took: None in surveys of older versions.
    A stage that was stopped has `finished` False; its `wall_s` and `processor_s` (of all threads and processes) count
    when it goes on with the same fingerprint.
    """

    fingerprint: str
    finished: bool = True
    wall_s: float = 0.0
    processor_s: float = 0.0
    peak_memory_mb: float | None = None
    finished_at: str = ""
    engines: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    outputs: Mapping[str, str] = field(default_factory=dict)
    info: Mapping[str, Any] = field(default_factory=dict)
    made_from: Mapping[str, str] | None = None

    @property
    def token(self) -> str:
        """A digest of the result; of what it was made from where it is not stored."""
        return digest([dict(self.outputs), dict(self.info)] if self.outputs else [self.fingerprint])

    def to_json(self) -> dict[str, Any]:
        """Return it as `survey.json` holds it."""
        values: dict[str, Any] = plain(self)
        return {**values, "wall_s": round(self.wall_s, 3), "processor_s": round(self.processor_s, 3)}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> StageRecord:
        """Return the record that `to_json` gave; entries of other versions are ignored.

        Raises `TypeError` or `ValueError` where it is none.
        """
        for name in ("outputs", "info", "engines", "made_from"):
            if not isinstance(values.get(name) or {}, dict):
                raise TypeError(f"{name}: expected an object, found {values[name]!r:.60}")
        if not isinstance(values.get("fingerprint"), str):
            raise TypeError("fingerprint: expected a text")
        float(values.get("wall_s", 0.0))
        known = {name: values[name] for name in cls.__dataclass_fields__ if name in values}
        return cls(**{**known, "warnings": tuple(known.get("warnings", ()))})


def now() -> str:
    """Return the time as the manifest writes it: UTC, to the second."""
    return datetime.now(UTC).replace(microsecond=0).isoformat()


class Meter:
    """Seconds of the clock and of processors, and peak memory, from its making on.

    On Linux the peak is the stage's own (the kernel's high-water mark is reset); on macOS it is the program's so far,
    and on Windows it is not known.
    Processes that a stage starts count for memory where one of them is larger than this one, and for seconds once they
    have ended.
    """

    def __init__(self) -> None:
        self._start, self._used = time.monotonic(), _processor_s()
        with contextlib.suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
        self._largest_child = _largest_child()

    @property
    def wall_s(self) -> float:
        """Seconds so far."""
        return time.monotonic() - self._start

    @property
    def processor_s(self) -> float:
        """Seconds that processors worked so far, the system's for it included."""
        return _processor_s() - self._used

    @property
    def peak_memory_mb(self) -> float | None:
        """The most memory held so far, in MB (10⁶ bytes); None where it is not known."""
        own = _peak_so_far()
        with contextlib.suppress(OSError, StopIteration, ValueError):
            status = Path("/proc/self/status").read_text(encoding="utf-8")
            own = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")) * 1024
        children = _largest_child()
        larger_child = children if children > self._largest_child else 0
        return round(max(own, larger_child) / 1e6, 1) if own else None


if sys.platform == "win32":

    def _peak_so_far() -> int:
        return 0  # not known

    def _largest_child() -> int:
        return 0

else:

    def _peak_so_far() -> int:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _UNIT_BYTES

    def _largest_child() -> int:
        return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * _UNIT_BYTES


def _processor_s() -> float:
    """Processor seconds of this program, and of the processes that it started and that ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
