"""Correcting in a real browser: each kind by mouse and by keyboard, undo, redo, export, and another run after it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from chromium import Opened, open_page, page_until
from correct_scenes import FALSE_ONE, GRID, MISSED, TWINS, Scene, masks_of, write_scene
from pomona.browser.view import Corrector, ViewServer, export_folder, read_survey
from pomona.cli.app import app
from pomona.corrections import read_corrections
from pomona.formats.detections.coco import write_coco
from pomona.formats.tables import read_fruits
from pomona.survey import SurveyFolder
from report_scenes import row_photos
from serving import running

pytestmark = pytest.mark.slow
# From pixels of the photo to the screen: scale, left, top.
_PLACED = """(() => {
    const placed = new DOMMatrix(getComputedStyle(document.querySelector('#photo .photo-sheet')).transform);
    const { left, top } = document.querySelector('#photo .stage').getBoundingClientRect();
    return [placed.a, placed.e + left, placed.f + top];
})()"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return write_scene(tmp_path_factory.mktemp("row"))


def _server(scene: Scene) -> ViewServer:
    corrector = Corrector(SurveyFolder.open(scene.survey), read_survey(scene.survey))
    return ViewServer(corrector.data, corrector=corrector)


@pytest.fixture(scope="module")
def server(scene: Scene) -> Iterator[ViewServer]:
    with running(_server(scene)) as started:
        yield started


@pytest.fixture(scope="module")
def opened(browser: Any, server: ViewServer) -> Iterator[Opened]:
    opened = open_page(browser, server.url)
    opened.page.set_viewport_size({"width": 1200, "height": 800})
    opened.page.click("#tool-correct")
    yield opened
    assert opened.said == []
    assert [asked for asked in opened.asked if not asked.startswith((server.url, "data:"))] == []
    opened.page.close()


def _choose(page: Any, fruit: int) -> None:
    page.fill("#find-id", str(fruit))
    page.click("#find button")
    page.wait_for_selector(f"#card:not([hidden]) h3:text-is('Fruit {fruit}')")


def _fruit(server: ViewServer, place: Any, within_m: float = 0.03) -> int:
    """The number that the page has of the fruit at a place; 0 for none."""
    assert server.corrector is not None
    fruits = server.corrector.data.fruits
    away = np.linalg.norm(fruits.centers_in_world - place, axis=1)
    return int(fruits.ids[away.argmin()]) if away.min() < within_m else 0


def _changes(page: Any, act: Any) -> str:
    """Do something that corrects; returns what the page then says."""
    with page.expect_navigation():
        act()
    page.wait_for_selector("html.has-webgl")
    page.wait_for_selector("#live:not(:empty)", state="attached")
    return str(page.inner_text("#correct-text"))


def _click_in_photo(page: Any, scene: Scene, place: Any) -> None:
    cameras = scene.taken_by
    k = cameras.photos.index(page.inner_text("#photo-name"))
    (x, y) = cameras.project(k, np.asarray(place)[None])[0][0]
    scale, left, top = page.evaluate(_PLACED)
    page.mouse.click(left + scale * x, top + scale * y)


def _advice(page: Any, beginning: str) -> None:
    page_until(page, "text => document.querySelector('#marking-text').textContent.startsWith(text)", arg=beginning)


def test_a_false_fruit_is_deleted_undone_and_deleted_again(opened: Opened, server: ViewServer, scene: Scene) -> None:
    page = opened.page
    assert page.is_disabled("#correct-delete")
    assert page.is_disabled("#correct-undo")
    false = _fruit(server, GRID[FALSE_ONE])
    _choose(page, false)
    page.select_option("#colour-by", "views")
    page.uncheck("[data-layer=ground]")
    assert _changes(page, lambda: page.click("#correct-delete")) == f"Fruit {false} deleted. 15 fruits"
    # All else is as it was.
    assert page.input_value("#colour-by") == "views"
    assert not page.is_checked("[data-layer=ground]")
    assert page.is_visible("#correct")
    assert page.evaluate("document.activeElement.id") == "correct-text"  # nothing is selected that could be deleted
    assert page.locator("#fruits tbody tr[data-id]").count() == 15
    assert page.inner_text("#correct-count") == "1 correction"
    assert len(read_corrections(scene.survey / "corrections.json").done) == 1
    assert _changes(page, lambda: page.keyboard.press("Control+z")) == "Undone. 16 fruits"
    _choose(page, false)
    assert _changes(page, lambda: page.keyboard.press("Control+Shift+z")) == "Done again. 15 fruits"
    assert _changes(page, lambda: page.click("#correct-undo")) == "Undone. 16 fruits"
    assert _changes(page, lambda: page.click("#correct-redo")) == "Done again. 15 fruits"


def test_after_a_correction_by_keyboard_the_keyboard_goes_on_where_it_was(opened: Opened) -> None:
    page = opened.page
    page.focus("#fruits tbody tr[data-id] button >> nth=0")
    for _ in range(3):
        page.keyboard.press("ArrowDown")
    ids = page.evaluate("[...document.querySelectorAll('#fruits tbody tr[data-id]')].map(row => row.dataset.id)")
    deleted = page.evaluate("document.activeElement.closest('tr').dataset.id")
    after = ids[ids.index(deleted) + 1]
    assert _changes(page, lambda: page.keyboard.press("Delete")).startswith(f"Fruit {deleted} deleted.")
    assert page.evaluate("document.activeElement.closest('tr').dataset.id") == after
    page.focus("#view canvas")
    _changes(page, lambda: page.keyboard.press("Control+z"))
    assert page.evaluate("document.activeElement.tagName") == "CANVAS"


def test_a_missed_fruit_is_added_by_two_clicks(opened: Opened, server: ViewServer, scene: Scene) -> None:
    page = opened.page
    page.click("#correct-add")
    page.wait_for_selector("#photo[open]")
    _advice(page, "Click the middle of the missed fruit")
    assert page.is_disabled("#marking-done")
    first = page.inner_text("#photo-name")
    _click_in_photo(page, scene, MISSED)
    _advice(page, "Now click the same fruit")
    page.wait_for_selector(".marks .sight", state="attached")
    second = page.inner_text("#photo-name")
    assert second != first
    # The line runs through the fruit.
    line = [float(v) for v in page.get_attribute(".marks .sight", "d").replace("M", " ").replace("L", " ").split()]
    points = np.array(line).reshape(-1, 2)
    cameras = scene.taken_by
    at = cameras.project(cameras.photos.index(second), MISSED[None])[0][0]
    dense = np.concatenate([np.linspace(a, b, 30) for a, b in pairwise(points)])
    assert np.linalg.norm(dense - at, axis=1).min() < 2
    page.click("#photo-next")
    assert page.inner_text("#photo-name") not in (first, second)
    page.click("#photo-previous")
    _click_in_photo(page, scene, MISSED)
    _advice(page, "Add it")
    assert re.search(r"It is taken to be (79|80|81) mm wide", page.inner_text("#marking-text"))
    # A click beside takes the place of the first, and can be taken back.
    page.click("#marking-back")
    assert page.is_disabled("#marking-done")
    _click_in_photo(page, scene, MISSED)
    said = _changes(page, lambda: page.click("#marking-done"))
    added = _fruit(server, MISSED)
    assert said == f"Fruit {added} added. 16 fruits"
    assert page.inner_text("#card h3") == f"Fruit {added}"
    page.wait_for_selector(".crop svg path.mine")
    assert page.locator(".crop").count() == 2


def test_a_click_beside_the_photo_is_none(opened: Opened, server: ViewServer) -> None:
    page = opened.page
    page.click("#correct-add")
    _advice(page, "Click the middle of the missed fruit")
    page.wait_for_selector("#photo img[src]")
    scale, left, top = page.evaluate(_PLACED)
    page.mouse.click(left - 8, top + 200 * scale)
    _advice(page, "That is beside the photo")
    assert page.is_disabled("#marking-back")
    page.keyboard.press("Escape")
    page.wait_for_selector("#marking", state="hidden")


def test_clicks_on_two_fruits_are_refused_in_words(opened: Opened, scene: Scene) -> None:
    page = opened.page
    page.click("#correct-add")
    _click_in_photo(page, scene, GRID[2])
    page.wait_for_selector(".marks .sight", state="attached")
    _click_in_photo(page, scene, GRID[7])
    _advice(page, "Add it")
    page.click("#marking-done")
    _advice(page, "The clicks are not of the same fruit")
    page.click("#marking-cancel")
    assert page.is_hidden("#marking")
    page.keyboard.press("Escape")


def test_a_missed_fruit_is_added_with_the_keyboard_alone(opened: Opened, scene: Scene) -> None:
    page = opened.page
    page.locator("#correct-add").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("#photo[open]")
    page.locator("#marking-here").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector(".marks .sight", state="attached")
    page.keyboard.press("Shift+ArrowDown")
    page.keyboard.press("Enter")
    page.wait_for_selector("#marking-done:enabled")
    page.keyboard.press("Escape")
    assert page.locator("#photo[open]").count() == 0
    assert page.is_hidden("#marking")


def test_two_that_were_taken_for_one_are_split(opened: Opened, server: ViewServer, scene: Scene) -> None:
    page = opened.page
    twins = _fruit(server, TWINS.mean(0))
    _choose(page, twins)
    page.wait_for_selector(".crop")
    page.click("#correct-split")
    _advice(page, "Click the middle of one of the two")
    _click_in_photo(page, scene, TWINS[0])
    _advice(page, "Now click the middle of the other")
    assert page.locator(".marks .dot:not(.under)").count() == 1
    _click_in_photo(page, scene, TWINS[1])
    _advice(page, "Split it")
    assert _changes(page, lambda: page.click("#marking-done")).startswith(f"Fruit {twins} split into {twins} and ")
    assert all(_fruit(server, twin, 0.01) for twin in TWINS)


def test_two_that_are_one_are_merged(opened: Opened, server: ViewServer) -> None:
    page = opened.page
    one, other = _fruit(server, GRID[0]), _fruit(server, GRID[1])
    _choose(page, one)
    page.click("#correct-merge")
    assert "the same as fruit" in page.inner_text("#correct-text")
    page.keyboard.press("Escape")
    assert page.inner_text("#correct-text") == "Nothing is merged."
    _choose(page, one)
    page.click("#correct-merge")
    page.fill("#find-id", str(other))
    said = _changes(page, lambda: page.click("#find button"))
    assert said.startswith(f"Fruits {one} and {other} merged to ")
    assert page.locator("#fruits tbody tr[data-id]").count() == 16


def test_a_fruit_is_moved_to_another_tree(opened: Opened, server: ViewServer) -> None:
    page = opened.page
    fruit = _fruit(server, GRID[14])
    _choose(page, fruit)
    page.fill("#correct-tree", "3")
    assert _changes(page, lambda: page.keyboard.press("Enter")) == f"Fruit {fruit} moved to tree 3. 16 fruits"
    assert "Tree" in page.inner_text("#card dl")
    page.click("#correct-log summary")
    assert page.locator("#correct-list li").count() == 5
    assert page.locator("#correct-list li").last.inner_text().endswith("to tree 3")


def test_another_window_is_told_of_what_this_one_changed(opened: Opened, browser: Any, server: ViewServer) -> None:
    other = open_page(browser, server.url)
    page = opened.page
    _changes(page, lambda: page.click("#correct-undo"))
    _changes(page, lambda: page.click("#correct-redo"))
    _changes(page, lambda: page.click("#correct-undo"))
    other.page.click("#tool-correct")
    said = _changes(other.page, lambda: other.page.keyboard.press("Control+z"))
    assert "changed elsewhere" in said
    other.page.close()
    _changes(page, lambda: page.click("#correct-redo"))


def test_why_a_correction_did_not_go_is_what_the_server_says(browser: Any, server: ViewServer) -> None:
    page = open_page(browser, server.url).page
    page.click("#tool-correct")
    _choose(page, _fruit(server, GRID[3]))
    page.route("**/corrections", lambda route: route.fulfill(status=404, content_type="text/plain", body="row is gone"))
    page.click("#correct-delete")
    page.wait_for_selector("#correct-text:text-is('Nothing was changed: row is gone')")
    page.route("**/corrections", lambda route: route.abort())
    page.click("#correct-delete")
    page.wait_for_selector("#correct-text:has-text('Nothing was changed: is Pomona still running')")
    page.route("**/data/fruits/*.bin", lambda route: route.fulfill(status=404, body="detections.json is damaged"))
    _choose(page, _fruit(server, GRID[4]))
    page.wait_for_selector("#card .note:has-text('could not be loaded: detections.json is damaged')")
    page.close()


def test_the_tables_and_the_masks_are_corrected_afterwards(opened: Opened, scene: Scene, tmp_path: Path) -> None:
    runner = CliRunner()
    for form in ("csv", "coco"):
        result = runner.invoke(app, ["export", str(scene.survey), "--to", form, "--out", str(tmp_path / form)])
        assert result.exit_code == 0, result.output
    fruits = read_fruits(tmp_path / "csv")
    assert len(fruits) == 16
    assert fruits.tree_ids.max() == 3
    annotations = json.loads((tmp_path / "coco").read_text())["annotations"]
    kinds = {entry["attributes"]["correction"] for entry in annotations}
    assert kinds == {"none", "added", "split", "merged", "moved"}


def test_another_run_with_other_numbers_still_has_them(
    opened: Opened,
    browser: Any,
    scene: Scene,
    tmp_path: Path,
) -> None:
    cameras = scene.taken_by
    write_coco(tmp_path / "masks.json", row_photos(cameras), masks_of(cameras, without=(12,)))
    scene.run(tmp_path / "masks.json")
    assert len(read_fruits(scene.survey / "fruits.csv")) == 15
    with running(_server(scene)) as server:
        page = open_page(browser, server.url).page
        page.set_viewport_size({"width": 1200, "height": 800})
        page.click("#tool-correct")
        assert page.inner_text("#correct-count") == "5 corrections"
        assert page.locator("#fruits tbody tr[data-id]").count() == 15
        assert not _fruit(server, GRID[FALSE_ONE])
        assert _fruit(server, MISSED)
        assert all(_fruit(server, twin, 0.01) for twin in TWINS)
        for _ in range(5):
            _changes(page, lambda: page.click("#correct-undo"))
        assert page.is_disabled("#correct-undo")
        assert _fruit(server, GRID[FALSE_ONE])
        assert not _fruit(server, MISSED)
        page.close()


def test_pages_without_a_server_say_nothing_of_correcting(browser: Any, scene: Scene, tmp_path: Path) -> None:
    folder = export_folder(read_survey(scene.survey), tmp_path / "out")
    for path in (folder, scene.survey / "report.html"):
        page = open_page(browser, path).page
        assert page.is_hidden("#tool-correct")
        assert page.is_hidden("#photo-add")
        page.close()
