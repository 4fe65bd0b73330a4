"""One 18-megapixel photo, from the JPEG to stitched detections: the shipped network beside the paper's Mask R-CNN.

python benchmarks/segment_speed.py [--model FILE ...] [--repeats N] [--without-mask-rcnn]

The photo is the bundled sample enlarged until its apples are as wide as the paper's, about 100 pixels. Mask R-CNN
(ResNet-101-FPN, the paper's 6 × 4 tiles of 1024 pixels) has random weights unless `--model` names a checkpoint: its
backbone and its thousand proposals a tile cost the same; none of them counts as fruit, so that what it would spend on
masks is left out. Each is timed in a process of its own, so that peak memory is
its own; the first photo, which loads the network, is not timed. "survey" adds, once for a whole survey, the search for
the scale to read photos at.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from importlib.resources import as_file, files
from pathlib import Path

import cv2

from command_line import parser_of
from tables import table_head, table_row
from usage import peak_mb

WIDTH_PX, HEIGHT_PX = 5184, 3456


def write_photo(path: Path) -> None:
    with as_file(files("pomona") / "demo" / "east") as side:
        halves = [cv2.imread(str(photo)) for photo in sorted(side.glob("*.jpg"))[5:9:3]]
    scale = WIDTH_PX / 2 / halves[0].shape[1]
    large = cv2.hconcat([cv2.resize(h, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC) for h in halves])
    top = (large.shape[0] - HEIGHT_PX) // 2
    cv2.imwrite(str(path), large[top : top + HEIGHT_PX, :WIDTH_PX], [cv2.IMWRITE_JPEG_QUALITY, 92])


def write_random_mask_rcnn(path: Path) -> None:
    import torch

    from pomona.stages.segment.mask_rcnn import build_mask_rcnn

    torch.manual_seed(1)
    state = build_mask_rcnn("maskrcnn-r101", 2).state_dict()
    state["roi_heads.box_predictor.cls_score.bias"] = torch.tensor([9.0, -9.0])  # all is background
    torch.save({"arch": "maskrcnn-r101", "model": state}, path)


def measure(folder: Path, model: str | None, repeats: int) -> None:
    from pomona.progress import Silent
    from pomona.stages.capture import load_photos
    from pomona.stages.segment import SegmentOptions, load_segmenter, scales_of, segment_photos

    photos = load_photos([folder], min_photos=1)
    segmenter = load_segmenter(model)
    start = time.perf_counter()
    (scale,) = scales_of(photos, segmenter, SegmentOptions(sample_photos=1), Silent()).by_name.values()
    search_s = time.perf_counter() - start
    options = SegmentOptions(scale=scale, kept_share=1)
    if search_s < 1e-2:  # no scale was looked for, so nothing has run yet
        segment_photos(photos, segmenter, options=options)
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        found = segment_photos(photos, segmenter, options=options)
        times.append(time.perf_counter() - start)
    print(json.dumps({"s": min(times), "search_s": search_s, "mb": peak_mb(), "scale": scale, "found": found.total}))


def in_process(folder: Path, model: str | None, repeats: int) -> dict[str, float]:
    command = [sys.executable, __file__, "--measure", str(folder), "--repeats", str(repeats)]
    command += ["--model", model] if model else []
    out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    result: dict[str, float] = json.loads(out.splitlines()[-1])
    return result


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--model", action="append", default=[])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--without-mask-rcnn", action="store_true")
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        measure(arguments.measure, next(iter(arguments.model), None), arguments.repeats)
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "photos"
        folder.mkdir()
        write_photo(folder / "photo.jpg")
        models = {"shipped": None, **{Path(model).name: model for model in arguments.model}}
        if not arguments.without_mask_rcnn:
            checkpoint = Path(temporary) / "maskrcnn-r101.pt"
            write_random_mask_rcnn(checkpoint)
            models["Mask R-CNN, ResNet-101"] = str(checkpoint)
        titles = "network | seconds a photo | times the shipped | search for the scale | peak memory | read at"
        print(table_head(titles))
        shipped_s = None
        for name, model in models.items():
            result = in_process(folder, model, arguments.repeats if "Mask" not in name else 1)
            shipped_s = shipped_s or result["s"]
            times = f"{result['s']:.2f}", f"{result['s'] / shipped_s:.1f}", f"{result['search_s']:.1f} s"
            print(table_row([name, *times, f"{result['mb']:.0f} MB", f"{result['scale']:.2f}"]), flush=True)


if __name__ == "__main__":
    main()
