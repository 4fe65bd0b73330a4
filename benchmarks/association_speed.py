"""How time and memory of the association grow with the length of the row, for docs/lab/benchmarks.md.

python benchmarks/association_speed.py [PHOTOS ...]      by default 75 150 300 600

A row made of numbers alone: photos 0.2 m apart and 2.5 m from the trees, on each about 60 fruits whose masks are discs
of which leaves cut off a part. Each length runs in a process of its own, on one
core; masks are made before the clock starts. What other programs do at the same time is in the seconds, and little of
it in those of the processor.
"""

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from command_line import parser_of
from pomona.stages.fuse.object import fuse
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.intrinsics import Intrinsics
from tables import table_head, table_row
from usage import peak_mb

STEP_M, DISTANCE_M, DIAMETER_M = 0.2, 2.5, 0.075
WIDTH_PX, HEIGHT_PX, FOCAL_PX = 800, 1200, 1200.0
FRUITS_A_METRE = 36.0
SEEN = 0.9  # share of the sightings that leaves leave


def row(photos: int, rng: np.random.Generator) -> tuple[Cameras, SurveyDetections, int]:
    rotation = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    eyes = np.stack([STEP_M * np.arange(photos), np.full(photos, -DISTANCE_M), np.full(photos, 1.5)], 1)
    poses = np.concatenate([np.tile(rotation, (photos, 1, 1)), -(eyes @ rotation.T)[:, :, None]], 2)
    intrinsics = Intrinsics("SIMPLE_PINHOLE", WIDTH_PX, HEIGHT_PX, np.array([FOCAL_PX, WIDTH_PX / 2, HEIGHT_PX / 2]))
    frame = WorldFrame("markers", approximate=False, up_is_known=True)
    names = tuple(f"{i:04d}.jpg" for i in range(photos))
    cameras = Cameras(names, (intrinsics,), np.zeros(photos, np.int64), poses, frame=frame)
    length_m = STEP_M * photos
    fruits = rng.uniform((-0.5, -0.3, 0.4), (length_m + 0.5, 0.3, 2.6), (round(FRUITS_A_METRE * length_m), 3))
    by_photo, first = {}, 1
    for i, name in enumerate(names):
        near = np.flatnonzero(np.abs(fruits[:, 0] - eyes[i, 0]) < 1.2)
        xy_px, depths_m = cameras.project(i, fruits[near])
        radii_px = FOCAL_PX * DIAMETER_M / 2 / depths_m
        inside = (xy_px > radii_px[:, None] + 1).all(1) & (xy_px < [WIDTH_PX, HEIGHT_PX] - radii_px[:, None] - 1).all(1)
        inside &= rng.random(len(near)) < SEEN
        masks = tuple(
            disc(*xy_px[k], float(radii_px[k]), np.random.default_rng(int(near[k]))) for k in np.flatnonzero(inside)
        )
        by_photo[name] = Detections(
            name, WIDTH_PX, HEIGHT_PX, masks, np.full(len(masks), 0.8), first + np.arange(len(masks))
        )
        first += len(masks)
    return cameras, SurveyDetections(by_photo), len(fruits)


def disc(x: float, y: float, radius: float, rng: np.random.Generator) -> Mask:
    """A disc of which the same side is cut off in every photo."""
    left, top, size = int(x - radius), int(y - radius), int(2 * radius) + 2
    columns, rows = np.meshgrid(np.arange(size) + left + 0.5 - x, np.arange(size) + top + 0.5 - y)
    way = rng.uniform(0, 2 * np.pi)
    kept = columns * np.cos(way) + rows * np.sin(way) < radius * rng.uniform(0.0, 1.5)
    return Mask.from_pixels((columns**2 + rows**2 < radius**2) & kept, left, top)


def measured(photos: int) -> str:
    cameras, detections, fruits = row(photos, np.random.default_rng(photos))
    before_mb = peak_mb()
    begun, used = time.monotonic(), time.process_time()
    fused = fuse(detections, cameras)
    seconds, used = time.monotonic() - begun, time.process_time() - used
    spent = f"{seconds:.1f}", f"{used:.1f}", f"{1000 * used / photos:.0f}"
    memory = f"{peak_mb():.0f} ({before_mb:.0f} before)"
    return table_row([photos, detections.total, fruits, len(fused.fruits), *spent, memory])


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("photos", type=int, nargs="*", default=[75, 150, 300, 600])
    args = parser.parse_args()
    print(table_head("photos | detections | fruits | found | seconds | of processor | of that ms a photo | peak MB"))
    for photos in args.photos:
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
            print(pool.submit(measured, photos).result(), flush=True)


if __name__ == "__main__":
    main()
