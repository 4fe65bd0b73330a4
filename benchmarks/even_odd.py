"""Whether even and odd photos of a survey give the same fruits, for docs/lab/object-method.md.

python benchmarks/even_odd.py SURVEY[=TRUTH] [SURVEY[=TRUTH] ...] [--no-second-look] [--splits 1 to 3]
    [--crops FOLDER --photos FOLDER]

A SURVEY is a folder of `pomona run` over all photos; with TRUTH, a rendered row's folder, each half is scored too.
Its cameras (so both halves are in one frame of reference) and detections are split by photo, sorted by name; each half
is fused, looked at again, filtered and measured alone. A fruit of one half is found by the other where that has one in
its fruits.csv at most half a median diameter away, one to one. Confident fruits are those whose score reaches a level:
0.4, which is all of fruits.csv, and 0.8. Of some dozens of fruits the share hangs on chance: `--splits 3` parts the
photos in two further ways, by pairs, and by the first and fourth of every four. `--crops` writes, for each fruit that
only one half has, what its best photos show.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

import pomona
from command_line import parser_of
from pomona.evaluate.fruits import Truth, evaluate_fruits, read_truth
from pomona.formats.cameras.colmap import read_colmap
from pomona.formats.detections.coco import read_coco
from pomona.learning.self_training.halves import found_by, same_places
from pomona.pipeline import RunOptions
from pomona.progress import Silent
from pomona.stages.fuse import Fused
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.photos import Photos
from tables import table_head, table_row

LEVELS = (0.4, 0.8)
SPLITS = {"even, odd": (0, 1, 0, 1), "pairs": (0, 0, 1, 1), "first and fourth": (0, 1, 1, 0)}  # of every four photos
TITLES = (
    "survey | score from | even | odd | counts differ | even found by odd | odd found by even | both ways | "
    "apart, mm (share of diameter) | F1 even, odd"
)


@dataclass(frozen=True)
class Halves:
    """Fruits from even and from odd photos, and which of their fruits are the same: pairs (m, 2) of indices."""

    even: Fused
    odd: Fused
    pairs: np.ndarray
    diameter_m: float


def detections_of(survey: Path) -> SurveyDetections:
    """The detections that `--method object` uses: those of a score from the run's own level up."""
    info = json.loads((survey / "survey.json").read_text())["stages"]["select"]["info"]
    return read_coco(survey / "detections.json").at_least(info["least_score"])


def halves_of(
    photos: Photos, detections: SurveyDetections, cameras: Cameras, half_of: tuple[int, ...], options: RunOptions
) -> Halves:
    names = sorted(cameras.photos)
    parts = [[name for i, name in enumerate(names) if half_of[i % len(half_of)] == half] for half in (0, 1)]
    even, odd = (found_by(photos, detections, cameras.of_photos(part), options, Silent()) for part in parts)
    diameter_m = float(np.nanmedian(np.concatenate([even.fruits.diameters_m, odd.fruits.diameters_m])))
    return Halves(even, odd, same_places(even.fruits, odd.fruits, diameter_m), diameter_m)


def rows(name: str, halves: Halves, truth: Truth | None) -> list[str]:
    even, odd, pairs = halves.even.fruits, halves.odd.fruits, halves.pairs
    apart_m = np.linalg.norm(even.centers_in_world[pairs[:, 0]] - odd.centers_in_world[pairs[:, 1]], axis=1)
    lines = []
    for level in LEVELS:
        sure = [fruits.scores >= level for fruits in (even, odd)]
        counts = [int(s.sum()) for s in sure]
        both = [int(s[pairs[:, k]].sum()) for k, s in enumerate(sure)]
        mine = sure[0][pairs[:, 0]] | sure[1][pairs[:, 1]]
        median_m = float(np.median(apart_m[mine])) if mine.any() else np.nan
        scores = ""
        if truth is not None:
            of_halves = (evaluate_fruits(f[s], truth).headline for f, s in zip((even, odd), sure, strict=True))
            scores = ", ".join(f"{scored.f1:.3f}" for scored in of_halves)
        cells = [
            name, f"{level:g}", *counts, share(abs(counts[0] - counts[1]), max(counts)),
            *map(share, both, counts), share(sum(both), sum(counts)),
            f"{1000 * median_m:.1f} ({median_m / halves.diameter_m:.2f})", scores,
        ]  # fmt: skip
        lines.append(table_row(cells))
    return lines


def share(part: int, whole: int) -> str:
    return f"{100 * part / whole:.1f} %" if whole else ""


def write_crops(survey: Path, photos: Path, halves: Halves, out: Path) -> None:
    """One picture a fruit that one half alone has: its circle in three photos of each half, its own half above."""
    cameras = read_colmap(survey / "cameras")
    names = sorted(cameras.photos)
    out.mkdir(parents=True, exist_ok=True)
    for label, mine, column in (("even", halves.even, 0), ("odd", halves.odd, 1)):
        other = halves.odd if column == 0 else halves.even
        alone = np.setdiff1d(np.arange(len(mine.fruits)), halves.pairs[:, column])
        for i in alone.tolist():
            own = [n for n, f in zip(mine.observations.photo, mine.observations.fruit_id, strict=True)
                   if f == mine.fruits.ids[i]]  # fmt: skip
            shown = sorted(own)[:: max(1, len(own) // 4)][:4]
            tiles = [crop(photos, cameras, n, mine, other, i) for n in shown]
            tiles += [crop(photos, cameras, names[min(names.index(n) + 1, len(names) - 1)], mine, other, i)
                      for n in shown]  # fmt: skip
            tiles += [np.zeros_like(tiles[0])] * (8 - len(tiles))
            picture = np.concatenate([np.concatenate(tiles[:4], 1), np.concatenate(tiles[4:], 1)], 0)
            cv2.imwrite(str(out / f"{label}_{mine.fruits.ids[i]}_{mine.fruits.scores[i]:.2f}.jpg"), picture)


def crop(photos: Path, cameras: Cameras, name: str, mine: Fused, other: Fused, i: int, size: int = 260) -> np.ndarray:
    """The fruit in yellow, the other fruits of its half in white, those of the other half in red."""
    picture = cv2.imread(str(photos / name))
    idx = cameras.photos.index(name)
    focal_px = cameras.intrinsics_of(idx).focal_px
    at, depth = cameras.project(idx, mine.fruits.centers_in_world[i : i + 1])
    half = max(20.0, 2.5 * focal_px * mine.fruits.diameters_m[i] / 2 / depth[0])
    layers = ((mine.fruits, (255, 255, 255)), (other.fruits, (0, 0, 255)), (mine.fruits[[i]], (0, 255, 255)))
    for fruits, color in layers:
        xy_px, depths = cameras.project(idx, fruits.centers_in_world)
        for (x, y), d, width in zip(xy_px, depths, fruits.diameters_m, strict=True):
            if np.isfinite([x, y, width]).all() and abs(x - at[0, 0]) < 2 * half and abs(y - at[0, 1]) < 2 * half:
                cv2.circle(picture, (round(x), round(y)), round(focal_px * width / 2 / d), color, 1)
    corner = (at[0] - half).astype(int)
    moved = np.array([[size / (2 * half), 0, -corner[0] * size / (2 * half)],
                      [0, size / (2 * half), -corner[1] * size / (2 * half)]])  # fmt: skip
    return cv2.warpAffine(picture, moved, (size, size))


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("surveys", nargs="+")
    parser.add_argument("--no-second-look", action="store_true")
    parser.add_argument("--splits", type=int, default=1, choices=range(1, len(SPLITS) + 1))
    parser.add_argument("--crops", type=Path)
    parser.add_argument("--photos", type=Path)
    arguments = parser.parse_args()
    print(table_head(TITLES))
    for each in arguments.surveys:
        folder, _, truth = each.partition("=")
        survey, known = Path(folder), read_truth(Path(truth)) if truth else None
        options = RunOptions(second_look=not arguments.no_second_look)
        photos = pomona.open(survey).photos
        cameras, detections = read_colmap(survey / "cameras"), detections_of(survey)
        for split, half_of in list(SPLITS.items())[: arguments.splits]:
            halves = halves_of(photos, detections, cameras, half_of, options)
            name = f"{survey.name}, {split}" if arguments.splits > 1 else survey.name
            print("\n".join(rows(name, halves, known)), flush=True)
            if arguments.crops and arguments.photos:
                write_crops(survey, arguments.photos, halves, arguments.crops / name)


if __name__ == "__main__":
    main()
