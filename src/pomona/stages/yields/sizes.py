"""How large the fruits of a whole crop are: corrected for which of them are found and measured.

Large fruits and those outside in the crown are seen more often, and more clearly, than others. So each found fruit
counts for as many as it stands for (Horvitz & Thompson 1952, doi:10.1080/01621459.1952.10483446), also one that is
hidden too far to be measured: what is seen of it, and how large the others are, still say how large it is likely to be.
Each is spread over the sizes that are likely for it, as the likeliest ones alone vary less than fruits do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from pomona.basics.arrays import FloatArray, set_checked
from pomona.stages.measure.allometry import Allometry
from pomona.values.crop import SizeDistribution
from pomona.values.fruits import Fruits

HOW = (
    "each found fruit counts for as many as it stands for, and is spread over the sizes that are likely for it; so is "
    "one that is hidden too far to be measured"
)
_DECILES = (10, 50, 90)
_STEP_M = 0.0005  # between sizes at which the distribution is known
_FARTHEST = 4.0  # standard deviations: nothing lies beyond
_SMALLEST_SD = 1e-4  # of the diameter: what a person gave is exact
_AT_ONCE = 2000  # fruits: bounds memory


@dataclass(frozen=True, eq=False)
class CropSizes:
    """Normal distributions of n fruits' diameters: `means_m` and `sds_m` (n,), each for `counts` (n,) of the crop."""

    means_m: FloatArray
    sds_m: FloatArray
    counts: FloatArray

    def __post_init__(self) -> None:
        n = len(self.counts)
        for name in ("means_m", "sds_m", "counts"):
            set_checked(self, name, (n,), np.float64)

    @classmethod
    def of(cls, fruits: Fruits) -> CropSizes | None:
        """Return the sizes of fruits that know for how many they stand; None where nothing is known.

        Fruits without any likely size are taken to be like the others.
        """
        measured, means_m = np.isfinite(fruits.diameters_m), fruits.likely_diameters_m
        sds_m = np.where(measured, fruits.diameter_sds_m, fruits.rough_diameter_sds_m)
        known = np.isfinite(means_m) & (fruits.stands_for > 0)
        if not (known & measured).any():
            return None
        counts = fruits.stands_for[known]
        return cls(
            means_m[known],
            np.maximum(np.nan_to_num(sds_m[known]), _SMALLEST_SD * means_m[known]),
            counts * (np.nansum(fruits.stands_for) / counts.sum()),
        )

    def below(self, edges_m: FloatArray) -> FloatArray:
        """Return how many fruits of the crop are smaller than each edge (k,)."""
        total = np.zeros(len(edges_m))
        for start in range(0, len(self.counts), _AT_ONCE):
            some = slice(start, start + _AT_ONCE)
            total += self.counts[some] @ ndtr((edges_m - self.means_m[some, None]) / self.sds_m[some, None])
        return total

    def edges_m(self) -> FloatArray:
        """Return diameters (k,), half a millimetre apart, between which all fruits are."""
        reach = _FARTHEST * self.sds_m
        low, high = max(float((self.means_m - reach).min()), 0.0), float((self.means_m + reach).max())
        return _STEP_M * np.arange(np.floor(low / _STEP_M), np.ceil(high / _STEP_M) + 1)


def size_distribution(fruits: Fruits, allometry: Allometry) -> SizeDistribution | None:
    """Return how large the fruits are as measured, and how large and heavy those of the crop; None: nothing is known.

    The fruits know for how many they stand.
    """
    sizes = CropSizes.of(fruits)
    if sizes is None:
        return None
    measured = np.percentile(fruits.diameters_m[np.isfinite(fruits.diameters_m)], _DECILES)
    edges = sizes.edges_m()
    below = sizes.below(edges)
    crop = np.interp(np.array(_DECILES) / 100 * sizes.counts.sum(), below, edges)
    between_kg = np.diff(below) * allometry.weights_g((edges[1:] + edges[:-1]) / 2) / 1000
    weights_kg = np.concatenate([[0.0], np.cumsum(between_kg)])
    columns = (tuple(map(float, values)) for values in (edges, below, weights_kg))
    return SizeDistribution(tuple(map(float, measured)), tuple(map(float, crop)), HOW, *columns)  # type: ignore[arg-type]
