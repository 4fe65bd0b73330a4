"""The paper's Table 3 and Figure 8: found fruits against true ones, by trees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray, IntArray
from pomona.datasets.fuji_row import TrueTrees
from pomona.datasets.published import FUJI_FIGURE_8, FUJI_TABLE_3
from pomona.datasets.values import ComparedTable, Figure
from pomona.evaluate.fruits import EvaluateOptions, Tally, Truth, evaluate_fruits
from pomona.values.fruits import Fruits

_MATCHES = {"boxes": "more than half of the found box in the true one", "inside": "the found centre in the true box"}


@dataclass(frozen=True)
class TreeCounts:
    """Detections D and true fruits T of each tree (n,)."""

    trees: tuple[int, ...]
    detections: IntArray
    true_fruits: IntArray

    @property
    def r2(self) -> float:
        """R² of the line through D over T: the square of their correlation; NaN where one of them is all the same."""
        if len(self.trees) < 3 or np.ptp(self.detections) == 0 or np.ptp(self.true_fruits) == 0:
            return float("nan")
        return float(np.corrcoef(self.detections, self.true_fruits)[0, 1] ** 2)

    @property
    def rmse_percent(self) -> float:
        """The root mean square of D − T, in percent of the mean T."""
        off = self.detections - self.true_fruits
        return float(100 * np.sqrt((off**2).mean()) / self.true_fruits.mean())


def trees_of(fruits: Fruits, truth: Truth) -> IntArray:
    """Return the tree (n,) of each found fruit: that of the true fruit whose centre is nearest."""
    if len(fruits) == 0:
        return np.zeros(0, np.int64)
    nearest = cKDTree(truth.centers_in_world).query(fruits.centers_in_world)[1]
    trees: IntArray = truth.tree_ids[nearest]
    return trees


def table_3(found: Mapping[str, Fruits], known: TrueTrees) -> list[ComparedTable]:
    """Return Table 3 for each part and each way to say what a right fruit is; a column for each of `found`."""
    tables = []
    for part in ("training", "test"):
        trees = np.array(sorted(known.of(part)))
        truth = _of_trees(known.truth, trees)
        if len(truth) == 0:
            continue
        for match, words in _MATCHES.items():
            options = EvaluateOptions(match=match)  # type: ignore[arg-type]
            tallies = {
                name: evaluate_fruits(fruits[np.isin(trees_of(fruits, known.truth), trees)], truth, options=options).all
                for name, fruits in found.items()
            }
            title = f"Table 3, {part} trees ({len(trees)}; {len(truth)} apples): right is {words}"
            tables.append(_table_3(title, tallies, part))
    return tables


def figure_8(found: Mapping[str, Fruits], known: TrueTrees) -> ComparedTable:
    """Return R² and RMSE of detections against true fruits by tree, and the counts themselves."""
    counts = {name: counts_by_tree(fruits, known) for name, fruits in found.items()}
    printed = FUJI_FIGURE_8.figures
    figures = [
        Figure("R²", {name: count.r2 for name, count in counts.items()}, printed["R²"]),
        Figure("RMSE, %", {name: count.rmse_percent for name, count in counts.items()}, printed["RMSE, %"]),
    ]
    for k, tree in enumerate(known.trees):
        of_tree = {name: int(count.detections[k]) for name, count in counts.items()}
        true = int((known.truth.tree_ids == tree).sum())
        figures.append(Figure(f"D of tree {tree} (T = {true})", of_tree))
    notes = ("RMSE is of D − T, in percent of the mean T; R² the squared correlation", known.source)
    return ComparedTable("Figure 8, detections D and fruits T by tree", tuple(figures), FUJI_FIGURE_8.source, notes)


def counts_by_tree(fruits: Fruits, known: TrueTrees) -> TreeCounts:
    """Return how many fruits were found on each tree, and how many there are."""
    of_fruits = trees_of(fruits, known.truth)
    found = [int((of_fruits == tree).sum()) for tree in known.trees]
    true = [int((known.truth.tree_ids == tree).sum()) for tree in known.trees]
    return TreeCounts(known.trees, np.array(found), np.array(true))


def _of_trees(truth: Truth, trees: IntArray) -> Truth:
    own = np.isin(truth.tree_ids, trees)
    boxes: FloatArray | None = None if truth.boxes_in_world is None else truth.boxes_in_world[own]
    return Truth(truth.ids[own], truth.centers_in_world[own], truth.diameters_m[own], truth.tree_ids[own], boxes)


def _table_3(title: str, tallies: Mapping[str, Tally], part: str) -> ComparedTable:
    values = {
        "DR": "detection_rate", "R": "recall", "P": "precision", "FDR": "false_detection_rate",
        "MDR": "multi_detection_rate", "F1": "f1", "T": "true_fruits", "D": "detections",
    }  # fmt: skip
    published = FUJI_TABLE_3[part]
    figures = tuple(
        Figure(
            name, {column: getattr(tally, field) for column, tally in tallies.items()},
            published.figures.get(name),
        )
        for name, field in values.items()
    )  # fmt: skip
    return ComparedTable(title, figures, published.source)
