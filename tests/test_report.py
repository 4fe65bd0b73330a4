"""The report as HTML: complete, escaped, without a network; and its 3D data, decoded again."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.arrays import Array
from pomona.cameras import WorldFrame
from pomona.fruits import FruitCloud, Fruits, Observations
from pomona.photos import Photo, Photos, Skipped
from pomona.report import ReportData, write_report
from pomona.report.axes import row_axes, seen_from
from pomona.report.contract import to_json
from pomona.report.page import report_html
from pomona.report.plots import bin_edges, heights
from pomona.report.scene import SceneOptions, survey_data
from pomona.report.svg import nice_step
from pomona.report.totals import duration
from pomona.scale import ScaleReport, SideTie
from pomona.sfm.values import Unregistered
from report_scenes import LENS, looking, row_cameras, row_cloud, row_fruits, row_report

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


def _scene(text: str) -> dict[str, object]:
    found = re.search(r'<script type="application/json" id="survey-data">(.*?)</script>', text, re.DOTALL)
    assert found
    values: dict[str, object] = json.loads(found[1])
    return values


def payload(data: ReportData, *, max_points: int = 600_000) -> dict[str, Any]:
    values: dict[str, Any] = to_json(survey_data(data, SceneOptions(max_points=max_points)))
    return values


def _numbers(text: str, dtype: str) -> Array:
    return np.frombuffer(base64.b64decode(text), dtype)


@pytest.fixture(scope="module")
def data() -> ReportData:
    return row_report()


@pytest.fixture(scope="module")
def text(data: ReportData) -> str:
    return report_html(data)


def test_page_is_well_formed_and_has_a_row_for_each_fruit(data: ReportData, text: str) -> None:
    page = _Page(text)
    ids = [int(row["data-id"] or 0) for row in page.tags("tr") if "data-id" in row]
    assert ids == data.fruits.ids.tolist()


def test_totals_say_what_the_values_say(data: ReportData, text: str) -> None:
    shown = re.sub(r"<[^>]+>", " ", text[text.index('<div class="totals">') : text.index("<section")])
    words = " ".join(shown.split())
    median_mm = 1000 * np.nanmedian(data.fruits.diameters_m)
    for expected in (
        "Fruits 240 from 1,234 detections",
        f"Median diameter {median_mm:.1f} mm",
        "16 of 18",
        "1 min 49 s",
    ):
        assert expected in words
    assert "approximate" not in words
    assert "Marker 7 was never seen" in text
    assert "Hold still." in text
    assert "the image is truncated" in text


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
    assert _scene(text)["photos"]["names"][0] == evil  # type: ignore[index]


def test_positions_and_colours_come_back(data: ReportData) -> None:
    values = payload(data)
    fruit = values["fruitPoints"]
    packed = _numbers(fruit["positions"], "<u2").reshape(-1, 3)
    middle = np.median(data.fruits.centers_in_world, axis=0)
    points = packed / 65535 * fruit["size"] + fruit["min"] + middle
    on_fruit = data.cloud.fruit_id > 0
    step = np.array(fruit["size"]) / 65535
    assert fruit["count"] == on_fruit.sum()
    assert np.all(np.abs(points - data.cloud.points_in_world[on_fruit]) <= 0.51 * step)
    assert np.array_equal(_numbers(fruit["colours"], "u1").reshape(-1, 3), data.cloud.rgb[on_fruit])
    centers = _numbers(values["fruits"]["centers"], "<f4").reshape(-1, 3) + middle
    assert np.allclose(centers, data.fruits.centers_in_world, atol=1e-6)
    assert np.isnan(_numbers(values["fruits"]["diameters"], "<f4")[3])


def test_rotations_and_lenses_are_the_cameras(data: ReportData) -> None:
    photos = payload(data)["photos"]
    assert np.allclose(_numbers(photos["rotations"], "<f4").reshape(-1, 3, 3), data.cameras.cam_from_world[:, :, :3])
    assert np.allclose(_numbers(photos["lenses"], "<f4").reshape(-1, 4)[0], [700, 700, 400, 300])


def test_frusta_show_where_cameras_look(data: ReportData) -> None:
    frusta = _numbers(payload(data)["photos"]["frusta"], "<f4").reshape(-1, 5, 3)
    middle = np.median(data.fruits.centers_in_world, axis=0)
    for k in range(len(data.cameras)):
        assert np.allclose(frusta[k, 0] + middle, data.cameras.centers_in_world[k], atol=1e-6)
        pinhole = replace(data.cameras, intrinsics=(type(LENS)("PINHOLE", 800, 600, np.array([700.0, 700, 400, 300])),))
        corners, _ = pinhole.project(k, frusta[k, 1:] + middle)
        assert np.allclose(corners, [[0, 0], [800, 0], [800, 600], [0, 600]], atol=0.01)


def test_sightings_name_fruit_and_camera(data: ReportData) -> None:
    values = payload(data)["sightings"]
    pairs = zip(_numbers(values["fruits"], "<u4"), _numbers(values["photos"], "<u4"), strict=True)
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


def test_stray_points_do_not_coarsen_the_rest(data: ReportData) -> None:
    cloud = data.cloud
    strays = np.array([[1e6, 0, 0], [np.nan, 0, 0]])
    with_strays = FruitCloud(
        np.concatenate([cloud.points_in_world, strays]),
        np.concatenate([cloud.rgb, np.zeros((2, 3), np.uint8)]),
        np.concatenate([cloud.fruit_id, [0, 0]]),
    )
    assert payload(replace(data, cloud=with_strays))["scene"]["size"] == payload(data)["scene"]["size"]


def test_no_fruit_is_a_valid_report() -> None:
    empty = replace(row_report(0, scene_points=0), cameras=row_cameras(frame=WorldFrame()))
    text = report_html(empty)
    _Page(text)
    assert "No fruit was found" in text
    assert "not known" in text
    assert _scene(text)["fruits"]["ids"] == []  # type: ignore[index]


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


@pytest.mark.parametrize("values", [[1.0], [2.0, 2.0], [0.0], [-3.0, 5.0, 7.5], list(np.linspace(60, 90, 500))])
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
    assert duration(seconds) == expected


def test_how_well_sides_agree_is_said(data: ReportData, tmp_path: Path) -> None:
    tie = SideTie("east", "west", "fruits", 34, 7.4, float("nan"))
    fruits = replace(data.fruits, sides=("both", "both", *data.fruits.sides[2:]))
    write_report(replace(data, fruits=fruits, scale=ScaleReport("markers", ties=(tie,))), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Sides agree to" in text
    assert "7 <small>mm</small>" in text
    both = sum(side == "both" for side in fruits.sides)
    assert f"{both} fruits seen from both, 34 of them placed by each side alone" in text
    assert "which brought the sides into one frame" in text
    write_report(replace(data, scale=ScaleReport("markers")), tmp_path / "report.html")
    assert "Sides agree" not in (tmp_path / "report.html").read_text(encoding="utf-8")
