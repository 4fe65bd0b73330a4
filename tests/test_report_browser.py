"""The report in a real browser, opened from disk: no error, nothing fetched, a picture in 3D, a table that sorts."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from chromium import PATIENCE_MS, Opened, drawn, open_page, page_until, red_px
from pomona.stages.report import write_report
from pomona.stages.report.pdf import write_pdf
from pomona.values.cameras import WorldFrame
from pomona.values.fruits import FruitCloud, Observations
from pomona.values.trees import Trees
from report_scenes import row_cameras, row_report


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(row_report(60, scene_points=1000, title="<script>alert(1)</script>"), path)
    return path


@pytest.fixture(scope="module")
def opened(browser: Any, report: Path) -> Opened:
    return open_page(browser, report)


def test_opens_from_disk_without_error_or_network(opened: Opened, report: Path) -> None:
    assert opened.page.locator("html.has-webgl").count() == 1
    assert opened.said == []
    assert opened.asked == [report.as_uri()]
    assert opened.page.inner_text("h1") == "<script>alert(1)</script>"
    assert opened.page.locator("#fruits tbody tr").count() == 60


def test_view_shows_red_fruits_that_can_be_hidden(opened: Opened) -> None:
    shown = red_px(opened.page)
    assert 300 < shown < 100_000
    opened.page.uncheck("[data-layer=fruits]")
    assert red_px(opened.page) < 0.1 * shown
    opened.page.check("[data-layer=fruits]")


def test_table_sorts_with_unmeasured_last(opened: Opened) -> None:
    column = opened.page.locator("#fruits th button", has_text="diameter")
    shown = "[...document.querySelectorAll('#fruits tbody td:nth-child(5)')].map(cell => cell.textContent)"
    for sign in (1, -1):
        column.click()
        cells = opened.page.evaluate(shown)
        assert cells[-1] == "–"
        values = [sign * float(cell) for cell in cells[:-1]]
        assert values == sorted(values)
        assert len(values) == 59


def test_row_and_fruit_are_selected_together(opened: Opened) -> None:
    page = opened.page
    page.click("tr[data-id='40']")
    assert page.inner_text("#card h3") == "Fruit 40"
    # A click on a row brings its fruit to the middle of the view, where it can be clicked after it was left.
    page.keyboard.press("Escape")
    assert page.is_hidden("#card")
    assert page.locator("tr[aria-current]").count() == 0
    page.locator("#view canvas").scroll_into_view_if_needed()
    box = page.locator("#view canvas").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    selected = page.locator("tr[aria-current]")
    assert selected.count() == 1
    assert page.inner_text("#card h3") == f"Fruit {selected.get_attribute('data-id')}"
    assert opened.said == []


def test_the_table_of_fruits_does_not_scroll_sideways_on_a_laptop(browser: Any, report: Path) -> None:
    page = open_page(browser, report).page
    page.set_viewport_size({"width": 1400, "height": 900})
    widths = page.evaluate(
        "(box => [box.scrollWidth, box.clientWidth])(document.querySelector('#fruits').parentElement)"
    )
    assert widths[0] <= widths[1]
    page.close()


def test_packing_classes_can_be_chosen_and_typed(opened: Opened) -> None:
    page = opened.page

    def fruits() -> list[int]:
        cells = (
            "[...document.querySelectorAll('#packing-table tr td:nth-child(2)')].map(cell => Number(cell.textContent))"
        )
        return list(page.evaluate(cells))

    assert sum(fruits()) == 59  # one was not measured
    page.fill("#packing-edges", "70 80")
    assert len(fruits()) == 3
    assert sum(fruits()) == 59
    page.select_option("#packing-preset", "apples, 10 mm")
    assert page.input_value("#packing-edges") == "50 60 70 80 90"


def test_on_paper_the_view_is_a_picture_and_nothing_scrolls(browser: Any, report: Path, tmp_path: Path) -> None:
    page = open_page(browser, report).page
    drawn(page)
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.is_hidden("#view canvas")
    assert page.is_hidden("#view .tools")
    page_until(page, "document.querySelector('#still').naturalWidth > 100")
    assert page.is_visible("#still")
    assert page.evaluate("getComputedStyle(document.querySelector('.scroll')).overflow") == "visible"
    pages = page.pdf(prefer_css_page_size=True).count(b"/Type /Page\n")
    assert 2 <= pages <= 8
    page.close()


def test_a_pdf_is_printed_by_the_browser_that_is_there(browser: Any, report: Path, tmp_path: Path) -> None:
    write_pdf(report, tmp_path / "report.pdf")
    content = (tmp_path / "report.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    assert len(content) > 50_000  # with the picture of the row


def test_fits_a_phone(opened: Opened) -> None:
    opened.page.set_viewport_size({"width": 360, "height": 640})
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= 360


def test_no_fruit_opens_without_error(browser: Any, tmp_path: Path) -> None:
    write_report(row_report(0, scene_points=0), tmp_path / "empty.html")
    opened = open_page(browser, tmp_path / "empty.html")
    assert opened.page.locator("html.has-webgl").count() == 1
    assert opened.said == []
    assert opened.page.is_visible("text=No fruit was found")
    opened.page.close()


def test_without_webgl_it_says_so_and_the_table_works(browser: Any, report: Path) -> None:
    opened = open_page(browser, report, before="HTMLCanvasElement.prototype.getContext = () => null")
    assert opened.page.is_visible("text=This browser gives no WebGL")
    opened.page.click("#fruits th button >> nth=0")
    assert opened.page.locator("#fruits th").first.get_attribute("aria-sort") == "ascending"
    assert opened.said == []
    opened.page.close()


def test_of_very_many_fruits_the_first_ones_are_printed_and_the_rest_is_told(browser: Any, tmp_path: Path) -> None:
    data = replace(row_report(6000, scene_points=0), trees=Trees.empty(), observations=Observations.empty())
    write_report(replace(data, cloud=FruitCloud.empty()), tmp_path / "many.html")
    page = open_page(browser, tmp_path / "many.html").page
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert "3,000 more fruits are not printed" in page.inner_text("#fruits tbody tr:last-child")
    # As high as the rows that are there: with room for the others there would be a hundred empty pages more.
    rows_px = page.evaluate("document.querySelector('#fruits tbody tr:nth-child(2)').offsetHeight * 3001")
    assert page.evaluate("document.querySelector('#fruits').offsetHeight") < 1.1 * rows_px
    page.emulate_media(media="screen")
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.locator("#fruits tbody tr").count() < 200
    page.close()


def test_all_numbers_are_in_the_reader_s_language(browser: Any, tmp_path: Path) -> None:
    write_report(row_report(1500, scene_points=0), tmp_path / "german.html")
    context = browser.new_context(locale="de-DE")
    page = context.new_page()
    page.goto((tmp_path / "german.html").as_uri())
    page.wait_for_selector("html.has-webgl, html.no-webgl", timeout=PATIENCE_MS)
    read = "\n".join(page.inner_text(place) for place in (".totals", "#fruits", ".two", "#quality", ".hint"))
    assert "1.500" in read
    assert not re.search(r"\d,\d{3} (of|det|points)|\d\.\d{1,2}\b", read)
    context.close()


def test_without_a_scale_numbers_are_in_the_reader_s_language_too(browser: Any, tmp_path: Path) -> None:
    data, cameras = row_report(40, scene_points=0), row_cameras(8, WorldFrame())
    write_report(replace(data, cameras=cameras, weight=None), tmp_path / "units.html")
    context = browser.new_context(locale="de-DE", reduced_motion="reduce")
    page = context.new_page()
    page.goto((tmp_path / "units.html").as_uri())
    page.wait_for_selector("html.has-webgl, html.no-webgl", timeout=PATIENCE_MS)
    page.locator("#fruits tbody button").first.click()
    first, spread = data.fruits.diameters_m[0], data.fruits.diameter_sds_m[0]
    expected = f"{float(f'{first:.3g}'):g} ± {float(f'{spread:.3g}'):g} units".replace(".", ",")
    assert expected in page.inner_text("#card")
    context.close()
