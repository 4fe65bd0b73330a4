"""What a person corrects in a survey: the log, and what it makes of the fruits that were found."""

from pomona.corrections.apply import Applier, apply
from pomona.corrections.corrected import Corrected, CorrectionOutcome, Found
from pomona.corrections.log import Correction, Corrections
from pomona.corrections.log_file import read_corrections, write_corrections

__all__ = [
    "Applier",
    "Corrected",
    "Correction",
    "CorrectionOutcome",
    "Corrections",
    "Found",
    "apply",
    "read_corrections",
    "write_corrections",
]
