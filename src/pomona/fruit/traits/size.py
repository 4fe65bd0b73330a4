"""How large the fruits of a survey are: what is assumed, and the one function that estimates it from fruits.

It is refined along a run, each time from what a stage knows better than the one before:

1. assumed, by default or by a person, where nothing says more;
2. from masks and the scene's points, before any fruit is known (`ranges`), or, of cameras without points, from masks
   that two photos have of whole fruits (`pairs`): `fuse` begins with it;
3. from fruits that are well seen, fitted without a prior on their size, after the first round of `fuse`, which begins
   anew where this differs by more than `ObjectOptions.same_size`;
4. from all fruits as fused: `filter` takes features relative to it;
5. from the fruits that `measure` measures well: the prior of those that leaves hide. Corrections and the page take the
   median of the fruits as measured.

No stage can take an earlier one's: on the bundled sample 2 to 5 are 84.5, 75.8, 75.3 and (as measured) 77.1 mm, and
the filter's machine was trained on features relative to 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.errors import InputError

DEFAULT_DIAMETER_M = 0.075
"""The diameter of a medium apple: what a fruit is assumed to measure until a person or the survey says otherwise."""

SizeSource = Literal["assumed", "masks", "fruits"]


@dataclass(frozen=True)
class FruitSize:
    """The typical diameter of the fruits of a survey, in metres.

    `source`: "assumed" by default or by a person; estimated from "masks", by their widths and how far away they are; or
    from "fruits", the median diameter of `count` of them. `sd_m` is the standard deviation between fruits, NaN where it
    is not known.
    """

    diameter_m: float = DEFAULT_DIAMETER_M
    source: SizeSource = "assumed"
    sd_m: float = float("nan")
    count: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.diameter_m < float("inf"):
            raise InputError(f"FruitSize.diameter_m: expected a positive number of metres, found {self.diameter_m}")

    @property
    def radius_m(self) -> float:
        """Half the diameter."""
        return self.diameter_m / 2


def size_of_fruits(diameters_m: FloatArray, otherwise: FruitSize) -> FruitSize:
    """Return the median of diameters (n,), NaN where a fruit was not measured; `otherwise` where none was."""
    measured = diameters_m[np.isfinite(diameters_m)]
    if len(measured) == 0:
        return otherwise
    sd_m = float(measured.std()) if len(measured) > 1 else float("nan")
    return FruitSize(float(np.median(measured)), "fruits", sd_m, len(measured))
