"""All fruit, hidden ones too: estimated from how often the found ones were seen, with intervals that hold the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pomona.basics.row_line import row_line
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.tables import read_segments, read_trees, write_segments, write_trees
from pomona.progress import Silent
from pomona.stages.measure.allometry import STORY_APPLES, weigh
from pomona.stages.planting import on_trees
from pomona.stages.planting.summary import trees_of
from pomona.stages.yields import Estimate, HandCounts, YieldOptions, estimate_crop, read_hand_counts
from pomona.stages.yields.detectability import Detectability
from pomona.stages.yields.encounters import encounters_of, kept_shares
from pomona.stages.yields.estimate import _Draws, _segments
from pomona.stages.yields.hand_counts import Calibration, OnTrees, calibration, known_counts
from pomona.survey.digest import plain
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.crop import Crop, RowSegments
from pomona.values.fruits import Fruits, Observations
from pomona.values.intervals import CropInterval
from pomona.values.intrinsics import Intrinsics
from pomona.values.trees import Trees, Trunks

METRES = WorldFrame(scale_source="markers", approximate=False, up_is_known=True)
TRUNKS = Trunks(np.arange(1, 5), np.column_stack([np.arange(4) * 1.0, np.zeros(4)]))


def standing(sides: int, photos: int = 12) -> Cameras:
    """Cameras 0.3 m apart along x, 2.5 m from the row, on one side or on both."""
    lens = Intrinsics("SIMPLE_PINHOLE", 600, 800, np.array([500.0, 300, 400]))
    poses, names = [], []
    for side in range(sides):
        toward = 1.0 if side == 0 else -1.0
        rotation = np.array([[toward, 0, 0], [0, 0, -1.0], [0, toward, 0]])
        for k in range(photos):
            eye = np.array([0.3 * k - 0.15, -2.5 * toward, 1.5])
            poses.append(np.column_stack([rotation, -rotation @ eye]))
            names.append(f"{'east' if side == 0 else 'west'}/{k:02}")
    return Cameras(tuple(names), (lens,), np.zeros(len(names), int), np.array(poses), frame=METRES)


def grown(
    seed: int, sides: int, count: int = 160, leaves: float = 1.0, photos: int = 12
) -> tuple[Fruits, Observations, Cameras, int]:
    """Fruits found of `count` in a crown 1 m deep that hides those behind it, and how many two photos look at."""
    rng = np.random.default_rng(seed)
    ends = (-0.4, 0.3 * photos - 0.2)
    centers = np.column_stack([rng.uniform(*ends, count), rng.uniform(-0.5, 0.5, count), rng.uniform(1, 2, count)])
    cameras = standing(sides, photos)
    looks, seen = np.zeros((count, len(cameras)), bool), np.zeros((count, len(cameras)), bool)
    for side in range(sides):
        depth = (0.5 + (centers[:, 1] if side == 0 else -centers[:, 1])) / 1.0
        clear = 3.0 - leaves * 4.5 * depth + rng.normal(0, 1.8, count)
        for j in range(photos * side, photos * side + photos):
            xy_px, _ = cameras.project(j, centers)
            looks[:, j] = ((xy_px > 0) & (xy_px < [600, 800])).all(1)
            seen[:, j] = looks[:, j] & (rng.random(count) < 1 / (1 + np.exp(-clear)))
    found = np.flatnonzero(seen.sum(1) >= 2)
    diameters = rng.normal(0.075, 0.005, len(found))
    fruits = Fruits(
        found + 1, centers[found], diameters, np.ones(len(found)), seen[found].sum(1), np.full(len(found), 0.001)
    )
    pairs = [(int(i) + 1, cameras.photos[j]) for i in found for j in np.flatnonzero(seen[i])]
    observations = Observations(
        np.array([i for i, _ in pairs]), tuple(p for _, p in pairs), np.arange(len(pairs)), np.zeros((len(pairs), 2))
    )
    return weigh(fruits, STORY_APPLES, METRES), observations, cameras, int((looks.sum(1) >= 2).sum())


def estimated(seed: int, sides: int, leaves: float = 1.0, **options: object) -> tuple[Estimate, int, int]:
    fruits, observations, cameras, true = grown(seed, sides, leaves=leaves)
    fruits = on_trees(fruits, TRUNKS)
    trees = trees_of(fruits, TRUNKS, STORY_APPLES)
    found = estimate_crop(
        fruits,
        observations,
        cameras,
        trees,
        STORY_APPLES,
        options=YieldOptions(draws=300, **options),  # type: ignore[arg-type]
    )
    return found, len(fruits), true


@pytest.mark.parametrize(("last_m", "lengths_m"), [(3.0, [1, 1, 1]), (3.25, [1, 1, 1, 0.25]), (0.4, [0.4])])
def test_no_segment_is_without_length(last_m: float, lengths_m: list[float]) -> None:
    along = np.append(np.arange(0, last_m, 0.125), last_m)
    n = len(along)
    centers = np.column_stack([along, np.zeros(n), np.ones(n)])
    fruits = Fruits(np.arange(n) + 1, centers, np.full(n, 0.07), np.ones(n), np.full(n, 3), np.full(n, 0.001))
    draws = _Draws(np.ones(n), np.ones(n), np.ones((2, n), np.float32), np.ones((2, n), bool), np.zeros((2, n), bool))
    segments = _segments(fruits, row_line(centers), draws, 1.0)
    lengths = np.linalg.norm(segments.ends_in_world - segments.starts_in_world, axis=1)
    np.testing.assert_allclose(lengths, lengths_m, atol=1e-6)
    assert segments.fruits.sum() == n


@pytest.mark.parametrize(
    ("sides", "leaves", "widest"),
    [
        (2, 1.0, 0.25),
        pytest.param(2, 1.4, 0.5, marks=pytest.mark.slow),
        pytest.param(1, 0.7, 1.2, marks=pytest.mark.slow),
    ],
)
def test_the_interval_holds_the_true_number(sides: int, leaves: float, widest: float) -> None:
    held, ratios = [], []
    for seed in range(4):
        found, count, true = estimated(seed, sides, leaves)
        assert found.crop is not None
        every = found.crop.fruits
        assert found.crop.sides == sides
        assert count <= every.high
        held.append(every.low <= true <= every.high)
        ratios.append(every.value / true)
        assert relative_width(every) < widest
    assert sum(held) >= 4
    assert 0.93 < np.mean(ratios) < (1.1 if sides == 2 else 1.2)  # of one side, fewer are seen than not


def relative_width(interval: CropInterval) -> float:
    """From low to high, as a share of the value."""
    return (interval.high - interval.low) / interval.value


def test_intervals_say_what_they_cover() -> None:
    both, one = estimated(1, 2)[0].crop, estimated(1, 1)[0].crop
    assert both is not None
    assert one is not None
    assert "hidden ones too" in both.fruits.covers
    assert "one side alone" in one.fruits.covers
    assert "one side" not in both.fruits.covers
    assert "not counted" in both.seen.covers
    assert relative_width(one.fruits) > 2 * relative_width(both.fruits)


def test_each_found_fruit_stands_for_itself_and_those_like_it() -> None:
    found, count, _ = estimated(2, 1)
    assert found.crop is not None
    stands = found.fruits.stands_for
    assert stands.shape == (count,)
    assert stands.min() >= 1
    assert stands.sum() == pytest.approx(found.crop.fruits.value)
    deep = found.fruits.centers_in_world[:, 1] > 0.2
    near = found.fruits.centers_in_world[:, 1] < -0.2
    assert stands[deep].mean() > 1.3 * stands[near].mean()


def test_trees_and_segments_add_up_to_the_row() -> None:
    found, count, _ = estimated(3, 2)
    assert found.crop is not None
    total, trees, segments = found.crop.fruits, found.trees, found.segments
    assert trees.all_fruits.sum() == pytest.approx(total.value, rel=0.05)
    assert (trees.all_low <= trees.all_fruits).all()
    assert (trees.all_fruits <= trees.all_high).all()
    assert (trees.all_high >= trees.fruits).all()
    assert segments.fruits.sum() == count
    assert segments.all_fruits.sum() == pytest.approx(total.value)
    assert np.linalg.norm(segments.ends_in_world[0] - segments.starts_in_world[0]) == pytest.approx(1.0)
    metre = found.crop.per_metre
    assert metre is not None
    assert metre.value == pytest.approx(total.value / 3.8, rel=0.05)


def test_sizes_count_fruits_as_often_as_there_are_such() -> None:
    """Fruits deep in the crown are made small: of those few are seen, and the corrected median is smaller."""
    fruits, observations, cameras, _ = grown(4, 1)
    diameters = 0.075 - 0.02 * fruits.centers_in_world[:, 1]
    fruits = weigh(replace(fruits, diameters_m=diameters), STORY_APPLES, METRES)
    trees = trees_of(fruits, Trunks.unknown(), STORY_APPLES)
    crop = estimate_crop(fruits, observations, cameras, trees, STORY_APPLES).crop
    assert crop is not None
    assert crop.sizes is not None
    assert crop.weight_kg is not None
    assert crop.sizes.measured[1] - 0.006 < crop.sizes.crop[1] < crop.sizes.measured[1] - 0.0005
    assert "measured" in crop.sizes.how
    assert crop.sizes.below[-1] == pytest.approx(crop.fruits.value, rel=1e-3)
    assert np.interp(crop.sizes.crop[1], crop.sizes.edges_m, crop.sizes.below) == pytest.approx(crop.fruits.value / 2)
    per_fruit = crop.weight_kg.value / crop.fruits.value
    assert per_fruit < float(np.mean(fruits.weights_g)) / 1000
    assert Crop.from_json(plain(crop)) == crop
    older = plain(crop) | {"sizes": {"measured": [0.06, 0.07, 0.08], "crop": [0.06, 0.07, 0.08], "how": "so"}}
    assert Crop.from_json(older) == replace(crop, sizes=None)


def test_weights_that_are_hardly_known_are_as_wide_as_they_are_uncertain() -> None:
    """The curve is known to 80 %: less than nothing is no weight, but the upper end says it."""
    fruits, observations, cameras, _ = grown(3, 2)
    vague = replace(STORY_APPLES, weight_sd=0.8)
    fruits = weigh(fruits, vague, METRES)
    crop = estimate_crop(fruits, observations, cameras, trees_of(fruits, Trunks.unknown(), vague), vague).crop
    assert crop is not None
    assert crop.weight_kg is not None
    assert crop.weight_kg.low == 0
    assert crop.weight_kg.high == pytest.approx((1 + 1.96 * 0.8) * crop.weight_kg.value, rel=0.07)


def test_the_crop_is_as_large_as_its_fruits_where_small_ones_are_not_measured() -> None:
    """Diameters of 66 to 82 mm; of those below 72 mm most are too hidden, and what is measured errs."""
    rng = np.random.default_rng(8)
    fruits, observations, cameras, _ = grown(4, 2)
    true_m = rng.uniform(0.066, 0.082, len(fruits))
    hidden = (true_m < 0.072) & (rng.random(len(fruits)) < 0.7)
    prior_sd_m, clear_sd_m, rough_sd_m = 0.0046, 0.001, 0.004
    # What is seen, and how large others are, put together: as the fit of a fruit that is hardly seen does.
    own_m = true_m + rough_sd_m * rng.standard_normal(len(fruits))
    trust = prior_sd_m**2 / (prior_sd_m**2 + rough_sd_m**2)
    rough_m, spread_m = 0.074 + trust * (own_m - 0.074), prior_sd_m * np.sqrt(1 - trust)
    fruits = replace(
        fruits,
        diameters_m=np.where(hidden, np.nan, true_m + clear_sd_m * rng.standard_normal(len(fruits))),
        diameter_sds_m=np.where(hidden, np.nan, clear_sd_m),
        rough_diameters_m=np.where(hidden, rough_m, np.nan),
        rough_diameter_sds_m=np.where(hidden, spread_m, np.nan),
    )
    fruits = weigh(fruits, STORY_APPLES, METRES)
    found = estimate_crop(fruits, observations, cameras, Trees.empty(), STORY_APPLES)
    assert found.crop is not None
    assert found.crop.sizes is not None
    low, middle, high = found.crop.sizes.crop
    assert found.crop.sizes.measured[1] > float(np.median(true_m)) + 0.0015
    assert middle == pytest.approx(float(np.median(true_m)), abs=0.0011)
    assert (low, high) == pytest.approx(tuple(np.percentile(true_m, [10, 90])), abs=0.0016)
    # Without any word on hidden fruits, they are taken to be like the others.
    silent = replace(fruits, rough_diameters_m=np.full(len(fruits), np.nan))
    alone = estimate_crop(silent, observations, cameras, Trees.empty(), STORY_APPLES).crop
    assert alone is not None
    assert alone.sizes is not None
    assert alone.sizes.crop[1] > middle + 0.001
    assert alone.sizes.below[-1] == pytest.approx(alone.fruits.value, rel=1e-3)


def test_draws_of_a_long_row_are_made_part_by_part() -> None:
    """Of 5000 fruits: what all parts share is shared, and what each has is its own."""
    count = 5000
    shown = Detectability(np.full(count, 0.8), np.ones((count, 1)), np.zeros(1), np.eye(1) * 0.04, 0.25)
    middles = np.column_stack([np.arange(count) / 50.0, np.zeros(count), np.ones(count)])
    fruits = Fruits(np.arange(1, count + 1), middles, np.full(count, 0.07), np.full(count, 0.9), np.full(count, 5))
    draws = _Draws.of(fruits, shown, 400, np.random.default_rng(0))
    assert draws.counts.nbytes + draws.real.nbytes + draws.elsewhere.nbytes <= 6 * 400 * count
    assert draws.counts.sum(axis=1).mean() == pytest.approx(draws.expected.sum(), rel=0.03)
    parts = np.array([part.sum(axis=1) for part in np.array_split(draws.counts, 5, axis=1)])
    assert np.corrcoef(parts)[0, 4] > 0.7
    assert draws.real.mean() == pytest.approx(0.95, abs=0.01)
    assert len(np.unique(draws.counts[0][:2000] != draws.counts[0][2000:4000])) == 2


def test_the_same_survey_gives_the_same_interval() -> None:
    assert estimated(5, 2)[0].crop == estimated(5, 2)[0].crop


def test_false_fruits_are_not_counted() -> None:
    fruits, observations, cameras, _ = grown(6, 2)
    trees = trees_of(fruits, Trunks.unknown(), STORY_APPLES)
    sure = estimate_crop(fruits, observations, cameras, trees, STORY_APPLES).crop
    doubtful = replace(fruits, scores=np.full(len(fruits), 0.8))
    less = estimate_crop(doubtful, observations, cameras, trees, STORY_APPLES).crop
    assert sure is not None
    assert less is not None
    assert less.fruits.value == pytest.approx(0.9 * sure.fruits.value)
    assert less.seen.low < 0.85 * len(fruits) < less.seen.high
    assert relative_width(less.fruits) > relative_width(sure.fruits)


def test_what_the_filter_drops_of_few_photos_is_made_up_for() -> None:
    fruits, observations, cameras, true = grown(7, 1, leaves=0.8)
    kept = fruits[fruits.views >= 4]
    mine = observations[np.isin(observations.fruit_id, kept.ids)]
    trees = trees_of(kept, Trunks.unknown(), STORY_APPLES)
    crop = estimate_crop(kept, mine, cameras, trees, STORY_APPLES, candidate_views=fruits.views).crop
    assert crop is not None
    assert len(kept) < 0.95 * len(fruits)
    assert crop.fruits.low <= true <= crop.fruits.high


def test_shares_kept_rise_with_the_photos() -> None:
    candidates = np.repeat([2, 3, 4, 5, 6], [10, 10, 10, 20, 20])
    views = np.repeat([3, 4, 5, 6], [2, 6, 20, 20])
    # Of those that three and four photos show, 0.82 and 0.97 are candidates at all.
    assert kept_shares(views, candidates) == pytest.approx([0, 0, 0, 0.2 * 0.82, 0.6 * 0.97])
    assert kept_shares(views, None) == pytest.approx([0, 0])


def test_of_many_photos_what_one_saw_stays_seen() -> None:
    fruits, observations, cameras, _ = grown(7, 1, photos=40)
    few = encounters_of(fruits, observations, cameras, options=YieldOptions(most_photos=4))
    all_of_them = encounters_of(fruits, observations, cameras, options=YieldOptions(most_photos=1000))
    assert (few.photos.max() < all_of_them.photos.max()).all()
    np.testing.assert_array_equal(few.seen > 0, all_of_them.seen > 0)
    assert (few.seen <= few.photos).all()


def test_where_every_candidate_was_kept_the_filter_lost_none() -> None:
    many = np.full(20, 10)
    shares = kept_shares(many, many)
    assert shares[:2] == pytest.approx([0, 0])
    assert (shares[2:] > 0.5).all()


@pytest.mark.slow
def test_fruits_that_the_association_loses_are_counted_too() -> None:
    """Of fruits that two and three photos saw, a half and a fifth are lost, and all others are found."""
    ratios = []
    for seed in range(6):
        fruits, observations, cameras, true = grown(40 + seed, 2, leaves=1.3, photos=8)
        lost = np.random.default_rng(seed).random(len(fruits)) < np.interp(fruits.views, [2, 3, 4], [0.5, 0.2, 0.0])
        found = fruits[~lost]
        mine = observations[np.isin(observations.fruit_id, found.ids)]
        values = found, mine, cameras, Trees.empty(), STORY_APPLES
        told, naive = (estimate_crop(*values, candidate_views=v).crop for v in (found.views, None))
        assert told is not None
        assert naive is not None
        assert told.fruits.value > naive.fruits.value
        assert told.fruits.low < true < told.fruits.high
        ratios.append((told.fruits.value / true, naive.fruits.value / true))
    (told_ratio, naive_ratio) = np.mean(ratios, axis=0)
    assert 0.97 < told_ratio < 1.06
    assert naive_ratio < told_ratio - 0.02


def test_too_few_fruits_and_no_metres_give_no_estimate() -> None:
    fruits, observations, cameras, _ = grown(8, 2)
    few = fruits[np.arange(5)]
    trees = trees_of(few, TRUNKS, STORY_APPLES)
    mine = observations[np.isin(observations.fruit_id, few.ids)]
    assert estimate_crop(few, mine, cameras, trees, STORY_APPLES).crop is None
    without = replace(cameras, frame=WorldFrame())
    found = estimate_crop(fruits, observations, without, trees, STORY_APPLES)
    assert found.crop is None
    assert len(found.segments) == 0


def test_a_fruit_that_a_person_added_stands_for_itself() -> None:
    fruits, observations, cameras, _ = grown(9, 2)
    mine = observations[observations.fruit_id != fruits.ids[0]]
    found = estimate_crop(fruits, mine, cameras, trees_of(fruits, TRUNKS, STORY_APPLES), STORY_APPLES)
    assert found.fruits.stands_for[0] == pytest.approx(1.0)


def test_sides_are_told_by_where_cameras_stand() -> None:
    fruits, observations, cameras, _ = grown(10, 2)
    encounters = encounters_of(fruits, observations, cameras)
    assert encounters.sides == 2
    assert encounters.depths[:, 0] == pytest.approx(-encounters.depths[:, 1])
    assert (encounters.seen <= encounters.photos).all()


@pytest.mark.parametrize("sides", [1, 2])
def test_sides_of_a_single_round_tree_are_those_of_the_walk(sides: int) -> None:
    found, depths = [], []
    for seed in range(8):
        fruits, observations, cameras, _ = grown(seed, sides, photos=5)
        as_wide_as_long = fruits.centers_in_world * [0.6, 1, 1] + [0.2, 0, 0]
        encounters = encounters_of(replace(fruits, centers_in_world=as_wide_as_long), observations, cameras)
        found.append(encounters.sides)
        depths.append(abs(np.corrcoef(encounters.depths[:, 0], as_wide_as_long[:, 1])[0, 1]))
    assert found == [sides] * 8
    assert min(depths) > 0.999


@pytest.mark.parametrize("sides", [1, 2])
def test_small_fruits_hang_as_deep_in_the_crown_as_large_ones(sides: int) -> None:
    """Cherries where apples hung are as hard to see: what hides them are the same leaves."""
    fruits, observations, cameras, _ = grown(17, sides, leaves=0.8)
    apples = encounters_of(fruits, observations, cameras)
    none = replace(fruits, diameters_m=np.full(len(fruits), np.nan))
    for other in (replace(fruits, diameters_m=fruits.diameters_m / 3), none):
        found = encounters_of(other, observations, cameras)
        assert found.depths == pytest.approx(apples.depths)
    assert np.ptp(apples.depths[:, 0]) == pytest.approx(1.0 / 0.3, rel=0.1)
    assert encounters_of(none, observations, cameras).sizes == pytest.approx(np.zeros(len(fruits)))


def on_arc(points: np.ndarray, radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) of a row along x when it is bent to the left, and how far each has turned (n,), radians."""
    angle, off = points[:, 0] / radius_m, radius_m - points[:, 1]
    return np.column_stack([off * np.sin(angle), radius_m - off * np.cos(angle), points[:, 2]]), angle


def cameras_on_arc(cameras: Cameras, radius_m: float) -> Cameras:
    places, angles = on_arc(cameras.centers_in_world, radius_m)
    turns = [np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]]) for a in angles]
    rotations = [pose[:, :3] @ turn for pose, turn in zip(cameras.cam_from_world, turns, strict=True)]
    poses = [np.column_stack([r, -r @ place]) for r, place in zip(rotations, places, strict=True)]
    return replace(cameras, cam_from_world=np.array(poses))


@pytest.mark.parametrize("sides", [1, 2])
def test_a_bent_row_has_as_many_fruits_as_a_straight_one(sides: int) -> None:
    """A row of 30 m, 2 m aside in its middle: by a straight line, depths in the crown are those of the bend."""
    fruits, observations, cameras, _ = grown(16, sides, count=500, photos=100, leaves=1.2 if sides == 2 else 0.7)
    bent = replace(fruits, centers_in_world=on_arc(fruits.centers_in_world, 56.0)[0])
    around = cameras_on_arc(cameras, 56.0)
    straight, arc = encounters_of(fruits, observations, cameras), encounters_of(bent, observations, around)
    assert arc.sides == straight.sides == sides
    assert (arc.seen == straight.seen).mean() > 0.99
    assert np.abs(arc.depths - straight.depths).max() < 0.4  # of a bend of 6.7
    options = YieldOptions(draws=100, most_fitted=150)
    crops = [
        estimate_crop(*row, trees_of(row[0], Trunks.unknown(), STORY_APPLES), STORY_APPLES, options=options)
        for row in ((fruits, observations, cameras), (bent, observations, around))
    ]
    (before, after), (segments, along) = [found.crop for found in crops], [found.segments for found in crops]
    assert before is not None
    assert after is not None
    assert after.per_metre is not None
    assert after.fruits.value == pytest.approx(before.fruits.value, rel=0.04)
    assert after.fruits.value / after.per_metre.value == pytest.approx(29.9, abs=0.3)
    assert len(along) == len(segments)
    assert np.abs(along.fruits - segments.fruits).max() <= 3
    assert np.linalg.norm(along.starts_in_world[1:] - along.ends_in_world[:-1], axis=1).max() < 1e-9


# ---- hand counts


def counted(path: Path, text: str) -> Path:
    path.write_text("tree,count\n" + text, encoding="utf-8")
    return path


def test_what_lies_between_parts_that_are_not_joined_is_no_row() -> None:
    fruits, observations, cameras, _ = grown(11, 2)
    trees = trees_of(fruits, Trunks.unknown(), STORY_APPLES)
    one, apart = (
        estimate_crop(fruits, observations, cameras, trees, STORY_APPLES, in_one_frame=joined)
        for joined in (True, False)
    )
    assert one.crop is not None
    assert apart.crop is not None
    assert one.crop.per_metre is not None
    assert apart.crop.per_metre is None
    assert (len(one.segments) >= 4, len(apart.segments)) == (True, 0)
    assert apart.crop.fruits.value == one.crop.fruits.value
    assert "count twice" in apart.crop.fruits.covers
    assert "count twice" not in one.crop.fruits.covers


def test_hand_counts_calibrate(tmp_path: Path) -> None:
    plain_, _, _ = estimated(11, 2)
    trees = plain_.trees
    twice = "".join(f"{i},{1.3 * n:.0f}\n" for i, n in zip(trees.ids[:3], trees.all_fruits[:3], strict=True))
    found, _, _ = estimated(11, 2, hand_counts=counted(tmp_path / "c.csv", twice))
    assert found.crop is not None
    assert plain_.crop is not None
    assert found.crop.calibration is not None
    assert found.crop.calibration.value == pytest.approx(1.3, rel=0.05)
    assert relative_width(plain_.crop.fruits) < relative_width(found.crop.fruits) < 0.26
    assert found.crop.fruits.value == pytest.approx(1.3 * plain_.crop.fruits.value, rel=0.05)
    assert "calibrated on hand counts" in found.crop.fruits.covers
    assert found.crop.fruits.low < 1.3 * plain_.crop.fruits.value < found.crop.fruits.high


def test_trees_add_up_to_the_row_with_two_hand_counts_too(tmp_path: Path) -> None:
    plain_, _, _ = estimated(11, 2)
    few = "".join(f"{i},{n:.0f}\n" for i, n in zip(plain_.trees.ids[:2], (30, 60), strict=True))
    found, _, _ = estimated(11, 2, hand_counts=counted(tmp_path / "c.csv", few))
    assert found.crop is not None
    assert found.trees.all_fruits.sum() == pytest.approx(found.crop.fruits.value, rel=0.02)
    assert (found.trees.all_low <= found.trees.all_fruits).all()
    assert (found.trees.all_fruits <= found.trees.all_high).all()


def test_counts_of_a_whole_orchard_are_named_in_few_words() -> None:
    listening = Silent()
    every = HandCounts(np.arange(1, 1001), np.full(1000, 20.0))
    known = known_counts(every, np.arange(301, 321), listening)
    assert known.tree_ids.tolist() == list(range(301, 321))
    assert listening.warnings == [
        "Hand counts of trees that the survey does not have were left out: 1, 2, 3, 4, 5 and 975 more; its photos show "
        "trees 301 to 320"
    ]


def test_hand_counts_may_call_trees_as_the_tables_of_fruits_do(tmp_path: Path) -> None:
    path = tmp_path / "counts.csv"
    path.write_text("tree_id;count\n1;150\n2;149,5\n")
    counts = read_hand_counts(path)
    assert counts.tree_ids.tolist() == [1, 2]
    assert counts.counts.tolist() == [150, 149.5]
    path.write_text("tree_id,tree,count\n9,1,150\n")
    assert read_hand_counts(path).tree_ids.tolist() == [1]


def test_a_counted_tree_tells_what_one_side_does_not_show(tmp_path: Path) -> None:
    ratios, true = [], 160 / 3.8  # fruits a metre of row
    for seed in range(3):
        without, _, _ = estimated(seed, 1)
        path = counted(tmp_path / f"{seed}.csv", f"2,{true:.0f}\n3,{true:.0f}\n")
        found, _, _ = estimated(seed, 1, hand_counts=path)
        assert found.crop is not None
        assert without.crop is not None
        assert found.crop.fruits.low <= 160 * 1.05
        assert found.crop.fruits.high >= 160 * 0.95
        ratios.append(found.crop.fruits.value / 160)
    assert 0.85 < np.mean(ratios) < 1.15


def test_hand_counts_of_trees_that_do_not_exist_are_named(tmp_path: Path) -> None:
    fruits, observations, cameras, _ = grown(12, 2)
    fruits = on_trees(fruits, TRUNKS)
    trees, listening = trees_of(fruits, TRUNKS, STORY_APPLES), Silent()
    options = YieldOptions(draws=300, hand_counts=counted(tmp_path / "c.csv", "2,40\n17,40\n"))
    found = estimate_crop(fruits, observations, cameras, trees, STORY_APPLES, options=options, progress=listening)
    assert found.crop is not None
    assert found.crop.calibration is not None
    assert ["17" in w and "1 to 4" in w for w in listening.warnings] == [True]


def test_trees_of_the_table_that_photos_do_not_show_are_neither_counted_nor_empty(tmp_path: Path) -> None:
    fruits, observations, cameras, _ = grown(12, 2)
    end = float(fruits.centers_in_world[:, 0].max())
    here = TRUNKS.xy_in_world
    beyond, other_row = here[-2:] + np.array([end, 0]), here + np.array([0, 4.0])
    table = Trunks(np.arange(1, 11), np.concatenate([here, beyond, other_row]))
    bare = Trunks(np.append(TRUNKS.ids, 9), np.vstack([here, [(here[0] + here[1]) / 2]]))

    def found(trunks: Trunks, counts: str) -> tuple[Estimate, list[str]]:
        planted, listening = on_trees(fruits, TRUNKS), Silent()
        trees = trees_of(planted, trunks, STORY_APPLES)
        options = YieldOptions(draws=300, hand_counts=counted(tmp_path / "c.csv", counts) if counts else None)
        made = estimate_crop(
            planted, observations, cameras, trees, STORY_APPLES, options=options, progress=listening
        )  # fmt: skip
        return made, listening.warnings

    alone, _ = found(TRUNKS, "1,40\n2,41\n")
    among_others, warnings = found(table, "1,40\n2,41\n5,40\n6,38\n8,45\n9,39\n")
    assert alone.crop is not None
    assert among_others.crop is not None
    assert among_others.crop.fruits == alone.crop.fruits
    assert ["5, 6, 8, 9" in said for said in warnings] == [True]
    np.testing.assert_allclose(among_others.trees.all_fruits[:4], alone.trees.all_fruits)
    for values in (among_others.trees.all_fruits, among_others.trees.all_low, among_others.trees.all_high):
        assert np.isnan(values[4:]).all()
    # A tree that photos show, and that bears nothing, is known to.
    shown, warnings = found(bare, "1,40\n2,41\n9,0\n")
    assert (shown.trees.ids[-1], shown.trees.all_fruits[-1]) == (9, 0)
    assert warnings == []


@pytest.mark.parametrize(("metres", "shown"), [(False, 20), (True, 9)])
def test_hand_counts_where_nothing_is_estimated_are_said(tmp_path: Path, metres: bool, shown: int) -> None:
    fruits, observations, cameras, _ = grown(3, 2)
    fruits = fruits[:shown]
    observations = observations[np.isin(observations.fruit_id, fruits.ids)]
    cameras = cameras if metres else replace(cameras, frame=WorldFrame())
    said = {}
    for counts in (None, counted(tmp_path / "c.csv", "2,40\n")):
        listening = Silent()
        options = YieldOptions(draws=300, hand_counts=counts)
        trees = trees_of(fruits, TRUNKS, STORY_APPLES)
        found = estimate_crop(fruits, observations, cameras, trees, STORY_APPLES, options=options, progress=listening)
        assert found.crop is None
        said[counts] = listening.warnings
    without, given = said.values()
    assert without == []
    assert ["which takes metres and 10 fruits" in warning for warning in given] == [True]


def test_hand_counts_without_trees_or_far_off_are_said(tmp_path: Path) -> None:
    fruits, observations, cameras, _ = grown(13, 2)
    options = YieldOptions(draws=300, hand_counts=counted(tmp_path / "c.csv", "2,40\n"))
    unknown, listening = trees_of(fruits, Trunks.unknown(), STORY_APPLES), Silent()
    found = estimate_crop(fruits, observations, cameras, unknown, STORY_APPLES, options=options, progress=listening)
    assert found.crop is not None
    assert "trees are not known" in listening.warnings[0]
    fruits = on_trees(fruits, TRUNKS)
    options = YieldOptions(draws=300, hand_counts=counted(tmp_path / "c.csv", "2,400\n3,38\n"))
    trees = trees_of(fruits, TRUNKS, STORY_APPLES)
    estimate_crop(fruits, observations, cameras, trees, STORY_APPLES, options=options, progress=listening)
    assert "Tree 2: 400" in listening.warnings[-1]
    assert "It was left out" in listening.warnings[-1]


def photographed(true: np.ndarray, seed: int, *, shown: float = 0.7, believed: float = 0.7) -> OnTrees:
    """What photos show of trees with so many fruits: a share, as they believe, but another one of each tree.

    Three fruits of a hundred are taken to hang on the next tree.
    """
    rng = np.random.default_rng(seed)
    moved = rng.binomial(true, 0.03)
    here = true - moved + np.roll(moved, 1)
    seen = rng.binomial(here, np.clip(shown + rng.normal(0, 0.08, len(true)), 0.1, 1)).astype(float)
    shares = np.clip(rng.normal(believed, 0.06, (400, 1)), 0.3, 1)
    hidden = rng.negative_binomial(np.maximum(seen, 1e-9), np.broadcast_to(shares, (400, len(true))))
    return OnTrees(seen / believed, seen, seen + hidden, np.broadcast_to(seen, hidden.shape))


def orchard(seed: int) -> np.ndarray:
    """Fruits of 40 trees, of which about six bear none."""
    rng = np.random.default_rng([seed, 7])
    loads = rng.lognormal(3.5, 0.4, 40) * (rng.random(40) > 0.15)
    return rng.poisson(loads)


def total(trees: OnTrees, by: Calibration) -> tuple[float, np.ndarray]:
    seen, all_of_them = trees.seen.sum(), trees.expected.sum()
    found, drawn = trees.seen_draws.sum(axis=1), trees.draws.sum(axis=1)
    return by.seen * seen + by.hidden * (all_of_them - seen), by.seen_draws * found + by.hidden_draws * (drawn - found)


@pytest.mark.parametrize(("count", "widest"), [(3, 0.8), (5, 0.55), (10, 0.35)])
@pytest.mark.parametrize("shown", [0.55, 0.7, 0.85])
def test_calibrated_totals_are_right_on_average_and_intervals_hold(count: int, widest: float, shown: float) -> None:
    """Of trees chosen by chance, some of which bear nothing; photos believe that 70 % are seen."""
    ratios, held, widths = [], [], []
    for seed in range(60):
        true, rng = orchard(seed), np.random.default_rng(seed)
        trees = photographed(true, seed, shown=shown)
        some = np.isin(np.arange(40), rng.choice(40, count, replace=False))
        if not true[some].any():
            continue
        by = calibration(HandCounts(np.flatnonzero(some) + 1, true[some].astype(float)), trees[some], rng, Silent())
        assert by is not None
        value, draws = total(trees, by)
        low, high = np.percentile(draws, (2.5, 97.5))
        ratios.append(value / true.sum())
        held.append(low <= true.sum() <= high)
        widths.append((high - low) / true.sum())
    assert 0.95 < np.mean(ratios) < 1.05
    assert np.mean(held) >= 0.9
    assert 0.02 < np.median(widths) < widest


def test_trees_that_bear_nothing_count() -> None:
    """Fruits that a neighbour's branches hold out over an empty tree are on that neighbour by hand."""
    trees = OnTrees(np.array([50.0, 6, 40]), np.array([40.0, 5, 33]), *[np.tile([50.0, 6, 40], (200, 1))] * 2)
    counts = HandCounts(np.array([1, 2, 3]), np.array([55.0, 0, 41]))
    listening = Silent()
    by = calibration(counts, trees, np.random.default_rng(0), listening)
    assert by is not None
    assert by.ratio.value == pytest.approx(96 / 96)
    nothing = HandCounts(np.array([2]), np.zeros(1))
    few = OnTrees(np.array([2.0]), np.array([2.0]), np.full((200, 1), 2.0), np.full((200, 1), 2.0))
    assert calibration(nothing, few, np.random.default_rng(0), listening) is None
    assert "All hand counts are 0, " in listening.warnings[-1]


@pytest.mark.parametrize("typed", [3.0, 340.0, 0.0])
@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_a_count_far_off_all_others_is_left_out(typed: float, count: int) -> None:
    true = np.array([34, 30, 41, 28, 37, 33])[:count]
    trees, listening = photographed(true, 1, shown=0.7), Silent()
    counts = np.array([typed, *true[1:]])
    by = calibration(HandCounts(np.arange(11, 11 + count), counts), trees, np.random.default_rng(0), listening)
    assert ["Tree 11" in w and "left out" in w and "table of hand counts" in w for w in listening.warnings] == [True]
    if count == 1:
        assert by is None
        return
    assert by is not None
    assert f"{count - 1} tree" in by.ratio.covers
    assert 0.75 < by.ratio.value < 1.35


def test_trees_that_all_differ_from_the_photos_are_no_slips() -> None:
    """Photos show a third of what they believe: that is what hand counts are for, and is said once."""
    true, listening = np.array([60, 52, 75, 44]), Silent()
    trees = photographed(true, 2, shown=0.25, believed=0.75)
    by = calibration(HandCounts(np.arange(1, 5), true.astype(float)), trees, np.random.default_rng(0), listening)
    assert by is not None
    assert by.ratio.value == pytest.approx(true.sum() / trees.expected.sum())
    assert "4 trees are 2." in listening.warnings[0] or "4 trees are 3." in listening.warnings[0]
    assert len(listening.warnings) == 1


def test_calibrated_totals_are_never_less_than_was_found() -> None:
    """Half of what photos believe to be hidden is there: a tree of which all was found keeps all of it."""
    seen, hidden = np.array([40.0, 30, 35, 60]), np.array([20.0, 16, 18, 0])
    drawn = np.tile(seen + hidden, (500, 1)), np.tile(seen, (500, 1))
    trees = OnTrees(seen + hidden, seen, *drawn)
    some = np.array([True, True, True, False])
    counts = HandCounts(np.arange(1, 4), np.array([50.0, 37, 45]))
    by = calibration(counts, trees[some], np.random.default_rng(0), Silent())
    assert by is not None
    assert (by.seen, by.hidden) == pytest.approx((1.0, 27 / 54))
    assert by.seen_draws.min() >= 1
    assert by.hidden_draws.min() >= 0
    fewer = calibration(replace(counts, counts=0.8 * seen[:3]), trees[some], np.random.default_rng(0), Silent())
    assert fewer is not None  # of what was found, a fifth is none
    assert (fewer.seen, fewer.hidden) == pytest.approx((0.8, 0.0))


@pytest.mark.parametrize(("text", "said"), [("1,-3\n", "count"), ("1,many\n", "line 2"), ("1,3\n1,4\n", "twice")])
def test_hand_counts_that_cannot_be(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(FormatError, match=said):
        read_hand_counts(counted(tmp_path / "c.csv", text))
    with pytest.raises(MissingFileError):
        read_hand_counts(tmp_path / "none.csv")


# ---- values and tables


def test_an_interval_holds_its_value() -> None:
    with pytest.raises(InputError, match="low"):
        CropInterval(3.0, 4.0, 5.0, "nothing")
    assert CropInterval.of_draws(10.0, np.array([1.0, 2.0]), "x").high == 10.0
    with pytest.raises(InputError, match="draws"):
        YieldOptions(draws=3)
    with pytest.raises(InputError, match="segment_m"):
        YieldOptions(segment_m=0.0)


def test_tables_come_back(tmp_path: Path) -> None:
    found, _, _ = estimated(14, 2)
    write_segments(tmp_path / "segments.csv", found.segments)
    write_trees(tmp_path / "trees.csv", found.trees)
    segments, trees = read_segments(tmp_path / "segments.csv"), read_trees(tmp_path / "trees.csv")
    assert segments.all_high == pytest.approx(found.segments.all_high, abs=0.06)
    assert segments.ends_in_world == pytest.approx(found.segments.ends_in_world, abs=1e-4)
    assert trees.all_low == pytest.approx(found.trees.all_low, abs=0.06)
    assert len(RowSegments.empty().to_pandas()) == 0


def test_a_table_of_trees_of_an_older_version_is_read(tmp_path: Path) -> None:
    found, _, _ = estimated(15, 2)
    write_trees(tmp_path / "trees.csv", found.trees)
    lines = (tmp_path / "trees.csv").read_text().splitlines()
    (tmp_path / "old.csv").write_text("\n".join(",".join(line.split(",")[:-3]) for line in lines) + "\n")
    assert np.isnan(read_trees(tmp_path / "old.csv").all_fruits).all()
