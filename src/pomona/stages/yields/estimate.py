"""The whole crop, hidden fruits too, from how likely each found one was found: Horvitz-Thompson, by draws.

Each found fruit that was found with probability p stands for 1 / p, itself and 1 / p - 1 others (Horvitz & Thompson
1952, doi:10.1080/01621459.1952.10483446). How many others there are is drawn as often as an interval takes, together
with whether a found one is a fruit (its score), which of two trees it hangs on, and what is not known of p.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pomona.basics.arrays import BoolArray, Float32Array, FloatArray, IntArray
from pomona.basics.row_line import RowLine, row_line, walk_of
from pomona.progress import Progress, Silent
from pomona.stages.measure.allometry import Allometry, total_weight
from pomona.stages.yields.detectability import Detectability, fit_detectability
from pomona.stages.yields.encounters import Encounters, encounters_of, trees_in_view
from pomona.stages.yields.hand_counts import Calibration, OnTrees, calibration, known_counts, read_hand_counts
from pomona.stages.yields.options import YieldOptions
from pomona.stages.yields.sizes import size_distribution
from pomona.values.cameras import Cameras
from pomona.values.crop import Crop, RowSegments, SizeDistribution
from pomona.values.fruits import Fruits, Observations
from pomona.values.intervals import CropInterval
from pomona.values.trees import Trees

_SEEN = "true fruits among those found, hidden ones not counted"
_ALL = {
    1: "all fruit of the part that photos look at, hidden ones too; photos of one side alone, what its far side hides "
    "is estimated from how fast fruits fade with depth",
    2: "all fruit of the part that photos look at, hidden ones too",
}
_CALIBRATED = ", calibrated on hand counts"
_APART = "; parts of the survey are not joined, and fruits that two of them see count twice"
_NOTHING_LEFT = 1e-6  # of a segment: a fruit at its very end hangs in it
_AT_ONCE = 2000  # fruits: more are drawn part by part, in bounded memory
_ENDS = (2.5, 97.5)


@dataclass(frozen=True, eq=False)
class Estimate:
    """The crop, the fruits with how many each `stands_for`, the trees with all their fruits, and parts of the row."""

    crop: Crop | None
    fruits: Fruits
    trees: Trees
    segments: RowSegments


def estimate_crop(
    fruits: Fruits,
    observations: Observations,
    cameras: Cameras,
    trees: Trees,
    allometry: Allometry,
    *,
    candidate_views: IntArray | None = None,
    in_one_frame: bool = True,
    options: YieldOptions | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Return how many fruits there are, also those that no photo shows, with 95 % intervals.

    `fruits` are those found, on their `trees`, `observations` the photos that saw them and `cameras` those of all
    photos; `candidate_views` (m,) are the numbers of photos of all that the filter chose from (None: all were kept).
    Where parts of the survey were only set beside each other, not `in_one_frame`, what lies between them is no row:
    nothing is said by metre. Of too few fruits, and without metres, nothing is estimated. Raises `FormatError` or
    `MissingFileError` for hand counts that cannot be read.
    """
    options, progress = options or YieldOptions(), progress or Silent()
    counts = None if options.hand_counts is None else read_hand_counts(options.hand_counts)
    if not cameras.frame.metric or len(np.unique(observations.fruit_id)) < options.fewest_fruits:
        if counts is not None:
            progress.warn(
                "Hand counts were left out: they calibrate the estimate of all fruit, which takes metres and "
                f"{options.fewest_fruits} fruits that photos show"
            )
        return Estimate(None, fruits, trees, RowSegments.empty())
    line = row_line(fruits.centers_in_world, walk_of(cameras.centers_in_world))
    encounters = encounters_of(fruits, observations, cameras, candidate_views, options)
    detectability = fit_detectability(encounters, options.most_fitted)
    rng = np.random.default_rng(options.seed)
    draws = _Draws.of(fruits, detectability, options.draws, rng)
    covers = _ALL[min(encounters.sides, 2)]
    ratio = None
    surveyed = trees_in_view(trees, fruits, observations, cameras)
    if counts is not None:
        known = known_counts(counts, trees.ids[surveyed], progress)
        found = calibration(known, draws.on_trees(fruits, known.tree_ids), rng, progress) if len(known) else None
        if found is not None:
            ratio, draws, covers = found.ratio, draws.calibrated(found), covers + _CALIBRATED
    if not in_one_frame:
        covers += _APART
    fruits = replace(fruits, stands_for=draws.expected)
    length_m = float(np.ptp(line.along_across(fruits.centers_in_world)[0])) if in_one_frame else 0.0
    return Estimate(
        _crop(fruits, length_m, encounters, draws, covers, ratio, allometry),
        fruits,
        _of_trees(fruits, trees, surveyed, draws),
        _segments(fruits, line, draws, options.segment_m) if in_one_frame else RowSegments.empty(),
    )


@dataclass(frozen=True, eq=False)
class _Draws:
    """How many each of n fruits stands for: `expected` (n,), of which `seen` (n,) itself, and both as they may be.

    `counts` (k, n) are all, `real` (k, n) says whether it is a fruit; `elsewhere` (k, n) where one between two trees
    hangs on the other.
    """

    expected: FloatArray
    seen: FloatArray
    counts: Float32Array
    real: BoolArray
    elsewhere: BoolArray

    @classmethod
    def of(
        cls,
        fruits: Fruits,
        detectability: Detectability,
        count: int,
        rng: np.random.Generator,
    ) -> _Draws:
        # Masks better than those that the filter learned from leave fewer false fruits: scores err all alike.
        false = rng.uniform(0, 2, (count, 1))
        found, seen = detectability.draws(count, rng), _reality(fruits)
        # Column by column, as trees and parts of the row take them.
        real, elsewhere = (np.zeros((count, len(fruits)), bool, order="F") for _ in range(2))
        counts = np.zeros(real.shape, np.float32, order="F")
        for start in range(0, len(fruits), _AT_ONCE):
            some = slice(start, start + _AT_ONCE)
            real[:, some] = rng.random((count, len(seen[some]))) >= false * (1 - seen[some])
            counts[:, some] = real[:, some] * (1 + rng.negative_binomial(1, found(some)))
            elsewhere[:, some] = (fruits.other_tree_ids[some] > 0) & (rng.random((count, len(seen[some]))) < 0.5)
        return cls(seen / detectability.probabilities, seen, counts, real, elsewhere)

    def calibrated(self, by: Calibration) -> _Draws:
        """Return what hand counts make of them."""
        seen, hidden = (each[:, None].astype(np.float32) for each in (by.seen_draws, by.hidden_draws))
        return replace(
            self,
            expected=by.seen * self.seen + by.hidden * (self.expected - self.seen),
            counts=hidden * self.counts + (seen - hidden) * self.real,
        )

    def on_trees(self, fruits: Fruits, tree_ids: IntArray) -> OnTrees:
        """Return what hangs on trees (t,), and what of that was seen."""
        trees = tree_ids.tolist()
        return OnTrees(
            np.array([_expected_on(self.expected, fruits, tree) for tree in trees]),
            np.array([_expected_on(self.seen, fruits, tree) for tree in trees]),
            np.stack([self._drawn_on(self.counts, fruits, tree) for tree in trees], axis=1),
            np.stack([self._drawn_on(self.real, fruits, tree) for tree in trees], axis=1),
        )

    def _drawn_on(self, drawn: Float32Array | BoolArray, fruits: Fruits, tree: int) -> FloatArray:
        """Return draws (k,) of how many of what was drawn (k, n) hang on a tree."""
        here, there = fruits.tree_ids == tree, fruits.other_tree_ids == tree
        mine = (drawn[:, here] * ~self.elsewhere[:, here]).sum(axis=1, dtype=float)
        total: FloatArray = mine + (drawn[:, there] * self.elsewhere[:, there]).sum(axis=1, dtype=float)
        return total


def _expected_on(expected: FloatArray, fruits: Fruits, tree: int) -> float:
    """Return how many of what is expected (n,) hang on a tree; of those between two trees half do."""
    here, there = fruits.tree_ids == tree, fruits.other_tree_ids == tree
    mine = expected[here] * np.where(fruits.other_tree_ids[here] > 0, 0.5, 1.0)
    return float(mine.sum() + 0.5 * expected[there].sum())


def _reality(fruits: Fruits) -> FloatArray:
    """The probability (n,) that there is a fruit, wherever it is.

    A score is that one is within half a diameter; of those that are not there, about half are fruits farther away
    (docs/lab/yields.md). A fruit without a score was put there by a person.
    """
    scores = np.clip(np.where(np.isfinite(fruits.scores), fruits.scores, 1.0), 0.0, 1.0)
    return np.asarray((1 + scores) / 2)


def _crop(
    fruits: Fruits,
    length_m: float,
    encounters: Encounters,
    draws: _Draws,
    covers: str,
    ratio: CropInterval | None,
    allometry: Allometry,
) -> Crop:
    total: FloatArray = draws.counts.sum(axis=1, dtype=float)
    everything = CropInterval.of_draws(float(draws.expected.sum()), total, covers)
    sizes = size_distribution(fruits, allometry)
    return Crop(
        seen=CropInterval.of_draws(float(_reality(fruits).sum()), draws.real.sum(axis=1), _SEEN),
        fruits=everything,
        per_metre=everything.times(1 / length_m) if length_m > 0 else None,
        weight_kg=_weight(fruits, sizes, everything, total, allometry),
        sides=encounters.sides,
        calibration=ratio,
        sizes=sizes,
    )


def _weight(
    fruits: Fruits, sizes: SizeDistribution | None, everything: CropInterval, total: FloatArray, allometry: Allometry
) -> CropInterval | None:
    """The weight of all fruit: of the number, and of the mean weight, whose errors are not of each other."""
    found = total_weight(fruits, allometry)
    if found is None or sizes is None or everything.value == 0:
        return None
    mean_kg = sizes.weights_below_kg[-1] / sizes.below[-1]
    rng = np.random.default_rng(len(fruits))
    spread = (found.high_kg - found.kg) / (1.96 * found.kg)  # its lower end is not below 0
    weights = total * mean_kg * (1 + spread * rng.standard_normal(len(total)))
    return CropInterval.of_draws(mean_kg * everything.value, np.maximum(weights, 0.0), everything.covers)


def _of_trees(fruits: Fruits, trees: Trees, surveyed: BoolArray, draws: _Draws) -> Trees:
    """Return the trees with all their fruits, hidden ones too; NaN of those that no photo looks at."""
    if not len(trees):
        return trees
    # By what is expected, as the row's total is: draws of few hand counts have no mean that is worth anything.
    on = draws.on_trees(fruits, trees.ids)
    low, high = np.percentile(on.draws, _ENDS, axis=0)
    estimates, low, high = (np.where(surveyed, each, np.nan) for each in (on.expected, low, high))
    return replace(
        trees, all_fruits=estimates, all_low=np.minimum(low, estimates), all_high=np.maximum(high, estimates)
    )


def _segments(fruits: Fruits, line: RowLine, draws: _Draws, length_m: float) -> RowSegments:
    """Return parts of the row of one length, the last as long as what is left of it."""
    along_m, _ = line.along_across(fruits.centers_in_world)
    first = float(along_m.min())
    share = (along_m - first) / length_m
    count = max(1, int(np.ceil(share.max() - _NOTHING_LEFT)))
    number = np.minimum(share.astype(int), count - 1)
    starts = first + length_m * np.arange(count)
    ends = np.minimum(starts + length_m, along_m.max())
    rows = []
    for k in range(count):
        mine = number == k
        own = draws.counts[:, mine].sum(axis=1, dtype=float)
        measured = fruits.diameters_m[mine & np.isfinite(fruits.diameters_m)]
        median = float(np.median(measured)) if len(measured) else float("nan")
        rows.append((mine.sum(), draws.expected[mine].sum(), *np.percentile(own, _ENDS), median))
    found, estimates, low, high, diameters = np.array(rows, float).T
    return RowSegments(
        line.places(starts), line.places(ends),
        found.astype(np.int64), estimates, np.minimum(low, estimates), np.maximum(high, estimates), diameters,
    )  # fmt: skip
