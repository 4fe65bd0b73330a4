"""`pomona run` on the real videos and the rendered row: processor seconds and memory of stages, fruits, scores.

python benchmarks/surveys.py OUT [--data FOLDER] [--only NAME ...]     prints the tables of docs/lab/benchmarks.md

A survey that is in OUT already is read, not run again.
"""

import json
import subprocess
import sys
from pathlib import Path

import pomona
from command_line import DATA, parser_of
from pomona.learning.synth.truth import write_masks_as_coco
from tables import table_head, table_row


def commands(data: Path, out: Path) -> dict[str, list[str]]:
    """The arguments of `pomona run`, without --out, by survey."""
    row = data / "orchard-dev"
    markers = ["--markers", str(row / "truth" / "markers.csv")]
    return {
        "apple-tree-video": [str(data / "apple-tree-video" / "frames")],
        "orange-tree-video": [str(data / "orange-tree-video" / "frames"), "--fruit", "orange"],
        "orchard-dev, true masks": [str(row / "images"), *markers, "--detections", str(true_masks(row, out))],
        "orchard-dev": [str(row / "images"), *markers],
    }


def true_masks(row: Path, out: Path) -> Path:
    path = out / f"{row.name}-true-masks.json"
    write_masks_as_coco(row, path)
    return path


def run(name: str, arguments: list[str], out: Path) -> Path:
    survey = out / name.replace(", ", "-").replace(" ", "-")
    if not (survey / "report.html").exists():
        subprocess.run([sys.executable, "-m", "pomona", "run", *arguments, "--out", str(survey)], check=True)
    return survey


def stage_lines(surveys: dict[str, pomona.Survey]) -> list[str]:
    records = {name: json.loads((s.folder / "survey.json").read_text())["stages"] for name, s in surveys.items()}
    stages = list(dict.fromkeys(stage for r in records.values() for stage in r))
    lines = [table_head(" | ".join(["stage", *records]))]
    for stage in stages:
        cells = [r.get(stage) for r in records.values()]
        shown = [f"{c['processor_s']:.1f} s, {c['peak_memory_mb'] or 0:.0f} MB" if c else "" for c in cells]
        lines.append(table_row([stage, *shown]))
    totals = [sum(c["processor_s"] for c in r.values()) for r in records.values()]
    photos = [len(survey.photos) for survey in surveys.values()]
    each = [f"{total:.0f} s, {total / count:.1f} s a photo" for total, count in zip(totals, photos, strict=True)]
    return [*lines, table_row(["together", *each])]


def result_lines(surveys: dict[str, pomona.Survey]) -> list[str]:
    lines = [table_head("survey | photos placed | fruits | all fruit, hidden ones too | metres from")]
    for name, survey in surveys.items():
        placed = f"{len(survey.cameras)} of {len(survey.photos)}"
        crop = survey.crop
        every = f"{crop.fruits.value:.0f} ({crop.fruits.low:.0f} to {crop.fruits.high:.0f})" if crop else ""
        lines.append(table_row([name, placed, len(survey.fruits), every, survey.cameras.frame.scale_source]))
    return lines


def scores(survey: Path, truth: Path) -> str:
    command = [sys.executable, "-m", "pomona", "evaluate", str(survey), "--truth", str(truth)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--only", nargs="*")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    wanted = commands(arguments.data, arguments.out)
    names = arguments.only or list(wanted)
    surveys = {name: pomona.open(run(name, wanted[name], arguments.out)) for name in names}
    print("\n".join([*stage_lines(surveys), "", *result_lines(surveys)]))
    for name, survey in surveys.items():
        if name.startswith("orchard-dev"):
            print(f"\n{name}\n{scores(survey.folder, arguments.data / 'orchard-dev' / 'truth')}")


if __name__ == "__main__":
    main()
