"""Segmenters on photos that they were not trained on: AP50, F1, masks and time, as a table for docs/lab/segmenter.md.

python benchmarks/detector.py [--model FILE ...] [--data FOLDER] [--row FOLDER ...] [--only NAME ...] [--min-visible PX]
        [--scale S] [--tile PX] [--without-shipped] [--json FILE]

Measures the shipped segmenter, and each --model, on `orchard-dev` and on the tiles that training holds out (whole
photos, 15 %, `benchmarks/fruit_tiles.py`). Photos are segmented as `pomona segment` does it, at the scale that is found
in them, but from a score of 0.05 up. Boxes decide (IoU at least 0.5 for AP50, more for F1), fruits under
12 px are not scored; where the truth has masks, a second line has what masks decide.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from command_line import DATA, parser_of
from fruit_tiles import labels_of, sides, tile_sets
from pomona.evaluate.detections import (
    DetectionScores,
    DetectionTruth,
    EvaluateDetectionsOptions,
    evaluate_detections,
    read_detection_truth,
    score,
)
from pomona.progress import Silent
from pomona.stages.capture import load_photos
from pomona.stages.segment import Segmenter, SegmentOptions, load_segmenter, scales_of, segment_photos
from pomona.values.detections import Detections
from pomona.values.photos import Photos
from tables import table_head, table_row

LEAST_SCORE = 0.05


@dataclass(frozen=True)
class Measured:
    """A line of the table; `match` is what decides."""

    data: str
    model: str
    match: str
    scores: DetectionScores
    scale: float
    seconds_a_photo: float

    def cells(self) -> list[str]:
        best, half = self.scores.best, self.scores.levels[0]
        f1, confidence, mask_iou = (best.f1, best.confidence, best.mask_iou) if best else (0.0, np.nan, np.nan)
        return [
            self.data, self.model, self.match, f"{len(self.scores.matches)}", f"{self.scores.true_fruits}",
            f"{self.scores.ap50:.3f}", f"{f1:.3f} at {confidence:.2f}", f"{half.f1:.3f}",
            f"{half.recall:.3f}", f"{half.precision:.3f}", "" if np.isnan(mask_iou) else f"{mask_iou:.3f}",
            f"{self.scale:.2f}", f"{self.seconds_a_photo:.2f}",
        ]  # fmt: skip


TITLES = (
    "photos of | segmenter | match | photos | fruits | AP50 | best F1 | F1 at 0.5 | R at 0.5 | P at 0.5 | "
    "mean mask IoU | scale | seconds a photo"
)


def held_out_tiles(data: Path) -> dict[str, tuple[DetectionTruth, list[Path]]]:
    """The truth and the files of the tiles of each set that training never sees."""
    folders = tile_sets(data)
    parts = sides({name: labels_of(folder) for name, folder in folders.items()})
    return {
        name: (read_detection_truth(folder), [folder / "images" / i["file_name"] for i in parts[name]["val"]])
        for name, folder in folders.items()
    }


def segmented(
    photos: Photos, segmenter: Segmenter, scale: float | None, tile_px: int | None
) -> tuple[dict[str, Detections], dict[str, float], float]:
    """The detections of each photo, down to the least score; scales; seconds a photo, scale and reading included."""
    start = time.perf_counter()
    # The scale is found from what the segmenter is sure of, as in a survey, not from all that it reports here.
    scales = dict(scales_of(photos, segmenter, SegmentOptions(scale=scale), Silent()).by_name)
    found: dict[str, Detections] = {}
    for value in sorted(set(scales.values())):
        group = Photos(tuple(photo for photo in photos if scales[photo.name] == value))
        options = SegmentOptions(score_threshold=LEAST_SCORE, kept_share=1, scale=value, tile_px=tile_px)
        found |= segment_photos(group, segmenter, options=options)
    return found, scales, (time.perf_counter() - start) / len(photos)


def measure(
    name: str, model: str, truth: DetectionTruth, files: Sequence[Path], segmenter: Segmenter, how: argparse.Namespace
) -> list[Measured]:
    photos = load_photos(list(files), min_photos=1)
    found, scales, seconds = segmented(photos, segmenter, how.scale, how.tile)
    mine = truth.of_photos(photos.names)
    scale = float(np.median(list(scales.values())))
    lines = []
    for match in ("boxes", "masks") if truth.has_masks else ("boxes",):
        options = EvaluateDetectionsOptions(match=match, min_visible_px=how.min_visible)
        lines.append(Measured(name, model, match, evaluate_detections(found, mine, options=options), scale, seconds))
    return lines


def together(lines: Sequence[Measured]) -> Measured:
    """All tiles as one set."""
    matches = [match for line in lines for match in line.scores.matches]
    seconds = sum(line.seconds_a_photo * len(line.scores.matches) for line in lines) / len(matches)
    scale = float(np.median([line.scale for line in lines]))
    return Measured("all held-out tiles", lines[0].model, "boxes", score(matches, by_masks=False), scale, seconds)


def measured(model: Path | None, how: argparse.Namespace) -> list[Measured]:
    name = "shipped" if model is None else model.name
    segmenter = load_segmenter(model, score_floor=LEAST_SCORE)
    lines = []
    for row in [how.data / "orchard-dev", *how.row]:
        if how.only and row.name not in how.only:
            continue
        truth, files = read_detection_truth(row), sorted((row / "images").iterdir())
        lines += measure(row.name, name, truth, files, segmenter, how)
    tiles = []
    for folder, (truth, files) in held_out_tiles(how.data).items():
        if not how.only or folder in how.only:
            tiles += measure(f"{folder}, held out", name, truth, files, segmenter, how)
    return [*lines, *tiles, together(tiles)] if len(tiles) > 1 else [*lines, *tiles]


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--model", type=Path, action="append", default=[], help="measured beside the shipped one")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--only", nargs="*", default=[], metavar="NAME", help="of a set or a row")
    parser.add_argument("--row", type=Path, action="append", default=[], help="a rendered row, measured too")
    parser.add_argument("--without-shipped", action="store_true")
    parser.add_argument("--min-visible", type=int, default=120, help="pixels of a rendered fruit that is to be found")
    parser.add_argument("--scale", type=float, help="at which photos are read; default: found in them")
    parser.add_argument("--tile", type=int, help="side of tiles in pixels, of which the network sees one at a time")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    print(table_head(TITLES), flush=True)
    results = []
    for model in [*([] if arguments.without_shipped else [None]), *arguments.model]:
        for line in measured(model, arguments):
            print(table_row(line.cells()), flush=True)
            about = {"data": line.data, "model": line.model, "seconds_a_photo": line.seconds_a_photo}
            results.append(about | line.scores.to_json())
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
