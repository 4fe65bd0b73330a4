"""Both sides of rendered rows in one frame: by markers, markers and fruits, fruits alone; for docs/lab/benchmarks.md.

python -m benchmarks.sides OUT ROW [ROW ...]

Cameras are Pomona's own, of true masks' surveys kept in OUT/<row> (benchmarks/association.py). "Off": the median over
true fruits and photos of how far a photo sees a fruit from where it is, in mm at the fruit; without markers, after the
one similarity that brings all cameras nearest to the true ones ("scale": what the assumed fruit diameter is wrong by).
"""

import argparse
import json
from pathlib import Path

import numpy as np
from benchmarks.association import SEGMENTER, TRUE, place, variants

from pomona.basics.geometry import Similarity, estimate_similarity
from pomona.evaluate.fruits import Truth, evaluate_fruits, read_truth
from pomona.fruit.geometry.discs import FruitDiscs, fruit_discs
from pomona.pipeline import RunOptions
from pomona.pipeline.select import SelectOptions
from pomona.stages import filter as filters
from pomona.stages.capture import load_photos
from pomona.stages.fuse import object
from pomona.stages.measure import measure
from pomona.stages.scale import Placed, ScaleOptions, place_in_world
from pomona.stages.scale.side_alignment import FindFruits
from pomona.stages.segment import load_segmenter
from pomona.stages.sfm.store import read_reconstruction
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import SurveyDetections


def true_cameras(row: Path, cameras: Cameras) -> list[dict[str, object]]:
    known = json.loads((row / "truth" / "cameras.json").read_text())
    return [known[Path(name).stem] for name in cameras.photos]


def to_truth(row: Path, cameras: Cameras) -> Similarity:
    poses = [(np.array(c["R"]), np.array(c["t"])) for c in true_cameras(row, cameras)]
    return estimate_similarity(cameras.centers_in_world, np.array([-r.T @ t for r, t in poses]))


def off_mm(row: Path, cameras: Cameras, truth: Truth) -> float:
    off = []
    for i, known in enumerate(true_cameras(row, cameras)):
        in_cam = truth.centers_in_world @ np.array(known["R"]).T + np.array(known["t"])
        xy_px = in_cam[:, :2] / in_cam[:, 2:] * known["f"] + [known["cx"], known["cy"]]
        inside = ((xy_px > 0) & (xy_px < [known["width"], known["height"]])).all(1)
        apart_px = np.linalg.norm(cameras.project(i, truth.centers_in_world)[0] - xy_px, axis=1)
        off.append((apart_px * in_cam[:, 2] / known["f"])[inside])  # type: ignore[operator]
    return 1000 * float(np.median(np.concatenate(off)))


def line(row: Path, kind: str, by: str, placed: Placed, detections: SurveyDetections, truth: Truth) -> str:
    cameras = placed.cameras
    if by == "fruits alone":
        similarity = to_truth(row, cameras)
        cameras = cameras.transformed(similarity, WorldFrame("given", approximate=False, up_is_known=True))
        scale = f"{similarity.scale:.3f}"
    else:
        scale = "–"
    svm = filters.load(filters.shipped("object"))
    fused = filters.apply_to_views(object.fuse(detections, cameras), detections, cameras, svm)
    photos = load_photos([row / "images"])
    fruits = measure(fused, detections, cameras, photos, options=RunOptions().of_stages.measure)
    scores = evaluate_fruits(fruits, truth).visible
    assert scores is not None
    ties = placed.report.ties
    agree = f"{ties[0].fruits} | {ties[0].median_mm:.1f}" if ties else "– | –"
    both = sum(side == "both" for side in fruits.sides)
    cells = (
        f"`{row.name}`", kind, by, agree, f"{off_mm(row, cameras, truth):.2f}", scale, both, f"{scores.f1:.3f}",
        f"{scores.multi_detection_rate:.3f}", f"{1000 * scores.center_median_m:.1f}",
    )  # fmt: skip
    return "| " + " | ".join(map(str, cells)) + " |"


def finder(detections: SurveyDetections) -> FindFruits:
    """What finds fruits by these detections, with the discs that photos see of them."""

    def find(cameras: Cameras) -> FruitDiscs:
        fused = object.fuse(detections, cameras)
        return fruit_discs(fused.fruits, fused.observations, detections, cameras)

    return find


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("rows", type=Path, nargs="+")
    arguments = parser.parse_args()
    head = (
        "row", "masks", "tied by", "shared", "agree to, mm", "off, mm", "scale", "seen from both", "F1", "MDR",
        "centre, mm",
    )  # fmt: skip
    print(f"| {' | '.join(head)} |", "|---" * len(head) + "|", sep="\n", flush=True)
    for row in [folder.resolve() for folder in arguments.rows]:
        survey, photos, truth = place(row, arguments.out), load_photos([row / "images"]), read_truth(row)
        reconstruction = read_reconstruction(survey / "work" / "pieces", photos)
        for kind in (TRUE, SEGMENTER):
            ((detections, _),) = variants(kind, row, survey, 0)
            if kind == SEGMENTER:
                _, least_score = SelectOptions().thresholds(load_segmenter(None).traits.score_threshold)
                detections = detections.at_least(least_score)
            for by in ("markers", "markers, then fruits", "fruits alone"):
                markers = None if by == "fruits alone" else row / "truth" / "markers.csv"
                placed = place_in_world(
                    reconstruction,
                    photos,
                    options=ScaleOptions(markers=markers),
                    detections=detections,
                    find_fruits=None if by == "markers" else finder(detections),
                )
                print(line(row, kind, by, placed, detections, truth), flush=True)


if __name__ == "__main__":
    main()
