"""Hand counts of a few trees, by which the estimate of all is calibrated: a ratio estimator (Cochran 1977, ch. 6)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from pomona.arrays import FloatArray, IntArray, set_checked
from pomona.errors import FormatError
from pomona.formats.small_table import read_small_table
from pomona.intervals import Interval
from pomona.progress import Progress

_FAR_OFF = 2.0  # a count that is so many times more or less than the estimate is of another tree, or a slip


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
    """Return the counts of trees that there are, with a warning that names the others."""
    known = np.isin(counts.tree_ids, tree_ids)
    if len(tree_ids) == 0:
        progress.warn(
            f"Hand counts of {len(counts)} trees are of no use, as trees are not known: give `trees` or `tree_spacing`"
        )
    elif not known.all():
        strange = ", ".join(str(i) for i in counts.tree_ids[~known])
        progress.warn(
            f"Hand counts of trees that the survey does not have were left out: {strange}; it has trees "
            f"{tree_ids.min()} to {tree_ids.max()}"
        )
    return HandCounts(counts.tree_ids[known], counts.counts[known])


def calibration(
    counts: HandCounts, draws: FloatArray, estimates: FloatArray, rng: np.random.Generator, progress: Progress
) -> tuple[Interval, FloatArray] | None:
    """Return the ratio of n counts to what was estimated of these trees (n,), and draws (k,) of it.

    `draws` (k, n) are those of the estimates. Each has a ratio of its own, so that what is not known of all trees alike
    cancels. Besides, the ratio of sums errs as trees scatter about it, with n − 1 degrees of freedom; of one tree that
    is not known. None where nothing can be compared.
    """
    usable = (estimates > 0) & (counts.counts > 0)
    for tree, count, estimate in zip(counts.tree_ids, counts.counts, estimates, strict=True):
        if not estimate / _FAR_OFF <= count <= estimate * _FAR_OFF:
            progress.warn(
                f"Tree {tree}: {count:g} fruits were counted by hand where some {estimate:.0f} were expected from the "
                "photos: is it the same tree?"
            )
    if not usable.any():
        return None
    counted, expected = counts.counts[usable], estimates[usable]
    ratio = float(counted.sum() / expected.sum())
    n = len(counted)
    ratios = counted.sum() / np.maximum(draws[:, usable].sum(axis=1), 1.0)
    if n > 1:
        of_trees = float(np.sqrt(n * (counted - ratio * expected).var(ddof=1))) / expected.sum()
        ratios = np.maximum(ratios + of_trees * student.rvs(n - 1, size=len(draws), random_state=rng), 0.0)
    return Interval.of_draws(ratio, ratios, f"hand counts of {n} tree{'s' if n > 1 else ''} to their estimates"), ratios
