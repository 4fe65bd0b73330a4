"""A big survey in a real browser: what is in the page and what is asked for does not grow with it, nothing is cut."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from chromium import Opened, drawn, open_page, page_until
from pomona.browser.view import ViewServer
from pomona.stages.report import ReportData, write_report
from report_scenes import observe, row_cameras, row_cloud, row_fruits, row_photos
from serving import running

pytestmark = pytest.mark.slow
_ELEMENTS = "() => document.querySelectorAll('*').length"
_FOCUSED = "() => document.activeElement.textContent"
_ROW = "() => document.activeElement.closest('tr').getAttribute('aria-rowindex')"
_TO_THE_TOP = "() => { document.querySelector('#fruits').parentElement.scrollTop = 0; }"


def _survey(fruits: int, per_side: int, scene_points: int) -> ReportData:
    cameras, found = row_cameras(per_side), row_fruits(fruits)
    return ReportData(
        title="big",
        photos=row_photos(cameras),
        cameras=cameras,
        fruits=found,
        observations=observe(found, cameras),
        cloud=row_cloud(found, scene_points),
    )


@contextmanager
def _served(browser: Any, data: ReportData) -> Iterator[Opened]:
    with running(ViewServer(data)) as server:
        opened = open_page(browser, server.url)
        opened.page.set_viewport_size({"width": 1200, "height": 800})
        yield opened
        assert opened.said == []
        opened.page.close()


@pytest.fixture(scope="module")
def big() -> ReportData:
    data = _survey(6000, 30, 400_000)
    assert len(data.observations) > 100_000
    return data


@pytest.fixture(scope="module")
def opened(browser: Any, big: ReportData) -> Iterator[Opened]:
    with _served(browser, big) as opened:
        yield opened


def test_page_has_hardly_more_elements_than_that_of_a_small_survey(browser: Any, opened: Opened) -> None:
    with _served(browser, _survey(150, 4, 1000)) as small:
        few = small.page.evaluate(_ELEMENTS)
        assert small.page.locator("#fruits tbody tr").count() == 150
    assert opened.page.evaluate(_ELEMENTS) < 1.2 * few
    assert opened.page.locator("#fruits tbody tr[data-id]").count() < 100


def test_all_points_come_in_pieces_and_none_twice(opened: Opened, big: ReportData) -> None:
    page_until(opened.page, "() => performance.getEntriesByName(new URL('data/points/scene/3.bin', location)).length")
    drawn(opened.page)
    asked = [url.split("/data/")[1] for url in opened.asked if "/data/" in url]
    scene, fruit = (len(big.cloud) - 6000 * 60, 6000 * 60)
    assert asked[0] == "survey.bin"
    assert asked[1:] == [f"points/scene/{k}.bin" for k in range(1, -(-scene // 125_000))]
    opened.page.check("[data-layer=fruitPoints]")
    page_until(opened.page, "() => performance.getEntriesByName(new URL('data/points/fruit/2.bin', location)).length")
    assert sum("points/fruit" in url for url in opened.asked) == -(-fruit // 125_000) - 1
    opened.page.uncheck("[data-layer=fruitPoints]")


def test_what_photos_saw_is_asked_for_by_fruit(opened: Opened, big: ReportData) -> None:
    page, before = opened.page, len(opened.asked)
    page.fill("#find-id", "12000")
    page.click("#find button")
    page.wait_for_selector(".crop")
    asked = [url.split("/data/")[1] for url in opened.asked[before:] if "/data/" in url]
    assert asked == ["fruits/12000.bin"]
    seen = int((big.observations.fruit_id == 12000).sum())
    assert page.locator(".crop").count() == min(seen, 12)


def test_table_is_reached_by_keyboard_and_says_where_one_is(opened: Opened) -> None:
    page = opened.page
    table = page.locator("#fruits")
    assert table.get_attribute("aria-rowcount") == "6001"
    page.locator('#fruits button[tabindex="0"]').focus()
    page.keyboard.press("Home")
    assert page.evaluate(_FOCUSED) == "2"
    for _ in range(60):
        page.keyboard.press("ArrowDown")
    assert page.evaluate(_FOCUSED) == "122"
    assert page.evaluate(_ROW) == "62"
    page.keyboard.press("End")
    assert page.evaluate(_FOCUSED) == "12000"
    assert page.evaluate(_ROW) == "6001"
    box, line = table.locator("..").bounding_box(), page.locator("tr[aria-current]").bounding_box()
    assert box["y"] < line["y"] < box["y"] + box["height"]
    # Scrolled out of sight, the row leaves the page; the keyboard stays in the table and goes on from there.
    page.evaluate(_TO_THE_TOP)
    page.wait_for_selector("tr[data-id='2']")
    assert page.locator("tr[data-id='12000']").count() == 0
    assert page.evaluate("() => document.activeElement === document.querySelector('#fruits').parentElement")
    page.keyboard.press("ArrowUp")
    assert page.inner_text("#card h3") == "Fruit 11998"


def test_every_row_can_be_sorted_to_and_filtered(opened: Opened, big: ReportData) -> None:
    page = opened.page
    page.evaluate(_TO_THE_TOP)
    heading = page.locator("#fruits th button", has_text="score")
    heading.click()
    heading.click()
    best = int(big.fruits.ids[np.argmax(big.fruits.scores)])
    assert page.locator("#fruits tbody tr[data-id]").first.get_attribute("data-id") == str(best)
    page.click("#tool-filter")
    page.fill("#limit-score", "0.99")
    few = int((big.fruits.scores >= 0.99).sum())
    assert page.inner_text("#limit-count") == f"{few:,} of 6,000 fruits"
    assert page.locator("#fruits").get_attribute("aria-rowcount") == str(few + 1)
    page.click("#limit-reset")
    page.click("#tool-filter")


def test_report_says_what_it_leaves_out(browser: Any, big: ReportData, tmp_path: Path) -> None:
    write_report(dataclasses.replace(big, title="report"), tmp_path / "report.html")
    opened = open_page(browser, tmp_path / "report.html")
    left_out = opened.page.inner_text("#left-out")
    assert f"300,000 of {len(big.cloud):,} points" in left_out
    assert "pomona view SURVEY" in left_out
    assert opened.asked == [(tmp_path / "report.html").as_uri()]
    assert opened.said == []
    opened.page.close()
