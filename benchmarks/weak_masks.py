"""How good masks made from boxes are: IoU with true masks, from the boxes of the true masks.

python benchmarks/weak_masks.py FOLDER [--photos N] [--json FILE]

FOLDER holds labelled photos with true masks in any format, for example a rendered row. Each fruit's true mask is
reduced to its box; `label_image_from_boxes` makes a mask of it again. Compared are that mask and, beside it, the
ellipse in the box and the whole box. Given per fruit: IoU and the ratio of areas; over all pixels in boxes: the share
that is doubtful and teaches nothing, and how many of the pixels taught as fruit, and as background, are so in truth.
"""

import itertools
import json
import sys
from pathlib import Path

import numpy as np

from command_line import parser_of
from pomona.formats.detections.label_sets import find_label_sets, read_label_set
from pomona.formats.detections.labelled import FEWEST_PIXELS, LabelledPhoto
from pomona.formats.detections.shapes import ellipse_mask
from pomona.learning.train.samples import Sample
from pomona.learning.train.weak_masks import label_image_from_boxes
from pomona.stages.capture.images import size_of
from pomona.values.detections import Mask

WIDTHS_PX = (0, 15, 30, 60, 10_000)


def compare(photo: LabelledPhoto) -> tuple[list[dict], np.ndarray]:
    """Return a row for each fruit and six counts of pixels.

    Those in boxes; of these the doubtful; those taught as fruit, and of them the true ones; those taught as none, and
    of them the true ones.
    """
    fruits = [f for f in photo.fruits if f.mask is not None and f.mask.area_px >= FEWEST_PIXELS]
    boxes = np.array([f.mask.box_px for f in fruits], float).reshape(-1, 4)
    pixels = Sample(photo.path, Path(), boxes, "", "").pixels()
    labels = label_image_from_boxes(pixels, boxes)
    truth, in_boxes = np.zeros(labels.shape, bool), np.zeros(labels.shape, bool)
    for fruit in fruits:
        x0, y0, x1, y1 = fruit.mask.box_px
        in_boxes[y0:y1, x0:x1] = True
        truth[y0:y1, x0:x1] |= fruit.mask.pixels
    rows = [row(k, f.mask, labels) for k, f in enumerate(fruits, start=1)]
    found, none = (labels > 0) & in_boxes, (labels == 0) & in_boxes
    counts = [in_boxes, (labels < 0) & in_boxes, found, found & truth, none, none & ~truth]
    return rows, np.array([int(c.sum()) for c in counts])


def row(k: int, true: Mask, labels: np.ndarray) -> dict:
    x0, y0, x1, y1 = true.box_px
    here = labels[y0:y1, x0:x1] == k
    shared = int((here & true.pixels).sum())
    area, true_area = int(here.sum()), true.area_px
    width, height = x1 - x0, y1 - y0
    inside = ellipse_mask(((x0 + x1) / 2, (y0 + y1) / 2), (width / 2, height / 2), 0, labels.shape[1], labels.shape[0])
    return {
        "width_px": max(width, height),
        "weak": shared / (area + true_area - shared),
        "ellipse": true.iou(inside) if inside else 0.0,
        "box": true_area / (width * height),
        "area_ratio": area / true_area,
    }


def table(rows: list[dict]) -> list[dict]:
    """Mean IoU by how wide fruits are, and of all."""
    widths = np.array([r["width_px"] for r in rows])
    lines = []
    for low, high in [*itertools.pairwise(WIDTHS_PX), (0, WIDTHS_PX[-1])]:
        some = [r for r, w in zip(rows, widths, strict=True) if low <= w < high]
        if some:
            means = {key: float(np.mean([r[key] for r in some])) for key in ("weak", "ellipse", "box")}
            weak = np.array([r["weak"] for r in some])
            more = {"median": float(np.median(weak)), "failed": float((weak < 0.5).mean())}
            area = float(np.median([r["area_ratio"] for r in some]))
            lines.append({"from_px": low, "to_px": high, "fruits": len(some), **means, **more, "area_ratio": area})
    return lines


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--photos", type=int)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    photos = [p for one in find_label_sets(asked.folder) for p in read_label_set(one, size_of)][: asked.photos]
    rows: list[dict] = []
    counts = np.zeros(6, np.int64)
    for photo in photos:
        mine, more = compare(photo)
        rows += mine
        counts += more
    lines = table(rows)
    print("width px      fruits   weak  median  <0.5  ellipse    box  area ratio")
    for line in lines:
        print(
            f"{line['from_px']:5d}-{line['to_px']:<6d}{line['fruits']:8d}  {line['weak']:.3f}   {line['median']:.3f} "
            f"{line['failed']:5.1%}    {line['ellipse']:.3f}  {line['box']:.3f}       {line['area_ratio']:.3f}"
        )
    all_px, doubtful, found, found_true, none, none_true = counts.tolist()
    print(
        f"of the pixels in boxes {doubtful / all_px:.1%} are doubtful; of those taught as fruit "
        f"{found_true / found:.1%} are, of those taught as none {none_true / none:.1%} are none"
    )
    if asked.json:
        asked.json.write_text(json.dumps({"by_width": lines, "pixels": counts.tolist()}, indent=1))


if __name__ == "__main__":
    sys.exit(main())
