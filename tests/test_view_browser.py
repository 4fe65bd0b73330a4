"""`pomona view` in a real browser: layers, a click on a fruit and on a camera, crops, photos, tools, truth."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from chromium import PATIENCE_MS, Opened, drawn, open_page, page_until, red_px
from pomona.browser.view import ViewServer, export_folder, read_survey, truth_data
from pomona.evaluate.fruits import read_truth
from pomona.stages.report.page import write_report
from pomona.stages.report.scene import origin_of
from report_scenes import row_report
from serving import running
from view_scenes import write_truth, write_view_survey

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_view_survey(tmp_path_factory.mktemp("view"))


@pytest.fixture(scope="module")
def url(survey: Path) -> Iterator[str]:
    data = read_survey(survey)
    write_truth(survey.parent / "truth.csv", survey)
    truth = truth_data(data.fruits, read_truth(survey.parent / "truth.csv"), origin_of(data))
    with running(ViewServer(data, truth=truth)) as server:
        yield server.url


@pytest.fixture(scope="module")
def opened(browser: Any, url: str) -> Iterator[Opened]:
    opened = open_page(browser, url)
    opened.page.set_viewport_size({"width": 1200, "height": 800})
    yield opened
    # After all that was done: nothing was complained of, nothing came from elsewhere.
    assert opened.said == []
    assert [asked for asked in opened.asked if not asked.startswith((url, "data:"))] == []
    opened.page.close()


def _center(page: Any) -> tuple[float, float]:
    drawn(page)
    box = page.locator("#view canvas").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def _picture(page: Any, *, still: bool = True) -> Any:
    """The pixels (h, w, 3; BGR) of the view below its tools and right of its panels."""
    drawn(page, still=still)
    box = page.locator("#view").bounding_box()
    clip = {"x": box["x"] + 250, "y": box["y"] + 150, "width": box["width"] - 260, "height": box["height"] - 200}
    encoded = np.frombuffer(page.screenshot(clip=clip), np.uint8)
    return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR)).astype(int)


def _red(page: Any) -> Any:
    pixels = _picture(page)
    return (pixels[:, :, 2] > 90) & (pixels[:, :, 2] > 2 * pixels[:, :, 1])


def _open_fruit(page: Any, fruit: int) -> None:
    page.fill("#find-id", str(fruit))
    page.click("#find button")
    page.wait_for_selector("#card:not([hidden])")


def _loaded(page: Any, selector: str) -> None:
    page_until(page, "s => [document.querySelector(s)].some(i => i?.complete && i.naturalWidth > 0)", arg=selector)


def test_view_comes_first_and_truth_is_beside_it(opened: Opened) -> None:
    page = opened.page
    view, totals = page.locator("#view").bounding_box(), page.locator(".totals").bounding_box()
    assert view["y"] < totals["y"]
    assert page.inner_text("#truth-rates").split() == ["P", "0.917", "R", "0.917", "F1", "0.917"]
    assert page.inner_text("#truth-counts").split("\n") == ["22 true", "2 false", "2 missed", "0 doubled"]


def test_score_slider_moves_the_scores_and_hides_fruits(opened: Opened) -> None:
    page = opened.page
    assert page.is_visible("#limits")  # with the truth it is open
    page.fill("#limit-score", "0.8")
    shown = int(page.inner_text("#limit-count").split()[0])
    assert 0 < shown < 24
    true, false = (int(text.split()[0]) for text in page.inner_text("#truth-counts").split("\n")[:2])
    assert true + false == shown
    assert page.locator("#fruits tbody tr:not([hidden])").count() == shown
    page.fill("#limit-high", "60")
    assert int(page.inner_text("#limit-count").split()[0]) < shown
    page.select_option("#limit-tree", "2")
    page.click("#limit-reset")
    assert page.inner_text("#limit-count") == "24 of 24 fruits"
    assert page.input_value("#limit-tree") == "0"
    page.click("#tool-filter")
    assert page.is_hidden("#limits")


@pytest.mark.parametrize("size", [(360, 640), (640, 400)])  # a phone; a laptop that shows all twice as large
def test_panels_can_be_used_beside_a_selected_fruit_on_a_narrow_screen(
    browser: Any, url: str, size: tuple[int, int]
) -> None:
    page = open_page(browser, url).page
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.set_default_timeout(10_000)
    _open_fruit(page, 8)
    page.fill("#limit-score", "0.8")
    page.click("#limit-reset")
    assert page.inner_text("#limit-count") == "24 of 24 fruits"
    page.click("#card .close")
    page.close()


def test_each_layer_can_be_seen_and_hidden(opened: Opened) -> None:
    page = opened.page
    page.select_option("#colour-by", "fruit")

    for layer in ("fruits", "fruitPoints", "scene", "cameras", "row", "ground"):
        page.click("[data-look=top]" if layer in ("row", "ground") else "[data-look=photos]")
        before = _picture(page)
        box = page.locator(f"[data-layer={layer}]")
        box.click()
        assert (_picture(page) != before).sum() > 100, layer
        box.click()
        assert (_picture(page) != before).sum() < 100, layer


def test_looks_and_fly_along_move_the_picture(opened: Opened) -> None:
    page = opened.page
    seen = set()
    for look in ("top", "side", "back", "front", "photos"):
        page.click(f"[data-look={look}]")
        seen.add(_picture(page).tobytes())
    page.click("#tool-fly")  # without motion: a step
    seen.add(_picture(page).tobytes())
    assert len(seen) == 6
    page.click("[data-look=photos]")


def test_click_on_a_sphere_shows_the_fruit_and_its_crops(opened: Opened) -> None:
    page = opened.page
    _open_fruit(page, 20)
    page.click("#card .close")
    page.mouse.click(*_center(page))
    chosen = page.inner_text("#card h3")
    assert re.fullmatch(r"Fruit \d+", chosen)
    facts = page.inner_text("#card dl")
    for label in ("Score", "Diameter", "Tree", "Side", "Seen in", "x, y, z"):
        assert label in facts
    assert re.search(r"\d+\.\d ± 3\.0 mm", facts)
    _loaded(page, ".crop img")
    page.wait_for_selector(".crop svg path.mine")
    assert page.locator(".crop").count() == page.locator(".crop svg path.mine").count() >= 1


def test_click_on_a_crop_opens_the_photo_with_all_outlines(opened: Opened) -> None:
    page = opened.page
    _open_fruit(page, 20)
    page.locator(".crop").first.click()
    page.wait_for_selector("#photo[open]")
    _loaded(page, "#photo .photo-sheet img")
    page.wait_for_selector("#photo path.mine")
    assert page.locator("#photo path").count() > page.locator("#photo path.mine").count() == 1
    # The outline lies in the middle of the stage, around red.
    outline, stage = page.locator("#photo path.mine").bounding_box(), page.locator("#photo .stage").bounding_box()
    assert abs(outline["x"] + outline["width"] / 2 - stage["x"] - stage["width"] / 2) < stage["width"] / 4
    first = page.inner_text("#photo-name")
    page.uncheck("#photo-only")
    page.keyboard.press("ArrowRight")
    assert page.inner_text("#photo-name") != first
    page.click("#photo-previous")
    assert page.inner_text("#photo-name") == first
    page.click("#photo-whole")
    other = page.locator("#photo path.other").first
    expected = re.search(r"Fruit (\d+)", other.locator("title").text_content() or "")
    assert expected
    other.click()
    assert page.locator("#photo[open]").count() == 0
    assert page.inner_text("#card h3") == f"Fruit {expected[1]}"


def test_the_wheel_zooms_where_the_pointer_is_and_a_window_of_another_size_keeps_the_photo(opened: Opened) -> None:
    page = opened.page
    _open_fruit(page, 20)
    page.locator(".crop").first.click()
    page.wait_for_selector("#photo path.mine")
    page.click("#photo-whole")
    stage = page.locator("#photo .stage").bounding_box()
    x, y = stage["x"] + 0.4 * stage["width"], stage["y"] + 0.7 * stage["height"]

    def at_pointer() -> tuple[float, float, float]:
        box = page.locator("#photo .photo-sheet").bounding_box()
        return (x - box["x"]) / box["width"], (y - box["y"]) / box["height"], box["width"]

    before = at_pointer()
    page.mouse.move(x, y)
    page.mouse.wheel(0, -200)
    page_until(page, "w => document.querySelector('#photo .photo-sheet').getBoundingClientRect().width > w", before[2])
    after = at_pointer()
    assert after[2] > 1.3 * before[2]
    assert after[:2] == pytest.approx(before[:2], abs=0.003)

    page.click("#photo-whole")
    page.set_viewport_size({"width": 400, "height": 800})
    whole = "(() => { const inner = document.querySelector('#photo .photo-sheet').getBoundingClientRect();"
    whole += " const room = document.querySelector('#photo .stage').getBoundingClientRect();"
    whole += " return inner.width > room.width - 2 && Math.abs(inner.left - room.left) < 2; })()"
    page_until(page, whole)
    page.set_viewport_size({"width": 1200, "height": 800})
    page.click("#photo-close")


def test_looking_through_a_camera_lays_the_photo_over_the_scene(opened: Opened) -> None:
    page = opened.page
    page.select_option("#colour-by", "fruit")
    _open_fruit(page, 20)
    page.locator(".crop").first.click()
    page.wait_for_selector("#photo[open]")
    page.click("#photo-through")
    page.wait_for_selector("#through:not([hidden])")
    _loaded(page, "#through-photo")
    page.click("#card .close")
    # With the photo wholly there and wholly gone, red is at the same places: camera and photo agree.
    for layer in ("scene", "cameras", "row", "ground"):
        page.uncheck(f"[data-layer={layer}]")
    page.evaluate("document.querySelectorAll('.tools, .panels, .hint, #legend').forEach(e => e.style.opacity = 0)")
    masks = []
    for transparency in ("0", "100"):
        page.fill("#through-opacity", transparency)
        masks.append(_red(page))
    page.evaluate("document.querySelectorAll('.tools, .panels, .hint, #legend').forEach(e => e.style.opacity = '')")
    side, _ = page.inner_text("#through-name").split("/")
    # The scene shows fruits of both sides; those of the photo's side are drawn in the photo.
    assert side in ("east", "west")
    assert masks[0].sum() > 100
    assert (masks[0] & masks[1]).sum() > 0.8 * masks[0].sum()
    name = page.inner_text("#through-name")
    page.click("#through-next")
    assert page.inner_text("#through-name") != name
    page.click("#through-close")
    assert page.is_hidden("#through")
    assert page.is_hidden("#through-photo")
    for layer in ("scene", "cameras", "row", "ground"):
        page.check(f"[data-layer={layer}]")


def test_click_on_a_camera_looks_through_it(opened: Opened) -> None:
    page = opened.page
    page.keyboard.press("Escape")
    page.click("[data-look=photos]")
    drawn(page)
    box = page.locator("#view").bounding_box()
    ys, xs = range(int(box["height"]) - 40, 160, -14), range(20, int(box["width"]) - 20, 14)
    for x, y in ((box["x"] + x, box["y"] + y) for y in ys for x in xs):
        page.mouse.move(x, y)
        if "look through" in (page.locator("#tip").text_content() or ""):
            name = (page.locator("#tip").text_content() or "").split(":")[0]
            page.mouse.click(x, y)
            break
    assert page.inner_text("#through-name") == name
    # A drag leaves the camera.
    page.mouse.down()
    page.mouse.move(x + 40, y + 10, steps=4)
    page.mouse.up()
    assert page.is_hidden("#through")


def test_measured_distance_is_that_of_the_fruits(opened: Opened) -> None:
    page = opened.page
    page.click("#tool-measure")
    _open_fruit(page, 20)
    page.mouse.click(*_center(page))
    _open_fruit(page, 30)
    page.mouse.click(*_center(page))
    found = re.search(r"([\d.]+) m$", page.inner_text("#measured"))
    assert found
    places = []
    for fruit in (20, 30):
        cells = page.locator(f"tr[data-id='{fruit}'] td").all_inner_texts()
        places.append(np.array([float(cell) for cell in cells[1:4]]))
    # The nearer of two fruits in one line may have been met.
    assert abs(float(found[1]) - np.linalg.norm(places[0] - places[1])) < 0.3
    page.click("#tool-measure")
    assert page.is_hidden("#measured")


def test_keyboard_reaches_table_view_and_photos(opened: Opened) -> None:
    page = opened.page
    page.keyboard.press("Escape")
    page.locator('#fruits button[tabindex="0"]').focus()
    page.keyboard.press("Enter")
    first = page.inner_text("#card h3")
    page.keyboard.press("ArrowDown")
    assert page.inner_text("#card h3") != first
    focused = page.evaluate("document.activeElement.textContent")
    assert page.inner_text("#card h3") == f"Fruit {focused}"
    assert page.inner_text("#live").startswith(f"Fruit {focused} selected")
    page.locator("#view canvas").focus()
    before = _picture(page)
    page.keyboard.press("ArrowLeft")
    assert (_picture(page) != before).sum() > 1000
    page.keyboard.press("Home")
    page.locator(".crop").first.focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("#photo[open]")
    page.keyboard.press("Escape")
    assert page.locator("#photo[open]").count() == 0


def test_every_control_has_a_name(opened: Opened) -> None:
    nameless = opened.page.evaluate(
        """[...document.querySelectorAll('button, input, select, canvas')].filter(e =>
             !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length)).map(e => e.outerHTML)"""
    )
    assert nameless == []


def test_search_says_when_there_is_no_such_fruit(opened: Opened) -> None:
    page = opened.page
    page.fill("#find-id", "7777")
    page.click("#find button")
    assert page.inner_text("#live") == "There is no fruit 7777"
    page.fill("#find-id", "20")


def test_dark_and_light(opened: Opened) -> None:
    page = opened.page
    colour = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(colour)
    page.click("#tool-light")
    assert page.evaluate(colour) != light
    page.click("#tool-light")
    assert page.evaluate(colour) == light


def _comes(page: Any, holds: Callable[[], bool]) -> bool:
    """Wait until something holds, as long as pages may take; say whether it does."""
    for _ in range(PATIENCE_MS // 300):
        if holds():
            return True
        page.wait_for_timeout(300)
    return False


def _stands_still(page: Any) -> bool:
    before = _picture(page)
    page.wait_for_timeout(300)
    return bool((_picture(page) != before).sum() < 100)


def test_fly_along_moves_until_it_is_stopped(browser: Any, url: str) -> None:
    page = browser.new_page(viewport={"width": 1200, "height": 800}, reduced_motion="no-preference")
    page.set_default_timeout(PATIENCE_MS)
    page.goto(url)
    page.wait_for_selector("html.has-webgl")
    before = _picture(page)
    page.click("#tool-fly")
    assert _comes(page, lambda: (_picture(page, still=False) != before).sum() > 1000)
    assert page.get_attribute("#tool-fly", "aria-pressed") == "true"
    page.click("#tool-fly")
    assert _comes(page, lambda: _stands_still(page))
    assert page.get_attribute("#tool-fly", "aria-pressed") == "false"
    page.close()


def test_exported_folder_works_from_disk(browser: Any, survey: Path, tmp_path: Path) -> None:
    page_path = export_folder(read_survey(survey), tmp_path / "out")
    opened = open_page(browser, page_path)
    page = opened.page
    _open_fruit(page, 20)
    _loaded(page, ".crop img")
    page.wait_for_selector(".crop svg path.mine")
    page.locator(".crop").first.click()
    _loaded(page, "#photo .photo-sheet img")
    assert page.locator("#photo path").count() > 1
    page.click("#photo-through")
    _loaded(page, "#through-photo")
    assert opened.said == []
    assert all(asked.startswith((tmp_path.as_uri(), "data:")) for asked in opened.asked)
    page.close()


def test_report_has_crops_and_says_where_photos_are(browser: Any, survey: Path, tmp_path: Path) -> None:
    write_report(read_survey(survey), tmp_path / "report.html")
    opened = open_page(browser, tmp_path / "report.html")
    page = opened.page
    _open_fruit(page, 20)
    _loaded(page, ".crop img")
    page.wait_for_selector(".crop svg path.mine")
    assert "pomona view" in page.inner_text("#card .note")
    page.locator(".crop").first.click()
    assert "pomona view" in page.inner_text("#photo-missing")
    # It has the outlines of its crops alone, which are not all that was detected in the photo.
    page.wait_for_selector("#photo path.mine")
    outlines = page.locator("#photo path").count()
    assert page.inner_text("#photo-summary") == f"{outlines} outline{'s' * (outlines > 1)} of this photo in this file"
    assert opened.said == []
    page.close()


def test_a_photo_that_goes_away_while_the_page_is_open_is_told_of(browser: Any, tmp_path: Path) -> None:
    data = read_survey(write_view_survey(tmp_path))
    fruit, name = int(data.observations.fruit_id[0]), data.observations.photo[0]
    photo = tmp_path / "photos" / name
    with running(ViewServer(data)) as server:
        page = open_page(browser, server.url).page
        photo.rename(photo.with_suffix(".away"))
        _open_fruit(page, fruit)
        page.click(f"#card .crop:has(.no-picture)[title='{name}']")
        page.wait_for_selector("#photo-missing:has-text('This photo is not where it was, or was changed')")
        assert page.is_hidden("#photo img")
        page.click("#photo-through")
        page.wait_for_selector("#through-note:has-text('This photo is not where it was, or was changed')")
        assert page.is_hidden("#through-photo")
        photo.with_suffix(".away").rename(photo)
        page.click("#through-next")
        page.click("#through-previous")
        _loaded(page, "#through-photo")
        assert page.inner_text("#through-note") == ""
        page.close()


def test_a_stopped_server_is_told_of(browser: Any, survey: Path) -> None:
    with running(ViewServer(read_survey(survey))) as server:
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.route("**/data/survey.bin", lambda route: route.abort())
        page.goto(server.url)
        page.wait_for_selector("#no-data:not([hidden])")
        assert page.is_visible("text=still running")
        page.close()


def test_red_fruits_are_seen(opened: Opened) -> None:
    opened.page.select_option("#colour-by", "fruit")
    opened.page.click("[data-look=photos]")
    assert red_px(opened.page) > 300


def test_many_fruits_are_drawn_as_discs_and_can_be_clicked(browser: Any, tmp_path: Path) -> None:
    write_report(row_report(3100, scene_points=100), tmp_path / "many.html")
    opened = open_page(browser, tmp_path / "many.html")
    page = opened.page
    page.set_viewport_size({"width": 1200, "height": 800})
    assert _red(page).sum() > 3000
    page.uncheck("[data-layer=fruits]")
    assert _red(page).sum() < 300
    page.check("[data-layer=fruits]")
    _open_fruit(page, 20)
    page.click("#card .close")
    page.locator("#view").scroll_into_view_if_needed()
    page.mouse.click(*_center(page))
    assert re.fullmatch(r"Fruit \d+", page.inner_text("#card h3"))
    assert opened.said == []
    page.close()
