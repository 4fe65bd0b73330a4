"""What fruits that a person marks in a few photos are worth: for docs/lab/self-training.md.

python benchmarks/marks_gain.py ROW OUT [--photos 3]

A rendered row is run, learns from itself, and learns from itself and from marks: all fruits of which at least a fifth
is seen in some photos, evenly spread, as circles that are off by a pixel or two, as a person's are. Surveys in OUT that
are there are not made again. Printed are what learning says of itself, and the evaluation of fruits in space.
"""

import json
import shutil
from pathlib import Path

import numpy as np

import pomona
from command_line import parser_of
from pomona.formats.detections.labelled import LabelledFruit
from pomona.learning.marks import MarkedPhoto, write_marks
from pomona.learning.self_training.learnt import read_learnt
from pomona.learning.self_training.options import AdaptOptions
from pomona.learning.self_training.rerun import run_adapted
from pomona.learning.synth.truth import RowFolder, read_fruits, read_mask
from pomona.pipeline import RunOptions
from pomona.progress import Silent
from pomona.survey import SurveyFolder
from row_cases import cameras_by_name

LEAST_SHARE, LEAST_RADIUS_PX, HAND_PX = 0.2, 5.0, 1.0


def marked(row: RowFolder, photo: str, rng: np.random.Generator) -> MarkedPhoto:
    """All fruits of a photo that a person would mark there, as circles."""
    camera = cameras_by_name(row)[Path(photo).stem]
    fruits, seen = read_fruits(row.truth("fruits.csv")), read_mask(row.mask(camera.name))
    pixels = np.bincount(seen.ravel(), minlength=int(fruits.ids.max()) + 1)
    centers_px, depths_m = camera.project(fruits.centres_in_world)
    radii_px = camera.focal_px * fruits.diameters_m / 2 / depths_m
    shares = pixels[fruits.ids] / (np.pi * radii_px**2)
    drawn = []
    for i in np.flatnonzero((depths_m > 0) & (radii_px >= LEAST_RADIUS_PX) & (shares >= LEAST_SHARE)):
        x, y = centers_px[i] + rng.normal(0, HAND_PX, 2)
        radius = max(2.0, float(radii_px[i] + rng.normal(0, HAND_PX)))
        box = x - radius, y - radius, x + radius, y + radius
        inside = max(0.0, box[0]), max(0.0, box[1]), min(camera.width_px, box[2]), min(camera.height_px, box[3])
        drawn.append(LabelledFruit(inside, None, circle_px=(float(x), float(y), radius)))
    return MarkedPhoto(photo, camera.width_px, camera.height_px, tuple(drawn), complete=True)


def said(survey: SurveyFolder, truth: Path) -> str:
    visible = pomona.open(survey.folder).evaluate(truth).headline
    return (
        f"F1 {visible.f1:.3f}, recall {visible.recall:.3f}, precision {visible.precision:.3f}, "
        f"centre {1000 * visible.center_median_m:.1f} mm"
    )


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("row", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--photos", type=int, default=3)
    arguments = parser.parse_args()
    row, images = RowFolder(arguments.row), arguments.row / "images"
    markers = row.truth("markers.csv")
    options = RunOptions(markers=markers if markers.is_file() else None, scene=False)
    first = arguments.out / "first"
    if not (first / "fruits.csv").is_file():
        pomona.run(images, first, markers=options.markers, scene=False)
    print("first:", said(SurveyFolder.open(first), row.root), flush=True)
    names = pomona.open(first).photos.names
    spread = [names[k] for k in np.linspace(0, len(names) - 1, arguments.photos + 2).round().astype(int)[1:-1]]
    for label in ("by itself", "by marks"):
        folder = arguments.out / label.replace(" ", "-")
        if not (folder / "fruits.csv").is_file():
            shutil.copytree(first, folder)
        survey = SurveyFolder.open(folder)
        if label == "by marks":
            rng = np.random.default_rng(0)
            photos = [marked(row, name, rng) for name in spread]
            write_marks(survey.marks, photos)
            print(f"{sum(len(photo.fruits) for photo in photos)} marks in {len(photos)} photos", flush=True)
        run_adapted([images], folder, options, Silent(), adapting=AdaptOptions())
        learnt = read_learnt(SurveyFolder.open(folder))
        print(f"{label}: {said(SurveyFolder.open(folder), row.root)}; {json.dumps(learnt, default=vars)}", flush=True)


if __name__ == "__main__":
    main()
