"""Calliper diameters of spheroids whose shape is known, for docs/lab/sizes.md.

python benchmarks/calipers.py [--fruits N] [--seed S]

Surveys of spheroids of one height-to-width ratio each (give or take 3 %), 60 to 90 mm wide, leaning by 0.2 rad, 2.5 m
from 6 to 20 cameras along one side or both, some 40 px wide. Their exact outlines are drawn as masks, of which two in
three lose what lies beyond a random straight edge, up to 60 % of their width. A person's prior (apples: 0.97) is the
same for all.
"""

import cv2
import numpy as np

from command_line import parser_of
from pomona.stages.fuse import Fused
from pomona.stages.measure import measure
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.intrinsics import Intrinsics
from tables import table_head, table_row

WIDTH_PX, HEIGHT_PX, FOCAL_PX = 1400, 1400, 1350.0


def cameras_of(count: int, both_sides: bool) -> Cameras:
    poses = []
    for i in range(count):
        y = 2.5 if both_sides and i % 2 else -2.5
        x = (i / max(count - 1, 1) - 0.5) * 2.4
        forward = np.array([0, -np.sign(y), 0.0])
        right = np.array([forward[1], -forward[0], 0.0])
        rotation = np.array([right, [0.0, 0, -1], forward])
        poses.append(np.column_stack([rotation, -rotation @ [x, y, 1.5]]))
    lens = Intrinsics("SIMPLE_PINHOLE", WIDTH_PX, HEIGHT_PX, np.array([FOCAL_PX, WIDTH_PX / 2, HEIGHT_PX / 2]))
    frame = WorldFrame(scale_source="markers", approximate=False, up_is_known=True)
    return Cameras(
        tuple(f"{i:02}.jpg" for i in range(count)), (lens,), np.zeros(count, int), np.array(poses), frame=frame
    )


def spheroid_pixels(
    cameras: Cameras, photo_idx: int, center: np.ndarray, radius: float, ratio: float, axis: np.ndarray
) -> tuple[np.ndarray, int, int]:
    """The pixels whose rays meet the spheroid, and where they lie in the photo."""
    at, depth = cameras.project(photo_idx, center[None])
    reach = int(FOCAL_PX * radius * max(ratio, 1) / depth[0]) + 4
    x0, y0 = (int(v) - reach for v in at[0])
    rows, columns = np.mgrid[y0 : y0 + 2 * reach, x0 : x0 + 2 * reach]
    rays = cameras.rays_in_world(photo_idx, np.column_stack([columns.ravel(), rows.ravel()]) + 0.5)
    stretch = np.eye(3) + (1 / ratio - 1) * np.outer(axis, axis)
    rays = rays @ stretch
    to_center = stretch @ (center - cameras.centers_in_world[photo_idx])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    off = np.linalg.norm(to_center - (rays @ to_center)[:, None] * rays, axis=1)
    return (off < radius).reshape(rows.shape), x0, y0


def hidden(pixels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The pixels less what lies beyond a straight edge."""
    rows, columns = np.nonzero(pixels)
    turn = rng.uniform(0, 2 * np.pi)
    along = np.cos(turn) * columns + np.sin(turn) * rows
    kept = along > along.min() + rng.uniform(0, 0.6) * np.ptp(along)
    result = np.zeros_like(pixels)
    result[rows[kept], columns[kept]] = True
    largest = cv2.connectedComponentsWithStats(result.astype(np.uint8))
    return np.asarray(largest[1] == 1 + int(np.argmax(largest[2][1:, cv2.CC_STAT_AREA])))


def survey(
    ratio: float, count: int, both_sides: bool, fruits: int, rng: np.random.Generator
) -> tuple[Fused, SurveyDetections, Cameras, np.ndarray]:
    cameras = cameras_of(count, both_sides)
    diameters = rng.uniform(0.06, 0.09, fruits)
    centers = np.column_stack([rng.uniform(-0.9, 0.9, fruits), rng.normal(0, 0.2, fruits), rng.uniform(1, 2, fruits)])
    masks: list[list[Mask]] = [[] for _ in range(count)]
    ids: list[list[int]] = [[] for _ in range(count)]
    seen = []
    for k in range(fruits):
        axis = np.array([*rng.normal(0, 0.2, 2), 1.0])
        axis /= np.linalg.norm(axis)
        own_ratio = ratio * rng.normal(1, 0.03)
        for i in range(count):
            pixels, x0, y0 = spheroid_pixels(cameras, i, centers[k], diameters[k] / 2, own_ratio, axis)
            if x0 < 0 or y0 < 0 or x0 + pixels.shape[1] > WIDTH_PX or y0 + pixels.shape[0] > HEIGHT_PX:
                continue
            if rng.random() < 2 / 3:
                pixels = hidden(pixels, rng)
            masks[i].append(Mask.from_pixels(pixels, x0, y0))
            ids[i].append(1000 * (i + 1) + k)
            seen.append((k + 1, cameras.photos[i], ids[i][-1]))
    found = {
        name: Detections(name, WIDTH_PX, HEIGHT_PX, tuple(m), np.ones(len(m)), np.array(n, int))
        for name, m, n in zip(cameras.photos, masks, ids, strict=True)
    }
    numbers = np.array([s[0] for s in seen])
    fused = Fused(
        Fruits(np.arange(1, fruits + 1), centers + rng.normal(0, 0.008, (fruits, 3)), np.full(fruits, 0.07),
               np.ones(fruits), np.bincount(numbers, minlength=fruits + 1)[1:]),
        Observations(numbers, tuple(s[1] for s in seen), np.array([s[2] for s in seen]), np.zeros((len(seen), 2))),
        FruitCloud.empty(),
    )  # fmt: skip
    return fused, SurveyDetections(found), cameras, diameters


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--fruits", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    titles = "height / width | photos | measured | bias, mm | MAE, mm | worst, mm | within one sd | ratio found"
    print(table_head(titles))
    for ratio in (0.75, 0.85, 0.95, 1.0, 1.1):
        for count, both_sides in ((6, False), (12, True), (20, True)):
            rng = np.random.default_rng([arguments.seed, int(100 * ratio), count])
            fused, detections, cameras, diameters = survey(ratio, count, both_sides, arguments.fruits, rng)
            fruits = measure(fused, detections, cameras)
            off_mm = 1000 * (fruits.diameters_m - diameters)
            known = np.isfinite(off_mm)
            within = np.abs(off_mm[known]) < 1000 * fruits.diameter_sds_m[known]
            found = np.nanmedian(fruits.heights_m / fruits.diameters_m)
            off_mm = off_mm[known]
            cells = [
                ratio, f"{count}, {'both sides' if both_sides else 'one side'}", f"{known.sum()} of {len(known)}",
                f"{off_mm.mean():+.2f}", f"{np.abs(off_mm).mean():.2f}", f"{np.abs(off_mm).max():.1f}",
                f"{100 * within.mean():.0f} %", f"{found:.2f}",
            ]  # fmt: skip
            print(table_row(cells), flush=True)


if __name__ == "__main__":
    main()
