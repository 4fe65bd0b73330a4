"""What a photo costs in rows of 50, 200 and 800 photos, step by step after matching: docs/lab/speed.md.

python benchmarks/long_row.py SURVEY [--photos 50 200 800]     SURVEY as `pomona run` made it

The photos of its first side, with their detections, places and tracks, are repeated along the row: nothing is decoded,
and no features are matched. Processor seconds are those of this process.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

import pomona
from command_line import parser_of
from pomona.adjustment.bundle import feature_noise_px
from pomona.adjustment.covariance import covariance
from pomona.adjustment.normal_equations import moved, normal_equations
from pomona.adjustment.weights import Weights, weighted
from pomona.basics.geometry import Similarity, row_axis
from pomona.fruit.geometry.discs import fruit_discs
from pomona.stages.filter.view_features import view_features
from pomona.stages.fuse import object as association
from pomona.values.cameras import Cameras, concatenate, split
from pomona.values.detections import SurveyDetections
from tables import table_head, table_row

T = TypeVar("T")


def repeated(cameras: Cameras, photos: int) -> Cameras:
    """So many photos along a row, by one lens: the same ones again and again, shifted; copies share no points."""
    times = -(-photos // len(cameras))
    _, axis = row_axis(cameras.centers_in_world)
    length_m = np.ptp(cameras.centers_in_world[:, :2] @ axis) * len(cameras) / (len(cameras) - 1)
    copies = []
    for k in range(times):
        moved = cameras.transformed(Similarity(1.0, np.eye(3), k * length_m * np.array([*axis, 0.0])))
        copies.append(replace(moved, photos=tuple(f"{k}/{name}" for name in cameras.photos)))
    row = concatenate(copies, cameras.frame)
    row = replace(row, intrinsics=cameras.intrinsics, intrinsics_idx=np.tile(cameras.intrinsics_idx, times))
    return row if len(row) == photos else split(row, [photos, len(row) - photos])[0]


def detected(detections: SurveyDetections, row: Cameras) -> SurveyDetections:
    """The detections of the photos that those of the row are copies of, numbered anew."""
    found, first = {}, 1
    for name in row.photos:
        own = detections[name.split("/", 1)[1]]
        found[name] = replace(own, photo=name, ids=np.arange(first, first + len(own)))
        first += len(own)
    return SurveyDetections(found)


def one_step(seeing: Cameras, weights: Weights) -> Cameras:
    """One of the steps of an adjustment, which are as many in long rows as in short ones."""
    return moved(seeing, normal_equations(seeing, weights), weights, 1e-4)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("survey", type=Path)
    parser.add_argument("--photos", type=int, nargs="+", default=[50, 200, 800])
    parser.add_argument("--no-fruits", action="store_true", help="the cameras alone")
    arguments = parser.parse_args()
    survey = pomona.open(arguments.survey)
    sides = [survey.sides.get(name, "") for name in survey.cameras.photos]
    cameras = split(survey.cameras, [sides.count(sides[0]), len(sides) - sides.count(sides[0])])[0]
    print(table_head("photos | step of the adjustment | uncertainties | association | discs | filter's features"))
    for photos in arguments.photos:
        row = repeated(cameras, photos)
        masks = detected(survey.detections.at_least(survey.score_threshold), row)
        spent: list[float] = []

        def timed(work: Callable[..., T], *given: object, spent: list[float] = spent, **named: object) -> T:
            begun = time.process_time()
            result = work(*given, **named)
            spent.append(time.process_time() - begun)
            return result

        frames = np.arange(photos) // len(cameras)
        seeing, weights = weighted(row, noise_px=feature_noise_px(row), free_frames=frames)
        timed(one_step, seeing, weights)
        timed(covariance, seeing, weights)
        if not arguments.no_fruits:
            fused = timed(association.fuse, masks, row)
            timed(fruit_discs, fused.fruits, fused.observations, masks, row)
            timed(view_features, fused, masks, row)
        print(table_row([photos, *(f"{1000 * s / photos:.1f}" for s in spent)]), flush=True)
    print("\nMilliseconds of processor time a photo.")


if __name__ == "__main__":
    main()
