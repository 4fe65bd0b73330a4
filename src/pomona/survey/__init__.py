"""The survey folder: every path in it, its manifest, and the values in its files."""

from pomona.survey.folder import SurveyFolder
from pomona.survey.record import StageRecord

__all__ = ["StageRecord", "SurveyFolder"]
