"""Cameras of hard sets of photos, against the truth: for docs/lab/cameras.md.

python benchmarks/camera_bed.py OUT [--data FOLDER] [--only TEXT ...] [--label LABEL]     prints a table
python benchmarks/camera_bed.py OUT --label LABEL --against LABEL     compares two runs, case by case

OUT holds the rendered rows (`rows/`), the sets of photos (`cases/`), and for each label the surveys and a JSON file of
figures a case, which are read, not measured again, where they are there. Cases run one at a time, each in a process of
its own; one that was stopped goes on. Positions are in mm in the markers' frame, and after the similarity that brings
them nearest to the truth.

A photo is off when its camera is more than 30 mm from where it was, or the whole scale is more than 1 % wrong. It is
missed when no warning names it (by its name, by a span of names, or by the side it is of).
"""

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from camera_cases import CASES, SCENES, write_case
from command_line import DATA, parser_of
from pomona.basics.geometry import estimate_similarity
from pomona.errors import PomonaError
from pomona.evaluate.fruits import evaluate_fruits, read_truth
from pomona.formats.cameras.colmap import read_colmap
from pomona.learning.synth import render_row
from pomona.learning.synth.truth import RowFolder
from pomona.pipeline import RunOptions
from pomona.pipeline import run as run_pipeline
from row_cases import cameras_by_name
from tables import table_head, table_row
from usage import processor_s

OFF_MM, SCALE_OFF = 30.0, 0.01
# Figures that do not depend on what the code says, for comparisons: name, digits.
COMPARED = (("placed", 0), ("pieces", 0), ("rms_mm", 1), ("similar_mm", 1), ("scale_percent", 2), ("focal_percent", 2),
            ("missed", 0), ("f1", 3), ("seconds", 0))  # fmt: skip


@dataclass(frozen=True)
class Figures:
    """One case: NaN where it cannot be measured. `missed` counts photos that are off and that no warning names."""

    photos: int
    placed: int
    pieces: int
    rms_mm: float
    worst_mm: float
    similar_mm: float
    scale_percent: float
    focal_percent: float
    off: int
    missed: int
    false_alarms: int
    fault: str  # "named", "missed" or "" where nothing is wrong with the input
    f1: float
    centre_mm: float
    seconds: float
    warnings: tuple[str, ...]
    said_mm: float = float("nan")  # how exact the run says that places are (one standard deviation)


def failed(photos: int, seconds: float, message: str) -> Figures:
    nan = float("nan")
    return Figures(photos, 0, 0, nan, nan, nan, nan, nan, 0, 0, 0, "", nan, nan, seconds, (message,))


def named_photos(warnings: Sequence[str], photos: Sequence[str], sides: Sequence[str]) -> set[str]:
    """The photos that warnings name, themselves, by spans ("a.jpg to d.jpg") or by their side ("Side east …")."""
    found: set[str] = set()
    for text in warnings:
        found |= {name for name in photos if name in text or Path(name).stem in re.findall(r"\w+", text)}
        for first, last in re.findall(r"([\w./-]+) (?:to|–) ([\w./-]+\.jpg)", text):
            ends = [i for i, name in enumerate(photos) if name in (first, f"{first}.jpg", last)]
            found |= set(photos[ends[0] : ends[-1] + 1]) if len(ends) > 1 else set()
        if "was left out" not in text:  # that says something of a marker, nothing of the photos
            found |= {name for name, side in zip(photos, sides, strict=True) if side and f"ide {side}" in text}
    return found


def scale_is_named(warnings: Sequence[str]) -> bool:
    return any(re.search(r"(?i)scale.*(±|off|doubt|contradict|disagree|uncertain|unsure)", text) for text in warnings)


def measure_case(name: str, folder: Path, survey: Path) -> Figures:
    case = CASES[name]
    options = RunOptions(
        markers=folder / "markers.csv",
        detections=folder / "masks.json",
        cameras=folder / case.given if case.given else None,
        scene=False,  # the cloud has no part in cameras
    )
    photos = sorted(path.name for path in (folder / "images").iterdir())
    before = processor_s()
    try:
        run_pipeline([folder / "images"], survey, options, until="results")
    except PomonaError as error:
        return failed(len(photos), processor_s() - before, str(error))
    record = json.loads((survey / "survey.json").read_text())
    warnings = [text for stage in record["stages"].values() for text in stage.get("warnings", [])]
    return compare(name, folder, survey, photos, warnings, processor_s() - before)


def compare(name: str, folder: Path, survey: Path, photos: list[str], warnings: list[str], seconds: float) -> Figures:
    cameras = read_colmap(survey / "cameras")
    known = {f"{name}.jpg": camera for name, camera in cameras_by_name(RowFolder(folder)).items()}
    here = [i for i, photo in enumerate(cameras.photos) if photo in known]
    true = np.array([known[cameras.photos[i]].centre_in_world for i in here])
    apart_mm = 1000 * np.linalg.norm(cameras.centers_in_world[here] - true, axis=1)
    nearest = estimate_similarity(cameras.centers_in_world[here], true)
    similar_mm = 1000 * np.linalg.norm(nearest.apply(cameras.centers_in_world[here]) - true, axis=1)
    ratios = [cameras.intrinsics_of(i).focal_px / known[cameras.photos[i]].focal_px - 1 for i in here]
    off = {cameras.photos[i] for i, mm in zip(here, apart_mm, strict=True) if mm > OFF_MM}
    scale = 1 / nearest.scale - 1
    if abs(scale) > SCALE_OFF and not scale_is_named(warnings):
        off = {cameras.photos[i] for i in here}
    sides = [photo.split("_")[0] if photo.startswith(("east", "west")) else "" for photo in photos]
    fault = CASES[name].fault
    named = named_photos(warnings, photos, sides)
    alarms = named_photos([text for text in warnings if not (fault and re.search(fault, text))], photos, sides)
    placed = {cameras.photos[i] for i in here}
    f1, centre_mm = _fruits(folder, survey)
    said = "" if fault is None else "named" if any(re.search(fault, text) for text in warnings) else "missed"
    return Figures(
        photos=len(known), placed=len(here), pieces=_pieces(survey), rms_mm=_rms(apart_mm),
        worst_mm=float(apart_mm.max()), similar_mm=_rms(similar_mm), scale_percent=100 * scale,
        focal_percent=100 * max(ratios, key=abs), off=len(off), missed=len(off - named),
        false_alarms=len((alarms & placed) - off), fault=said, f1=f1, centre_mm=centre_mm, seconds=seconds,
        warnings=tuple(warnings), said_mm=_said_mm(survey),
    )  # fmt: skip


def _fruits(folder: Path, survey: Path) -> tuple[float, float]:
    """F1 of visible fruits, and the median error of their centres in mm."""
    from pomona import open as open_survey

    scores = evaluate_fruits(open_survey(survey).fruits, read_truth(folder)).visible
    return (scores.f1, 1000 * scores.center_median_m) if scores else (float("nan"), float("nan"))


def _pieces(survey: Path) -> int:
    return len(json.loads((survey / "survey.json").read_text())["stages"]["scale"]["info"]["report"]["pieces"])


def _said_mm(survey: Path) -> float:
    said = json.loads((survey / "survey.json").read_text())["stages"]["scale"]["info"]["report"]["accuracy"]
    return said["position_sd_mm"] if said else float("nan")


def _rms(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    return float(np.sqrt((values**2).mean()))


def folder_name(case: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", case.lower()).strip("-")


def rows(out: Path, data: Path, wanted: set[str]) -> dict[str, Path]:
    """The rendered rows that cases are made of; those that are missing are rendered."""
    found = {"orchard-dev": data / "orchard-dev"}
    for name, options in SCENES.items():
        found[name] = out / "rows" / name
        if name in wanted and not found[name].exists():
            found[name].parent.mkdir(parents=True, exist_ok=True)
            print(f"Rendering {render_row(options, found[name])}", file=sys.stderr, flush=True)
    return found


def figures_of(name: str, out: Path, label: str, data: Path) -> Figures:
    """The figures of a case: those kept, or measured in a process of its own."""
    path = out / label / f"{folder_name(name)}.json"
    if not path.exists():
        folder = out / "cases" / folder_name(name)
        if not folder.exists():
            folder.parent.mkdir(parents=True, exist_ok=True)
            case = CASES[name]
            write_case(case, rows(out, data, {case.row}), folder)
        command = [sys.executable, __file__, str(out), "--label", label, "--measure", name]
        subprocess.run(command, check=True)
    kept = json.loads(path.read_text())
    return Figures(**{**kept, "warnings": tuple(kept["warnings"])})


def table(found: dict[str, Figures]) -> str:
    titles = (
        "case | placed | pieces | RMS, mm | said ± | worst | similarity | scale, % | focal, % | off | missed | "
        "false alarms | fault | F1 | centre, mm | CPU s"
    )
    lines = [table_head(titles)]
    for name, f in found.items():
        cells = (name, f"{f.placed} of {f.photos}", f.pieces, f"{f.rms_mm:.1f}", f"{f.said_mm:.1f}",
                 f"{f.worst_mm:.0f}", f"{f.similar_mm:.1f}", f"{f.scale_percent:+.2f}", f"{f.focal_percent:+.2f}",
                 f.off, f.missed, f.false_alarms, f.fault or "–", f"{f.f1:.3f}", f"{f.centre_mm:.1f}",
                 f"{f.seconds:.0f}")  # fmt: skip
        lines.append(table_row(cells))
    return "\n".join(lines)


def comparison(before: dict[str, Figures], after: dict[str, Figures]) -> str:
    names = [name for name in before if name in after]
    lines = [table_head(" | ".join(["case", *(name for name, _ in COMPARED)]))]
    for name in names:
        cells = [
            f"{getattr(before[name], field):.{digits}f} → {getattr(after[name], field):.{digits}f}"
            for field, digits in COMPARED
        ]
        lines.append(table_row([name, *cells]))
    return "\n".join(lines)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--label", default="now")
    parser.add_argument("--against")
    parser.add_argument("--only", nargs="*", default=[""])
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    out = arguments.out.resolve()
    if arguments.measure:
        name, at = arguments.measure, out / arguments.label
        at.mkdir(parents=True, exist_ok=True)
        found = measure_case(name, out / "cases" / folder_name(name), at / folder_name(name))
        (at / f"{folder_name(name)}.json").write_text(json.dumps(asdict(found), indent=1))
        return
    names = [name for name in CASES if any(text in name for text in arguments.only)]
    figures = {name: figures_of(name, out, arguments.label, arguments.data) for name in names}
    print(table(figures))
    if arguments.against:
        print("\n" + comparison({n: figures_of(n, out, arguments.against, arguments.data) for n in names}, figures))


if __name__ == "__main__":
    main()
