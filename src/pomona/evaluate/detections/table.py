"""Scores of detections as a table for people."""

from __future__ import annotations

import math

from rich.console import Group
from rich.table import Table

from pomona.evaluate.detections.options import EvaluateDetectionsOptions
from pomona.evaluate.detections.scores import DetectionScores, Level


def detections_table(scores: DetectionScores, options: EvaluateDetectionsOptions | None = None) -> Group:
    """Return the scores as `rich` tables: the counts and average precisions, and below them the paper's Table 2."""
    options = options or EvaluateDetectionsOptions()
    what = "masks" if scores.by_masks else "boxes"
    totals = Table(title=f"Detections against true fruits, by {what}", show_header=False)
    totals.add_column("")
    totals.add_column("", justify="right")
    totals.add_row("photos", str(len(scores.matches)))
    totals.add_row("true fruits", str(scores.true_fruits))
    totals.add_row(_ignored(options), str(scores.ignored))
    totals.add_row("detections", str(scores.detections))
    totals.add_row("AP (IoU 0.50 to 0.95)", _share(scores.ap))
    totals.add_row("AP50", _share(scores.ap50))
    if scores.best:
        totals.add_row(f"best F1 (at confidence {scores.best.confidence:.3f})", _share(scores.best.f1))
        totals.add_row("mean IoU of right ones' masks, there", _share(scores.best.mask_iou))
        totals.add_row("mean IoU of right ones' boxes, there", _share(scores.best.box_iou))
    return Group(totals, _table_2(scores, options))


def _table_2(scores: DetectionScores, options: EvaluateDetectionsOptions) -> Table:
    table = Table(title=f"By confidence, IoU > {options.min_iou:g}")
    for name in ("Confidence", "R", "P", "F1", "mean IoU"):
        table.add_column(name, justify="right")
    known = [level.f1 for level in scores.levels if not math.isnan(level.f1)]
    for level in scores.levels:
        is_best = bool(known) and level.f1 == max(known)
        table.add_row(*_cells(level, scores.by_masks), style="bold" if is_best else "")
    return table


def _cells(level: Level, by_masks: bool) -> list[str]:
    iou = level.mask_iou if by_masks else level.box_iou
    return [f"{level.confidence:g}", *(_share(value) for value in (level.recall, level.precision, level.f1, iou))]


def _ignored(options: EvaluateDetectionsOptions) -> str:
    reasons = [f"under {options.min_size_px:g} px wide"] if options.min_size_px else []
    reasons += [f"under {options.min_visible_px} px visible"] if options.min_visible_px else []
    return f"true ones not scored ({', '.join([*reasons, 'ignored'])})"


def _share(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.4f}"
