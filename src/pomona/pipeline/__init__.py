"""The stages in order, redoing only what changed: `run` is the whole job of `pomona run`."""

from pomona.pipeline.names import STAGES
from pomona.pipeline.options import METHODS, RunOptions
from pomona.pipeline.run import go_on, run, segment_only
from pomona.pipeline.summary import SettledStage, Summary

__all__ = ["METHODS", "STAGES", "RunOptions", "SettledStage", "Summary", "go_on", "run", "segment_only"]
