"""Do intervals of the whole crop hold the true number? For docs/lab/yields.md.

python benchmarks/yields.py make OUT FIRST LAST          rows without pictures: true masks and cameras, seconds each
python benchmarks/yields.py trials ROW [ROW ...] [--joined-by truth]
python benchmarks/yields.py survey SURVEY TRUE_NUMBER    the crop of a finished survey, estimated again

A trial takes the true masks of a row, or some of them, joins, filters and measures them as `pomona run` does (of a row
without pictures without a second look and circles), and compares the interval with the true number of fruits in the
part of the row that photos look at: those that two photos of the trial at least have in the picture, whatever hangs in
front. Kinds of trials:

two       both sides, all masks that show 3 % of a fruit
half      both sides, every second photo
dropped   both sides; of masks that show little more are dropped (60 % of the hidden share, and 0 to 30 % by photo)
uneven    the same, and 30 % more on one side
one       one side
one-dropped   one side, masks dropped as in "dropped"
"""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from command_line import parser_of
from pomona.learning.synth import RowOptions, truth
from pomona.learning.synth.cameras import row_cameras
from pomona.learning.synth.layout import lay_out_row
from pomona.learning.synth.options import VARIETIES
from pomona.learning.synth.truth import RowFolder, read_cameras, read_fruits, read_mask
from pomona.stages.capture import load_photos
from pomona.stages.measure.allometry import STORY_APPLES
from pomona.stages.yields import YieldOptions, estimate_crop
from pomona.stages.yields.detectability import fit_detectability
from pomona.stages.yields.encounters import encounters_of
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import Fruits, Observations
from pomona.values.trees import Trees
from row_cases import METRES, Case, true_cameras
from tables import table_head, table_row

KINDS = ("two", "half", "dropped", "uneven", "one", "one-dropped")
LEAST_SHARE = 0.03


def row_options(number: int) -> RowOptions:
    """No two rows alike: trees, fruits, leaves (2500 to 12000 a tree), sizes, steps and distances."""
    rng = np.random.default_rng([number, 4711])
    return RowOptions(
        seed=52_000 + number, trees=int(rng.integers(2, 4)), fruits_per_tree=int(rng.integers(25, 90)),
        variety=list(VARIETIES)[number % 6], leaves_per_tree=int(np.exp(rng.uniform(np.log(2500), np.log(12000)))),
        spacing_m=float(rng.uniform(0.9, 1.3)), fruit_diameter_m=float(rng.uniform(0.066, 0.084)),
        fruit_diameter_sd_m=float(rng.uniform(0.004, 0.008)), rough=True, photos_per_side=13,
        step_m=float(rng.uniform(0.2, 0.3)), distance_m=float(rng.uniform(2.1, 2.9)), camera_height_m=1.6,
        width_px=480, height_px=720, markers=False,
    )  # fmt: skip


def make(number: int, out: Path) -> None:
    """Draw the masks alone: what is seen in each pixel, without light."""
    import moderngl

    from pomona.learning.synth.quick.gl import Painter, _column_major
    from pomona.learning.synth.quick.row import row_scene
    from pomona.learning.synth.quick.stage import _view

    options, folder, painter = row_options(number), RowFolder(out), Painter()
    folder.make()
    row, cameras, context = lay_out_row(options), row_cameras(options), painter._context
    scene = row_scene(row, [], options, photo_idx=0)
    buffers = context.buffer(scene.vertices.tobytes()), context.buffer(scene.triangles.tobytes())
    names = ("place", "normal", "colour", "material", "fruit")
    painter._drawn = context.vertex_array(painter._seen, [(buffers[0], "3f 3f 3f 1f 1f", *names)], buffers[1])
    for camera in cameras:
        view = _view(camera, 1)
        size = (view.width_px, view.height_px)
        layers = [context.texture(size, 4, dtype="f4") for _ in range(3)]
        frame = context.framebuffer(layers, context.depth_renderbuffer(size))
        frame.use()
        frame.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
        context.enable_only(moderngl.DEPTH_TEST)
        painter._seen["clip_from_world"].write(_column_major(view.clip_from_world))
        painter._seen["eye"].value = tuple(view.eye)
        painter._draw_part(np.eye(4), 0.0, 0, len(scene.triangles))
        ids = np.frombuffer(layers[0].read(), np.float32).reshape(*size[::-1], 4)[::-1, :, 3]
        truth.write_mask(folder.mask(camera.name), np.round(ids).astype(np.uint16))
    truth.write_cameras(folder.truth("cameras.json"), cameras)
    folder.options.write_text(json.dumps(asdict(options)))
    truth.write_fruits(folder.truth("fruits.csv"), row.fruits)


class TrueRow:
    """A row's masks with the share of its fruit that each shows, cameras, and true fruits."""

    def __init__(self, row: Path) -> None:
        folder, self.fruits = RowFolder(row), read_fruits(RowFolder(row).truth("fruits.csv"))
        stands = read_cameras(folder.truth("cameras.json"))
        self.photos = load_photos([row / "images"]) if any((row / "images").glob("*")) else None
        names = {Path(photo.name).stem: photo.name for photo in self.photos or ()}
        self.cameras = true_cameras(folder, [names.get(c.name, c.name) for c in stands], METRES)
        n, p = len(self.fruits.ids), len(stands)
        self.shares, self.in_picture, self.masks = np.zeros((n, p)), np.zeros((n, p), bool), {}
        for j, camera in enumerate(stands):
            ids = read_mask(folder.mask(camera.name))
            xy_px, depths = self.cameras.project(j, self.fruits.centres_in_world)
            discs_px = np.pi * (self.fruits.diameters_m / 2 * camera.focal_px / depths) ** 2
            self.in_picture[:, j] = ((xy_px > 0) & (xy_px < [camera.width_px, camera.height_px])).all(axis=1)
            for i in np.unique(ids[(ids > 0) & (ids <= n)]).tolist():
                mask = Mask.from_pixels(ids == i)
                self.masks[i - 1, j] = mask
                self.shares[i - 1, j] = min(mask.area_px / discs_px[i - 1], 1.0)

    def trial(self, kind: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Which masks (n, p) and which photos (p,) a trial has."""
        rng, p = np.random.default_rng([seed, KINDS.index(kind)]), len(self.cameras)
        east = np.array([name.startswith("east") for name in self.cameras.photos])
        photos = east if kind.startswith("one") else np.ones(p, bool)
        if kind == "half":
            photos = np.arange(p) % 2 == seed % 2
        dropped = np.zeros(self.shares.shape)
        if kind in ("dropped", "uneven", "one-dropped"):
            dropped = 0.6 * (1 - self.shares) + rng.uniform(0, 0.3, p)
        if kind == "uneven":
            dropped = dropped + 0.3 * east
        return (self.shares >= LEAST_SHARE) & photos & (rng.random(self.shares.shape) >= dropped), photos


def joined(row: TrueRow, kept: np.ndarray, cameras: Cameras) -> tuple[Fruits, Observations, np.ndarray]:
    found, first = {}, 1
    for j, name in enumerate(row.cameras.photos):
        lens = row.cameras.intrinsics_of(j)
        masks = tuple(row.masks[i, j] for i in np.flatnonzero(kept[:, j]).tolist())
        ids = np.arange(first, first + len(masks))
        first += len(masks)
        found[name] = Detections(name, lens.width_px, lens.height_px, masks, np.ones(len(masks)), ids)
    case = Case(row.photos, cameras, SurveyDetections({name: found[name] for name in cameras.photos}))
    candidates = case.associated()
    if row.photos is not None:
        candidates = case.looked_again(candidates)
    measured = case.measured(candidates)
    return measured.fruits, measured.observations, candidates.fruits.views


def joined_by_truth(row: TrueRow, kept: np.ndarray) -> tuple[Fruits, Observations, None]:
    true = row.fruits
    mine = kept.sum(axis=1) >= 2
    fruits = Fruits(
        true.ids[mine], true.centres_in_world[mine], true.diameters_m[mine], np.ones(mine.sum()), kept.sum(axis=1)[mine]
    )
    at = [(int(true.ids[i]), row.cameras.photos[j]) for i, j in zip(*np.nonzero(kept & mine[:, None]), strict=True)]
    numbers = np.arange(len(at))
    seen = Observations(np.array([i for i, _ in at]), tuple(name for _, name in at), numbers, np.zeros((len(at), 2)))
    return fruits, seen, None


def trials(rows: list[Path], by_truth: bool, kinds: list[str]) -> None:
    print(table_head("row | trial | true | of these two photos look at | found | estimate | 95 % | width | covers"))
    results: dict[str, list[tuple[bool, float, float, bool]]] = {kind: [] for kind in kinds}
    for path in rows:
        row = TrueRow(path)
        for kind in kinds:
            kept, photos = row.trial(kind, seed=sum(path.name.encode()))
            cameras = row.cameras.of_photos([row.cameras.photos[j] for j in np.flatnonzero(photos)])
            fruits, seen, views = joined_by_truth(row, kept) if by_truth else joined(row, kept, cameras)
            crop = estimate_crop(fruits, seen, cameras, Trees.empty(), STORY_APPLES, candidate_views=views).crop
            if crop is None:
                continue
            true = int((((row.in_picture | (row.shares >= LEAST_SHARE)) & photos).sum(axis=1) >= 2).sum())
            every = crop.fruits
            covers, width = every.low <= true <= every.high, (every.high - every.low) / true
            results[kind].append((covers, width, every.value / true, every.low <= len(kept) <= every.high))
            figures = f"{every.value:.0f}", f"{every.low:.0f} to {every.high:.0f}", f"{100 * width:.0f} %"
            print(table_row([path.name, kind, len(kept), true, len(fruits), *figures, covers]), flush=True)
    titles = "trials | rows | covered | covered, of all | width, mean | width, largest | estimate / true, mean, sd"
    print("\n" + table_head(titles))
    for kind, each in results.items():
        if each:
            covers, widths, ratios, of_all = np.array(each, float).T
            shares = (f"{100 * x:.0f} %" for x in (covers.mean(), of_all.mean(), widths.mean(), widths.max()))
            print(table_row([kind, len(each), *shares, f"{ratios.mean():.3f}, {ratios.std():.3f}"]))


def survey(folder: Path, true: int) -> None:
    import pomona

    found = pomona.open(folder)
    views = None if found.before_filter is None else found.before_filter[0].views
    values = found.fruits, found.observations, found.cameras
    encounters = encounters_of(*values, views)
    crop = estimate_crop(*values, found.trees, STORY_APPLES, candidate_views=views).crop
    print(f"{folder.name}: {len(found.fruits)} found, {true} true, kept {encounters.kept.round(2)}")
    print("parameters", fit_detectability(encounters, YieldOptions().most_fitted).parameters.round(2))
    print(crop)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("what", choices=("make", "trials", "survey"))
    parser.add_argument("arguments", nargs="+")
    parser.add_argument("--joined-by", choices=("pomona", "truth"), default="pomona")
    parser.add_argument("--kinds", default=",".join(KINDS))
    chosen = parser.parse_args()
    if chosen.what == "make":
        out, first, last = chosen.arguments
        for number in range(int(first), int(last) + 1):
            folder = Path(out) / f"y{number:02d}"
            if not (folder / "truth" / "fruits.csv").is_file():
                make(number, folder)
                print(folder, flush=True)
    elif chosen.what == "survey":
        survey(Path(chosen.arguments[0]), int(chosen.arguments[1]))
    else:
        trials([Path(row) for row in chosen.arguments], chosen.joined_by == "truth", chosen.kinds.split(","))


if __name__ == "__main__":
    main()
