"""The survey folder: every path in it, its manifest, and stages that are done again only when something changed."""

from pomona.survey.folder import Survey
from pomona.survey.record import StageRecord
from pomona.survey.stage import Stage

__all__ = ["Stage", "StageRecord", "Survey"]
