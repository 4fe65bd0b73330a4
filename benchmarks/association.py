"""The ways of joining detections into fruits, on the same rows: scores, time and memory, for docs/lab/benchmarks.md.

python benchmarks/association.py OUT ROW [ROW ...] [--seeds N] [--only KIND ...] [--methods METHOD ...] [--json FILE]

A ROW is a rendered row's folder (`benchmarks/render_rows.py`, or orchard-dev). Cameras are Pomona's own, placed by
markers, and kept in OUT/<row>. Detections are, of every photo: the true masks; the shipped segmenter's; and true masks
made worse, `--seeds` times with other chances. `paper` in both its readings needs a cloud of the masks, which its time
includes. Each fusion runs in a process of its own, with the filter that is shipped for it and the measures.
Scores are over visible fruits (at least 120 pixels in at least 2 photos): mean ± standard deviation over rows and
seeds.
"""

import json
import multiprocessing
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from command_line import parser_of
from pomona.evaluate.fruits import evaluate_fruits, read_truth
from pomona.formats.cameras.colmap import read_colmap
from pomona.formats.detections.coco import read_coco
from pomona.learning.synth.truth import write_masks_as_coco
from pomona.pipeline import RunOptions
from pomona.pipeline import run as run_pipeline
from pomona.stages import filter as filters
from pomona.stages.capture import load_photos
from pomona.stages.dense import fruit_cloud
from pomona.stages.fuse import paper
from pomona.stages.measure import measure
from pomona.stages.segment import load_segmenter, segment_photos
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, Mask, SurveyDetections
from row_cases import Case, trusted
from tables import table_head, table_row
from usage import peak_mb

METHODS = ("object", "paper, as in the text", "paper, as in the authors' code")
SEGMENTER, TRUE = "shipped segmenter", "true masks"
FALSE_SHARE, DROPPED, CHANGE = 0.2, 0.3, 0.2
JITTER_PX = 2.0


@dataclass(frozen=True)
class Result:
    row: str
    kind: str
    method: str
    f1: float
    recall: float
    precision: float
    detection_rate: float
    multi_detection_rate: float
    merged: float
    center_median_mm: float
    seconds: float
    megabytes: float
    trees: tuple[tuple[int, int], ...] = ()


def dropped(found: Detections, rng: np.random.Generator) -> Detections:
    return found[rng.random(len(found)) >= DROPPED]


def with_false(found: Detections, rng: np.random.Generator) -> Detections:
    """Discs as large as the photo's masks, anywhere, as often as `FALSE_SHARE` of the true ones."""
    masks = list(found.masks)
    for _ in range(round(FALSE_SHARE * len(found))):
        radius = max(2, round(np.sqrt(found.masks[rng.integers(len(found))].area_px / np.pi)))
        yy, xx = np.mgrid[-radius : radius + 1, -radius : radius + 1]
        x, y = rng.integers(0, [found.width_px - 2 * radius - 1, found.height_px - 2 * radius - 1])
        masks.append(Mask.from_pixels(xx**2 + yy**2 <= radius**2, int(x), int(y)))
    new = len(masks) - len(found)
    ids = np.concatenate([found.ids, found.ids.max(initial=0) * 1000 + 1_000_000 + np.arange(new)])
    scores = np.concatenate([found.scores, np.ones(new)])
    return Detections(found.photo, found.width_px, found.height_px, tuple(masks), scores, ids)


def resized(found: Detections, operation: int) -> Detections:
    """Masks whose width is about `CHANGE` smaller or larger."""
    masks, kept = [], []
    for k, mask in enumerate(found.masks):
        radius = max(1, round(CHANGE * np.sqrt(mask.area_px / np.pi)))
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        padded = cv2.copyMakeBorder(mask.pixels.astype(np.uint8), *[radius] * 4, cv2.BORDER_CONSTANT, value=0)
        changed = cv2.morphologyEx(padded, operation, kernel).astype(bool)
        x, y = mask.x_px - radius, mask.y_px - radius
        changed = changed[max(0, -y) : found.height_px - y, max(0, -x) : found.width_px - x]
        if changed.any():
            masks.append(Mask.from_pixels(changed, max(x, 0), max(y, 0)))
            kept.append(k)
    return Detections(found.photo, found.width_px, found.height_px, tuple(masks), found.scores[kept], found.ids[kept])


def jittered(cameras: Cameras, rng: np.random.Generator) -> Cameras:
    """Each camera turned a little, so that points move by `JITTER_PX` (RMS) in its photo."""
    poses = cameras.cam_from_world.copy()
    for i in range(len(cameras)):
        turn = rng.normal(0, JITTER_PX / np.sqrt(2) / cameras.intrinsics_of(i).focal_px, 3)
        poses[i] = cv2.Rodrigues(turn)[0] @ poses[i]
    return replace(cameras, cam_from_world=poses)


Change = Callable[[Detections, np.random.Generator], Detections]
WORSE: dict[str, Change] = {
    "30 % of true masks dropped": dropped,
    "20 % false masks added": with_false,
    "masks eroded by 20 %": lambda found, _: resized(found, cv2.MORPH_ERODE),
    "masks dilated by 20 %": lambda found, _: resized(found, cv2.MORPH_DILATE),
}
JITTERED, HALF = "poses jittered by 2 px", "every second photo removed"
KINDS = (TRUE, SEGMENTER, *WORSE, JITTERED, HALF)


def place(row: Path, out: Path) -> Path:
    """Return the survey of the row with cameras, made with true masks where it is not there yet."""
    survey = out / row.name
    if not (survey / "cameras").is_dir():
        masks = out / f"{row.name}-true-masks.json"
        write_masks_as_coco(row, masks)
        options = RunOptions(markers=row / "truth" / "markers.csv", detections=masks)
        run_pipeline([row / "images"], survey, options, until="scale")
    return survey


def variants(kind: str, row: Path, survey: Path, seeds: int) -> Iterator[tuple[SurveyDetections, Cameras]]:
    photos, cameras = load_photos([row / "images"]), read_colmap(survey / "cameras")
    if kind == SEGMENTER:
        yield segment_photos(photos, load_segmenter(None)), cameras
        return
    true = read_coco(survey / "detections.json", photos)
    if kind == TRUE:
        yield true, cameras
    elif kind == HALF:
        yield SurveyDetections({name: true[name] for name in photos.names[::2]}), cameras
    for seed in range(seeds if kind in WORSE or kind == JITTERED else 0):
        rng = np.random.default_rng(seed)
        if kind == JITTERED:
            yield true, jittered(cameras, rng)
        else:
            yield SurveyDetections({name: WORSE[kind](found, rng) for name, found in true.items()}), cameras


def joined(kind: str, method: str, row: Path, detections: SurveyDetections, cameras: Cameras) -> Result:
    photos, truth = load_photos([row / "images"]), read_truth(row)
    if kind == SEGMENTER:
        detections = trusted(detections, load_segmenter(None).traits.score_threshold)
    begun = time.monotonic()
    if method == "object":
        case = Case(None, cameras, detections)
        fruits = case.measured(case.associated()).fruits
    else:
        options = RunOptions(method="paper").of_stages
        as_code = method.endswith("code")
        chosen = paper.PaperOptions.as_published_code() if as_code else options.paper
        chosen = replace(chosen, min_score=0.0)  # scores of other networks mean other things
        fused = paper.fuse(detections, cameras, fruit_cloud(photos, detections, cameras), options=chosen)
        fruits = measure(filters.apply(fused), detections, cameras, options=options.measure)
    seconds = time.monotonic() - begun
    scores = evaluate_fruits(fruits, truth).headline
    by_tree: defaultdict[int, list[int]] = defaultdict(lambda: [0, 0])
    tree_of = dict(zip(truth.ids.tolist(), truth.tree_ids.tolist(), strict=True))
    middles = {tree: truth.centers_in_world[truth.tree_ids == tree].mean(0) for tree in set(tree_of.values())}
    for outcome in scores.outcomes:
        if outcome.kind in ("matched", "missed", "merged") and outcome.truth_id is not None:
            by_tree[tree_of[outcome.truth_id]][0] += 1
        if outcome.kind in ("matched", "false", "double"):
            near = min(middles, key=lambda tree: float(np.linalg.norm(middles[tree][:2] - outcome.center_in_world[:2])))
            own = tree_of[outcome.truth_id] if outcome.truth_id is not None else near
            by_tree[own][1] += 1
    merged = sum(outcome.kind == "merged" for outcome in scores.outcomes) / scores.true_fruits
    return Result(
        row.name, kind, method, scores.f1, scores.recall, scores.precision, scores.detection_rate,
        scores.multi_detection_rate, merged, 1000 * scores.center_median_m, seconds,
        peak_mb(),
        tuple((true, found) for true, found in by_tree.values()),
    )  # fmt: skip


def table(results: list[Result]) -> str:
    lines = [table_head("detections | method | F1 | P | R | DR | MDR | merged | centre, mm | seconds | MB")]
    for kind in KINDS:
        for method in METHODS:
            mine = [r for r in results if (r.kind, r.method) == (kind, method)]
            if mine:
                cells = [_spread([getattr(r, name) for r in mine]) for name in
                         ("f1", "precision", "recall", "detection_rate", "multi_detection_rate", "merged")]  # fmt: skip
                mean = {name: np.mean([getattr(r, name) for r in mine]) for name in
                        ("center_median_mm", "seconds", "megabytes")}  # fmt: skip
                means = f"{mean['center_median_mm']:.1f}", f"{mean['seconds']:.1f}", f"{mean['megabytes']:.0f}"
                lines.append(table_row([kind, method, *cells, *means]))
    return "\n".join(lines)


def per_tree(results: list[Result]) -> str:
    lines = [table_head("detections | method | trees | R² | RMSE, share of fruits")]
    for kind in (TRUE, SEGMENTER):
        for method in METHODS:
            trees = np.array([t for r in results if (r.kind, r.method) == (kind, method) for t in r.trees], float)
            if len(trees) > 1:
                r2 = np.corrcoef(trees.T)[0, 1] ** 2
                rmse = np.sqrt(((trees[:, 1] - trees[:, 0]) ** 2).mean()) / trees[:, 0].mean()
                lines.append(table_row([kind, method, len(trees), f"{r2:.3f}", f"{100 * rmse:.1f} %"]))
    return "\n".join(lines)


def _spread(values: list[float]) -> str:
    return f"{np.mean(values):.3f} ± {np.std(values):.3f}" if len(values) > 1 else f"{values[0]:.3f}"


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", nargs="*", choices=KINDS, default=KINDS)
    parser.add_argument("--methods", nargs="*", choices=METHODS, default=METHODS)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    results: list[Result] = []
    context = multiprocessing.get_context("spawn")
    for row in [folder.resolve() for folder in arguments.rows]:
        survey = place(row, arguments.out)
        for kind in arguments.only:
            for detections, cameras in variants(kind, row, survey, arguments.seeds):
                # The paper's way takes minutes: it is compared where its own paper does.
                for method in arguments.methods:
                    if method != "object" and kind not in (TRUE, SEGMENTER):
                        continue
                    with ProcessPoolExecutor(1, mp_context=context) as pool:
                        results.append(pool.submit(joined, kind, method, row, detections, cameras).result())
                    print(results[-1], flush=True)
    print(table(results), per_tree(results), sep="\n\n")
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(result) for result in results], indent=1) + "\n")


if __name__ == "__main__":
    main()
