"""What the surroundings of fruits do to their scores: the same fruits in windows of several sizes.

python benchmarks/surroundings.py PHOTO X,Y [X,Y ...] [--scale S] [--model FILE] [--windows PX [PX ...]]

X,Y are fruits' centres in the photo's pixels. For each window about them, in the photo's pixels (0: the whole photo),
the table has the best score near each centre and the highest probability there that a pixel is fruit.
"""

from pathlib import Path

import numpy as np

from command_line import parser_of
from pomona.basics.arrays import ByteArray, FloatArray
from pomona.stages.capture import load_photos, read_pixels
from pomona.stages.segment.center_offset import CenterOffsetSegmenter
from pomona.stages.segment.load import SHIPPED_WEIGHTS
from pomona.stages.segment.resize import resized_pixels
from tables import table_head, table_row

NEAR_CELLS = 2


def scores_at(
    segmenter: CenterOffsetSegmenter, pixels: ByteArray, at_px: FloatArray, scale: float
) -> tuple[float, float]:
    """The best score and fruit probability near a place of an image that is read at a scale."""
    height, width = (round(side * scale) for side in pixels.shape[:2])
    maps = segmenter.maps(resized_pixels(pixels, width, height))
    column, row = (at_px * scale / maps.stride).astype(int)
    near = np.s_[max(row - NEAR_CELLS, 0) : row + NEAR_CELLS + 1, max(column - NEAR_CELLS, 0) : column + NEAR_CELLS + 1]
    return float(maps.heatmap[near].max()), float(maps.foreground[near].max())


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("photo", type=Path)
    parser.add_argument("fruits", nargs="+", metavar="X,Y")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--windows", type=int, nargs="+", default=[0, 400, 320, 256, 192, 128, 96])
    arguments = parser.parse_args()
    segmenter = CenterOffsetSegmenter(arguments.model or SHIPPED_WEIGHTS)
    (photo,) = load_photos([arguments.photo], min_photos=1)
    pixels = read_pixels(photo)
    fruits = np.array([fruit.split(",") for fruit in arguments.fruits], float)
    print(table_head(" | ".join(["window, px", *arguments.fruits])))
    for window in arguments.windows:
        cells = []
        for fruit in fruits:
            x0, y0 = np.maximum((fruit - window / 2).astype(int), 0) if window else (0, 0)
            part = pixels[y0 : y0 + window, x0 : x0 + window] if window else pixels
            score, probability = scores_at(segmenter, part, fruit - [x0, y0], arguments.scale)
            cells.append(f"{score:.2f} / {probability:.2f}")
        print(table_row([window or "all", *cells]), flush=True)


if __name__ == "__main__":
    main()
