"""What the manifest keeps of each stage, and how time and memory are measured."""

from __future__ import annotations

import contextlib
import resource
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pomona.survey.digest import digest, plain


@dataclass(frozen=True, kw_only=True)
class StageRecord:
    """A stage that ran: from what (`fingerprint` of options and inputs), what it wrote (path in the folder → digest).

    `token` stands for the result in the fingerprints of later stages. `info` are the stage's facts, `engines` the
    versions of the outside packages it ran with.
    A stage that was stopped has `finished` False; its `wall_s` counts when it goes on with the same fingerprint.
    """

    fingerprint: str
    finished: bool = True
    wall_s: float = 0.0
    peak_memory_mb: float | None = None
    finished_at: str = ""
    engines: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    outputs: Mapping[str, str] = field(default_factory=dict)
    info: Mapping[str, Any] = field(default_factory=dict)

    @property
    def token(self) -> str:
        """A digest of the result; of what it was made from where it is not stored."""
        return digest([dict(self.outputs), dict(self.info)] if self.outputs else [self.fingerprint])

    def to_json(self) -> dict[str, Any]:
        """Return it as `survey.json` holds it."""
        values: dict[str, Any] = plain(self)
        return {**values, "wall_s": round(self.wall_s, 3)}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> StageRecord:
        """Return the record that `to_json` gave; entries of other versions are ignored.

        Raises `TypeError` or `ValueError` where it is none.
        """
        for name in ("outputs", "info", "engines"):
            if not isinstance(values.get(name, {}), dict):
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
    """Wall seconds and peak memory from its making on.

    On Linux the peak is the stage's own (the kernel's high-water mark is reset); elsewhere it is the program's so far.
    Processes that a stage starts count where one of them is larger than this one.
    """

    def __init__(self) -> None:
        self._start = time.monotonic()
        with contextlib.suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5")
        self._children_kb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss

    @property
    def wall_s(self) -> float:
        """Seconds so far."""
        return time.monotonic() - self._start

    @property
    def peak_memory_mb(self) -> float:
        """The most memory held so far, in MB (10⁶ bytes)."""
        unit_bytes = 1 if sys.platform == "darwin" else 1024
        own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit_bytes
        with contextlib.suppress(OSError, StopIteration, ValueError):
            status = Path("/proc/self/status").read_text()
            own = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")) * 1024
        children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        larger_child = children * unit_bytes if children > self._children_kb else 0
        return round(max(own, larger_child) / 1e6, 1)
