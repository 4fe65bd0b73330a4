"""Train the support vector machine that tells fruits from false positives.

python benchmarks/train_filter.py OUT.json ROW [ROW ...] [--method object|paper] [--variant published-code]
                                  [--second-look] [--repeats N] [--left-out FOLDER]

A ROW is a rendered row's folder with its truth (`benchmarks/render_rows.py`, or orchard-dev), with the true cameras.
Detections are those of the shipped segmenter, for `object` from several scores up, and true masks of which some were
dropped and false ones added, with scores that say nothing, so that what is learnt is not one segmenter's habits; each
of these from all photos, from every second and from every third, so that it is not one density of photos either. With
`--second-look`, of fruits that were looked at again, and fewer of each. For `paper` true masks made worse and joined by
false ones, `--repeats` times; with `--variant published-code` on that program's six features, of detections of any
score, through the true lens. Fusion, measures and (for the paper's method) the cloud are the pipeline's own.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from association import dropped, with_false
from command_line import parser_of
from pomona.evaluate.fruits import Truth, evaluate_fruits, read_truth
from pomona.evaluate.fruits.matching import EvaluateOptions, candidates_by_center
from pomona.learning.synth.truth import RowFolder, read_mask
from pomona.pipeline import RunOptions
from pomona.stages.capture import load_photos
from pomona.stages.dense import fruit_cloud
from pomona.stages.filter import (
    LOOKED_FEATURE_NAMES,
    VIEW_FEATURE_NAMES,
    LinearSvm,
    resized,
    view_features,
)
from pomona.stages.filter.point_features import CODE_FEATURE_NAMES, FEATURE_NAMES
from pomona.stages.filter.training import training_table
from pomona.stages.fuse import Fused, paper
from pomona.stages.measure import measure
from pomona.stages.segment import load_segmenter, segment_photos
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import Fruits
from pomona.values.photos import Photos
from row_cases import RowCase, true_cameras, true_detections

REFERENCE_M = 0.075
# Masks smaller than this share of a fruit's disc are not looked for by a segmenter.
SMALLEST_SHARE = 0.08
# The scores from which detections are used, as shares of the segmenter's own threshold.
SHARES = (1.0, 0.8, 0.6, 0.4)
LEAST_CHANCE_SCORES = (0.4, 1.0)
# Which photos: every n-th, from which on.
THINNED = ((1, 0), (2, 0), (2, 1), (3, 1))
# Looking again takes longer.
SHARES_LOOKED, LEAST_CHANCE_SCORES_LOOKED, THINNED_LOOKED = (0.8, 0.5), (0.4,), ((1, 0), (2, 0), (3, 1))


def false_objects(truth: Truth, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Centres and half widths (m) of leaves that pass for fruits: among the fruits, and in none of them."""
    count = max(8, len(truth) // 3)
    beside = truth.centers_in_world[rng.integers(0, len(truth), 4 * count)] + rng.normal(0, 0.15, (4 * count, 3))
    apart = np.linalg.norm(beside[:, None] - truth.centers_in_world[None], axis=2).min(1)
    centers = beside[apart > 0.9 * np.median(truth.diameters_m)][:count]
    return centers, rng.uniform(0.15, 0.5, len(centers)) * np.median(truth.diameters_m)


def ellipse(shape: tuple[int, int], center: np.ndarray, half_px: float, rng: np.random.Generator) -> np.ndarray:
    canvas = np.zeros(shape, np.uint8)
    axes = (max(1, round(half_px)), max(1, round(half_px * rng.uniform(0.4, 1))))
    at = (round(float(center[0])), round(float(center[1])))
    return cv2.ellipse(canvas, at, axes, float(rng.uniform(0, 180)), 0, 360, 1, -1).astype(bool)


def worse(mask: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    change = rng.choice([cv2.MORPH_ERODE, cv2.MORPH_DILATE, cv2.MORPH_CLOSE])
    return cv2.morphologyEx(mask.astype(np.uint8), int(change), kernel).astype(bool)


def photo_masks(
    ids: np.ndarray, fruit_px: float, projected: list[tuple[np.ndarray, float]], rng: np.random.Generator
) -> Iterator[tuple[np.ndarray, float]]:
    """Yield masks (H, W) and scores: true ones, some missed and all a little wrong; then false ones."""
    whole_px = np.pi / 4 * fruit_px**2
    for i in np.unique(ids[ids > 0]):
        share = (ids == i).sum() / whole_px
        if share > SMALLEST_SHARE and rng.random() < min(0.95, 0.5 + share):
            yield worse(ids == i, rng), rng.uniform(0.6, 1)
    alone = [(rng.uniform((0, 0), ids.shape[::-1]), rng.uniform(0.15, 0.5) * fruit_px) for _ in range(3)]
    for center, half_px in [*(p for p in projected if rng.random() < 0.35), *alone]:
        yield ellipse(ids.shape, center, half_px, rng) & (ids == 0), rng.uniform(0.5, 0.9)


def worse_detections(row: RowFolder, cameras: Cameras, truth: Truth, rng: np.random.Generator) -> SurveyDetections:
    centers, halves_m = false_objects(truth, rng)
    by_photo, next_id = {}, 1
    for i, name in enumerate(cameras.photos):
        ids = read_mask(row.mask(Path(name).stem))
        focal_px = cameras.intrinsics_of(i).focal_px
        xy_px, depth_m = cameras.project(i, centers)
        inside = np.isfinite(xy_px).all(1) & (xy_px > 0).all(1) & (xy_px < ids.shape[::-1]).all(1)
        projected = [(xy_px[k], focal_px * halves_m[k] / depth_m[k]) for k in np.flatnonzero(inside)]
        typical_m = np.median(cameras.project(i, truth.centers_in_world)[1])
        found = photo_masks(ids, focal_px * np.median(truth.diameters_m) / typical_m, projected, rng)
        kept = [(Mask.from_pixels(m), score) for m, score in found if m.sum() >= 20]
        scores = np.array([score for _, score in kept])
        new_ids = np.arange(next_id, next_id + len(kept))
        by_photo[name] = Detections(name, ids.shape[1], ids.shape[0], tuple(m for m, _ in kept), scores, new_ids)
        next_id += len(kept)
    return SurveyDetections(by_photo)


@dataclass(frozen=True)
class Learnt:
    """What a machine is for."""

    method: str
    variant: str | None
    second_look: bool
    repeats: int

    @property
    def names(self) -> tuple[str, ...]:
        if self.method == "object":
            return LOOKED_FEATURE_NAMES if self.second_look else VIEW_FEATURE_NAMES
        return CODE_FEATURE_NAMES if self.variant == "published-code" else FEATURE_NAMES

    @property
    def shares(self) -> tuple[float, ...]:
        if self.method == "paper":
            return (1.0,)
        return SHARES_LOOKED if self.second_look else SHARES


@dataclass(frozen=True)
class Example:
    """What one survey teaches: features (n, k), whether each is a fruit (n,), and the fruits as they are measured.

    `place_probability` (n,): that it is where it is said, which no machine learns.
    """

    label: str
    values: np.ndarray
    is_fruit: np.ndarray
    fruits: Fruits
    truth: Truth
    place_probability: np.ndarray


def kinds_of_detections(
    learnt: Learnt, row: RowFolder, photos: Photos, cameras: Cameras, truth: Truth
) -> Iterator[tuple[str, SurveyDetections]]:
    segmenter = load_segmenter(None)
    found = segment_photos(photos, segmenter)
    for share in learnt.shares:
        score = share * segmenter.traits.score_threshold
        yield f"the shipped segmenter's masks from a score of {score:g} up", found.at_least(score)
    if learnt.method == "paper":
        for r in range(learnt.repeats):
            yield f"true masks made worse {r}", worse_detections(row, cameras, truth, np.random.default_rng(r))
        return
    rng = np.random.default_rng(0)
    for least in LEAST_CHANCE_SCORES_LOOKED if learnt.second_look else LEAST_CHANCE_SCORES:
        worse = {name: with_chance_scores(with_false(dropped(found, rng), rng), least, rng) for name, found in
                 true_detections(row, photos).items()}  # fmt: skip
        yield f"true masks dropped and joined by false ones, scores {least:g} to 1", SurveyDetections(worse)


def with_chance_scores(found: Detections, least: float, rng: np.random.Generator) -> Detections:
    return replace(found, scores=rng.uniform(least, 1, len(found)))


def examples(folder: Path, learnt: Learnt) -> Iterator[Example]:
    row, truth = RowFolder(folder), read_truth(folder)
    photos = load_photos([folder / "images"])
    cameras = true_cameras(row, photos.names)
    for kind, detections in kinds_of_detections(learnt, row, photos, cameras, truth):
        case = RowCase(photos, cameras, detections, truth)
        if learnt.method == "paper":
            yield paper_example(f"{folder.name}, {kind}", case, learnt.variant)
            continue
        for step, first in THINNED_LOOKED if learnt.second_look else THINNED:
            label = f"{folder.name}, {kind}, every photo {step} from {first}"
            yield object_example(label, case.every(step, first), learnt.second_look)


def paper_example(label: str, case: RowCase, variant: str | None) -> Example:
    options = RunOptions(method="paper", variant=variant).of_stages
    chosen = replace(options.paper, min_score=0.0, projection="lens")
    cloud = fruit_cloud(case.photos, case.detections, case.cameras)
    fused = paper.fuse(case.detections, case.cameras, cloud, options=chosen)
    # Truth is compared with measured centres; the filter itself comes before the measures, and sees the fused ones.
    measured = measure(fused, case.detections, case.cameras, options=options.measure)
    names = CODE_FEATURE_NAMES if variant == "published-code" else FEATURE_NAMES
    values, is_fruit = training_table(Fused(measured, fused.observations, fused.cloud), case.truth, names=names)
    values = resized(values, REFERENCE_M / float(np.median(fused.fruits.diameters_m)), names)
    fruits = measured[np.isin(measured.ids, fused.cloud.fruit_id)]
    return Example(label, values, is_fruit, fruits, case.truth, np.ones(len(fruits)))


def object_example(label: str, case: RowCase, second_look: bool) -> Example:
    """An example of fruits as they are associated, or looked at again."""
    fused = case.looked_again(case.associated()) if second_look else case.associated()
    measured = measure(fused, case.detections, case.cameras, case.photos if second_look else None)
    near = candidates_by_center(measured, case.truth, EvaluateOptions()).found_idx
    features, is_fruit = view_features(fused, case.detections, case.cameras), np.isin(np.arange(len(measured)), near)
    judged = np.isfinite(features.values).all(1)  # others no photo shows well enough to be looked at
    features = features[judged]
    placed = features.place_probability(looked=second_look)
    return Example(label, features.values, is_fruit[judged], measured[judged], case.truth, placed)


def trained(done: list[Example], learnt: Learnt) -> LinearSvm:
    values, is_fruit = np.concatenate([e.values for e in done]), np.concatenate([e.is_fruit for e in done])
    rows = ", ".join(dict.fromkeys(e.label.partition(",")[0] for e in done))
    worse = {
        "paper": f"true masks made worse and joined by false ones, {learnt.repeats} times a row",
        "object": "true masks of which 30 % were dropped and 20 % false ones added, with scores that say nothing; "
        "of all photos, of every second and of every third",
    }[learnt.method]
    after = ", after the second look" if learnt.second_look else ""
    trained_on = (
        f"{is_fruit.sum()} fruits and {(~is_fruit).sum()} false positives of the rendered rows {rows}, with true "
        f"cameras{after}; detections: those of the shipped segmenter, and {worse}. No real orchard."
    )
    return LinearSvm.train(values, is_fruit, names=learnt.names, fruit_diameter_m=REFERENCE_M, trained_on=trained_on)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--method", choices=("object", "paper"), default="object")
    parser.add_argument("--variant", choices=("published-code",), help="of --method paper")
    parser.add_argument("--second-look", action="store_true", help="of --method object: fruits looked at again")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--left-out", type=Path, help="also write FOLDER/ROW.json, trained on the other rows")
    arguments = parser.parse_args()
    if arguments.left_out and len(arguments.rows) == 1:
        parser.error("--left-out: expected two rows or more, found one: nothing is left to train on")
    learnt = Learnt(arguments.method, arguments.variant, arguments.second_look, arguments.repeats)
    done: list[Example] = []
    for folder in arguments.rows:
        for example in examples(folder, learnt):
            done.append(example)
            fruits = example.is_fruit.sum()
            print(f"{example.label}: {fruits} fruits, {len(example.is_fruit) - fruits} false positives", flush=True)
    if arguments.left_out:
        arguments.left_out.mkdir(parents=True, exist_ok=True)
        for folder in arguments.rows:
            others = [e for e in done if not e.label.startswith(f"{folder.name},")]
            trained(others, learnt).save(arguments.left_out / f"{folder.name}.json")
    svm = trained(done, learnt)
    svm.save(arguments.out)
    print(svm.trained_on, dict(zip(svm.names, svm.weights.round(2).tolist(), strict=True)))
    for example in done:
        kept = svm.probability(example.values) * example.place_probability >= 0.5
        before = evaluate_fruits(example.fruits, example.truth).all
        after = evaluate_fruits(example.fruits[kept], example.truth).all
        print(f"{example.label}: F1 {before.f1:.3f} -> {after.f1:.3f}, FDR {before.false_detection_rate:.3f} -> "
              f"{after.false_detection_rate:.3f}, R {before.recall:.3f} -> {after.recall:.3f}")  # fmt: skip


if __name__ == "__main__":
    main()
