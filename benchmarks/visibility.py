"""How much of their discs fruits show in photos, as masks have it and really: docs/lab/sizes.md.

python benchmarks/visibility.py ROW SURVEY        a rendered row with its truth, and a survey of it
"""

from itertools import pairwise
from pathlib import Path

import numpy as np

import pomona
from command_line import parser_of
from pomona.evaluate.fruits import read_truth
from pomona.learning.synth.truth import RowFolder, read_mask
from row_cases import nearest_true
from tables import table_head, table_row

NEAR_M = 0.025
BINS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.2)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("row", type=Path)
    parser.add_argument("survey", type=Path)
    arguments = parser.parse_args()
    row, truth, survey = RowFolder(arguments.row), read_truth(arguments.row), pomona.open(arguments.survey)
    fruits, cameras, seen = survey.fruits, survey.cameras, survey.observations
    of_truth, away_m = nearest_true(fruits, truth)
    near = away_m < NEAR_M
    place_of = {fruit_id: k for k, fruit_id in enumerate(fruits.ids.tolist())}
    ids = {photo: read_mask(row.mask(Path(photo).stem)) for photo in cameras.photos}
    rows = []
    for fruit_id, photo, detection_id in zip(
        seen.fruit_id.tolist(), seen.photo, seen.detection_id.tolist(), strict=True
    ):
        k, found = place_of[fruit_id], survey.detections[photo]
        if not near[k]:
            continue
        i = cameras.index_of(photo)
        assert i is not None
        depth_m = cameras.project(i, fruits.centers_in_world[k : k + 1])[1][0]
        width_px = cameras.intrinsics_of(i).focal_px * truth.diameters_m[of_truth[k]] / depth_m
        mask = found.masks[int(np.flatnonzero(found.ids == detection_id)[0])]
        true_px = int((ids[photo] == truth.ids[of_truth[k]]).sum())
        rows.append((k, mask.area_px / (np.pi / 4 * width_px**2), true_px / (np.pi / 4 * width_px**2)))
    of, masked, true = (np.array(column) for column in zip(*rows, strict=True))
    print(table_head("shown, really | masks | really | as masks have it"))
    for low, high in pairwise(BINS):
        those = (true >= low) & (true < high)
        means = (f"{shares[those].mean():.3f}" for shares in (true, masked))
        print(table_row([f"{low:g} to {high:g}", those.sum(), *means]))
    known = [k for k in np.unique(of) if np.isfinite(fruits.visibilities[k])]
    most = np.array([min(true[of == k].max(), 1.0) for k in known])
    off = fruits.visibilities[known] - most
    error = f"{off.mean():+.3f} on average, mean absolute error {np.abs(off).mean():.3f}"
    print(f"`visibility` of {len(known)} fruits: {error}")


if __name__ == "__main__":
    main()
