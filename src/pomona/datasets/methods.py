"""Fruits from given cameras and masks, perhaps photos and a cloud, by every method that these allow."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pomona.basics.arrays import IntArray
from pomona.datasets.fuji_row import TrueTrees
from pomona.datasets.row_scores import trees_of
from pomona.errors import InputError
from pomona.evaluate.fruits import EvaluateOptions
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.pipeline import RunOptions
from pomona.progress import Progress
from pomona.stages import filter as filters
from pomona.stages.filter import CODE_FEATURE_NAMES, FEATURE_NAMES, LinearSvm
from pomona.stages.filter.training import training_table
from pomona.stages.fuse import Fused, object, paper
from pomona.stages.fuse.paper.projection import MIN_DLT_POINTS
from pomona.stages.measure import measure
from pomona.stages.second_look import look_again
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits
from pomona.values.photos import Photos

OBJECT = "object"
_VARIANTS = {"paper": None, "paper, text": "text", "paper, published code": "published-code"}


@dataclass(frozen=True, eq=False)
class Given:
    """What fruits are made of.

    `photos` are those of the cameras, without which there is no second look, and the paper's method needs a `cloud`.
    `least_score` is the score from which a detection in a single photo counts; 0 for masks that were given, as who
    gives them has chosen them.
    """

    cameras: Cameras
    detections: SurveyDetections
    photos: Photos | None = None
    cloud: FruitCloud | None = None
    least_score: float = 0.0


def found_by_methods(
    given: Given, known: TrueTrees | None, fruit_diameter_m: float, progress: Progress
) -> tuple[dict[str, Fruits], tuple[str, ...]]:
    """Return the fruits by method, and what need be said of them.

    The paper's method needs a cloud; its support vector machine is trained on the training trees, as in the paper,
    where there are enough fruits and false positives, else it is the shipped one.
    """
    found = {OBJECT: _by_object(given, fruit_diameter_m, progress)}
    notes: list[str] = []
    for name, variant in _VARIANTS.items() if given.cloud is not None else ():
        if variant == "published-code" and not _has_tie_points(given.cameras):
            notes.append(f"{name}: left out, as the cameras have no tie points, which that program needs")
            continue
        # The published code's own threshold is for its own masks' scores.
        threshold = given.least_score or None
        options = RunOptions(
            method="paper", variant=variant, fruit_diameter_m=fruit_diameter_m, score_threshold=threshold
        )
        found[name], note = _by_paper(given, options, known, progress)
        notes.append(f"{name}: {note}")
    return found, tuple(notes)


def _by_object(given: Given, fruit_diameter_m: float, progress: Progress) -> Fruits:
    run = RunOptions(fruit_diameter_m=fruit_diameter_m)
    options = run.of_stages
    _, least_score = options.select.thresholds(given.least_score)
    detections = given.detections.at_least(least_score)
    fused = object.fuse(detections, given.cameras, options=options.object, progress=progress)
    if len(fused.fruits) == 0:
        return fused.fruits
    if given.photos is not None:
        fused = look_again(
            fused, detections, given.photos, given.cameras,
            options=options.looking, association=options.object, progress=progress,
        )  # fmt: skip
    fused = filters.apply_to_views(
        fused, detections, given.cameras, photos=given.photos, options=options.filter, progress=progress
    )
    return measure(fused, detections, given.cameras, given.photos, options=options.measure, progress=progress)


def _by_paper(given: Given, run: RunOptions, known: TrueTrees | None, progress: Progress) -> tuple[Fruits, str]:
    assert given.cloud is not None
    options = run.of_stages
    detections = given.detections.at_least(given.least_score)
    fused = paper.fuse(detections, given.cameras, given.cloud, options=options.paper, progress=progress)
    if len(fused.fruits) == 0:
        least = f" of a score of {options.paper.min_score:g} or more" if options.paper.min_score else ""
        return fused.fruits, f"no fruit: no detection{least} has points of the cloud"
    svm, note = _machine(fused, run, known)
    fused = filters.apply(fused, svm)
    return measure(fused, detections, given.cameras, options=options.measure, progress=progress), note


def _machine(fused: Fused, options: RunOptions, known: TrueTrees | None) -> tuple[LinearSvm, str]:
    """The machine of the training trees' fruits, and what it was trained on."""
    shipped = filters.load(filters.shipped("paper", options.variant))
    if known is None:
        return shipped, "with the shipped support vector machine, as no true fruits are known"
    names = CODE_FEATURE_NAMES if options.variant == "published-code" else FEATURE_NAMES
    of_training = _on_training_trees(fused, known)
    matched = EvaluateOptions(match="inside")
    values, is_fruit = training_table(of_training, known.truth, names=names, options=matched)
    diameter_m = size_of_fruits(fused.fruits.diameters_m, FruitSize()).diameter_m
    said = f"{is_fruit.sum()} fruits and {(~is_fruit).sum()} false positives of the training trees"
    try:
        svm = LinearSvm.train(values, is_fruit, names=names, fruit_diameter_m=diameter_m, trained_on=said)
    except InputError:
        return shipped, f"with the shipped support vector machine, as there are only {said}"
    return svm, f"its support vector machine trained on {said}"


def _on_training_trees(fused: Fused, known: TrueTrees) -> Fused:
    own: IntArray = fused.fruits.ids[np.isin(trees_of(fused.fruits, known.truth), sorted(known.training))]
    cloud = replace(fused.cloud, fruit_id=np.where(np.isin(fused.cloud.fruit_id, own), fused.cloud.fruit_id, 0))
    return replace(fused, cloud=cloud)


def _has_tie_points(cameras: Cameras) -> bool:
    return bool(np.bincount(cameras.track_photo_idx, minlength=1).max() >= MIN_DLT_POINTS)
