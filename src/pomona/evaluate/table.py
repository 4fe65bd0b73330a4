"""Scores as a table for people."""

from __future__ import annotations

import math

from rich.table import Table

from pomona.evaluate.scores import Scores, Tally


def scores_table(scores: Scores) -> Table:
    """Return the scores as a `rich` table, a column for each set of true fruits; the paper's letters in brackets."""
    table = Table(title="Found fruits against true ones")
    table.add_column("")
    for tally in scores.tallies:
        table.add_column("all fruits" if tally.label == "all" else f"{tally.label} fruits", justify="right")
    for cells in zip(*(_cells(tally) for tally in scores.tallies), strict=True):
        table.add_row(
            cells[0][0], *(value for _, value in cells), end_section=cells[0][0] in ("hidden, not scored", "F1")
        )
    return table


def _cells(tally: Tally) -> list[tuple[str, str]]:
    return [
        ("true fruits (T)", str(tally.true_fruits)),
        ("detections (D)", str(tally.detections)),
        ("right (TP)", str(tally.true_positives)),
        ("false (FP)", str(tally.false_positives)),
        ("doubles (MD)", str(tally.multi_detections)),
        ("true fruits detected (LD)", str(tally.labels_detected)),
        ("hidden, not scored", str(tally.hidden)),
        ("detection rate (DR)", _share(tally.detection_rate)),
        ("recall (R)", _share(tally.recall)),
        ("precision (P)", _share(tally.precision)),
        ("false detections (FDR)", _share(tally.false_detection_rate)),
        ("multiple detections (MDR)", _share(tally.multi_detection_rate)),
        ("F1", _share(tally.f1)),
        ("centre error, RMS", _mm(tally.center_rmse_m)),
        ("centre error, median", _mm(tally.center_median_m)),
        ("diameter, mean error", _mm(tally.diameter_bias_m, signed=True)),
        ("diameter, mean absolute error", _mm(tally.diameter_mae_m)),
    ]


def _share(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.3f}"


def _mm(value_m: float, *, signed: bool = False) -> str:
    if math.isnan(value_m):
        return "–"
    return f"{1000 * value_m:+.1f} mm" if signed else f"{1000 * value_m:.1f} mm"
