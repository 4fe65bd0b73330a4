"""Whole runs of rows of 50, 200 and 800 photos: what a photo costs, and how far places drift; docs/lab/speed.md.

python benchmarks/row_length.py ROW OUT [--photos 50 200 800]

ROW is one side of a rough row of 50 m in 200 photos, rendered where it is missing. Shorter rows are its first photos.
Longer ones are its photos again and again under other names, shifted along the row, whose cameras, points and tracks
are given, as the run of the longest row that was matched has them: features, matching and mapping are not in these.
Metres come from control points, two above each other every six metres (or with `--apart`, at any distance): fruits,
clicked with a pixel of noise in the four photos nearest to each. Processor seconds are those of the stages of
`pomona run`, with all threads and processes. OUT keeps the surveys, and goes on where it was stopped.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import pomona
from command_line import parser_of
from long_row import repeated
from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import estimate_similarity
from pomona.evaluate.fruits import read_truth
from pomona.formats.cameras.colmap import write_colmap
from pomona.learning.synth import RowOptions, render_row
from pomona.learning.synth.truth import RowFolder, read_cameras
from pomona.stages.capture import load_photos
from pomona.stages.scale.control_points import read_control_points
from row_cases import true_centers
from tables import table_head, table_row
from usage import used_by

ROW = RowOptions(
    seed=7, trees=51, fruits_per_tree=30, sides=("east",), photos_per_side=200, step_m=0.25, masks=False, rough=True
)
# The row lies where the scale of this projection is 1.
CRS = "+proj=tmerc +lat_0=0 +lon_0=3 +k=1 +x_0=500000 +y_0=0 +ellps=WGS84 +units=m +no_defs"
ORIGIN = np.array([500_000.0, 4_600_000.0, 100.0])


def linked(paths: list[Path], folder: Path, names: list[str]) -> Path:
    """The files under these names in a folder, which are not copied."""
    folder.mkdir(parents=True, exist_ok=True)
    for path, name in zip(paths, names, strict=True):
        if not (folder / name).exists():
            (folder / name).hardlink_to(path)
    return folder


def control_points(row: Path, photos: list[Path], file: Path, apart_m: float) -> tuple[list[str], FloatArray]:
    """Write a `gcp_list.txt` for these photos; return what `pomona run` is given, and the frame's origin (3,)."""
    rng, names = np.random.default_rng(0), {path.stem for path in photos}
    cameras = [camera for camera in read_cameras(RowFolder(row).truth("cameras.json")) if camera.name in names]
    centers = np.array([camera.centre_in_world for camera in cameras])
    fruits = read_truth(row).centers_in_world
    stations = np.arange(centers[:, 0].min(), centers[:, 0].max() + apart_m / 2, apart_m)
    lines = [CRS]
    for x in stations:
        near = fruits[np.abs(fruits[:, 0] - x) < 0.5]
        for place in near[[near[:, 2].argmin(), near[:, 2].argmax()]]:
            clicked = 0
            for i in np.argsort(np.abs(centers[:, 0] - place[0])):
                (pixel,), _ = cameras[i].project(place[None])
                pixel += rng.normal(0, 1, 2)
                if clicked < 4 and (pixel > 0).all() and (pixel < (cameras[i].width_px, cameras[i].height_px)).all():
                    numbers = " ".join(f"{number:.4f}" for number in (*(place + ORIGIN), *pixel))
                    lines.append(f"{numbers} {cameras[i].name}.jpg")
                    clicked += 1
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    local = read_control_points(file).markers.points_in_world[0]
    return ["--gcp", str(file)], local - (np.array(lines[1].split()[:3], float) - ORIGIN)


def repeated_row(source: Path, row: Path, folder: Path, photos: int) -> list[str]:
    """Write so many photos, and their cameras, to a folder; return what `pomona run` is given."""
    cameras = repeated(pomona.open(source).cameras, photos)
    copies = [name.split("/", 1) for name in cameras.photos]
    names = [f"{int(copy):03d}-{name}" for copy, name in copies]
    images = linked([row / "images" / name for _, name in copies], folder / "images", names)
    write_colmap(folder / "cameras", replace(cameras, photos=tuple(names)), load_photos([images]))
    return [str(images), "--cameras", str(folder / "cameras")]


def errors(survey: Path, row: Path, shift_m: FloatArray) -> dict[str, float]:
    """How far cameras are from the truth, mm: in the frame of the control points, and after a similarity."""
    cameras = pomona.open(survey).cameras
    true = true_centers(RowFolder(row), cameras.photos) + shift_m
    apart_mm = 1000 * np.linalg.norm(cameras.centers_in_world - true, axis=1)
    nearest = estimate_similarity(cameras.centers_in_world, true).apply(cameras.centers_in_world)
    return {
        "placed": len(cameras),
        "rms_mm": float(np.sqrt((apart_mm**2).mean())),
        "worst_mm": float(apart_mm.max()),
        "similar_mm": 1000 * float(np.sqrt(((nearest - true) ** 2).sum(1).mean())),
    }


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("row", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--apart", type=float, default=6.0, help="metres between control points")
    parser.add_argument("--photos", type=int, nargs="+", default=[50, 200, 800])
    arguments = parser.parse_args()
    row, out = arguments.row.resolve(), arguments.out.resolve()
    if not row.exists():
        render_row(ROW, row)
    originals = sorted((row / "images").iterdir())
    stages: dict[int, dict[str, float]] = {}
    for photos in sorted(arguments.photos):
        survey, kept = out / f"survey-{photos}", out / f"figures-{photos}.json"
        if not kept.exists():
            if photos <= len(originals):
                first = originals[:photos]
                images = linked(first, out / f"images-{photos}", [path.name for path in first])
                points, shift_m = control_points(row, first, out / f"gcp-{photos}.txt", arguments.apart)
                given = [str(images), *points]
            else:
                matched = max(n for n in stages if n <= len(originals))
                given = repeated_row(out / f"survey-{matched}", row, out / f"row-{photos}", photos)
            usage = used_by([sys.executable, "-m", "pomona", "run", *given, "--out", str(survey)])
            record = json.loads((survey / "survey.json").read_text())["stages"]
            figures = {name: stage["processor_s"] / photos for name, stage in record.items()}
            figures |= {"together": sum(figures.values()), "peak MB": usage.memory_mb}
            figures |= errors(survey, row, shift_m) if photos <= len(originals) else {}
            kept.write_text(json.dumps(figures, indent=1))
        stages[photos] = json.loads(kept.read_text())
    names = dict.fromkeys(name for figures in stages.values() for name in figures)
    print(table_head(" | ".join(["photos", *map(str, stages)])))
    for name in names:
        print(table_row([name, *(f"{figures.get(name, float('nan')):.2f}" for figures in stages.values())]))


if __name__ == "__main__":
    main()
