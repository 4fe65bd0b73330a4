"""What every method of fusion gives."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.fruits import FruitCloud, Fruits, Observations


@dataclass(frozen=True, eq=False)
class Fused:
    """The fruits, the detections that saw each, and the cloud with `fruit_id` set to the fruits' ids (0: none)."""

    fruits: Fruits
    observations: Observations
    cloud: FruitCloud
