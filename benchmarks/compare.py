"""How many matches of two surveys of a row are right: rows grown and thinned by the generator, in any frames.

python benchmarks/compare.py laid-out [--rows N] [--bend] [--unlike] # found fruits drawn from the truth, no pictures
python benchmarks/compare.py surveys A B --rows ROW_A ROW_B # two surveys of rendered rows, with their truth
python benchmarks/compare.py strangers [--rows N] # two different rows: none may be laid over the other

Each pair is compared as it is, with the first survey turned and shifted, and with it scaled, too (then the comparison
does not know that both are in metres). `right` is the share of matches whose fruits are the same true fruit; matches of
a false fruit count as wrong. `of those in both` is how many of the true fruits that both found are matched.
"""

import dataclasses
import time
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from command_line import parser_of
from pomona.basics.geometry import Similarity
from pomona.change.matching import Overlay, lay_over
from pomona.evaluate.fruits import read_truth
from pomona.evaluate.fruits.scores import match
from pomona.learning.synth.layout import lay_out_row
from pomona.learning.synth.options import RowOptions
from pomona.survey import SurveyFolder
from pomona.survey.reader import SurveyReader

FRAMES = ("as it is", "turned", "scaled")


@dataclasses.dataclass
class Found:
    """Centres (n, 3), the true fruit of each (negative: none), and a usual diameter; `hanging` are all true fruits."""

    centers: np.ndarray
    ids: np.ndarray
    diameter: float
    hanging: set[int]


def drawn(options: RowOptions, rng: np.random.Generator, share: float, noise_m: np.ndarray) -> Found:
    """A share of a row's fruits, a little off, and a few false ones."""
    row = lay_out_row(options).fruits
    seen = rng.random(len(row.ids)) < share
    centers = row.centres_in_world[seen] + rng.normal(0, 1, (seen.sum(), 3)) * noise_m
    false = rng.uniform(centers.min(0), centers.max(0), (round(0.05 * seen.sum()), 3))
    ids = np.concatenate([row.ids[seen], -1 - np.arange(len(false))])
    return Found(np.concatenate([centers, false]), ids, float(np.median(row.diameters_m[seen])), set(row.ids.tolist()))


def laid_out(seed: int, bend: bool, unlike: bool) -> tuple[Found, Found]:
    rng = np.random.default_rng(seed)
    base = RowOptions(seed=seed, trees=int(rng.integers(2, 8)), fruits_per_tree=int(rng.integers(15, 71)),
                      leaves_per_tree=0, fruit_diameter_m=0.06)  # fmt: skip
    grow = rng.uniform(0, 0.02)
    late = dataclasses.replace(base, days_later=30, grow_m=grow, grow_sd_m=0.15 * grow, drop_share=rng.uniform(0, 0.5))
    noise_m = np.array([0.004, 0.009, 0.004]) * rng.uniform(0.5, 1.5)
    shares = rng.uniform(0.6, 0.95, 2)
    before = drawn(base, rng, shares[0], noise_m)
    after = drawn(late, rng, shares[int(unlike)], noise_m)
    if bend:  # a bow, and branches that sag, each as the ones around it
        x = after.centers[:, 0] - after.centers[:, 0].mean()
        after.centers[:, 1] += rng.uniform(-0.012, 0.012) * x**2
        after.centers[:, 2] -= 0.02 * (1 + np.sin(5 * x + rng.uniform(0, 6)) * np.cos(3 * after.centers[:, 2]))
    return before, after


def of_survey(folder: Path, row: Path) -> Found:
    survey = SurveyReader(SurveyFolder.open(folder))
    truth = read_truth(row / "truth" / "fruits.csv")
    true = match(survey.fruits, truth)
    ids = np.where(true >= 0, truth.ids[true], -survey.fruits.ids)
    sizes = survey.fruits.diameters_m
    hanging = set(truth.ids.tolist())
    return Found(survey.fruits.centers_in_world, ids, float(np.nanmedian(sizes)), hanging)


def overlay_of(before: Found, after: Found, frame: str, seed: int) -> Overlay | None:
    rng = np.random.default_rng([seed, 7])
    scale = rng.uniform(0.2, 5) if frame == "scaled" else 1.0
    turn = Rotation.random(random_state=seed).as_matrix() if frame != "as it is" else np.eye(3)
    moved = Similarity(scale, turn, rng.normal(0, 10, 3) if frame != "as it is" else np.zeros(3))
    return lay_over(
        moved.apply(before.centers), after.centers, (scale * before.diameter, after.diameter),
        rigid=frame != "scaled", same_frame=frame == "as it is",
    )  # fmt: skip


def compare(before: Found, after: Found, frame: str, seed: int) -> dict[str, float]:
    start = time.perf_counter()
    overlay = overlay_of(before, after, frame, seed)
    seconds = time.perf_counter() - start
    both = len({i for i in before.ids.tolist() if i > 0} & set(after.ids.tolist()))
    if overlay is None:
        return {"right": np.nan, "both": 0.0, "s": seconds, "gone": np.nan}
    one, other = before.ids[overlay.pairs[:, 0]], after.ids[overlay.pairs[:, 1]]
    right = (one == other) & (one > 0)
    gone, new = len(before.ids) - len(overlay.pairs), len(after.ids) - len(overlay.pairs)
    truly = sum(i > 0 and i not in after.hanging for i in before.ids.tolist())
    half = 1.96 * np.sqrt(2 * new + 1)
    covered = gone - new - half <= truly <= gone - new + half
    return {"right": right.mean(), "both": right.sum() / both, "s": seconds, "gone": float(covered),
            "matches": len(right)}  # fmt: skip


def tell(name: str, results: list[dict[str, float]]) -> None:
    done = [r for r in results if np.isfinite(r["right"])]
    right = np.array([r["right"] for r in done] or [np.nan])
    both = np.array([r["both"] for r in results])
    print(
        f"{name:9} {len(done)} of {len(results)} laid over; right: mean {right.mean():.3f}, worst {right.min():.3f}; "
        f"of those in both: mean {both.mean():.3f}, worst {both.min():.3f}; really gone within its interval: "
        f"{np.mean([r['gone'] for r in done] or [np.nan]):.2f}; median {np.median([r['s'] for r in results]):.1f} s",
        flush=True,
    )


def main() -> None:
    parser = parser_of(__doc__)
    kinds = parser.add_subparsers(dest="kind", required=True)
    for kind in ("laid-out", "strangers"):
        part = kinds.add_parser(kind)
        part.add_argument("--rows", type=int, default=100)
        part.add_argument("--bend", action="store_true", help="the later survey is bent, and branches sag")
        part.add_argument("--unlike", action="store_true", help="the two surveys find different shares of the fruits")
    part = kinds.add_parser("surveys")
    part.add_argument("surveys", type=Path, nargs=2)
    part.add_argument("--rows", type=Path, nargs=2, required=True)
    arguments = parser.parse_args()
    if arguments.kind == "surveys":
        before, after = map(of_survey, arguments.surveys, arguments.rows)
        for frame in FRAMES:
            tell(frame, [compare(before, after, frame, seed) for seed in range(5 if frame != "as it is" else 1)])
        return
    strangers = arguments.kind == "strangers"
    for frame in FRAMES:
        results = []
        for seed in range(arguments.rows):
            before, after = laid_out(seed, arguments.bend, arguments.unlike)
            if strangers:
                after = laid_out(seed + 10_000, arguments.bend, arguments.unlike)[1]
            results.append(compare(before, after, frame, seed))
        if strangers:
            print(f"{frame}: {sum(np.isfinite(r['right']) for r in results)} of {len(results)} laid over", flush=True)
        else:
            tell(frame, results)


if __name__ == "__main__":
    main()
