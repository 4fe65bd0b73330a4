"""Scores of fruits and of detections, and what went wrong, as tables for people."""

from __future__ import annotations

import math

from rich.console import Group
from rich.table import Table

from pomona.evaluate.detections.matching import EvaluateDetectionsOptions
from pomona.evaluate.detections.scores import DetectionScores, Level
from pomona.evaluate.diagnosis.mistakes import STAGES, Mistakes
from pomona.evaluate.fruits.scores import Scores, Tally
from pomona.evaluate.rates import written


def fruits_table(scores: Scores) -> Table:
    """Return the scores as a `rich` table, a column for each set of true fruits; the paper's letters in brackets."""
    table = Table(title="Found fruits against true ones")
    table.add_column("")
    for tally in scores.tallies:
        table.add_column("all fruits" if tally.label == "all" else f"{tally.label} fruits", justify="right")
    for cells in zip(*(_fruit_cells(tally) for tally in scores.tallies), strict=True):
        table.add_row(
            cells[0][0], *(value for _, value in cells), end_section=cells[0][0] in ("hidden, not scored", "F1")
        )
    return table


def _fruit_cells(tally: Tally) -> list[tuple[str, str]]:
    return [
        ("true fruits (T)", str(tally.true_fruits)),
        ("detections (D)", str(tally.detections)),
        ("right (TP)", str(tally.true_positives)),
        ("false (FP)", str(tally.false_positives)),
        ("doubles (MD)", str(tally.multi_detections)),
        ("true fruits detected (LD)", str(tally.labels_detected)),
        ("hidden, not scored", str(tally.hidden)),
        ("detection rate (DR)", written(tally.detection_rate)),
        ("recall (R)", written(tally.recall)),
        ("precision (P)", written(tally.precision)),
        ("false detections (FDR)", written(tally.false_detection_rate)),
        ("multiple detections (MDR)", written(tally.multi_detection_rate)),
        ("F1", written(tally.f1)),
        ("centre error, RMS", _mm(tally.center_rmse_m)),
        ("centre error, median", _mm(tally.center_median_m)),
        ("diameter, mean error", _mm(tally.diameter_bias_m, signed=True)),
        ("diameter, mean absolute error", _mm(tally.diameter_mae_m)),
    ]


def detections_table(scores: DetectionScores, options: EvaluateDetectionsOptions | None = None) -> Group:
    """Return the scores as `rich` tables: the counts and average precisions, and below them the paper's Table 2."""
    options = options or EvaluateDetectionsOptions()
    what = "masks" if scores.by_masks else "boxes"
    totals = Table(title=f"Detections against true fruits, by {what}", show_header=False)
    totals.add_column("")
    totals.add_column("", justify="right")
    totals.add_row("photos", str(len(scores.matches)))
    totals.add_row("true fruits", str(scores.true_fruits))
    totals.add_row(_not_scored(options), str(scores.ignored))
    totals.add_row("detections", str(scores.detections))
    totals.add_row("AP (IoU 0.50 to 0.95)", written(scores.ap, digits=4))
    totals.add_row("AP50", written(scores.ap50, digits=4))
    if scores.best:
        totals.add_row(f"best F1 (at confidence {scores.best.confidence:.3f})", written(scores.best.f1, digits=4))
        totals.add_row("mean IoU of right ones' masks, there", written(scores.best.mask_iou, digits=4))
        totals.add_row("mean IoU of right ones' boxes, there", written(scores.best.box_iou, digits=4))
    return Group(totals, _table_2(scores, options))


def _table_2(scores: DetectionScores, options: EvaluateDetectionsOptions) -> Table:
    table = Table(title=f"By confidence, IoU > {options.min_iou:g}")
    for name in ("Confidence", "R", "P", "F1", "mean IoU"):
        table.add_column(name, justify="right")
    known = [level.f1 for level in scores.levels if not math.isnan(level.f1)]
    for level in scores.levels:
        is_best = bool(known) and level.f1 == max(known)
        table.add_row(*_level_cells(level, scores.by_masks), style="bold" if is_best else "")
    return table


def _level_cells(level: Level, by_masks: bool) -> list[str]:
    values = (level.recall, level.precision, level.f1, level.mask_iou if by_masks else level.box_iou)
    return [f"{level.confidence:g}", *(written(value, digits=4) for value in values)]


def _not_scored(options: EvaluateDetectionsOptions) -> str:
    reasons = [f"under {options.min_size_px:g} px wide"] if options.min_size_px else []
    reasons += [f"under {options.min_visible_px} px visible"] if options.min_visible_px else []
    return f"true ones not scored ({', '.join([*reasons, 'ignored'])})"


def mistakes_table(mistakes: Mistakes) -> Table:
    """Return how many fruits went wrong, by kind and by stage, as a `rich` table."""
    table = Table(title="What went wrong, and where")
    for column in ("kind", "likely stage"):
        table.add_column(column)
    table.add_column("visible fruits" if mistakes.label == "visible" else "fruits", justify="right")
    for kind, of in mistakes.counts().items():
        for k, (stage, number) in enumerate(of.items()):
            table.add_row(kind if k == 0 else "", STAGES[stage], str(number), end_section=k == len(of) - 1)
    return table


def _mm(value_m: float, *, signed: bool = False) -> str:
    if math.isnan(value_m):
        return "–"
    return f"{1000 * value_m:+.1f} mm" if signed else f"{1000 * value_m:.1f} mm"
