"""How likely it is that a fruit is found at all: conditional likelihood of how often the found ones were seen.

Capture-recapture with a probability of its own for each animal (Huggins 1989, doi:10.1093/biomet/76.1.133; Alho 1990,
doi:10.2307/2531439), photos being the occasions. How likely a photo shows a fruit depends, on the logit scale, on the
side, on how deep in the crown as seen from there and how large the fruit is, on what leaves and wood are about that
fruit (a normal deviate that both sides share) and on what hides it from that side (one for each side, Coull & Agresti
1999, doi:10.1111/j.0006-341X.1999.00294.x). Photos of one side are so nearly alike that the last is large.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, gammaln, log_expit, logit, roots_hermitenorm

from pomona.basics.arrays import FloatArray, IntArray
from pomona.stages.yields.encounters import Encounters

# What is known before any fruit is seen, means and standard deviations: how often a fruit in the middle of the crown is
# seen, by how much that falls with depth and rises with size, and the logarithms of the two deviates' spreads. They are
# what rows of many kinds showed that were photographed from both sides (docs/lab/yields.md); of one side, photos say
# little of the last three.
_LEVEL, _BY_DEPTH, _BY_SIZE, _SHARED, _OWN = (1.5, 2.0), (-1.6, 0.5), (0.2, 0.3), (-0.4, 0.5), (0.8, 0.5)
_RECALL = (2.5, 1.5)
_LEAST = 0.05  # found with a lower probability, a fruit would stand for too many others to be believed
# Of the logit of being found, for all fruits of a row alike: no crown is as the model has it. Photos of one side do not
# show how it goes on behind what they see.
_MODEL_SD, _ONE_SIDED_SD = 0.1, 0.6
_SHARED_NODES, _SHARED_WEIGHTS = roots_hermitenorm(9)
_SHARED_WEIGHTS = _SHARED_WEIGHTS / _SHARED_WEIGHTS.sum()
_BETWEEN = 0.5
_LOGITS = np.arange(-9.0, 9.01, _BETWEEN)  # where the integral over what hides a fruit from one side is taken
_STEP = 0.05  # of the parameters, for second derivatives: a share of their standard deviations
_LEAST_CURVATURE = 0.3


@dataclass(frozen=True, eq=False)
class Detectability:
    """The probability (n,) that each fruit is found, and how its logit (n, k) changes with the k parameters.

    The `parameters` (k,) are known with the `covariance` (k, k); what the model gets wrong moves all logits alike, by
    `model_sd`.
    """

    probabilities: FloatArray
    slopes: FloatArray
    parameters: FloatArray
    covariance: FloatArray
    model_sd: float

    def draws(self, count: int, rng: np.random.Generator) -> Callable[[slice], FloatArray]:
        """Return what gives probabilities (count, m) of some fruits as the parameters may be, the same for all.

        Of all fruits of a long row at once they would take gigabytes.
        """
        off = rng.multivariate_normal(np.zeros(len(self.parameters)), self.covariance, count)
        beyond = rng.normal(0.0, self.model_sd, (count, 1))

        def of(some: slice) -> FloatArray:
            logits = logit(self.probabilities[some]) + off @ self.slopes[some].T + beyond
            return np.asarray(np.clip(expit(logits), _LEAST, 1.0))

        return of


def fit_detectability(encounters: Encounters, most_fitted: int) -> Detectability:
    """Return how likely each of n fruits is found, by what was seen of `most_fitted` of them.

    One that no photo saw was put there by a person, and is sure.
    """
    seen = encounters.seen.any(axis=1)
    sure = np.flatnonzero(seen)
    some = sure[:: max(1, -(-len(sure) // most_fitted))]
    fitted, weight = _Likelihood.of(encounters[some]), len(sure) / max(len(some), 1)
    all_of_them = _Likelihood.of(encounters)
    start, sds = _prior(encounters.sides)

    def loss(off: FloatArray) -> float:
        return 0.5 * float((off**2).sum()) - weight * fitted.log(start + sds * off)

    best = np.asarray(minimize(loss, np.zeros(len(start)), method="BFGS", options={"gtol": 1e-2, "eps": 1e-4}).x)
    values, vectors = np.linalg.eigh(_curvature(loss, best))
    covariance = (vectors / np.maximum(values, _LEAST_CURVATURE)) @ vectors.T
    parameters = start + sds * best
    steps = _STEP * sds
    slopes = [
        (_logit(all_of_them.found(parameters + step)) - _logit(all_of_them.found(parameters - step))) / (2 * step.max())
        for step in np.diag(steps)
    ]
    found = np.where(seen, all_of_them.found(parameters), 1.0)
    return Detectability(
        np.clip(found, _LEAST, 1 - 1e-9),
        np.where(seen[:, None], np.stack(slopes, axis=1), 0.0),
        parameters,
        covariance * np.outer(sds, sds),
        _MODEL_SD if encounters.sides > 1 else _ONE_SIDED_SD,
    )


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """What was seen of n fruits on s sides; `ways` (n, s) and `few_ways` (n, s, k) to be so, and less."""

    encounters: Encounters
    ways: FloatArray
    few_ways: FloatArray

    @classmethod
    def of(cls, encounters: Encounters) -> _Likelihood:
        n, few = encounters.photos, np.arange(len(encounters.kept))
        return cls(encounters, _ways(n, encounters.seen), _ways(n[:, :, None], few))

    def log(self, parameters: FloatArray) -> float:
        """The logarithm of the probability of what was seen, given that the fruits were found."""
        shares, (yes, no) = self._shares(parameters), _chances(parameters)
        x, n = self.encounters.seen[:, :, None], self.encounters.photos[:, :, None]
        seen = _mean(shares, np.exp(self.ways[:, :, None] + x * yes + (n - x) * no)[..., None])[..., 0]
        ratio = np.log(np.maximum(seen.prod(axis=1) @ _SHARED_WEIGHTS, 1e-300))
        return float((ratio - np.log(np.maximum(self._found(shares, yes, no), 1e-12))).sum())

    def found(self, parameters: FloatArray) -> FloatArray:
        """The probability (n,) to be seen by as many photos as it takes, and kept."""
        return self._found(self._shares(parameters), *_chances(parameters))

    def _found(self, shares: FloatArray, yes: FloatArray, no: FloatArray) -> FloatArray:
        few = np.arange(len(self.encounters.kept))
        n = self.encounters.photos[:, :, None, None]
        values = self.few_ways[:, :, None] + few * yes[:, None] + np.maximum(n - few, 0) * no[:, None]
        counts = np.moveaxis(_mean(shares, np.exp(values)), 1, 0)  # (s, n, u, k): how often seen from each side
        missed = counts[0]
        for other in counts[1:]:
            missed = np.stack([(missed[..., : k + 1] * other[..., k::-1]).sum(axis=-1) for k in few], axis=-1)
        found: FloatArray = 1 - (missed @ (1 - self.encounters.kept)) @ _SHARED_WEIGHTS
        return found

    def _shares(self, parameters: FloatArray) -> FloatArray:
        """How often each logit is met (n, s, u, t) by fruits as deep and large, at u values of the shared deviate.

        Up to a factor for all logits.
        """
        sides = self.encounters.sides
        level, (by_depth, by_size, shared, own, _) = parameters[:sides], parameters[sides:]
        middle = level + by_depth * self.encounters.depths + by_size * self.encounters.sizes[:, None]
        middles = middle[:, :, None] + np.exp(shared) * _SHARED_NODES
        # In place: nearly all of the time goes into this array. The nearest logit has a share of 1.
        nearest = _LOGITS[np.clip(np.rint((middles - _LOGITS[0]) / _BETWEEN), 0, len(_LOGITS) - 1).astype(int)]
        shares = _LOGITS - middles[..., None]
        np.square(shares, out=shares)
        shares -= ((nearest - middles) ** 2)[..., None]
        shares *= -0.5 / np.exp(2 * own)
        return np.asarray(np.exp(shares, out=shares))


def _mean(shares: FloatArray, values: FloatArray) -> FloatArray:
    """Return the means (n, s, u, k) of `values` (n, s, t, k), each logit t by its share (n, s, u, t)."""
    return np.asarray((shares @ values) / shares.sum(axis=-1, keepdims=True))


def _chances(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The logarithms (t,) of the chances that a photo sees a fruit, and that it does not, at each logit."""
    recall = expit(parameters[-1])
    return np.log(recall) + log_expit(_LOGITS), np.log1p(-recall * expit(_LOGITS))


def _ways(n: IntArray, x: IntArray) -> FloatArray:
    """The logarithm of the number of ways to choose x of n; minus infinity where there is none."""
    possible = x <= n
    left = np.where(possible, n - x, 0)
    return np.where(possible, gammaln(n + 1) - gammaln(x + 1) - gammaln(left + 1), -np.inf)


def _prior(sides: int) -> tuple[FloatArray, FloatArray]:
    mean, sd = np.array([*([_LEVEL] * sides), _BY_DEPTH, _BY_SIZE, _SHARED, _OWN, _RECALL]).T
    return mean, sd


def _logit(probabilities: FloatArray) -> FloatArray:
    return np.asarray(logit(np.clip(probabilities, 1e-9, 1 - 1e-9)))


def _curvature(loss: Callable[[FloatArray], float], at: FloatArray) -> FloatArray:
    """The second derivatives (k, k) by differences."""
    k, steps = len(at), np.eye(len(at)) * _STEP
    second = np.zeros((k, k))
    for i in range(k):
        for j in range(i + 1):
            one, other = steps[i], steps[j]
            corners = loss(at + one + other) - loss(at + one - other) - loss(at - one + other) + loss(at - one - other)
            second[i, j] = second[j, i] = corners / (4 * _STEP**2)
    return second
