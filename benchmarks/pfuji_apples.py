"""Fruits in the union cloud of 215 real apples, by spheres and by the paper's clustering, for docs/lab/cloud-method.md.

python benchmarks/pfuji_apples.py [FOLDER] [--worse]

FOLDER holds one .npz (`xyz`, metres) an apple, all in one frame (default: ../shared/data/pfuji-apples). The union is
taken as it is: its apples are of neighbouring trees in one photogrammetric model, and their clouds do not lie in each
other (in 0.3 % of points any of the twelve nearest is another apple's).

An apple is found as a `single` fruit where one found fruit holds more than half of the apple's points, and more than
half of that fruit's points are the apple's: this is one to one. Else it is `merged`, where more than half of its points
are in one fruit (most of which is not its), `split`, where more than half are in fruits, but in no single one, or
`missed`. A found fruit that is no apple's single one is a `piece`, where more than half of it is one apple's, or
`mixed`.
`doubled` are apples with two or more found fruits that are mostly theirs, single or not.

Centres and diameters are compared with the spheres that fit apples alone best (no tie to a usual size), where these are
clear: points all around at least 40 % of the sphere, and half of them within 3 mm of it.

--worse repeats the search by spheres in turned, thinned, noisy and strewn versions of the cloud, and from other sizes.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from command_line import DATA, parser_of
from pomona.basics.arrays import FloatArray, IntArray
from pomona.stages.fuse.cloud import CloudOptions, fruits_of_cloud
from pomona.stages.fuse.paper import PaperOptions
from pomona.stages.fuse.paper.clustering import connected_groups, split_in_two
from pomona.values.fruits import FruitCloud
from tables import table_head, table_row

BEST_EPS_M = (0.003, 0.005, 0.006, 0.007, 0.008, 0.01, 0.012, 0.015, 0.02)


@dataclass(frozen=True, eq=False)
class Apples:
    """Points (n, 3) of all apples together, and whose each is (n,): −1 for none's."""

    points: FloatArray
    apple: IntArray

    @property
    def count(self) -> int:
        return int(self.apple.max()) + 1


@dataclass(frozen=True, eq=False)
class Found:
    """Which fruit each point is of (n,), 0 for none; and spheres, where the method has them: centre and diameter."""

    fruit_id: IntArray
    spheres: FloatArray | None
    seconds: float


@dataclass(frozen=True)
class Score:
    apples: int
    found: int
    single: int
    merged: int
    split: int
    doubled: int
    pieces: int
    mixed: int
    partner: IntArray  # (apples,) id of the single fruit, 0 for none

    @property
    def missed(self) -> int:
        return self.apples - self.single - self.merged - self.split

    @property
    def share(self) -> float:
        return self.single / self.apples


def read(folder: Path) -> Apples:
    files = sorted(folder.glob("*.npz"))
    parts = [np.load(file)["xyz"].astype(np.float64) for file in files]
    return Apples(np.concatenate(parts), np.repeat(np.arange(len(parts)), [len(part) for part in parts]))


def by_spheres(points: FloatArray, options: CloudOptions | None = None) -> Found:
    cloud = FruitCloud(points, np.zeros((len(points), 3), np.uint8), np.zeros(len(points), np.int64))
    begun = time.monotonic()
    fused = fruits_of_cloud(cloud, options=options)
    seconds = time.monotonic() - begun
    spheres = np.c_[fused.fruits.centers_in_world, fused.fruits.diameters_m]
    return Found(fused.cloud.fruit_id, spheres, seconds)


def by_groups(points: FloatArray, options: PaperOptions) -> Found:
    """One mask that shows all: each connected group is a fruit. The published code splits large ones, once, in two."""
    begun = time.monotonic()
    groups = connected_groups(points, eps_m=options.eps_m, min_points=options.dbscan_min_points)
    counts = np.bincount(groups + 1)[1:]
    fruit_id, last = np.zeros(len(points), np.int64), 0
    order = np.argsort(groups, kind="stable")[(groups < 0).sum() :]
    for members in np.split(order, np.cumsum(counts)[:-1]):
        if len(members) < options.min_points:
            continue
        large = options.split_above_points is not None and len(members) > options.split_above_points
        half = split_in_two(points[members]) if large else np.zeros(len(members), np.int64)
        fruit_id[members] = last + 1 + half
        last += 2 if large else 1
    return Found(fruit_id, None, time.monotonic() - begun)


def score(apples: Apples, fruit_id: IntArray) -> Score:
    fruits = int(fruit_id.max(initial=0)) + 1
    known = apples.apple >= 0
    shared = np.bincount(apples.apple[known] * fruits + fruit_id[known], minlength=apples.count * fruits)
    shared = shared.reshape(apples.count, fruits)
    whole, size = shared.sum(1), np.bincount(fruit_id, minlength=fruits)
    inside, own = shared[:, 1:], 2 * shared[:, 1:] > size[1:]
    holds = 2 * inside > whole[:, None]
    single = holds & own
    is_single = single.any(1)
    merged = holds.any(1) & ~is_single
    split = (2 * inside.sum(1) > whole) & ~is_single & ~merged
    present = size[1:] > 0
    pieces = own.any(0) & ~single.any(0)
    mixed = present & ~own.any(0)
    partner = np.where(is_single, single.argmax(1) + 1, 0) if fruits > 1 else np.zeros(apples.count, np.int64)
    return Score(
        apples.count, int(present.sum()), int(is_single.sum()), int(merged.sum()), int(split.sum()),
        int((own.sum(1) > 1).sum()), int(pieces.sum()), int(mixed.sum()), partner,
    )  # fmt: skip


def own_spheres(apples: Apples) -> FloatArray:
    """Centre and diameter (apples, 4) of the sphere that fits each apple alone; NaN where it is not clear."""
    k = np.arange(200) + 0.5
    ring, turn = np.sqrt(1 - (1 - k / 100) ** 2), np.pi * (1 + 5**0.5) * k
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), 1 - k / 100], axis=1)
    result = np.full((apples.count, 4), np.nan)
    for apple in range(apples.count):
        points = apples.points[apples.apple == apple]

        def off(sphere: FloatArray, points: FloatArray = points) -> FloatArray:
            return np.linalg.norm(points - sphere[:3], axis=1) - sphere[3]

        start = np.append(np.median(points, axis=0), 0.04)
        sphere = least_squares(off, start, loss="cauchy", f_scale=0.003).x
        near = np.abs(off(sphere)) < 0.003
        if near.mean() < 0.5:
            continue
        outward = (points[near] - sphere[:3]) / np.linalg.norm(points[near] - sphere[:3], axis=1, keepdims=True)
        covered = cKDTree(outward).query(directions)[0] < 2 * np.sin(np.deg2rad(15) / 2)
        if covered.mean() >= 0.4:
            result[apple] = [*sphere[:3], 2 * sphere[3]]
    return result


def row(name: str, found: Found, apples: Apples, own: FloatArray) -> str:
    result = score(apples, found.fruit_id)
    errors = ["", ""]
    if found.spheres is not None:
        both = (result.partner > 0) & np.isfinite(own[:, 0])
        mine = found.spheres[result.partner[both] - 1]
        center = 1000 * np.linalg.norm(mine[:, :3] - own[both, :3], axis=1)
        diameter = 1000 * (mine[:, 3] - own[both, 3])
        errors = [
            f"{np.median(center):.1f} mm, {np.percentile(center, 95):.1f} mm (of {both.sum()})",
            f"{diameter.mean():+.1f} ± {diameter.std():.1f} mm",
        ]
    cells = [
        name, result.found, f"{result.single} ({100 * result.share:.1f} %)", result.merged, result.split,
        result.missed, result.doubled, result.pieces, result.mixed, *errors, f"{found.seconds:.1f} s",
    ]  # fmt: skip
    return table_row(cells)


def compared(apples: Apples) -> Iterator[str]:
    own, per_apple = own_spheres(apples), int(np.median(np.bincount(apples.apple)))
    printed, code = PaperOptions.as_printed(), PaperOptions.as_published_code()
    yield table_head(
        "method | found | single | merged | split | missed | doubled | pieces | mixed | centre: median, 95 % | "
        "diameter | time"
    )
    yield row("`fuse.cloud`", by_spheres(apples.points), apples, own)
    yield row("`paper`, as printed: DBSCAN, 30 mm", by_groups(apples.points, printed), apples, own)
    yield row("`paper`, as in its code: and 4000 points", by_groups(apples.points, code), apples, own)
    twice = replace(code, split_above_points=2 * per_apple)
    yield row(f"the same, {2 * per_apple} points (two apples here)", by_groups(apples.points, twice), apples, own)
    tried = {eps: by_groups(apples.points, replace(printed, eps_m=eps)) for eps in BEST_EPS_M}
    best = max(tried, key=lambda eps: score(apples, tried[eps].fruit_id).single)
    yield row(f"DBSCAN, {1000 * best:.0f} mm: the best of {len(tried)} for this truth", tried[best], apples, own)


def worse(apples: Apples) -> Iterator[str]:
    yield table_head("the cloud, or the search | found | single | pieces and mixed | time")
    for name, changed, options in _worse_clouds(apples):
        found = by_spheres(changed.points, options)
        result = score(changed, found.fruit_id)
        single = f"{100 * result.share:.1f} %"
        yield table_row([name, result.found, single, result.pieces + result.mixed, f"{found.seconds:.1f} s"])


def _worse_clouds(apples: Apples) -> Iterator[tuple[str, Apples, CloudOptions]]:
    rng, usual = np.random.default_rng(0), CloudOptions()
    points, n = apples.points, len(apples.points)
    for number in range(4):
        yield (
            f"turned ({number + 1})",
            Apples(points @ Rotation.random(random_state=number).as_matrix().T, apples.apple),
            usual,
        )
    for part in (4, 16, 64):
        kept = rng.random(n) < 1 / part
        yield f"one point in {part}", Apples(points[kept], np.unique(apples.apple[kept], return_inverse=True)[1]), usual
    for share in (0.02, 0.05):
        moved = points + rng.normal(0, share * 0.08 / np.sqrt(3), points.shape)
        yield f"noise of {100 * share:.0f} % of a diameter", Apples(moved, apples.apple), usual
    strays = rng.uniform(points.min(0), points.max(0), (n * 3 // 100, 3))
    strewn = Apples(np.concatenate([points, strays]), np.append(apples.apple, np.full(len(strays), -1)))
    yield "3 % stray points", strewn, usual
    for diameter_m in (0.065, 0.09):
        yield f"begun at {1000 * diameter_m:.0f} mm", apples, CloudOptions(fruit_diameter_m=diameter_m)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=DATA / "pfuji-apples")
    parser.add_argument("--worse", action="store_true")
    arguments = parser.parse_args()
    apples = read(arguments.folder)
    table: Callable[[Apples], Iterator[str]] = worse if arguments.worse else compared
    for line in table(apples):
        print(line, flush=True)


if __name__ == "__main__":
    main()
