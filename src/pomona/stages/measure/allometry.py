"""Weight from diameter: allometry of a kind of fruit, or of a person's own pairs of diameters and weights.

Weight is a power of the calliper diameter, `w = a · d^b`, fitted by least squares on logarithms; the mean of what is
scattered about it there is `exp(s² / 2)` higher (Baskerville 1972, doi:10.1139/x72-009). The scatter of few pairs is
hardly known: what is known of the curve is then wider than a normal distribution, Student's (Gelman et al. 2013,
*Bayesian Data Analysis*, section 14.2), whose standard deviation is that of the curve here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.errors import InputError
from pomona.fruit.traits.kinds import FruitKind
from pomona.values.cameras import WorldFrame
from pomona.values.fruits import Fruits, TotalWeight

FEWEST_PAIRS = 5
"""With fewer pairs of diameter and weight, the scatter about the curve is not known."""
_LIKELY_DIAMETERS_MM = (5.0, 300.0)
_LIKELY_DENSITIES_G_CM3 = (0.3, 2.0)  # of a sphere of that diameter: outside, a unit is wrong
_OF_ANOTHER_FRUIT = 4.0  # times as dense, or as light, as usual: no scatter of fruits, but a slip of the pen
# Of kinds that were not weighed for Pomona, the density and the height to width of a variety are known to about that.
_PRESET_SD, _PRESET_SHARED_SD = 0.12, 0.08
_WITHIN_95 = 1.96


@dataclass(frozen=True, kw_only=True)
class Allometry:
    """Weights of fruits by their calliper diameters, with the errors of that.

    A fruit of `diameter_mm` weighs `weight_g` on average, others in proportion to the diameter's power `exponent`.
    `scatter` is the standard deviation of single fruits about the curve, `weight_sd` and `exponent_sd` are those of the
    curve; `scatter` and `weight_sd` are shares of the weight. `source` says where it is from, for the report.

    Raises `InputError` for values that no fruit can have.
    """

    diameter_mm: float
    weight_g: float
    exponent: float
    scatter: float
    weight_sd: float
    exponent_sd: float
    source: str

    def __post_init__(self) -> None:
        for name in ("diameter_mm", "weight_g", "exponent"):
            if not 0 < getattr(self, name) < float("inf"):
                raise InputError(f"Allometry.{name}: expected a number above 0, found {getattr(self, name)}")
        for name in ("scatter", "weight_sd", "exponent_sd"):
            if not 0 <= getattr(self, name) < float("inf"):
                raise InputError(f"Allometry.{name}: expected 0 or more, found {getattr(self, name)}")

    def weights_g(self, diameters_m: FloatArray) -> FloatArray:
        """Return the weight in grams expected at each diameter (n,); NaN at NaN."""
        weights: FloatArray = self.weight_g * (1000 * diameters_m / self.diameter_mm) ** self.exponent
        return weights

    def single_sds(self, diameters_m: FloatArray, diameter_sds_m: FloatArray) -> FloatArray:
        """Return the standard deviation (n,) of what each fruit errs alone, as a share of its weight.

        It is made of the scatter of fruits and of the error of the diameter.
        """
        sds: FloatArray = np.hypot(self.scatter, self.exponent * diameter_sds_m / diameters_m)
        return sds

    def shared_sds(self, diameters_m: FloatArray) -> FloatArray:
        """Return the standard deviation (n,) of the curve at each diameter, which all fruits share, as a share."""
        off = np.log(1000 * diameters_m / self.diameter_mm)
        sds: FloatArray = np.hypot(self.weight_sd, self.exponent_sd * off)
        return sds

    def shared_sd_of_all_g(self, diameters_m: FloatArray) -> float:
        """Return the standard deviation of the curve in the weight of fruits (n,) together, in grams.

        Where the curve is too steep, small fruits are too light and large ones too heavy, which cancels in part.
        """
        weights_g, off = self.weights_g(diameters_m), np.log(1000 * diameters_m / self.diameter_mm)
        return float(np.hypot(self.weight_sd * weights_g.sum(), self.exponent_sd * (weights_g @ off)))


STORY_APPLES = Allometry(
    diameter_mm=71.66,
    weight_g=174.2,
    exponent=3.295,
    scatter=0.1204,
    weight_sd=0.0247,
    exponent_sd=0.299,
    source="26 weighed apples (cultivar Story)",
)
"""Fitted to the table of GRAP-UdL-AT/ak_sw_benchmarker (MIT licence); a test fits it again."""


def allometry_of_kind(kind: FruitKind) -> Allometry:
    """Return the allometry of a kind of fruit: fitted for apples, of ellipsoids of usual shape for the others."""
    if kind.name == "apple":
        return STORY_APPLES
    diameter_cm = 100 * kind.diameter_m
    return Allometry(
        diameter_mm=10 * diameter_cm,
        weight_g=kind.density_g_cm3 * np.pi / 6 * diameter_cm**3 * kind.height_to_width,
        exponent=3.0,
        scatter=_PRESET_SD,
        weight_sd=_PRESET_SHARED_SD,
        exponent_sd=0.0,
        source=f"the usual shape and density of {kind.plural}",
    )


def fit_allometry(diameters_mm: FloatArray, weights_g: FloatArray, *, source: str) -> Allometry:
    """Return the allometry of n pairs of a calliper diameter (n,) and a weight (n,).

    Raises `InputError` for fewer than `FEWEST_PAIRS` pairs, for values that are not those of fruit in millimetres and
    grams, one pair that is far off the others included, where all diameters are the same, and where weight does not
    rise with the diameter.
    """
    if len(diameters_mm) < FEWEST_PAIRS:
        raise InputError(f"expected at least {FEWEST_PAIRS} pairs of diameter and weight, found {len(diameters_mm)}")
    if not (diameters_mm.min() > 0 and weights_g.min() > 0):
        raise InputError("expected diameters and weights above 0")
    low_mm, high_mm = _LIKELY_DIAMETERS_MM
    if not low_mm <= np.median(diameters_mm) <= high_mm:
        raise InputError(
            f"expected diameters in millimetres, between {low_mm:.0f} and {high_mm:.0f}, found "
            f"{np.median(diameters_mm):g} in the middle of them"
        )
    densities = weights_g / (np.pi / 6 * (diameters_mm / 10) ** 3)
    density = float(np.median(densities))
    if not _LIKELY_DENSITIES_G_CM3[0] <= density <= _LIKELY_DENSITIES_G_CM3[1]:
        low, high = _LIKELY_DENSITIES_G_CM3
        expected = "diameters in millimetres and weights in grams"
        if low <= density / 1000 <= high:
            expected = "diameters in millimetres (these look like centimetres)"
        elif low <= density * 1000 <= high:
            expected = "weights in grams (these look like kilograms)"
        raise InputError(f"expected {expected}: as spheres of their diameters, these fruits have {density:.3g} g/cm³")
    off = np.abs(np.log(densities / density))
    if off.max() > np.log(_OF_ANOTHER_FRUIT):
        worst = int(np.argmax(off))
        raise InputError(
            f"{diameters_mm[worst]:g} mm and {weights_g[worst]:g} g are not of a fruit like the others: as spheres, "
            f"these have {density:.2g} g/cm³, and it {densities[worst]:.2g}; is a digit or a point wrong?"
        )
    x, y = np.log(diameters_mm), np.log(weights_g)
    spread = float(((x - x.mean()) ** 2).sum())
    if spread < 1e-9:
        raise InputError(f"expected diameters that differ, found {diameters_mm[0]:g} mm alone")
    exponent, level = np.polyfit(x - x.mean(), y, 1)
    if exponent <= 0:
        raise InputError("expected weights that rise with the diameter, found ones that fall: are columns exchanged?")
    residuals = y - level - exponent * (x - x.mean())
    freedom = len(x) - 2
    scatter = float(np.sqrt((residuals**2).sum() / freedom))
    students = (freedom / (freedom - 2)) ** 0.5
    return Allometry(
        diameter_mm=float(np.exp(x.mean())),
        weight_g=float(np.exp(level + scatter**2 / 2)),
        exponent=float(exponent),
        scatter=scatter,
        weight_sd=students * scatter / len(x) ** 0.5,
        exponent_sd=students * scatter / spread**0.5,
        source=source,
    )


def weigh(fruits: Fruits, allometry: Allometry, frame: WorldFrame) -> Fruits:
    """Return the fruits with the weight of each that has a diameter, and its standard deviation, in grams.

    Without metres there is no weight: the fruits are returned as they are.
    """
    if not frame.metric:
        return fruits
    weights_g = allometry.weights_g(fruits.diameters_m)
    # Of a size that a person gave, the error may not be known: what is left is that of the curve.
    alone = allometry.single_sds(fruits.diameters_m, np.nan_to_num(fruits.diameter_sds_m))
    shares = np.hypot(alone, allometry.shared_sds(fruits.diameters_m))
    return replace(fruits, weights_g=weights_g, weight_sds_g=weights_g * shares)


def total_weight(fruits: Fruits, allometry: Allometry) -> TotalWeight | None:
    """Return the weight of all fruits, None where none was measured.

    The interval covers the scatter of fruits, the errors of their diameters, taken as independent, and that of the
    curve, which all fruits share; not fruits that no photo shows, nor an error of the survey's scale.
    """
    known = np.isfinite(fruits.weights_g)
    if not known.any():
        return None
    weighed = fruits[known]
    weights_g = weighed.weights_g
    factor = len(fruits) / len(weighed)
    alone_g = weights_g * allometry.single_sds(weighed.diameters_m, np.nan_to_num(weighed.diameter_sds_m))
    shared_g = allometry.shared_sd_of_all_g(weighed.diameters_m)
    missing = len(fruits) - len(weighed)
    spread_g = float(weights_g.std(ddof=1)) if len(weighed) > 1 else float(weights_g[0])
    # Each is off by how fruits differ, in size and at one size in weight, and all by the mean that they are given.
    single_g = np.hypot(spread_g, allometry.scatter * weights_g.mean())
    of_missing_g2 = missing * single_g**2 + missing**2 * spread_g**2 / len(weighed)
    sd_g = float(np.sqrt((alone_g**2).sum() + of_missing_g2 + (factor * shared_g) ** 2))
    total_g = factor * float(weights_g.sum())
    low_g = max(total_g - _WITHIN_95 * sd_g, 0.0)
    high_g = total_g + _WITHIN_95 * sd_g
    mean_g = float(weights_g.mean())
    return TotalWeight(total_g / 1000, low_g / 1000, high_g / 1000, mean_g, len(weighed), allometry.source)
