"""`pomona run`: the whole job."""

from __future__ import annotations

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
    engine: Annotated[
        str, typer.Option(metavar="auto|opencv|patchmatch", help="Engine for the dense cloud; patchmatch needs a GPU.")
    ] = "auto",
    gnss: Annotated[bool, typer.Option(help="Use the photos' GNSS positions for scale and place.")] = True,
    second_look: Annotated[
        bool, typer.Option(help="Look at every fruit again in all photos, to place it better.")
    ] = True,
    scene: Annotated[bool, typer.Option(help="Make a dense cloud of the whole row for viewing.")] = True,
    filter: Annotated[bool, typer.Option("--filter/--no-filter", help="Remove fruits that are probably false.")] = True,
    filter_model: Annotated[
        Path | None, typer.Option(metavar="JSON", help="Use your own support vector machine for --filter.")
    ] = None,
    adapt: Annotated[
        bool, typer.Option("--adapt", help="Train the segmenter on this survey, then run again with it.")
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Start again: discard earlier results in SURVEY.")
    ] = False,
    as_json: shared.Json = False,
) -> None:
    """Find every fruit in photos of a row, with its position and size, as a table, a map, a cloud and a report.

    An interrupted run continues where it stopped; a changed option recomputes only what depends on it.
    """
    chosen = RunOptions(
        sides=sides,
        method=method,
        variant=variant,
        model=model,
        score_threshold=score_threshold,
        detections=detections,
        classes=parse_names(classes),
        cameras=cameras,
        markers=markers,
        markers_crs=markers_crs,
        gcp=gcp,
        positions=positions,
        scale_bar=parse_scale_bar(scale_bar),
        marker_dictionary=marker_dictionary,
        use_gnss=gnss,
        fruit=fruit,
        fruit_diameter_m=fruit_diameter,
        weights=weights,
        trees=trees,
        tree_spacing=tree_spacing,
        hand_counts=hand_counts,
        packing=packing,
        engine=engine,
        second_look=second_look,
        scene=scene,
        filter_false_positives=filter,
        filter_model=filter_model,
    )

    def work(progress: TerminalProgress) -> Summary:
        if not adapt:
            return run_pipeline(photos, out, chosen, progress, overwrite=overwrite, on_stage=progress.stage)
        from pomona.self_training.rerun import run_adapted

        rerun = run_adapted(photos, out, chosen, progress, overwrite=overwrite, on_stage=progress.stage)
        say("Learnt", "bold", rerun.changed)
        return rerun.summary

    show(with_progress(work, out), as_json=as_json)
