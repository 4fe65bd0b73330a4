"""Where the truth is known: the paper's Table 3 (detections in 3D) and Figure 8 (counts of trees), as HTML."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import IntArray
from pomona.evaluate.fruits import Tally, Truth, evaluate_fruits
from pomona.stages.report.data import ReportData
from pomona.stages.report.plots import caption, framed
from pomona.stages.report.svg import Axis, Point, scatter_chart
from pomona.stages.report.tables import plain_table


def table_3(data: ReportData, truth: Truth) -> str:
    """Return the scores of the paper's Table 3: a line for all true fruits, and one for those that photos show."""
    tallies = evaluate_fruits(data.fruits, truth).tallies
    heads = ("true fruits", "T", "D", "TP", "FP", "MD", "DR", "R", "P", "FDR", "MDR", "F1")
    note = "<p class='note'>As defined by equations 3 to 8 of Gené-Mola et al. 2020.</p>"
    table = plain_table(heads, [_cells(tally) for tally in tallies])
    return f'<div class="sheet"><h2>Against the truth</h2>{table}{note}</div>'


def _cells(tally: Tally) -> tuple[str, ...]:
    counts = (tally.true_fruits, tally.detections, tally.true_positives, tally.false_positives, tally.multi_detections)
    rates = (
        tally.detection_rate, tally.recall, tally.precision, tally.false_detection_rate, tally.multi_detection_rate,
        tally.f1,
    )  # fmt: skip
    return tally.label, *map(str, counts), *(f"{rate:.3f}" if math.isfinite(rate) else "–" for rate in rates)


def counts_by_tree(data: ReportData, truth: Truth) -> tuple[IntArray, IntArray, IntArray]:
    """Return the true trees (t,), and how many fruits each has and was found to have, (t,).

    A found fruit is of the tree of the nearest true one: trees of a survey may be numbered otherwise.
    """
    trees = np.unique(truth.tree_ids[truth.tree_ids > 0])
    on_tree = truth.tree_ids > 0
    if not len(trees) or not len(data.fruits):
        return trees, np.zeros(len(trees), np.int64), np.zeros(len(trees), np.int64)
    nearest = cKDTree(truth.centers_in_world[on_tree]).query(data.fruits.centers_in_world)[1]
    found = truth.tree_ids[on_tree][np.asarray(nearest)]
    true_counts = np.array([(truth.tree_ids == tree).sum() for tree in trees])
    return trees, true_counts, np.array([(found == tree).sum() for tree in trees])


def figure_8(data: ReportData, truth: Truth) -> str:
    """Return the fruits found on each tree over those that hang there, with R² and RMSE; nothing below two trees."""
    trees, true, found = counts_by_tree(data, truth)
    if len(trees) < 2:
        return ""
    rmse = float(np.sqrt(np.mean((found - true) ** 2)))
    varied = true.std() > 0 and found.std() > 0
    r2 = f"R² {np.corrcoef(true, found)[0, 1] ** 2:.3f}, " if varied else ""
    points = [
        Point(float(t), float(f), f"tree {tree}: {f} of {t}") for tree, t, f in zip(trees, true, found, strict=True)
    ]
    chart = scatter_chart(points, Axis(name="fruits on the tree"), Axis(name="found"))
    return framed([caption("Trees against the truth", f"{r2}RMSE {rmse:.1f} fruits") + chart])
