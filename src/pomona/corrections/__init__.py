"""What a person corrects in a survey: the log, and what it makes of the fruits that were found."""

from pomona.corrections.apply import Applier, apply
from pomona.corrections.json import read_corrections, write_corrections
from pomona.corrections.outcome import Corrected, Found, Outcome
from pomona.corrections.values import Correction, Corrections

__all__ = [
    "Applier",
    "Corrected",
    "Correction",
    "Corrections",
    "Found",
    "Outcome",
    "apply",
    "read_corrections",
    "write_corrections",
]
