"""`pomona run`: the whole job."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from pomona.cli import options as shared
from pomona.cli.action import with_progress
from pomona.cli.failures import say
from pomona.cli.progress import TerminalProgress
from pomona.cli.summary import show
from pomona.pipeline import RunOptions, Summary
from pomona.pipeline import run as run_pipeline
from pomona.pipeline.options import parse_names, parse_scale_bar

_ENGINE = Annotated[
    str, typer.Option(metavar="auto|opencv|patchmatch", help="Engine for the dense cloud; patchmatch needs a GPU.")
]
_ADAPT = Annotated[bool, typer.Option("--adapt", help="Train the segmenter on this survey, then run again with it.")]


def run(
    photos: shared.Photos,
    out: shared.Out,
    markers: shared.Markers = None,
    markers_crs: shared.MarkersCrs = None,
    gcp: shared.Gcp = None,
    positions: shared.Positions = None,
    scale_bar: shared.ScaleBar = None,
    marker_dictionary: shared.MarkerDictionary = "DICT_4X4_50",
    fruit: shared.Fruit = None,
    fruit_diameter: shared.FruitDiameter = None,
    weights: shared.Weights = None,
    trees: shared.Trees = None,
    tree_spacing: shared.TreeSpacing = None,
    hand_counts: shared.HandCounts = None,
    packing: shared.Packing = None,
    model: shared.Model = None,
    score_threshold: shared.ScoreThreshold = None,
    detections: shared.GivenDetections = None,
    classes: shared.Classes = None,
    cameras: shared.Cameras = None,
    method: shared.Method = "object",
    variant: shared.Variant = None,
    sides: shared.Sides = "auto",
    engine: _ENGINE = "auto",
    gnss: shared.Gnss = True,
    second_look: shared.SecondLook = True,
    scene: shared.Scene = True,
    filter: shared.Filter = True,
    filter_model: shared.FilterModel = None,
    adapt: _ADAPT = False,
    overwrite: shared.Overwrite = False,
    as_json: shared.Json = False,
) -> None:
    """Find every fruit in photos of a row, with its position and size, as a table, a map, a cloud and a report.

    An interrupted run continues where it stopped; a changed option recomputes only what depends on it.
    """
    chosen = RunOptions(
        sides=sides, model=model, score_threshold=score_threshold,
        detections=detections, classes=parse_names(classes), cameras=cameras,
        markers=markers, markers_crs=markers_crs, marker_dictionary=marker_dictionary,
        gcp=gcp, positions=positions, use_gnss=gnss, scale_bar=parse_scale_bar(scale_bar),
        fruit=fruit, fruit_diameter_m=fruit_diameter, weights=weights,
        trees=trees, tree_spacing=tree_spacing, hand_counts=hand_counts, packing=packing,
        method=method, variant=variant, engine=engine, second_look=second_look, scene=scene,
        filter_false_positives=filter, filter_model=filter_model,
    )  # fmt: skip
    work = _run_adapted if adapt else run_pipeline
    summary = with_progress(
        lambda progress: work(photos, out, chosen, progress, overwrite=overwrite, on_stage=progress.stage), out
    )
    show(summary, as_json=as_json)


def _run_adapted(
    photos: list[Path],
    out: Path,
    options: RunOptions,
    progress: TerminalProgress,
    *,
    overwrite: bool,
    on_stage: Callable[[str], None],
) -> Summary:
    """Run, train the segmenter on what was found, and run again with it; says what that changed."""
    from pomona.learning.self_training.rerun import run_adapted

    rerun = run_adapted(photos, out, options, progress, overwrite=overwrite, on_stage=on_stage)
    say("Learnt", "bold", rerun.changed)
    return rerun.summary
