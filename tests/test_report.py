"""The report as HTML: complete, escaped, without a network; and its 3D data, decoded again."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray
from pomona.errors import InputError
from pomona.evaluate.fruits import Truth
from pomona.stages.capture.quality import Problems
from pomona.stages.report import ReportData, ReportOptions, engines_of, settings_in_words, write_report
from pomona.stages.report.axes import places_along, row_axes, seen_from
from pomona.stages.report.columns import as_bytes
from pomona.stages.report.html import about
from pomona.stages.report.page import Sections, _left_out, _view_note, page_html, report_html
from pomona.stages.report.plots import bin_edges, heights, photos
from pomona.stages.report.quality import quality
from pomona.stages.report.scene import SceneOptions, survey_data
from pomona.stages.report.seen import kept_of_each
from pomona.stages.report.svg import (
    Axis,
    Bar,
    Dot,
    Point,
    column_chart,
    dot_chart,
    nice_step,
    row_chart,
    scatter_chart,
)
from pomona.stages.report.tables import trees_table
from pomona.stages.report.totals import duration, totals
from pomona.stages.report.truth import counts_by_tree
from pomona.stages.scale import ScaleReport, SideTie
from pomona.stages.scale.report import Accuracy
from pomona.stages.sfm.pieces import Unregistered
from pomona.values.cameras import WorldFrame
from pomona.values.crop import Crop, SizeDistribution
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.intervals import CropInterval
from pomona.values.photos import ONE_SIDE, Photo, Photos, Skipped
from report_scenes import LENS, looking, row_cameras, row_cloud, row_fruits, row_photos, row_report, unpacked, values_in

_VOID = {"meta", "br", "input", "link", "img"}


class _Page(HTMLParser):
    """Collects elements and texts, and checks that they are nested."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, str] = {}
        self._open: list[str] = []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in _VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        key = self._open[-1] if self._open else ""
        name = self.elements[-1][1].get("id") if self.elements else None
        self.texts[name or key] = self.texts.get(name or key, "") + data

    def tags(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


def as_read(page: str) -> str:
    """The page with numbers as they are read where no script writes them in the reader's language."""
    return re.sub("</?data[^>]*>", "", page).replace("\N{NO-BREAK SPACE}", " ")


def payload(data: ReportData, *, max_points: int | None = 600_000) -> dict[str, Any]:
    values: dict[str, Any] = unpacked(as_bytes(survey_data(data, SceneOptions(max_points=max_points))))
    return values


@pytest.fixture(scope="module")
def data() -> ReportData:
    return row_report()


@pytest.fixture(scope="module")
def text(data: ReportData) -> str:
    return report_html(data)


def test_page_is_well_formed_and_carries_every_fruit(data: ReportData, text: str) -> None:
    _Page(text)
    assert values_in(text)["fruits"]["ids"] == data.fruits.ids.tolist()


def test_totals_say_what_the_values_say(data: ReportData, text: str) -> None:
    shown = re.sub(r"<[^>]+>", " ", text[text.index('<div class="totals">') : text.index("<section")])
    words = " ".join(shown.split())
    median_mm = 1000 * np.nanmedian(data.fruits.diameters_m)
    for expected in (
        "Fruits 240 from 1,234 detections",
        f"Median diameter {median_mm:.1f} mm",
        "16 of 17",
    ):
        assert expected in words
    times = text[text.index("<h2>Time per stage</h2>") :]
    assert ">1 min 49 s in all, at most " in times[: times.index("</div>")]
    assert "approximate" not in words
    assert "Marker 7 was never seen" in text
    assert "Hold still." in text
    assert "the image is truncated" in text


def test_weight_is_shown_with_its_interval_and_where_it_is_from(data: ReportData, text: str) -> None:
    total = data.weight
    assert total is not None
    assert f">{total.kg:.1f}</data> <small>kg</small>" in text
    shown = as_read(text)
    assert f"{total.low_kg:.1f} to {total.high_kg:.1f} kg (95 %)" in shown
    assert "g each, estimated from 26 weighed apples (cultivar Story)" in shown
    assert "1 not measured" in shown


def test_every_tree_has_a_line(data: ReportData, text: str) -> None:
    table = text[text.index("<h2>Trees</h2>") :]
    table = table[: table.index("</table>")]
    assert table.count("<tr>") == 1 + len(data.trees)
    for tree in range(len(data.trees)):
        low, high = data.trees.fruits_low[tree], data.trees.fruits_high[tree]
        assert f"{low} to {high}" in as_read(table)
    assert data.trees.fruits.sum() == len(data.fruits)


def test_sizes_on_trees_are_in_no_unit_without_a_scale(data: ReportData) -> None:
    unscaled = replace(data, cameras=replace(data.cameras, frame=WorldFrame()))
    table = as_read(trees_table(unscaled))
    assert "median diameter units" in table
    assert "mm" not in table
    assert f">{data.trees.diameters_m[0]:.3g}<" in table


def test_quality_is_gathered_with_advice_that_names_photos(data: ReportData, text: str) -> None:
    section = text[text.index('<section class="sheet" id="quality">') :]
    section = section[: section.index("</section>")]
    assert f"<td>{len(data.cameras)} of {len(data.photos)}</td>" in re.sub(' class="[^"]*"', "", section)
    assert f"{data.lost[0].photo}: {data.lost[0].advice}" in section
    assert "would close the gap" not in section
    east = [i for i, name in enumerate(data.cameras.photos) if name.startswith("east")]
    kept = np.array([i for i in range(len(data.cameras)) if i not in east[2:6]])
    cameras = replace(
        data.cameras,
        photos=tuple(data.cameras.photos[i] for i in kept),
        intrinsics_idx=data.cameras.intrinsics_idx[kept],
        cam_from_world=data.cameras.cam_from_world[kept],
    )
    gap = report_html(replace(data, cameras=cameras))
    before, after = (data.cameras.photos[east[k]] for k in (1, 6))
    assert f"nothing lies between {before} and {after}" in gap


def test_photos_that_are_blurred_or_badly_lit_are_named_and_fine_ones_are_not(data: ReportData) -> None:
    first, second, third = data.photos.names[:3]
    said = report_html(replace(data, problems=Problems(blurred=(first, second), dark=(), bright=(third,), gap=())))
    section = said[said.index('<section class="sheet" id="quality">') :]
    section = section[: section.index("</section>")]
    assert f"{first}, {second}: hold still, walk more slowly or expose shorter" in section
    assert f"{third}: expose shorter, or keep the sky out of them" in section
    assert ">2</td>" in section
    assert "dark photos" not in section
    fine = report_html(replace(data, problems=Problems((), (), (), ())))
    assert not [word for word in ("blurred photos", "dark photos", "too bright") if word in fine]


def test_chosen_packing_classes_come_first(data: ReportData, text: str) -> None:
    first = re.search(r'<select id="packing-preset"><option data-edges="([^"]+)">([^<]+)<', text)
    assert first is not None
    assert first.groups() == ("50 60 65 70 75 80 85 90", "apples, 5 mm")
    assert '<option data-edges="61 72.5">own</option>' in report_html(replace(data, packing="61,72.5"))


def test_sizes_of_the_whole_crop_stand_beside_those_measured(data: ReportData, text: str) -> None:
    edges = tuple(np.arange(0.05, 0.1, 0.0005).tolist())
    below = tuple((400 * np.clip((np.array(edges) - 0.06) / 0.02, 0, 1)).tolist())
    sizes = SizeDistribution((0.07, 0.074, 0.08), (0.062, 0.07, 0.078), "so", edges, below, below)
    every = CropInterval(400, 380, 420, "all")
    shown = report_html(replace(data, crop=Crop(every, every, None, None, 2, None, sizes)))
    assert "of the whole crop; 80 % lie between 62 and 78 mm" in as_read(shown)
    assert shown.count('<path class="outline"') == 1
    crop = json.loads(unescape(re.search(r'id="packing" data-crop="([^"]+)"', shown).group(1)))  # type: ignore[union-attr]
    assert crop["edges"][0] == 50
    assert crop["fruits"][-1] == 400
    assert len(crop["edges"]) == len(crop["fruits"]) == len(crop["kg"])
    assert 'class="outline"' not in text


@pytest.mark.parametrize("sagitta_m", [0.0, 4.0, 8.0])
def test_places_along_a_row_follow_its_bend(sagitta_m: float) -> None:
    rng, data = np.random.default_rng(0), row_report(count=600, scene_points=0)
    along, across = np.sort(rng.uniform(-30, 30, 600)), rng.uniform(-0.5, 0.5, 600)
    bend = 8 * sagitta_m / 60**2
    xy = np.column_stack([along, across])
    if bend:
        radius = 1 / bend - across
        xy = np.column_stack([radius * np.sin(along * bend), 1 / bend - radius * np.cos(along * bend)])
    centers = np.column_stack([xy, rng.uniform(1, 2, 600)])
    places = places_along(replace(data, fruits=replace(data.fruits, centers_in_world=centers)))
    assert places.min() == 0
    assert places == pytest.approx(along - along[0], abs=0.4)


def test_broken_numbers_of_plots_can_be_written_as_the_reader_does(text: str) -> None:
    ticks = re.findall(r'<text[^>]*>(<tspan data-value="(-?\d+\.\d+)">\2</tspan>)', text)
    assert len(ticks) > 3
    assert not re.search(r"<text[^>]*>-?\d+\.\d+</text>", text)


def test_a_kind_of_fruit_is_called_by_its_name(data: ReportData, tmp_path: Path) -> None:
    write_report(replace(data, fruit_words="cherries"), tmp_path / "report.html")
    assert '<div class="label">Cherries</div>' in (tmp_path / "report.html").read_text()


def test_nothing_is_fetched(text: str) -> None:
    page = _Page(text)
    for tag, attributes in page.elements:
        for name in ("src", "href", "srcset", "action", "data"):
            value = attributes.get(name) or "#"
            assert value.startswith("#"), f"<{tag} {name}={value}>"
    assert not page.tags("link")
    assert not re.search(r"url\(|@import", "".join(re.findall(r"<style>(.*?)</style>", text, re.DOTALL)))
    assert "default-src 'none'" in text


def test_policy_knows_the_script_that_is_there(text: str) -> None:
    script = text[text.rindex("<script>") + len("<script>") : text.rindex("</script>")]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in text
    assert "<!--" not in script
    assert "MIT License" in script


def test_names_of_files_are_never_html(data: ReportData) -> None:
    evil = '</script><img src=x onerror="alert(1)">&.JPG'
    cameras = replace(data.cameras, photos=(evil, *data.cameras.photos[1:]))
    photos = Photos((Photo(evil, Path("x"), 800, 600, side="<i>"),), skipped=(Skipped(evil, evil),))
    seen = replace(data.observations, photo=(evil,) * len(data.observations))
    lost = (Unregistered(evil, evil, evil, evil),)
    evil_data = replace(
        data, title=evil, photos=photos, cameras=cameras, observations=seen, lost=lost, warnings=(evil,), version=evil
    )
    text = report_html(evil_data)
    page = _Page(text)
    assert not [image for image in page.tags("img") if image.get("src")]
    assert len(page.tags("script")) == 2
    assert page.texts["title"].startswith(f"{evil} · Pomona")
    assert values_in(text)["photos"]["names"][0] == evil


def test_positions_and_colours_come_back(data: ReportData) -> None:
    values = payload(data)
    fruit = values["fruitPoints"]
    packed = fruit["points"].reshape(-1, 4)
    middle = np.median(data.fruits.centers_in_world, axis=0)
    points = packed[:, :3] / 65535 * fruit["size"] + fruit["min"] + middle
    on_fruit = data.cloud.fruit_id > 0
    step = np.array(fruit["size"]) / 65535
    assert fruit["count"] == len(packed) == on_fruit.sum()
    # In an order by chance: each is the nearest of the points that were given.
    away, idx = cKDTree(data.cloud.points_in_world[on_fruit]).query(points)
    assert away.max() <= 0.9 * np.linalg.norm(step)
    assert len(np.unique(idx)) == len(idx)
    assert np.ptp(idx[: len(idx) // 10]) > 0.9 * len(idx)
    colours = np.stack([packed[:, 3] >> 11, packed[:, 3] >> 5 & 63, packed[:, 3] & 31], axis=1) * [8, 4, 8]
    assert (data.cloud.rgb[on_fruit][idx] - colours).min() >= 0
    assert (data.cloud.rgb[on_fruit][idx] - colours).max() < 8
    centers = values["fruits"]["centers"].reshape(-1, 3) + middle
    assert np.allclose(centers, data.fruits.centers_in_world, atol=1e-6)
    assert np.isnan(values["fruits"]["diameters"][3])


def test_rotations_and_lenses_are_the_cameras(data: ReportData) -> None:
    photos = payload(data)["photos"]
    assert np.allclose(photos["rotations"].reshape(-1, 3, 3), data.cameras.cam_from_world[:, :, :3])
    assert np.allclose(photos["lenses"].reshape(-1, 4)[0], [700, 700, 400, 300])


def test_frusta_show_where_cameras_look(data: ReportData) -> None:
    frusta = payload(data)["photos"]["frusta"].reshape(-1, 5, 3)
    middle = np.median(data.fruits.centers_in_world, axis=0)
    for k in range(len(data.cameras)):
        assert np.allclose(frusta[k, 0] + middle, data.cameras.centers_in_world[k], atol=1e-6)
        pinhole = replace(data.cameras, intrinsics=(type(LENS)("PINHOLE", 800, 600, np.array([700.0, 700, 400, 300])),))
        corners, _ = pinhole.project(k, frusta[k, 1:] + middle)
        assert np.allclose(corners, [[0, 0], [800, 0], [800, 600], [0, 600]], atol=0.01)


def test_sightings_name_fruit_and_camera(data: ReportData) -> None:
    values = payload(data)["sightings"]
    pairs = zip(np.repeat(np.arange(len(data.fruits)), np.diff(values["starts"])), values["photos"], strict=True)
    named = {(int(data.fruits.ids[f]), data.cameras.photos[c]) for f, c in pairs}
    assert named == set(zip(data.observations.fruit_id.tolist(), data.observations.photo, strict=True))


def test_size_is_bounded_and_both_kinds_of_points_keep_half() -> None:
    many = row_report(0)
    fruits = row_fruits(200)
    many = replace(many, fruits=fruits, cloud=row_cloud(fruits, 30_000))
    values = payload(many, max_points=4000)
    assert values["scene"]["count"] == values["fruitPoints"]["count"] == 2000
    values = payload(many, max_points=15_000)
    assert (values["scene"]["count"], values["fruitPoints"]["count"]) == (7500, 7500)
    values = payload(many, max_points=20_000)
    assert (values["scene"]["count"], values["fruitPoints"]["count"]) == (10_000, 10_000)
    values = payload(many, max_points=None)
    assert 29_900 < values["scene"]["count"] <= 30_000  # strays far outside are left out
    assert values["fruitPoints"]["count"] == 12_000


def test_what_is_left_out_is_said(data: ReportData, text: str) -> None:
    left_out = '<p class="note" id="left-out"></p>'
    assert left_out in text
    values = survey_data(data, SceneOptions(max_points=1000, max_sightings=len(data.fruits) * 2))
    page = page_html(data, values)
    assert left_out not in page
    assert f"it has 1,000 of {len(data.cloud):,} points, at most 2 of the photos that saw each fruit." in as_read(page)
    starts = values_in(page)["sightings"]["starts"]
    seen = np.bincount(data.observations.fruit_id, minlength=data.fruits.ids.max() + 1)[data.fruits.ids]
    assert np.array_equal(np.diff(starts), np.minimum(seen, 2))


def test_options_say_how_many_points_and_sightings_are_left_out(data: ReportData) -> None:
    values = values_in(report_html(data, ReportOptions(max_points=1000, max_sightings=len(data.fruits) * 2)))
    assert values["scene"]["count"] + values["fruitPoints"]["count"] == 1000
    assert np.diff(values["sightings"]["starts"]).max() == 2
    with pytest.raises(InputError, match=r"ReportOptions\.max_points: expected at least 1, found 0"):
        ReportOptions(max_points=0)


def test_of_many_sightings_each_fruit_keeps_the_same_number() -> None:
    counts = np.array([9, 3, 1, 0])
    assert [kept_of_each(counts, most) for most in (99, 13, 12, 6, 3, 0)] == [9, 9, 8, 2, 1, 1]
    assert kept_of_each(np.zeros(0, np.int64), 5) == 1


def test_stray_points_do_not_coarsen_the_rest(data: ReportData) -> None:
    cloud = data.cloud
    strays = np.array([[1e6, 0, 0], [np.nan, 0, 0]])
    with_strays = FruitCloud(
        np.concatenate([cloud.points_in_world, strays]),
        np.concatenate([cloud.rgb, np.zeros((2, 3), np.uint8)]),
        np.concatenate([cloud.fruit_id, [0, 0]]),
    )
    assert payload(replace(data, cloud=with_strays))["scene"]["size"] == payload(data)["scene"]["size"]


def test_photos_are_counted_as_the_command_counts_them(data: ReportData) -> None:
    def card(data: ReportData) -> str:
        words = re.sub("<[^>]+>", " ", as_read(totals(data)))
        return re.sub(r"[ ,]+", " ", words[words.index("Photos used") :])

    used, usable = len(data.cameras), len(data.photos)
    assert card(data).startswith(f"Photos used {used} of {usable} 1 without a place 1 more file left out")
    nowhere = replace(data, cameras=row_cameras().of_photos(()), lost=(), photos=Photos(data.photos.items))
    assert card(nowhere).startswith(f"Photos used 0 of {usable} {usable} without a place")
    all_placed = replace(data, lost=(), photos=Photos(data.photos.items[:-1]))
    assert card(all_placed).startswith(f"Photos used {used} of {used} all of them have a place")


def test_of_one_side_no_side_is_named(data: ReportData) -> None:
    """What the only side is called tells a person nothing."""
    assert set(values_in(report_html(data))["fruits"]["sides"]) == {"east", "west"}
    photos = Photos(tuple(replace(photo, side=ONE_SIDE) for photo in data.photos))
    fruits = replace(data.fruits, sides=(ONE_SIDE,) * len(data.fruits))
    said = report_html(replace(data, photos=photos, fruits=fruits))
    assert set(values_in(said)["fruits"]["sides"]) == {""}
    assert "<td>steps of the walk</td>" in re.sub(' class="[^"]*"', "", said)


def test_one_fruit_is_no_median_of_many() -> None:
    said = re.sub("<[^>]+>", "", as_read(report_html(replace(row_report(1), detections=1))))
    assert "from 1 detection, seen" in said
    assert " each" not in said[said.index("from 1 detection, seen") :][:40]
    assert "in fewer than" not in said


def test_no_fruit_is_a_valid_report() -> None:
    empty = replace(row_report(0, scene_points=0), cameras=row_cameras(frame=WorldFrame()))
    text = report_html(empty)
    _Page(text)
    assert "No fruit was found" in text
    assert "not known" in text
    assert values_in(text)["fruits"]["ids"] == []


def test_least_survey_of_all() -> None:
    cameras = replace(row_cameras(1), photos=(), intrinsics_idx=np.zeros(0, int), cam_from_world=np.zeros((0, 3, 4)))
    _Page(report_html(ReportData(title="", photos=Photos(()), cameras=cameras, fruits=Fruits.empty())))
    one = row_fruits(1)
    _Page(report_html(ReportData(title="one", photos=Photos(()), cameras=cameras, fruits=one)))


def test_approximate_scale_is_said(data: ReportData, tmp_path: Path) -> None:
    frame = WorldFrame("fruit-diameter", approximate=True)
    write_report(replace(data, cameras=replace(data.cameras, frame=frame)), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert '<span class="badge">approximate</span>' in text
    assert "from an assumed fruit diameter" in text
    assert "which way is up is a guess" in text


def test_row_runs_along_the_cameras_and_one_looks_from_them(data: ReportData) -> None:
    axes = row_axes(replace(data, observations=Observations.empty()))
    assert np.allclose(axes.along, [1, 0, 0], atol=0.02)
    assert abs(axes.toward[1]) == pytest.approx(1, abs=0.02)


def test_first_look_is_from_where_most_photos_were_taken(data: ReportData) -> None:
    west = np.array([photo.startswith("west") for photo in data.observations.photo])
    for kept, sign in ((west, 1), (~west, -1)):
        seen_once = replace(data, observations=data.observations[kept])
        toward = seen_from(seen_once, row_axes(seen_once))
        assert np.linalg.norm(toward) == pytest.approx(1)
        assert 0.85 < sign * toward[1] <= 1


def test_first_look_follows_a_camera_that_moves_forward() -> None:
    # Photos on a way towards the fruits: the row's axis is that way, and one looks along it.
    fruits = row_fruits(20)
    poses = [looking(np.array([-x, 0.0, 1.5]), np.array([0.0, 0.0, 1.5])) for x in (4.0, 3.5, 3.0, 2.5)]
    cameras = replace(
        row_cameras(1), photos=tuple("abcd"), intrinsics_idx=np.zeros(4, np.int64), cam_from_world=np.array(poses)
    )
    seen = Observations(np.repeat(fruits.ids, 4), tuple("abcd") * 20, np.arange(80), np.zeros((80, 2)))
    data = ReportData(title="", photos=Photos(()), cameras=cameras, fruits=fruits, observations=seen)
    axes = row_axes(data)
    assert abs(axes.toward[0]) < 0.1
    assert seen_from(data, axes)[0] < -0.9


@pytest.mark.parametrize(
    ("span", "steps", "expected"), [(10, 5, 2), (10, 4, 2.5), (1, 4, 0.25), (300, 4, 100), (0.07, 7, 0.01), (1, 1, 1)]
)
def test_nice_step(span: float, steps: int, expected: float) -> None:
    assert nice_step(span, steps) == pytest.approx(expected)


@pytest.mark.parametrize(
    "values", [[1.0], [2.0, 2.0], [0.0], [-3.0, 5.0, 7.5], [0.3, 0.7, 1.1], list(np.linspace(60, 90, 500))]
)
def test_bins_hold_all_values(values: list[float]) -> None:
    edges = bin_edges(np.array(values))
    assert 2 <= len(edges) <= 40
    assert np.histogram(values, edges)[0].sum() == len(values)


def test_zero_height_is_written_as_zero(data: ReportData) -> None:
    centers = np.array([[0.0, 0.0, -0.83], [0.0, 0.0, 0.79]])
    fruits = Fruits(np.array([1, 2]), centers, np.full(2, 0.07), np.ones(2), np.ones(2, np.int64))
    chart = heights(replace(data, fruits=fruits))
    assert ">0<" in chart
    assert not re.search(r"\de-\d", chart)


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [(0.04, "0.0 s"), (9.94, "9.9 s"), (9.96, "10 s"), (59.6, "1 min 00 s"), (307, "5 min 07 s"), (7530, "2 h 05 min")],
)
def test_duration(seconds: float, expected: str) -> None:
    assert as_read(duration(seconds)) == expected


def test_how_well_sides_agree_is_said(data: ReportData, tmp_path: Path) -> None:
    tie = SideTie("east", "west", "fruits", 34, 7.4, float("nan"))
    fruits = replace(data.fruits, sides=("both", "both", *data.fruits.sides[2:]))
    write_report(replace(data, fruits=fruits, scale=ScaleReport("markers", ties=(tie,))), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Sides agree to" in text
    assert "7 <small>mm</small>" in text
    both = sum(side == "both" for side in fruits.sides)
    assert 2 <= both < 34  # those that were compared are not part of these: some are no fruits any more
    assert f"34 fruits placed by each side alone, {both} seen from both, which" in as_read(text)
    assert "which brought the sides into one frame" in text
    write_report(replace(data, scale=ScaleReport("markers")), tmp_path / "report.html")
    assert "Sides agree" not in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_short_row_from_the_side_is_no_wider_than_the_charts_beside_it() -> None:
    short, long = (
        dot_chart([Dot(x, z, 0.04, "") for x in (0.0, length) for z in (0.5, 2.5)], Axis(name="m"), Axis(name="z"))
        for length in (1.8, 12.0)
    )
    assert '<svg class="plot"' in short
    assert '<svg class="plot map"' in long


def starts_of_labels(chart: str) -> list[float]:
    """Where the labels on the left of a chart begin, in a font of 12 px whose digits are wide (DejaVu Sans)."""
    found = re.findall(r'<text x="([\d.]+)" y="[\d.]+" text-anchor="end">(?:<tspan[^>]*>)?(-?[\d.]+)<', chart)
    return [float(x) - sum({".": 3.8, "-": 10.0}.get(letter, 7.6) for letter in label) for x, label in found]


def test_labels_on_the_left_are_not_cut_off() -> None:
    axis = Axis(name="m")
    charts = [
        column_chart([Bar(-0.06, ""), Bar(0.03, "")], axis, counts=False),
        column_chart([Bar(120_000, "")], axis),
        row_chart([Bar(3, "")], Axis(name="z, m", ticks=[(0, "-0.025"), (1, "-100.25")])),
        dot_chart([Dot(x, z, 0.04, "") for x in (0.0, 40.0) for z in (-1000.06, -996.02)], axis, axis),
        scatter_chart([Point(100_000, 140_000, "")], axis, axis),
    ]
    starts = [starts_of_labels(chart) for chart in charts]
    assert [len(each) > 1 for each in starts] == [True] * len(charts)
    assert min(map(min, starts)) >= 0


@pytest.mark.parametrize("length", [0.3, 1.8, 12.0, 200.0])
def test_labels_of_the_row_from_the_side_do_not_overlap(length: float) -> None:
    dots = [Dot(x, z, 0.04, "") for x in (0.0, length) for z in (0.5, 2.5)]
    chart = dot_chart(dots, Axis(name="m from the first fruit"), Axis(name="z, m"))
    numbers = re.findall(
        r'<text x="([\d.]+)" y="([\d.]+)" text-anchor="(middle|end)">(?:<tspan[^>]*>)?-?[\d.]+<', chart
    )
    along = [float(x) for x, _, anchor, *_ in numbers if anchor == "middle"]
    upward = [-float(y) for _, y, anchor, *_ in numbers if anchor == "end"]
    assert along
    assert np.diff(along).min(initial=100) > 25
    assert np.diff(upward).min(initial=100) > 12
    name = re.search(r'<text x="([\d.]+)"[^>]*>m from', chart)
    width = re.search(r'viewBox="0 0 (\d+) ', chart)
    assert name is not None
    assert width is not None
    half_px = 3 * len("m from the first fruit")
    assert half_px < float(name[1]) < float(width[1]) - half_px


def test_each_photo_has_one_number(data: ReportData) -> None:
    few = replace(data, photos=Photos(data.photos.items[:5]))
    assert re.findall(r">(\d)</text>", photos(few).split("</rect>")[-1]) == ["1", "2", "3", "4", "5"]


def test_a_fruit_of_which_a_photo_has_two_masks_is_seen_once_in_it(data: ReportData) -> None:
    seen = data.observations
    cut = data.observations[[*range(len(seen)), 0, 0]]
    assert photos(replace(data, observations=cut)) == photos(data)


def test_the_row_is_drawn_from_the_side_and_each_tree_has_a_bar(data: ReportData, text: str) -> None:
    drawing = text[text.index('<svg class="plot map"') :]
    drawing = drawing[: drawing.index("</svg>")]
    assert drawing.count("<circle") == len(data.fruits)
    places = [float(x) for x in re.findall(r'cy="([\d.]+)"', drawing)]
    heights = data.fruits.centers_in_world[:, 2]
    assert max(places) - min(places) == pytest.approx(260, abs=20)  # as high as charts of one scale are
    highest = data.fruits.ids[np.argmax(heights)]
    assert f"fruit {highest}</title>" in drawing.split("<circle")[1 + int(np.argmin(places))]
    assert "on each tree" in text
    for tree, fruits in zip(data.trees.ids, data.trees.fruits, strict=True):
        assert f"<title>tree {tree}: {fruits} " in text


def test_numbers_and_days_carry_what_a_reader_s_language_needs(data: ReportData, text: str) -> None:
    assert f'<data value="{len(data.fruits)}" data-digits="0">' in text
    assert not re.search(r"<data value=\"[^\"]*,", text)


def test_no_number_is_left_in_another_language_than_those_beside_it() -> None:
    data = row_report(3000, scene_points=5000)
    crop = Crop(*(CropInterval(v, 0.9 * v, 1.1 * v, "all") for v in (2900.0, 4321.0, 1234.5)), None, 2)
    exact = ScaleReport(source="markers", accuracy=Accuracy(3.1, 0.0009))
    data = replace(data, crop=crop, detections=12345, corrections=1000, scale=exact)
    sections = Sections.of(data)
    values = survey_data(data, SceneOptions(max_points=2000))
    for part in (sections.totals, sections.tables, sections.photos, _left_out(data, values), _view_note(data, values)):
        assert "<data" in part
        without = re.sub(r"<data.*?</data>|<[^>]*>", " ", part)
        assert not re.search(r"\d[.,]\d", without)


@pytest.mark.parametrize(
    ("value", "digits", "said"),
    [(0.0374, 2, "0.037"), (0.5, 2, "0.5"), (12.34, 3, "12.3"), (1234.56, 3, "1,235"), (99.6, 2, "100"), (0, 2, "0")],
)
def test_about_how_much(value: float, digits: int, said: str) -> None:
    assert as_read(about(value, digits)) == said
    assert as_read(about(-value, digits)) == (f"-{said}" if value else "0")
    assert about(float("nan")) == "–"


def test_a_pdf_without_a_browser_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pomona.stages.report import pdf

    monkeypatch.setattr(pdf, "find_browser", lambda: None)
    with pytest.raises(InputError, match="install Chromium, Chrome or Edge"):
        pdf.write_pdf(tmp_path / "report.html", tmp_path / "report.pdf")
    browser = tmp_path / "browser"
    browser.write_text("#!/bin/sh\necho broken >&2\n")
    browser.chmod(0o755)
    monkeypatch.setattr(pdf, "find_browser", lambda: str(browser))
    with pytest.raises(InputError, match=r"wrote no PDF .*broken"):
        pdf.write_pdf(tmp_path / "report.html", tmp_path / "report.pdf")


def test_settings_and_versions_are_told_without_folders(data: ReportData) -> None:
    options = {"markers": "/home/ann/row 7/markers.csv", "use_gnss": True, "fruit": None, "sides": ["a/east", "a/west"],
               "object": {"min_views": 3}}  # fmt: skip
    settings = settings_in_words(options)
    assert settings == {"markers": "markers.csv", "use gnss": "yes", "sides": "east, west"}
    engines = engines_of([{"numpy": "1.26"}, {"cv2": "4.11", "numpy": "1.26"}])
    text = report_html(replace(data, settings=settings, engines=engines))
    assert "<dt>markers</dt><dd>markers.csv</dd>" in text
    assert "numpy 1.26, cv2 4.11" in text
    assert "/home/ann" not in text


def test_an_accuracy_that_checks_contradict_is_red(data: ReportData, tmp_path: Path) -> None:
    exact = ScaleReport("markers", accuracy=Accuracy(3.1, 0.0009))
    write_report(replace(data, scale=exact), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "± 0.09 %, positions ± 3.1 mm" in as_read(text)
    assert "contradicted by" not in text
    write_report(replace(data, scale=replace(exact, contradictions=("one", "two"))), tmp_path / "report.html")
    text = as_read((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert re.search(
        r'<strong style="color: var\(--apple\)">[^<]*positions ± 3.1 mm; contradicted by 2 of the notes', text
    )


def test_with_the_truth_the_paper_s_table_and_figure_are_there(data: ReportData) -> None:
    fruits = data.fruits
    # All but the first ten are true, and five more were not found.
    centers = np.concatenate([fruits.centers_in_world[10:], np.array([[0.0, 0, 9.0 + k] for k in range(5)])])
    trees = np.concatenate([fruits.tree_ids[10:], np.full(5, 3)])
    truth = Truth(np.arange(len(centers)) + 1, centers, np.full(len(centers), 0.075), trees)
    text = report_html(data, truth=truth)
    table = text[text.index("<h2>Against the truth</h2>") :]
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", table[: table.index("</table>")])
    assert cells[:3] == ["all", str(len(truth)), str(len(fruits))]
    assert abs(int(cells[3]) - (len(fruits) - 10)) <= 2  # one of the ten may hang beside another true one
    assert 0.93 < float(cells[8]) < 1
    ids, true, found = counts_by_tree(data, truth)
    assert ids.tolist() == [1, 2, 3]
    assert true.sum() == len(truth)
    assert found.sum() == len(fruits)
    rmse = float(np.sqrt(((true - found) ** 2).mean()))
    assert f"RMSE {rmse:.1f} fruits" in text
    assert f"tree 3: {found[2]} of {true[2]}" in text
    assert "Against the truth" not in report_html(data)


def test_a_chart_of_many_dots_is_a_few_shapes() -> None:
    dots = [Dot(0.01 * k, 1 + 0.5 * (k % 7), 0.04, f"fruit {k}", ("", "other")[k % 2]) for k in range(3000)]

    few, many = (dot_chart(some, Axis(name="m"), Axis(name="z")) for some in (dots[:50], dots))

    assert (few.count("<circle"), few.count("<title>"), few.count("<path")) == (50, 50, 0)
    assert (many.count("<circle"), many.count("<title>"), many.count("<path")) == (0, 0, 2)
    assert many.count("M") == 3000


def _walked(xy: FloatArray, side: str = "row") -> ReportData:
    """A report of photos taken at places (n, 2), one after another, of one side."""
    poses = [looking(np.array([x, y, 1.4]), np.array([x, y + 3, 1.5])) for x, y in xy]
    cameras = replace(
        row_cameras(1),
        photos=tuple(f"{side}/IMG_{i:03d}.JPG" for i in range(len(xy))),
        intrinsics_idx=np.zeros(len(xy), np.int64),
        cam_from_world=np.array(poses),
    )
    return ReportData(title="", photos=row_photos(cameras), cameras=cameras, fruits=row_fruits(0))


def _steps_in_words(data: ReportData) -> str:
    section = as_read(quality(data))
    return section[section.index("steps of the walk") :]


@pytest.mark.parametrize("turned_deg", [30, 90, 150])
def test_gaps_of_a_walk_are_found_as_the_row_bends(turned_deg: float) -> None:
    turns = np.radians(turned_deg) * (np.linspace(0, 1, 81) - 0.5)
    on_arc = 40 / np.radians(turned_deg) * np.column_stack([np.sin(turns), 1 - np.cos(turns)])
    assert re.search(r">0\.(49|5) m as a rule", _steps_in_words(_walked(on_arc)))
    assert "would close the gap" not in _steps_in_words(_walked(on_arc))
    gap = _walked(np.delete(on_arc, [4, 5, 6], axis=0))
    assert "nothing lies between row/IMG_003.JPG and row/IMG_004.JPG" in _steps_in_words(gap)


@pytest.mark.parametrize("length_m", [4.0, 30.0])
def test_a_row_walked_there_and_back_in_one_folder_has_no_gap(length_m: float) -> None:
    x = np.arange(0, length_m, 0.5)
    there = np.column_stack([x, np.full(len(x), -3.0)])
    data = _walked(np.concatenate([there, there[::-1] * [1, -1]]))
    assert np.abs(row_axes(data).along) == pytest.approx([1, 0, 0], abs=1e-6)
    assert "0.5 m as a rule, 0.5 m at most" in _steps_in_words(data)
    assert "would close the gap" not in _steps_in_words(data)


def test_photos_at_several_heights_are_no_steps() -> None:
    rng = np.random.default_rng(0)
    stops = np.repeat(np.column_stack([np.arange(12.0), np.zeros(12)]), 3, axis=0)
    data = _walked(stops + rng.normal(0, 0.02, stops.shape))
    assert re.search(r">(0\.9\d|1) m as a rule, 1 m at most", _steps_in_words(data))
    assert "would close the gap" not in _steps_in_words(data)


def test_one_fruit_is_spoken_of_in_the_singular() -> None:
    page = report_html(row_report(1, scene_points=50))
    assert ": 1 fruit</title>" in page
    assert "one fruit measured" in page
    assert "Fruits along the row" not in page
    assert "Fruits by height" not in page
    assert not re.search(r"\b1(?:</data>)? fruits(?! in fewer)", page)
    assert "80 % lie between" not in page
