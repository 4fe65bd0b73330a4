"""How long stages took, as a report shows it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pomona.pipeline.names import STAGE_WORDS, stages_by
from pomona.survey import StageRecord

if TYPE_CHECKING:
    from pomona.stages.report import StageTime


def stage_times(records: Mapping[str, StageRecord], options: Mapping[str, Any]) -> tuple[StageTime, ...]:
    """Return the times of finished stages in words, in the order in which a run with these options computes them.

    Records are in the order in which stages were last computed, of which some may be older than others.
    """
    from pomona.stages.report import StageTime

    order = stages_by(options.get("method", ""))
    finished = [name for name in order if name in records and records[name].finished]
    return tuple(StageTime(STAGE_WORDS[name], records[name].wall_s, records[name].peak_memory_mb) for name in finished)
