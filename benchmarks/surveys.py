"""`pomona run` on the real videos and the rendered row: stage times, peak memory, photos placed, fruits, scores.

python benchmarks/surveys.py OUT [--data FOLDER] [--only NAME ...]     prints the tables of docs/benchmarks.md

A survey that is in OUT already is read, not run again.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image
from pycocotools import mask as coco_rle

DATA = (Path(__file__).resolve().parents[2] / "shared" / "data").resolve()


def commands(data: Path, out: Path) -> dict[str, list[str]]:
    """The arguments of `pomona run`, without --out, by survey."""
    row = data / "orchard-dev"
    markers = ["--markers", str(row / "truth" / "markers.csv")]
    return {
        "apple-tree-video": [str(data / "apple-tree-video" / "frames")],
        "orange-tree-video": [str(data / "orange-tree-video" / "frames")],
        "orchard-dev, true masks": [str(row / "images"), *markers, "--detections", str(true_masks(row, out))],
        "orchard-dev": [str(row / "images"), *markers],
    }


def true_masks(row: Path, out: Path) -> Path:
    """Write a rendered row's true masks as COCO."""
    path = out / f"{row.name}-true-masks.json"
    images, annotations = [], []
    for k, file in enumerate(sorted((row / "truth" / "masks").glob("*.png")), start=1):
        ids = np.asarray(Image.open(file))
        images.append({"id": k, "file_name": f"{file.stem}.jpg", "width": ids.shape[1], "height": ids.shape[0]})
        for fruit in np.unique(ids[ids > 0]):
            rle = coco_rle.encode(np.asfortranarray(ids == fruit))
            rle["counts"] = rle["counts"].decode()
            annotation = {"id": len(annotations) + 1, "image_id": k, "category_id": 1, "segmentation": rle}
            annotations.append({**annotation, "bbox": coco_rle.toBbox(rle).tolist(), "area": int(coco_rle.area(rle))})
    categories = [{"id": 1, "name": "fruit"}]
    path.write_text(json.dumps({"images": images, "annotations": annotations, "categories": categories}))
    return path


def run(name: str, arguments: list[str], out: Path) -> Path:
    survey = out / name.replace(", ", "-").replace(" ", "-")
    if not (survey / "report.html").exists():
        subprocess.run([sys.executable, "-m", "pomona", "run", *arguments, "--out", str(survey)], check=True)
    return survey


def stage_lines(surveys: dict[str, Path]) -> list[str]:
    records = {name: json.loads((s / "survey.json").read_text())["stages"] for name, s in surveys.items()}
    stages = list(dict.fromkeys(stage for r in records.values() for stage in r))
    lines = ["| stage | " + " | ".join(records) + " |", "|---|" + "---|" * len(records)]
    for stage in stages:
        cells = [r.get(stage) for r in records.values()]
        shown = [f"{c['wall_s']:.1f} s, {c['peak_memory_mb'] or 0:.0f} MB" if c else "" for c in cells]
        lines.append(f"| {stage} | " + " | ".join(shown) + " |")
    totals = [sum(c["wall_s"] for c in r.values()) for r in records.values()]
    return [*lines, "| together | " + " | ".join(f"{t:.0f} s" for t in totals) + " |"]


def scores(survey: Path, truth: Path) -> str:
    command = [sys.executable, "-m", "pomona", "evaluate", str(survey), "--truth", str(truth)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--only", nargs="*")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    wanted = commands(arguments.data, arguments.out)
    names = arguments.only or list(wanted)
    surveys = {name: run(name, wanted[name], arguments.out) for name in names}
    print("\n".join(stage_lines(surveys)))
    for name, survey in surveys.items():
        if name.startswith("orchard-dev"):
            print(f"\n{name}\n{scores(survey, arguments.data / 'orchard-dev' / 'truth')}")


if __name__ == "__main__":
    main()
