"""Many rows on many machines: surveys of one file as tasks of a cluster; one table, one map and one report of all."""

from pomona.orchard.plan import Orchard, PlannedSurvey, WorkerOptions, read_orchard
from pomona.orchard.run import OrchardSummary, run_orchard
from pomona.orchard.status import OrchardStatus, orchard_status

__all__ = [
    "Orchard",
    "OrchardStatus",
    "OrchardSummary",
    "PlannedSurvey",
    "WorkerOptions",
    "orchard_status",
    "read_orchard",
    "run_orchard",
]
