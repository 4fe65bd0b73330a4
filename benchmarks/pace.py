"""Processor seconds that a photo of 18 megapixels takes, by stage, beside the least possible: docs/lab/speed.md.

python benchmarks/pace.py ROW OUT [--enlarge 4] [--options ...]     ROW as `pomona synth` writes it (images/, truth/)

Photos are those of a rendered row, enlarged, with noise and the EXIF of a camera of that size; OUT keeps them, and the
last survey. `pomona run` has a process of its own: its processor seconds are those of all its threads and of the
processes it starts, its memory the most that all of these held together, asked for ten times a second. The least is
what decoding each photo once, one pass of the network and one of feature extraction take, in the same sitting.
"""

import json
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from PIL import Image

from command_line import parser_of
from tables import table_head, table_row
from usage import Usage, used_by

T = TypeVar("T")
NOISE_SD, QUALITY = 3.0, 92
_PIXEL_TAGS = {0xA002: 0, 0xA003: 1}  # ExifImageWidth, ExifImageHeight: index of the upright size


def enlarged(row: Path, out: Path, times: int) -> Path:
    """The photos of the row, `times` as wide and as high; made where they are not there yet."""
    folder = out / f"photos-x{times}"
    folder.mkdir(parents=True, exist_ok=True)
    for i, path in enumerate(sorted((row / "images").glob("*.jpg"))):
        if not (folder / path.name).exists():
            enlarge(path, folder / path.name, times, np.random.default_rng(i))
    return folder


def enlarge(source: Path, target: Path, times: int, rng: np.random.Generator) -> None:
    with Image.open(source) as photo:
        exif, pixels = photo.getexif(), np.asarray(photo.convert("RGB"))
    size = pixels.shape[1] * times, pixels.shape[0] * times
    large = cv2.resize(pixels, size, interpolation=cv2.INTER_CUBIC).astype(np.int16)
    large += np.rint(rng.standard_normal(large.shape, np.float32) * NOISE_SD).astype(np.int16)
    details = exif.get_ifd(0x8769)
    details.update({tag: size[axis] for tag, axis in _PIXEL_TAGS.items()})
    part = target.with_suffix(".part")
    Image.fromarray(np.clip(large, 0, 255).astype(np.uint8)).save(part, "JPEG", quality=QUALITY, exif=exif)
    part.replace(target)


def floor(folder: str) -> dict[str, float]:
    """Processor seconds a photo of the three things that cannot be left out, each done once on one thread.

    The photo is decoded as large as the network or the features need it.
    """
    from pomona.progress import Silent
    from pomona.stages.capture import load_photos, read_pixels
    from pomona.stages.segment import SegmentOptions, load_segmenter, scales_of, segment_photo
    from pomona.stages.sfm.features import features_of
    from pomona.stages.sfm.options import SfmOptions

    photos, segmenter, sfm, options = load_photos([Path(folder)]), load_segmenter(None), SfmOptions(), SegmentOptions()
    scales = scales_of(photos, segmenter, options, Silent()).by_name
    spent = dict.fromkeys(("decoding", "network", "features"), 0.0)

    def timed(name: str, work: Callable[..., T], *given: object, **named: object) -> T:
        begun = time.process_time()
        result = work(*given, **named)
        spent[name] += time.process_time() - begun
        return result

    for photo in photos:
        longer_px = max(photo.width_px, photo.height_px)
        side_px = min(longer_px, round(scales[photo.name] * longer_px))
        large = timed("decoding", read_pixels, photo, max_side_px=max(sfm.max_side_px, side_px))
        timed("network", segment_photo, shrunk(large, side_px), segmenter, options=options)
        timed("features", features_of, shrunk(large, sfm.max_side_px), photo, sfm)
    return {name: seconds / len(photos) for name, seconds in spent.items()}


def shrunk(pixels: np.ndarray, side_px: int) -> np.ndarray:
    scale = side_px / max(pixels.shape[:2])
    size = round(pixels.shape[1] * scale), round(pixels.shape[0] * scale)
    return pixels if scale >= 1 else cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)


def table(survey: Path, usage: Usage, photos: int, least: dict[str, float]) -> list[str]:
    stages = json.loads((survey / "survey.json").read_text())["stages"]
    lines = [table_head("stage | processor s a photo | wall s a photo | peak MB")]
    for name, record in stages.items():
        each = f"{record['processor_s'] / photos:.2f}", f"{record['wall_s'] / photos:.2f}"
        lines.append(table_row([name, *each, f"{record['peak_memory_mb']:.0f}"]))
    rest_s = usage.processor_s - sum(record["processor_s"] for record in stages.values())
    rest_wall_s = usage.wall_s - sum(record["wall_s"] for record in stages.values())
    lines.append(table_row(["start, headers, digests", f"{rest_s / photos:.2f}", f"{rest_wall_s / photos:.2f}", ""]))
    every = f"**{usage.processor_s / photos:.2f}**", f"{usage.wall_s / photos:.2f}"
    lines.append(table_row(["**together**", *every, f"{usage.memory_mb:.0f}"]))
    together = sum(least.values())
    parts = ", ".join(f"{name} {seconds:.2f}" for name, seconds in least.items())
    share = 100 * together / (usage.processor_s / photos)
    return [*lines, "", f"Least possible: {together:.2f} s a photo ({parts}), {share:.0f} % of what was spent."]


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("row", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--enlarge", type=int, default=4)
    parser.add_argument("--no-floor", action="store_true")
    arguments, more = parser.parse_known_args()
    folder = enlarged(arguments.row, arguments.out, arguments.enlarge)
    photos = len(list(folder.glob("*.jpg")))
    survey = arguments.out / "survey"
    markers = arguments.row / "truth" / "markers.csv"
    given = ["--markers", str(markers)] if markers.is_file() else []
    command = [sys.executable, "-m", "pomona", "run", str(folder), "--out", str(survey), "--overwrite", *given, *more]
    usage = used_by(command)
    least: dict[str, float] = {}
    if not arguments.no_floor:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            least = pool.submit(floor, str(folder)).result()
    print("\n".join(table(survey, usage, photos, least)))


if __name__ == "__main__":
    main()
