"""Hand counts of a few trees, by which the estimate of all is calibrated: a ratio estimator (Cochran 1977, ch. 6)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.errors import FormatError, few
from pomona.formats.small_table import read_small_table
from pomona.progress import Progress
from pomona.values.intervals import CropInterval

_FAR_OFF = 2.0  # a count that is so many times more or less than it should be is named
_SLIP = 3.0  # so many times, and it is a slip, or of another tree,
_SURELY, _LIKELY = 3.0, 2.5  # if off by so many standard deviations; by fewer if photos contradict it by themselves
# How trees differ in what photos show of them, as a share, before that is known; it counts as so many trees.
_TREE_SD, _TREES = 0.1, 4
_ENDS = (2.5, 97.5)


@dataclass(frozen=True, eq=False)
class HandCounts:
    """What a person counted: `counts` (n,) on the trees `tree_ids` (n,), each of them once."""

    tree_ids: IntArray
    counts: FloatArray

    def __post_init__(self) -> None:
        set_checked(self, "tree_ids", (len(self.tree_ids),), np.int64)
        set_checked(self, "counts", (len(self.tree_ids),), np.float64)

    def __len__(self) -> int:
        return len(self.tree_ids)


def read_hand_counts(path: Path) -> HandCounts:
    """Read a table with the columns `tree,count`; the first may be called `tree_id`, as in `fruits.csv`.

    Raises `MissingFileError`, and `FormatError` naming line and column; also for counts below 0.
    """
    table = read_small_table(path, ("tree", "count"), "`hand_counts`", "tree", also_called={"tree": "tree_id"})
    ids, counts = table.ids("tree"), table.numbers("count")
    for tree, count, line in zip(ids, counts, table.lines, strict=True):
        if count < 0:
            raise FormatError(f"{path}, line {line}, column count: expected 0 or more, found {count:g} of tree {tree}")
    return HandCounts(np.array(ids, np.int64), counts)


def known_counts(counts: HandCounts, tree_ids: IntArray, progress: Progress) -> HandCounts:
    """Return the counts of trees (t,) that photos look at, with a warning that names the others."""
    known = np.isin(counts.tree_ids, tree_ids)
    if len(tree_ids) == 0:
        progress.warn("Hand counts are of no use where trees are not known: give `trees` or `tree_spacing`")
    elif not known.all():
        strange = [str(i) for i in counts.tree_ids[~known]]
        progress.warn(
            f"Hand counts of trees that the survey does not have were left out: {few(strange)}; its photos show trees "
            f"{tree_ids.min()} to {tree_ids.max()}"
        )
    return HandCounts(counts.tree_ids[known], counts.counts[known])


@dataclass(frozen=True, eq=False)
class OnTrees:
    """What photos say of n trees: `expected` fruits (n,), hidden ones too, and those of them that were `seen` (n,).

    `draws` (k, n) and `seen_draws` (k, n) are of both as they may be.
    """

    expected: FloatArray
    seen: FloatArray
    draws: FloatArray
    seen_draws: FloatArray

    def __getitem__(self, selection: BoolArray) -> OnTrees:
        return OnTrees(
            self.expected[selection], self.seen[selection], self.draws[:, selection], self.seen_draws[:, selection]
        )


@dataclass(frozen=True, eq=False)
class Calibration:
    """The `ratio` of counts to estimates, and how many fruits each `seen` and each `hidden` one stands for.

    `seen_draws` (k,) and `hidden_draws` (k,) are of both as they may be.
    """

    ratio: CropInterval
    seen: float
    hidden: float
    seen_draws: FloatArray
    hidden_draws: FloatArray


def calibration(counts: HandCounts, trees: OnTrees, rng: np.random.Generator, progress: Progress) -> Calibration | None:
    """Return what n counts make of what photos say of these trees; None where nothing can be compared.

    Counts that are far off all others are left out, with a warning that names the tree. Each draw has a ratio of its
    own, so that what is not known of all trees alike cancels. Besides, the ratio of sums errs as trees scatter about
    it; of few trees, as trees usually do. Trees on which nothing was counted, or nothing found, count as others do:
    without them the ratio is that of trees chosen by what hangs on them.
    """
    good = _without_slips(counts, trees, progress)
    counted, trees, n = counts.counts[good], trees[good], int(good.sum())
    expected = float(trees.expected.sum())
    if expected == 0:
        return None
    if counted.sum() == 0:
        progress.warn(
            f"All hand counts are 0, where some {expected:.0f} fruits were expected from the photos: they were left "
            "out. Count trees that bear fruit, too"
        )
        return None
    ratio = float(counted.sum()) / expected
    if n > 1 and not 1 / _FAR_OFF <= ratio <= _FAR_OFF:
        progress.warn(
            f"Hand counts of {n} trees are {ratio:.2g} times what was expected from the photos: are they the same "
            "trees, on the same day?"
        )
    sums = np.maximum(trees.draws.sum(axis=1), 1.0)
    fruits = np.full(len(sums), float(counted.sum()))
    off = _scatter(counted, ratio, trees) * rng.standard_t(n - 1 + _TREES, len(sums))
    fruits = np.maximum(fruits + off, 0.0)
    found = trees.seen_draws.sum(axis=1)
    # What was found is there, unless fewer were counted on these very trees.
    fruits = np.where(counted.sum() >= found, np.maximum(fruits, found), fruits)
    seen, hidden = _shares(counted.sum(), np.array(trees.seen.sum()), np.array(expected))
    words = f"hand counts of {n} tree{'s' if n > 1 else ''} to their estimates"
    return Calibration(
        CropInterval.of_draws(ratio, fruits / sums, words), float(seen), float(hidden), *_shares(fruits, found, sums)
    )


def _scatter(counted: FloatArray, ratio: float, trees: OnTrees) -> float:
    """Return the standard deviation of the sum of n counts (n,), as trees scatter about the ratio."""
    usual, squares = _usual_scatter(trees).sum(), ((counted - ratio * trees.expected) ** 2).sum()
    return float(np.sqrt((_TREES * usual + len(counted) * squares) / (_TREES + len(counted) - 1)))


def _shares(fruits: FloatArray, found: FloatArray, expected: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how many each found fruit and each hidden one stands for, where there are so many fruits in all.

    Where there are more than expected, all are as many times more. Where there are fewer, fewer are hidden; only where
    there are fewer than found, were some of those none.
    """
    more, beyond = fruits >= expected, np.maximum(fruits - found, 0.0)
    seen = np.where(more, fruits / expected, np.minimum(fruits / np.maximum(found, 1e-9), 1.0))
    hidden = np.where(more, fruits / expected, beyond / np.maximum(expected - found, 1e-9))
    return seen, hidden


def _without_slips(counts: HandCounts, trees: OnTrees, progress: Progress) -> BoolArray:
    """Return which of n counts (n,) to use: not those that are many times what is due by all others.

    Of one, or of two that disagree, it is that which the photos contradict, if they do.
    """
    good = np.ones(len(counts), bool)
    low, high = np.percentile(trees.draws, _ENDS, axis=0)
    for _ in range(max((len(counts) - 1) // 2, 1)):
        due, off = _due(counts.counts, trees, good)
        by_photos = (off > _LIKELY) & _apart(counts.counts, low, high, _SLIP)
        by_counts = (off > _SURELY) & (len(counts) > 2) & (2 * trees.expected <= trees.expected[good].sum())
        slips = good & (by_photos | by_counts) & _apart(counts.counts, due, due, _SLIP)
        if not slips.any():
            break
        good[np.argmax(np.where(slips, off, 0.0))] = False
    due, off = _due(counts.counts, trees, good)
    strange = ~good | ((off > 1) & _apart(counts.counts, due, due, _FAR_OFF))
    for tree, count, expected, used in zip(
        counts.tree_ids[strange], counts.counts[strange], due[strange], good[strange], strict=True
    ):
        by = "the photos and the other counts" if len(counts) > 1 else "the photos"
        done = "It is used all the same" if used else "It was left out"
        progress.warn(
            f"Tree {tree}: {count:g} fruits were counted by hand where some {expected:.0f} were expected from {by}: is "
            f"it the same tree, and no slip? {done}; correct or remove it in the table of hand counts"
        )
    return good


def _due(counted: FloatArray, trees: OnTrees, good: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return what each count (n,) should be by all other good ones, and how many standard deviations it is off.

    A single count should be what is expected.
    """
    others, of_others, scatter = (
        values[good].sum() - np.where(good, values, 0.0) for values in (counted, trees.expected, _usual_scatter(trees))
    )
    known = of_others > 0
    share = trees.expected / np.where(known, of_others, 1.0)
    due = np.where(known, others * share, trees.expected)
    variances = counted + due + np.where(known, share**2 * scatter, 0.0)
    return due, np.abs(counted - due) / np.sqrt(np.maximum(variances, 1.0))


def _usual_scatter(trees: OnTrees) -> FloatArray:
    """Return the variance (n,) of counts about what is expected, as trees usually have it."""
    return np.asarray(trees.expected - trees.seen + (_TREE_SD * trees.expected) ** 2)


def _apart(counts: FloatArray, low: FloatArray, high: FloatArray, times: float) -> BoolArray:
    return np.asarray((counts > times * high) | (times * counts < low))
