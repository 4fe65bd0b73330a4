"""How fruits, their observations and their points are kept between stages: one `.npz` file in `work/`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pomona.fruits import FruitCloud, Fruits, Observations
from pomona.fuse.fused import Fused
from pomona.pipeline.stage import Store, SurveyContext
from pomona.survey.values import arrays_of, columns_from, read_arrays, write_arrays


def fused_store(name: str) -> Store[Fused]:
    """Return how the stage `name` keeps its fruits."""

    def save(fused: Fused, context: SurveyContext) -> Mapping[str, Any]:
        arrays = {
            **arrays_of(fused.fruits, "fruits/"),
            **arrays_of(fused.observations, "observations/"),
            **arrays_of(fused.cloud, "cloud/"),
        }
        write_arrays(context.survey.work(f"{name}.npz"), arrays)
        return {"fruits": len(fused.fruits)}

    def load(info: Mapping[str, Any], context: SurveyContext) -> Fused:
        arrays = read_arrays(context.survey.work(f"{name}.npz"))
        return Fused(
            columns_from(Fruits, arrays, "fruits/"),
            columns_from(Observations, arrays, "observations/"),
            columns_from(FruitCloud, arrays, "cloud/"),
        )

    return Store(save=save, load=load, outputs=lambda survey: (survey.work(f"{name}.npz"),))
