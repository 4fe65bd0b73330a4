"""Both sides of rendered rows in one frame: by markers, markers and fruits, fruits alone; for docs/lab/benchmarks.md.

python benchmarks/sides.py OUT ROW [ROW ...]

Cameras are Pomona's own, of true masks' surveys kept in OUT/<row> (benchmarks/association.py). "Off": the median over
true fruits and photos of how far a photo sees a fruit from where it is, in mm at the fruit; without markers, after the
one similarity that brings all cameras nearest to the true ones ("scale": what the assumed fruit diameter is wrong by).
"""

from pathlib import Path

import numpy as np

from association import SEGMENTER, TRUE, place, variants
from command_line import parser_of
from pomona.basics.geometry import Similarity, estimate_similarity
from pomona.evaluate.fruits import Truth, evaluate_fruits, read_truth
from pomona.fruit.geometry.discs import FruitDiscs, fruit_discs
from pomona.learning.synth.truth import RowFolder
from pomona.stages.capture import load_photos
from pomona.stages.fuse import object
from pomona.stages.scale import Placed, ScaleOptions, place_in_world
from pomona.stages.scale.side_alignment import FindFruits
from pomona.stages.segment import load_segmenter
from pomona.stages.sfm.store import read_reconstruction
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import SurveyDetections
from row_cases import Case, cameras_by_name, true_centers, trusted
from tables import table_head, table_row


def to_truth(row: Path, cameras: Cameras) -> Similarity:
    return estimate_similarity(cameras.centers_in_world, true_centers(RowFolder(row), cameras.photos))


def off_mm(row: Path, cameras: Cameras, truth: Truth) -> float:
    off, by_name = [], cameras_by_name(RowFolder(row))
    for i, name in enumerate(cameras.photos):
        known = by_name[Path(name).stem]
        xy_px, depths_m = known.project(truth.centers_in_world)
        inside = ((xy_px > 0) & (xy_px < [known.width_px, known.height_px])).all(1)
        apart_px = np.linalg.norm(cameras.project(i, truth.centers_in_world)[0] - xy_px, axis=1)
        off.append((apart_px * depths_m / known.focal_px)[inside])
    return 1000 * float(np.median(np.concatenate(off)))


def line(row: Path, kind: str, by: str, placed: Placed, detections: SurveyDetections, truth: Truth) -> str:
    cameras = placed.cameras
    if by == "fruits alone":
        similarity = to_truth(row, cameras)
        cameras = cameras.transformed(similarity, WorldFrame("given", approximate=False, up_is_known=True))
        scale = f"{similarity.scale:.3f}"
    else:
        scale = "–"
    case = Case(load_photos([row / "images"]), cameras, detections)
    fruits = case.measured(case.associated(), by_colours=False).fruits
    scores = evaluate_fruits(fruits, truth).headline
    ties = placed.report.ties
    agree = f"{ties[0].fruits} | {ties[0].median_mm:.1f}" if ties else "– | –"
    both = sum(side == "both" for side in fruits.sides)
    cells = (
        f"`{row.name}`", kind, by, agree, f"{off_mm(row, cameras, truth):.2f}", scale, both, f"{scores.f1:.3f}",
        f"{scores.multi_detection_rate:.3f}", f"{1000 * scores.center_median_m:.1f}",
    )  # fmt: skip
    return table_row(cells)


def finder(detections: SurveyDetections) -> FindFruits:
    """What finds fruits by these detections, with the discs that photos see of them."""

    def find(cameras: Cameras) -> FruitDiscs:
        fused = object.fuse(detections, cameras)
        return fruit_discs(fused.fruits, fused.observations, detections, cameras)

    return find


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("rows", type=Path, nargs="+")
    arguments = parser.parse_args()
    titles = "row | masks | tied by | shared | agree to, mm | off, mm | scale | seen from both | F1 | MDR | centre, mm"
    print(table_head(titles), flush=True)
    for row in [folder.resolve() for folder in arguments.rows]:
        survey, photos, truth = place(row, arguments.out), load_photos([row / "images"]), read_truth(row)
        reconstruction = read_reconstruction(survey / "work" / "pieces", photos)
        for kind in (TRUE, SEGMENTER):
            ((detections, _),) = variants(kind, row, survey, 0)
            if kind == SEGMENTER:
                detections = trusted(detections, load_segmenter(None).traits.score_threshold)
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
