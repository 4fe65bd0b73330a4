"""Two surveys of one row: rows grown and thinned by the generator, whose true fruits say which is which."""

import csv
import json
import re
import tracemalloc
from dataclasses import dataclass, replace
from datetime import date, datetime, timedelta
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import pomona
from pomona.basics.geometry import Similarity
from pomona.change import Comparison, compare_surveys, constellation
from pomona.change.constellation import find_constellation
from pomona.change.matching import _Following, lay_over, matched
from pomona.change.page import (
    PAGE,
    _earlier,
    _sizes_figure,
    _totals,
    _trees_table,
    _write_table,
    comparison_html,
)
from pomona.change.surveys import _in_view, _sightings
from pomona.cli.app import app
from pomona.cli.compare import _show
from pomona.errors import InputError, SurveyError
from pomona.formats.tables import read_fruits, write_fruits
from pomona.learning.synth import RowOptions
from pomona.learning.synth.layout import lay_out_row
from pomona.progress import Silent
from pomona.values.cameras import WorldFrame
from pomona.values.fruits import Fruits, Observations
from pomona.values.photos import Photos
from pomona.values.trees import Trunks
from report_scenes import LENS, observe, row_cameras, row_photos, row_report
from view_scenes import write_view_survey

EARLY = RowOptions(seed=5, trees=3, fruits_per_tree=30, leaves_per_tree=0, fruit_diameter_m=0.06)
LATE = replace(EARLY, days_later=40, grow_m=0.015, grow_sd_m=0.002, drop_share=0.25)


def found(options: RowOptions, seed: int, share: float = 0.85, noise_m: float = 0.006) -> Fruits:
    """What a survey finds of a row: a share of its fruits, a little off; ids are those of the true fruits."""
    rng = np.random.default_rng(seed)
    row = lay_out_row(options).fruits
    seen = np.flatnonzero(rng.random(len(row.ids)) < share)
    seen = rng.permutation(seen)
    n = len(seen)
    centers = row.centres_in_world[seen] + rng.normal(0, noise_m, (n, 3))
    sizes = row.diameters_m[seen] + rng.normal(0, 0.001, n)
    return Fruits(row.ids[seen], centers, sizes, np.ones(n), np.full(n, 5), np.full(n, 0.001), tree_ids=row.trees[seen])


def moved(fruits: Fruits, similarity: Similarity) -> Fruits:
    return replace(
        fruits,
        centers_in_world=similarity.apply(fruits.centers_in_world),
        diameters_m=similarity.scale * fruits.diameters_m,
        diameter_sds_m=similarity.scale * fruits.diameter_sds_m,
    )


def somewhere(scale: float = 1.0) -> Similarity:
    """A frame turned in all directions, and far away."""
    return Similarity(scale, Rotation.from_euler("xyz", [1.9, -0.7, 2.4]).as_matrix(), np.array([40.0, -7.0, 3.0]))


MARKERS = WorldFrame("markers", approximate=False, up_is_known=True)
NO_PHOTOS, NO_TRUNKS = Photos(()), Trunks.unknown()


@dataclass
class Survey:
    """As much of a survey as a comparison reads."""

    folder: Path
    fruits: Fruits
    frame: WorldFrame = MARKERS
    photos: Photos = NO_PHOTOS
    trunks: Trunks = NO_TRUNKS

    @property
    def poses(self):
        return row_cameras(1)

    @property
    def observations(self) -> Observations:
        return Observations.empty()


def on_day(survey: Survey, day: float) -> Survey:
    start = datetime(2026, 7, 1, 9)
    photos = row_photos(row_cameras(2))
    taken = tuple(
        replace(photo, taken_at=start + timedelta(days=day, seconds=k)) for k, photo in enumerate(photos.items)
    )
    return replace(survey, photos=Photos(taken))


def compared(before: Fruits, after: Fruits, frame: WorldFrame | None = None, **more) -> Comparison:
    one = on_day(Survey(Path("a"), before), 0)
    if frame is not None:
        one = replace(one, frame=frame)
    return compare_surveys(one, on_day(Survey(Path("b"), after), 40), **more)


def share_right(comparison: Comparison) -> float:
    """Ids are those of true fruits."""
    pairs = comparison.pairs
    return float((comparison.before.ids[pairs[:, 0]] == comparison.after.ids[pairs[:, 1]]).mean())


@pytest.mark.parametrize("count", [6, 7, 10, 15, 30])
def test_the_interval_of_growth_has_the_true_median_as_often_as_it_says(count: int) -> None:
    rng, has, rows = np.random.default_rng(count), 0, 400
    places = np.column_stack([np.arange(count), np.zeros((count, 2))]).astype(float)
    sizes = np.full(count, 0.06)
    before = Fruits(np.arange(1, count + 1), places, sizes, np.ones(count), np.full(count, 5))
    all_ones = np.ones(count, bool)
    same = Comparison(
        before, before, np.column_stack([np.arange(count)] * 2), np.zeros(count),
        Similarity(1.0, np.eye(3), np.zeros(3)), all_ones, all_ones,
    )  # fmt: skip
    for _ in range(rows):
        after = replace(before, diameters_m=sizes + rng.normal(0.015, 0.004, count))
        growth = replace(same, after=after).growth()
        assert growth.low <= growth.value <= growth.high
        has += growth.low <= 0.015 <= growth.high
    assert 0.93 <= has / rows <= 0.998
    few = replace(before, diameters_m=np.r_[np.full(5, 0.07), np.full(count - 5, np.nan)])
    growth = replace(same, after=few).growth()
    assert growth.value == pytest.approx(0.01)
    assert np.isnan([growth.low, growth.high]).all()


@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_fruits_of_a_grown_and_thinned_row_are_matched_in_any_frame(scale: float) -> None:
    before, after = found(EARLY, 1), found(LATE, 2)
    both = len(np.intersect1d(before.ids, after.ids))
    frame = None if scale == 1 else WorldFrame("none")
    comparison = compared(moved(before, somewhere(scale)), after, frame)
    assert share_right(comparison) >= 0.95
    assert 0.9 * both <= len(comparison.pairs) <= both / 0.95
    over = comparison.after_from_before
    assert over.scale * scale == pytest.approx(1, abs=0.01)
    assert np.linalg.norm(over.apply(moved(before, somewhere(scale)).centers_in_world) - before.centers_in_world,
                          axis=1).max() < 0.03  # fmt: skip
    growth = comparison.growth()
    assert growth.value == pytest.approx(0.015, abs=0.001 if scale == 1 else 0.002)
    assert growth.low < growth.value < growth.high < growth.low + 0.003
    assert comparison.days == pytest.approx(40)


def test_surveys_in_the_markers_frame_are_matched_where_they_are_and_order_does_not_matter() -> None:
    before, after = found(EARLY, 1), found(LATE, 2)
    comparison = compared(before, after)
    order = np.random.default_rng(0).permutation(len(before))
    again = compared(before[order], after)
    assert sorted(map(tuple, comparison.pairs.tolist())) == sorted((int(order[i]), int(j)) for i, j in again.pairs)
    assert share_right(comparison) >= 0.95


def test_a_row_that_one_survey_bent_is_followed_along_it() -> None:
    long = replace(EARLY, trees=10, fruits_per_tree=25)
    before, after = found(long, 1), found(replace(long, days_later=30, grow_m=0.01, drop_share=0.2), 2)
    bent = after.centers_in_world.copy()
    bent[:, 1] += 0.006 * (bent[:, 0] - 4.5) ** 2  # 12 cm at the ends
    comparison = compared(moved(before, somewhere()), replace(after, centers_in_world=bent))
    both = len(np.intersect1d(before.ids, after.ids))
    assert share_right(comparison) >= 0.95
    assert len(comparison.pairs) >= 0.9 * both


def along(length_m: float, seed: int = 0, per_m: float = 12.0) -> np.ndarray:
    """Centres of fruits (n, 3) on a long row without trunks, none nearer to another than 7 cm."""
    rng = np.random.default_rng(seed)
    places = rng.uniform([0, -0.3, 0.5], [length_m, 0.3, 2.2], (round(length_m * per_m), 3))
    too_near = cKDTree(places).query_pairs(0.07, output_type="ndarray")
    return np.delete(places, np.unique(too_near[:, 0]), axis=0)


def of_long_row(places: np.ndarray, seed: int, share: float = 0.85) -> Fruits:
    """What a survey finds of it, 5 mm off; ids are those of the true fruits."""
    rng = np.random.default_rng(seed)
    seen = rng.permutation(np.flatnonzero(rng.random(len(places)) < share))
    n = len(seen)
    return Fruits(seen + 1, places[seen] + rng.normal(0, 0.005, (n, 3)), np.full(n, 0.07), np.ones(n), np.full(n, 5))


def test_a_long_row_is_followed_to_its_ends_and_laid_over_as_a_whole() -> None:
    row = along(90)
    before, after = of_long_row(row, 1), of_long_row(row, 2)
    x = after.centers_in_world[:, 0]
    # Straight in both near its start; then the later survey leads away, and winds.
    away = np.column_stack([0 * x, 0.02 * np.maximum(x - 8, 0) + 0.2 * np.sin(np.maximum(x - 8, 0) / 9), 0 * x])
    over = lay_over(before.centers_in_world, after.centers_in_world + away, (0.07, 0.07), rigid=True, same_frame=True)
    assert over is not None
    both = len(np.intersect1d(before.ids, after.ids))
    right = before.ids[over.pairs[:, 0]] == after.ids[over.pairs[:, 1]]
    assert right.mean() >= 0.99
    assert 0.97 * both <= len(right) <= both / 0.99
    assert not over.source_lost.any()
    assert not over.target_lost.any()
    # The whole is turned as most of the row is, not as its start: what is left is the winding.
    assert 0.02 < over.bent < 0.2
    assert np.linalg.norm(over.shifts, axis=1).max() < 0.5
    back = over.carried_back(after.centers_in_world + away)
    assert 0.002 < np.median(np.linalg.norm(back - after.centers_in_world, axis=1)) < 0.02
    np.testing.assert_allclose(back, after.centers_in_world, atol=0.03)


def test_following_looks_at_each_fruit_a_few_times_however_long_the_row() -> None:
    looks = []
    for length_m in (20, 40):
        row = along(length_m)
        start = np.flatnonzero(row[:, 0] < 3)
        following = _Following.start(row, row + np.array([0.02, 0.01, 0]), np.stack([start, start], axis=1), 0.04)
        following.go_on()
        assert (following.partner == np.arange(len(row))).all()
        looks.append(following.rounds.mean())
    assert 1 <= looks[0] <= 12
    assert looks[1] == pytest.approx(looks[0], rel=0.2)


def test_where_following_does_not_get_through_nothing_is_called_gone_and_people_are_told() -> None:
    row = along(30)
    before, after = of_long_row(row, 1), of_long_row(row, 2)
    beyond = after.centers_in_world[:, 0] > 16
    broken = after.centers_in_world + np.where(beyond[:, None], [0.0, 0.25, -0.2], 0.0)
    comparison = compared(before, replace(after, centers_in_world=broken))
    assert share_right(comparison) >= 0.99
    old_state, new_state = (np.array(each) for each in comparison.states)
    old_beyond = before.centers_in_world[:, 0] > 20
    assert set(old_state[old_beyond]) == {"out of view"}
    assert set(new_state[after.centers_in_world[:, 0] > 20]) == {"not seen before"}
    assert (old_state[before.centers_in_world[:, 0] < 14] == "same").mean() > 0.8
    (warning,) = comparison.warnings
    assert "along a part of the row only" in warning
    lost = int(re.search(r"(\d+) of its", warning)[1])  # type: ignore[index]
    assert old_beyond.sum() <= lost <= (before.centers_in_world[:, 0] > 14).sum()


def test_a_picked_stretch_is_gone_and_no_reason_for_a_warning() -> None:
    row = along(24)
    before, after = of_long_row(row, 1), of_long_row(row, 2)
    picked = (after.centers_in_world[:, 0] > 8) & (after.centers_in_world[:, 0] < 15)
    comparison = compared(before, after[np.flatnonzero(~picked)])
    x = before.centers_in_world[:, 0]
    assert set(np.array(comparison.states[0])[(x > 8.1) & (x < 14.9)]) == {"gone"}
    assert (np.array(comparison.states[0])[(x < 7.9) | (x > 15.1)] == "same").mean() > 0.8
    assert comparison.warnings == ()


def test_what_is_gone_is_told_from_what_is_hidden() -> None:
    before, after = found(EARLY, 1), found(LATE, 2)
    comparison = compared(before, after)
    left = set(lay_out_row(LATE).fruits.ids.tolist())
    really_gone = sum(int(fruit) not in left for fruit in before.ids)
    gone = comparison.gone()
    assert comparison.states[0].count("gone") > really_gone
    assert gone.low <= really_gone <= gone.high
    assert 0 <= gone.low < gone.value < gone.high


def test_where_nothing_is_gone_the_interval_says_so() -> None:
    comparison = compared(found(EARLY, 1)[:40], found(EARLY, 1))
    gone = comparison.gone()
    assert comparison.states[1].count("new") > 5
    assert gone.low == gone.value == 0 <= gone.high


def test_a_fruit_that_one_survey_lacks_has_no_number_there_in_pandas() -> None:
    pytest.importorskip("pandas")
    comparison = compared(found(EARLY, 1)[:40], found(EARLY, 1))
    table = comparison.to_pandas()
    assert str(table.before_id.dtype) == "Int64"
    assert table.before_id.isna().tolist() == (comparison.columns()["before_id"] == 0).tolist()
    assert table.before_id.isna().any()
    assert table.before_id.min() > 0


@pytest.mark.slow
def test_rows_without_anything_in_common_are_not_matched_by_force() -> None:
    other = replace(EARLY, seed=6)
    with pytest.raises(InputError, match="nothing in common"):
        compared(found(EARLY, 1), found(other, 2))
    apart = found(other, 2)
    diameters = (0.06, 0.06)
    assert lay_over(
        found(EARLY, 1).centers_in_world, somewhere(2).apply(apart.centers_in_world), diameters,
        rigid=False, same_frame=False,
    ) is None  # fmt: skip


def triangles_one_by_one(places: np.ndarray, diameter: float, partners: int) -> set[tuple[int, ...]]:
    """The slow obvious way of `_triangles`: corners in the order of the sides opposite."""
    found = set()
    for i, place in enumerate(places):
        away = np.linalg.norm(places - place, axis=1)
        near = [j for j in np.argsort(away)[: 4 * partners] if away[j] > 3 * diameter][:partners]
        for j, k in combinations(near, 2):
            corners = sorted((i, int(j), int(k)), key=lambda c, e=(i, int(j), int(k)): opposite(places, c, e))
            sides = [opposite(places, c, tuple(corners)) for c in corners]
            one, other = places[corners[1]] - places[corners[0]], places[corners[2]] - places[corners[0]]
            height = np.linalg.norm(np.cross(one, other)) / sides[2]
            if sides[0] > 3 * diameter and height > 0.35 * sides[2]:
                found.add(tuple(corners))
    return found


def opposite(places: np.ndarray, corner: int, corners: tuple[int, ...]) -> float:
    one, other = (places[c] for c in corners if c != corner)
    return float(np.linalg.norm(one - other))


def test_triangles_are_those_of_looking_at_each_fruit(monkeypatch: pytest.MonkeyPatch) -> None:
    places = along(6)
    monkeypatch.setattr(constellation, "_CORNERS_AT_A_TIME", 7)
    monkeypatch.setattr(constellation, "_TRIANGLES_AT_A_TIME", 50)
    found = [tuple(each) for each in constellation._triangles(places, 0.07, 6).tolist()]
    assert len(found) == len(set(found)) > 200
    assert set(found) == triangles_one_by_one(places, 0.07, 6)


def test_memory_without_metres_is_that_of_a_part_of_the_hypotheses(monkeypatch: pytest.MonkeyPatch) -> None:
    row = along(13, per_m=20)
    before, after = of_long_row(row, 1).centers_in_world, of_long_row(row, 2).centers_in_world
    peaks_mb, found = [], []
    for at_a_time in (10_000_000, 1000):
        monkeypatch.setattr(constellation, "_VOTED_AT_A_TIME", at_a_time)
        tracemalloc.start()
        found.append(find_constellation(somewhere(0.4).apply(before), after, (0.028, 0.07), rigid=False))
        peaks_mb.append(tracemalloc.get_traced_memory()[1] / 1e6)
        tracemalloc.stop()
    at_once, in_parts = found
    assert at_once is not None
    assert in_parts is not None
    np.testing.assert_array_equal(at_once.pairs, in_parts.pairs)
    assert 1 < peaks_mb[1] < 0.6 * peaks_mb[0]
    # Triangles alone are some megabytes.
    assert peaks_mb[1] < 25


def test_too_few_fruits_the_same_survey_and_days_that_are_not_known_are_said() -> None:
    before, after = found(EARLY, 1), found(LATE, 2)
    one, other = Survey(Path("a"), before), Survey(Path("b"), after)
    with pytest.raises(InputError, match="compared with itself"):
        compare_surveys(one, replace(other, folder=Path("a")))
    with pytest.raises(InputError, match="a has 5 fruits"):
        compare_surveys(replace(one, fruits=before[np.arange(5)]), other)
    unknown = compare_surveys(one, other)
    assert np.isnan(unknown.days)
    assert "No photo of a and b says when" in unknown.warnings[0]
    assert compare_surveys(one, other, dates=(date(2026, 7, 1), date(2026, 7, 31))).days == 30
    assert compare_surveys(one, other, dates=(datetime(2026, 7, 1, 23), date(2026, 7, 31))).days == 30
    assert "older than" in compare_surveys(on_day(one, 30), on_day(other, 0)).warnings[0]
    for day in (3, 3 - 1e-4):  # the second one by some seconds the older, too
        of_one_day = compare_surveys(on_day(one, 3), on_day(other, day))
        assert "of one day" in of_one_day.warnings[0]
        assert np.isnan(of_one_day.days)


def test_a_scale_that_contradicts_the_other_is_said() -> None:
    before, after = found(EARLY, 1, noise_m=0.003), found(LATE, 2, noise_m=0.003)
    wrong = compared(moved(before, Similarity(1.04, np.eye(3), np.zeros(3))), after)
    assert any("smaller in b than in a" in warning for warning in wrong.warnings)
    assert share_right(wrong) >= 0.95
    assert not compared(before, after).warnings


def test_an_approximate_scale_takes_the_metres_of_the_other() -> None:
    before, after = found(EARLY, 1), found(LATE, 2)
    rough = WorldFrame("fruit-diameter", approximate=True)
    comparison = compared(moved(before, somewhere(1.3)), after, rough)
    assert comparison.growth().value == pytest.approx(0.015, abs=0.002)
    assert comparison.metric


def trunks_beneath(fruits: Fruits) -> Trunks:
    """Trunks that stand beneath the middle of their trees' fruits."""
    ids = np.unique(fruits.tree_ids)
    return Trunks(ids, np.array([fruits.centers_in_world[fruits.tree_ids == tree, :2].mean(axis=0) for tree in ids]))


@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_fruits_are_on_the_trees_of_the_earlier_survey_where_the_later_one_does_not_know_up(scale: float) -> None:
    high = Similarity(1.0, np.eye(3), np.array([0.0, 0.0, 250.0]))  # heights are altitudes
    before, after = moved(found(EARLY, 1), high), found(LATE, 2)
    bare = replace(after, tree_ids=np.zeros(len(after), np.int64))
    earlier = on_day(Survey(Path("a"), before, trunks=trunks_beneath(before)), 0)
    frame = MARKERS if scale == 1 else WorldFrame("none")
    comparison = compare_surveys(earlier, on_day(Survey(Path("b"), moved(bare, somewhere(scale)), frame), 40))
    assert np.mean(comparison.after.tree_ids == after.tree_ids) > 0.95
    known = dict(comparison.tree_growth())
    assert set(known) == {1, 2, 3}
    assert all(growth.value == pytest.approx(0.015, abs=0.003) for growth in known.values())


def bare(fruits: Fruits) -> Fruits:
    return replace(fruits, tree_ids=np.zeros(len(fruits), np.int64))


@pytest.mark.parametrize("moved_in", ["before", "after"])
@pytest.mark.parametrize("trunks_in", ["before", "after"])
def test_a_tree_that_a_person_named_takes_no_fruits_from_those_that_have_trunks(moved_in: str, trunks_in: str) -> None:
    """One fruit was moved to a tree 7, which has no trunk."""
    fruits = {"before": found(EARLY, 1), "after": found(LATE, 2)}
    trunks = trunks_beneath(fruits[trunks_in])
    fruits = {name: each if name == trunks_in else bare(each) for name, each in fruits.items()}
    mine = fruits[moved_in]
    in_both = np.isin(mine.ids, np.intersect1d(fruits["before"].ids, fruits["after"].ids))
    trees = mine.tree_ids.copy()
    trees[np.flatnonzero(in_both)[0]] = 7
    fruits[moved_in] = replace(mine, tree_ids=trees)
    before, after = (
        on_day(Survey(Path(name), fruits[name], trunks=trunks if name == trunks_in else NO_TRUNKS), day)
        for name, day in (("before", 0), ("after", 40))
    )
    table = {
        name: np.asarray(values).tolist() for name, values in compare_surveys(before, after).tree_columns().items()
    }
    named = [7] if moved_in == trunks_in else []  # where the other survey knows trunks, those say where a fruit hangs
    assert table["id"] == [1, 2, 3, *named]
    names = ("fruits_before", "fruits_after", "same", "gone", "out_of_view", "new")
    for tree, old, new, same, gone, away, more in zip(table["id"], *(table[name] for name in names), strict=True):
        assert (old, new) == (same + gone + away, same + more)
        assert (old, new, same) == (1, 1, 1) if tree == 7 else (20 <= old <= 30 and 12 <= new <= 26)


def test_where_trees_are_not_known_one_that_a_person_named_has_that_fruit_alone() -> None:
    before, after = bare(found(EARLY, 1)), bare(found(LATE, 2))
    k = int(np.flatnonzero(np.isin(after.ids, before.ids))[0])
    after = replace(after, tree_ids=np.where(np.arange(len(after)) == k, 7, 0))
    comparison = compared(before, after)
    table = comparison.tree_columns()
    assert (table["id"].tolist(), table["fruits_after"], table["same"]) == ([7], [1], [1])
    assert 1 <= table["fruits_before"][0] <= 3  # and those that hung beside it and are gone


def test_the_page_shows_growth_in_the_unit_of_its_diameters() -> None:
    """The later survey has no scale: a unit of its page is 3.3 of the earlier one's metres."""
    before, after = found(EARLY, 1), moved(found(LATE, 2), somewhere(0.3))
    later = on_day(Survey(Path("b"), after, WorldFrame("none")), 40)
    comparison = compare_surveys(on_day(Survey(Path("a"), before), 0), later)
    assert comparison.growth().value == pytest.approx(0.015, abs=0.002)
    page = _earlier(comparison, replace(row_report(1, scene_points=10), fruits=after))
    same = np.array(page.later) >= 0
    later_idx = np.array(page.later)[same]
    assert page.growth[later_idx] == pytest.approx(after.diameters_m[later_idx] - page.diameters[same], abs=1e-6)


def test_without_a_scale_nothing_is_in_millimetres(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    unknown = WorldFrame("none")
    surveys = [
        replace(on_day(Survey(Path(name), moved(fruits, somewhere(0.3))), day), frame=unknown)
        for name, fruits, day in (("a", found(EARLY, 1), 0), ("b", found(LATE, 2), 40))
    ]
    comparison = compare_surveys(*surveys)
    assert not comparison.metric
    assert comparison.growth().value == pytest.approx(0.3 * 0.015, abs=0.001)
    for columns in (comparison.columns(), comparison.tree_columns()):
        in_mm = [name for name in columns if "_mm" in name]
        assert len(in_mm) >= 4
        assert all(np.isnan(columns[name]).all() for name in in_mm)
    figures = comparison.to_json()
    assert set(figures["growth_mm"].values()) == {None}
    assert [figures[name] for name in ("growth_mm_per_day", "apart_mm", "bent_mm")] == [None] * 3
    assert figures["same"] > 30
    shown = _totals(comparison) + _trees_table(comparison) + _sizes_figure(comparison)
    assert "mm" not in shown
    assert ">growth units<" in shown
    words = re.sub("<[^>]+>", "", shown)
    low, high = re.search(r"(0\.00\d+) to (0\.00\d+) units \(95\s%\)", words).groups()
    assert 0.0035 < float(low) < 0.0045 < float(high) < 0.0055
    _show(comparison)
    assert "growth         no scale" in capsys.readouterr().out
    _write_table(tmp_path / "fruits.csv", comparison.columns())
    with (tmp_path / "fruits.csv").open() as file:
        assert {row["growth_mm"] for row in csv.DictReader(file)} == {""}


def test_the_page_says_which_survey_is_the_later_one_and_what_is_not_known_of_growth(tmp_path: Path) -> None:
    before, after = found(EARLY, 1), found(LATE, 2)
    report = replace(row_report(1, scene_points=10), fruits=before)
    backwards = compare_surveys(on_day(Survey(Path("b"), after), 40), on_day(Survey(Path("a"), before), 0))
    page = comparison_html(backwards, report, ("b", "a"))
    assert "a compared with b, 40 days earlier" in page
    assert "-40" not in page.split("<script")[0]
    in_both, alone = compared(before, after).pairs[0, 0], np.setdiff1d(np.arange(len(before)), backwards.pairs[:, 1])[0]
    for measured, said in ((in_both, "of too few fruits for an interval"), (alone, "no fruit was measured in both")):
        sizes = np.where(np.arange(len(before)) == measured, before.diameters_m, np.nan)
        comparison = compared(replace(before, diameters_m=sizes), after)
        assert said in _totals(comparison)
        assert "– to –" not in _totals(comparison) + _trees_table(comparison)


def test_a_pair_is_the_best_for_all_not_for_one() -> None:
    places = np.array([[0.0, 0, 0], [0.05, 0, 0], [5.0, 0, 0], [6.0, 0, 0]])
    target = np.array([[0.035, 0, 0], [0.085, 0, 0], [5.035, 0, 0], [9.0, 0, 0]])
    assert matched(places, target, 0.06).tolist() == [[0, 0], [1, 1], [2, 2]]


def test_what_shrank_by_next_to_nothing_has_no_negative_zero(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = found(EARLY, 1)
    comparison = compared(before, replace(before, diameters_m=before.diameters_m - 1e-6))  # 25 nm a day
    assert -2e-6 < comparison.growth().value < 0
    _show(comparison)
    _write_table(tmp_path / "fruits.csv", comparison.columns())
    _write_table(tmp_path / "trees.csv", comparison.tree_columns())
    told = capsys.readouterr().out
    figures = json.dumps(comparison.to_json())
    assert "0.0 mm (0.0 to 0.0), 0.000 mm a day over 40 days" in told
    for text in (told, figures, _totals(comparison), _trees_table(comparison), *(
        path.read_text() for path in tmp_path.glob("*.csv")
    )):  # fmt: skip
        assert not re.search(r"-0(\.0*)?(?![.\d])", text)
        assert "0.0" in text


def test_days_are_counted_forwards_where_the_older_survey_comes_second(capsys: pytest.CaptureFixture[str]) -> None:
    after = found(EARLY, 1)
    _show(replace(compared(after, replace(after, diameters_m=after.diameters_m - 0.004)), days=-40.0))
    assert "-4.0 mm (-4.0 to -4.0), 0.100 mm a day over 40 days" in capsys.readouterr().out


def test_classes_of_size_that_shrank_hang_below_those_that_grew() -> None:
    before = found(EARLY, 1)
    small = before.diameters_m < np.median(before.diameters_m)
    after = replace(before, diameters_m=before.diameters_m + np.where(small, 0.004, -0.002))
    figure = _sizes_figure(compared(before, after))
    bars = re.findall(
        r'<rect class="bar leaf"[^>]* y="([\d.]+)"[^>]* height="([\d.]+)"[^>]*><title>[^:]*: (\S+) ', figure
    )
    zero = next(
        float(y) for y, label in re.findall(r'y1="([\d.]+)"[^>]*/><text[^>]*>([^<]+)</text>', figure) if label == "0"
    )
    shrank = [(float(y), float(height)) for y, height, growth in bars if float(growth) < -1]
    grew = [(float(y), float(height)) for y, height, growth in bars if float(growth) > 1]
    assert len(shrank) >= 2 <= len(grew)
    assert all(y == zero for y, _ in shrank)
    assert all(y + height == pytest.approx(zero, abs=0.11) for y, height in grew)
    assert grew[0][1] == pytest.approx(2 * shrank[0][1], rel=0.02)


def test_the_command_writes_tables_a_plot_and_a_page(tmp_path: Path) -> None:
    surveys = [write_view_survey(tmp_path / name, count=40) for name in ("july", "august")]
    early = read_fruits(surveys[0] / "fruits.csv")
    write_fruits(surveys[0] / "fruits.csv", replace(early, diameters_m=early.diameters_m - 0.01)[np.arange(38)])
    arguments = ["compare", str(surveys[0]), str(surveys[1]), "--dates", "2026-07-01,2026-08-10"]
    out = tmp_path / "change"
    result = CliRunner().invoke(app, [*arguments, "--out", str(out), "--json"])
    assert result.exit_code == 0
    figures = json.loads(result.stdout)
    assert figures == json.loads((out / "comparison.json").read_text())
    assert (figures["before"], figures["after"]) == tuple(survey.name for survey in surveys)
    assert (figures["same"], figures["gone"], figures["days"]) == (38, 0, 40)
    with (out / "fruits.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 40
    assert [row["state"] for row in rows].count("same") == 38
    grown = [row for row in rows if row["growth_mm"]]
    assert {float(row["growth_mm"]) for row in grown} == {10.0}
    assert {float(row["growth_mm_per_day"]) for row in grown} == {0.25}
    assert sum(int(row["same"]) for row in csv.DictReader((out / "trees.csv").open())) == 38
    assert (out / "growth.svg").read_text().startswith("<svg")
    reference = (Path(__file__).parents[1] / "docs/reference/methods/compare.md").read_text()
    for part, names in (
        ("`fruits.csv`:", rows[0]),
        ("`trees.csv`:", next(csv.reader((out / "trees.csv").open()))),
        ("`comparison.json`:", json.loads((out / "comparison.json").read_text())),
    ):
        table = reference.split(f"\n{part}", 1)[1].split("\n\n", 2)[1]
        first_cells = "".join(line.split("|")[1] for line in table.splitlines()[2:])
        assert re.findall(r"`(\w+)`", first_cells) == list(names), part
    page = (out / "comparison.html").read_text()
    assert "38" in page
    assert "40 days later" in page
    assert '<data value="10.0" data-digits="1">10.0</data> <small>mm</small>' in page  # in the reader's language
    assert "growth         10.0 mm" in CliRunner().invoke(app, [*arguments, "--out", str(out)]).stdout
    with pytest.raises(SurveyError, match="holds something else"):
        pomona.compare(*surveys, out=surveys[0])
    undated = CliRunner().invoke(app, [*arguments[:3], "--out", str(out), "--json"])
    assert "Say the dates with --dates" in " ".join(json.loads(undated.stdout)["warnings"])
    assert "Say the dates with --dates" in (out / "comparison.html").read_text()
    refused = CliRunner().invoke(app, [*arguments[:3], "--out", str(out), "--dates", "spring"])
    assert refused.exit_code == 1
    assert "expected two days" in refused.stderr


@pytest.mark.parametrize("dates", [("2026-07-01", "2026-08-01"), (date(2026, 7, 1),), date(2026, 7, 1)])
def test_dates_of_another_kind_are_refused(dates: object) -> None:
    with pytest.raises(InputError, match=r"`dates`: expected a tuple of 2 \(date, date\), or None, found"):
        pomona.compare("july", "august", dates=dates)


def test_warnings_are_heard_by_who_listens_and_kept_in_their_words(tmp_path: Path) -> None:
    surveys = [write_view_survey(tmp_path / name, count=40) for name in ("july", "august ü")]
    listener = Silent()
    compared = pomona.compare(pomona.open(surveys[0]), pomona.open(surveys[1]), progress=listener)
    assert "Say the dates with `dates`" in " ".join(listener.warnings)
    assert compared.warnings == tuple(listener.warnings)
    out = tmp_path / "change"
    result = CliRunner().invoke(app, ["compare", *map(str, surveys), "--out", str(out), "--json"])
    for text in (result.stdout, result.stderr, (out / "comparison.json").read_text(), (out / PAGE).read_text()):
        assert "Say the dates with --dates" in text
        assert "`dates`" not in text


def test_an_option_that_compare_lacks_is_not_advised_where_photos_were_moved(tmp_path: Path) -> None:
    surveys = [write_view_survey(tmp_path / name, count=40) for name in ("july", "august")]
    (tmp_path / "august" / "photos").rename(tmp_path / "elsewhere")
    result = CliRunner().invoke(app, ["compare", *map(str, surveys), "--out", str(tmp_path / "change")])
    assert result.exit_code == 0
    assert "The photos were not found" in result.stderr
    assert "The same `pomona run` again, given the place where they are now, notes that" in result.stderr
    assert "--photos" not in result.stderr


def in_view_of_all_photos(places: np.ndarray, survey: Survey) -> np.ndarray:
    """What `_in_view` says, by asking every photo for every place."""
    cameras = survey.poses
    fruit, camera = _sightings(survey)
    away = np.linalg.norm(survey.fruits.centers_in_world[fruit] - cameras.centers_in_world[camera], axis=1)
    shown = np.zeros(len(places), int)
    for k in range(len(cameras)):
        xy_px, depths = cameras.project(k, places)
        inside = ((xy_px > 0) & (xy_px < [LENS.width_px, LENS.height_px])).all(axis=1) & (depths > 0)
        shown += inside & (np.linalg.norm(places - cameras.centers_in_world[k], axis=1) < np.percentile(away, 98))
    return shown >= 2


def test_places_in_view_are_found_by_the_photos_near_them() -> None:
    fruits = found(replace(EARLY, trees=3), 1)
    fruits = replace(fruits, sides=("east",) * len(fruits))
    cameras = row_cameras(9)

    class Whole(Survey):
        poses = cameras
        observations = observe(fruits, cameras)

    survey = Whole(Path("a"), fruits)
    places = np.random.default_rng(3).uniform([-5, -2.5, -1], [5, 2.5, 4], (3000, 3))
    places = np.concatenate([places, fruits.centers_in_world])
    expected = in_view_of_all_photos(places, survey)
    assert 0.1 < expected.mean() < 0.9
    assert _in_view(places, survey).tolist() == expected.tolist()


def test_a_place_that_no_photo_shows_is_out_of_view() -> None:
    fruits = found(replace(EARLY, trees=2), 1)
    cameras = row_cameras(8)
    fruits = replace(fruits, sides=("east",) * len(fruits))

    class Whole(Survey):
        poses = cameras
        observations = observe(fruits, cameras)

    survey = Whole(Path("a"), fruits)
    places = np.array([[0.5, 0, 1.5], [9.0, 0, 1.5], [0.5, 0, 30.0]])
    assert _in_view(places, survey).tolist() == [True, False, False]
