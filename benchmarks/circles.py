"""How well a network says where whole fruits are, hidden parts and all, against what boxes say: on rendered rows.

python benchmarks/circles.py MODEL.onnx ROW [ROW ...] [--scale S] [--every N]

A ROW is a rendered row's folder with its truth. Each detection with a score of 0.5 or more is compared with the fruit
that its mask overlaps most: errors of the centre and of the radius as shares of the true radius, of the circle that the
network says, and of the circle about its box (half the longer side). `off by` is the error over the deviation that the
network says, which is 1 where it is honest (root mean square; robust: median of the absolute, over 0.6745).
"""

from pathlib import Path

import cv2
import numpy as np

from command_line import parser_of
from pomona.learning.synth.truth import RowFolder, read_fruits, read_mask
from pomona.stages.capture import load_photos, read_pixels
from pomona.stages.segment import load_segmenter
from row_cases import cameras_by_name
from tables import table_head, table_row

SURE = 0.5
LEAST_OVERLAP = 0.5  # of a detection's mask with the fruit


def compared(model: Path, row: RowFolder, scale: float, every: int) -> np.ndarray:
    """(n, 8): errors of centre and radius by circle, by box; deviations said; visible share; the true radius (px)."""
    segmenter = load_segmenter(model)
    fruits, lines = read_fruits(row.truth("fruits.csv")), []
    cameras, photos = cameras_by_name(row), load_photos([row.root / "images"])
    for photo in list(photos)[::every]:
        camera, ids = cameras[Path(photo.name).stem], read_mask(row.mask(Path(photo.name).stem))
        pixels = read_pixels(photo)
        size = (round(pixels.shape[1] * scale), round(pixels.shape[0] * scale))
        (found,) = segmenter.segment([cv2.resize(pixels, size, interpolation=cv2.INTER_LINEAR)])
        ids = cv2.resize(ids, size, interpolation=cv2.INTER_NEAREST_EXACT)
        assert found.circles_px is not None, f"{model} says no circles"
        centres, depths = camera.project(fruits.centres_in_world)
        radii = scale * camera.focal_px * fruits.diameters_m / 2 / depths
        for k in np.flatnonzero(found.scores >= SURE):
            x0, y0, x1, y1 = found.masks[k].box_px
            under = ids[y0:y1, x0:x1][found.masks[k].pixels]
            seen, counts = np.unique(under, return_counts=True)
            best = seen[counts.argmax()]
            if best == 0 or counts.max() < LEAST_OVERLAP * len(under):
                continue
            (at,) = np.flatnonzero(fruits.ids == best)
            true, radius = scale * centres[at], radii[at]
            circle, box = found.circles_px[k], found.boxes_px[k]
            from_box = np.array([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2, (box[2:] - box[:2]).max() / 2])
            errors = [(np.hypot(*(c[:2] - true)) / radius, c[2] / radius - 1) for c in (circle, from_box)]
            share = (ids == best).sum() / (np.pi * radius**2)
            lines.append([*errors[0], *errors[1], circle[3] / radius, circle[4] / radius, share, radius])
    return np.array(lines)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("model", type=Path)
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--every", type=int, default=1)
    arguments = parser.parse_args()
    print(table_head("row | visible | fruits | centre: circle | box | radius: circle | box | off by: centre | radius"))
    for row in arguments.rows:
        lines = compared(arguments.model, RowFolder(row), arguments.scale, arguments.every)
        for low, high in ((0.0, 0.5), (0.5, 0.9), (0.9, 2.0)):
            e = lines[(lines[:, 6] >= low) & (lines[:, 6] < high)]
            if len(e) == 0:
                continue
            off_centre, off_radius = e[:, 0] / np.sqrt(2) / e[:, 4], np.abs(e[:, 1]) / e[:, 5]
            cells = [
                row.name, f"{low:.0%} to {min(high, 1):.0%}", f"{len(e)}",
                *(f"{np.median(np.abs(e[:, k])):.3f}" for k in (0, 2, 1, 3)),
                f"{np.sqrt(np.mean(off_centre**2)):.2f}",
                f"{np.sqrt(np.mean(off_radius**2)):.2f} ({np.median(off_radius) / 0.6745:.2f})",
            ]  # fmt: skip
            print(table_row(cells), flush=True)


if __name__ == "__main__":
    main()
