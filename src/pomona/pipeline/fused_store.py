"""How stages keep fruits, their observations and their points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pomona.pipeline.stage import Store, SurveyContext
from pomona.stages.fuse.fused import Fused
from pomona.survey.fused import fused_path, read_fused, write_fused


def fused_store(name: str) -> Store[Fused]:
    """Return how the stage `name` keeps its fruits."""

    def save(fused: Fused, context: SurveyContext) -> Mapping[str, Any]:
        write_fused(context.survey, name, fused)
        return {"fruits": len(fused.fruits)}

    def load(info: Mapping[str, Any], context: SurveyContext) -> Fused:
        return read_fused(context.survey, name)

    return Store(save=save, load=load, outputs=lambda survey: (fused_path(survey, name),))
