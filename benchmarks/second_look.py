"""Fruits with and without the second look, paired: for docs/lab/second-look.md.

python benchmarks/second_look.py ROW[=SURVEY] [...] [--network FILE.onnx] [--true-masks] [--every N]

A ROW is a rendered row's folder with its truth; cameras are the true ones, or those of a SURVEY of it. Detections are
the shipped segmenter's, or the true masks. Scores are over visible fruits, after the filter and the measures.
"""

import argparse
import time
from pathlib import Path

from pomona import filter as filters
from pomona.capture import load_photos
from pomona.detections import SurveyDetections
from pomona.evaluate.fruits import evaluate_fruits, read_truth
from pomona.formats.cameras.colmap import read_colmap
from pomona.fuse import object
from pomona.measure import measure
from pomona.pipeline import RunOptions
from pomona.second_look import CentersNetwork, look_again
from pomona.second_look.network import SHIPPED
from pomona.segment import load_segmenter, segment_photos
from pomona.self_training.halves import part_of
from pomona.synth.truth import RowFolder
from train_filter import cameras_of, true_detections


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", nargs="+", metavar="ROW[=SURVEY]")
    parser.add_argument("--network", type=Path, default=SHIPPED)
    parser.add_argument("--true-masks", action="store_true")
    parser.add_argument("--every", type=int, default=1)
    arguments = parser.parse_args()
    network, options = CentersNetwork(arguments.network), RunOptions().of_stages
    print("| row | second look | F1 | R | P | centre, mm (median) | processor seconds a photo |")
    print("|---|---|---|---|---|---|---|")
    for name in arguments.rows:
        folder, _, survey = name.partition("=")
        row, truth = RowFolder(Path(folder)), read_truth(Path(folder))
        photos = load_photos([row.root / "images"])
        cameras = read_colmap(Path(survey) / "cameras") if survey else cameras_of(row, photos)
        segmenter = load_segmenter(None)
        least = options.select.trusted_share * segmenter.traits.score_threshold
        found = true_detections(row, photos) if arguments.true_masks else segment_photos(photos, segmenter)
        names = sorted(cameras.photos)[:: arguments.every]
        detections = SurveyDetections({n: found[n] for n in names if n in found}).at_least(least)
        cameras = part_of(cameras, frozenset(names))
        fused = object.fuse(detections, cameras)
        began = time.process_time()
        looked = look_again(fused, detections, photos, cameras, network=network)
        seconds = (time.process_time() - began) / len(names)
        for label, fruits in (("no", fused), ("yes", looked)):
            kept = filters.apply_to_views(fruits, detections, cameras)
            measured = measure(kept, detections, cameras, options=options.measure)
            scores = evaluate_fruits(measured, truth).visible
            assert scores is not None
            off_mm = 1e3 * scores.center_median_m
            cells = [
                row.root.name, label, *(f"{v:.3f}" for v in (scores.f1, scores.recall, scores.precision)),
                f"{off_mm:.1f}", f"{seconds:.2f}" if fruits is looked else "",
            ]  # fmt: skip
            print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
