"""From an empty list to a corrected survey in a real browser, with stop and resume; bad folders; both languages."""

from __future__ import annotations

import csv
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pipeline_fakes import Fakes, make_photos
from pomona import sample_folder
from pomona.app.folders import Folders
from pomona.app.pages import AppServer
from pomona.app.service import Homes
from pomona.corrections import read_corrections
from pomona.pipeline import RunOptions, run
from pomona.survey import SurveyFolder
from serving import running
from test_report_browser import PATIENCE_MS, browser  # noqa: F401 (a fixture)

pytestmark = pytest.mark.slow
SAMPLE = sample_folder()
_RUN_MS = 900_000


@pytest.fixture
def server(tmp_path: Path) -> Iterator[AppServer]:
    homes = Homes(tmp_path / "data" / "surveys.json", tmp_path / "surveys", tmp_path / "surveys" / "photos")
    with running(AppServer(homes, Folders([tmp_path]))) as started:
        yield started


@pytest.fixture
def page(browser: Any, server: AppServer) -> Iterator[Any]:  # noqa: F811
    context = browser.new_context(viewport={"width": 1280, "height": 800}, locale="en-GB", accept_downloads=True)
    opened = context.new_page()
    opened.set_default_timeout(PATIENCE_MS)
    said: list[str] = []
    opened.on("pageerror", lambda error: said.append(str(error)))
    opened.on("console", lambda message: message.type == "error" and said.append(message.text))
    opened.goto(server.url)
    yield opened
    context.close()
    assert [text for text in said if "status of 4" not in text] == []  # refusals are shown in words


def _state(page: Any, state: str, timeout: int = PATIENCE_MS) -> None:
    page.wait_for_selector(f".head .state.{state}", timeout=timeout)


def _choose(page: Any, opener: str, folder: Path, *, file: str = "") -> None:
    """Go to a folder in the chooser, as far as its home page lets one, and choose it, or a file in it."""
    page.click(opener)
    page.wait_for_selector("dialog .path")
    while page.inner_text("dialog .path") != str(folder):
        here = Path(page.inner_text("dialog .path"))
        before = str(here)
        if folder.is_relative_to(here):
            name = folder.relative_to(here).parts[0]
            page.click(f"dialog .places button:has(span:text-is('{name}'))")
        else:
            page.click("dialog button:text-is('One folder up')")
        page.wait_for_function("before => document.querySelector('dialog .path').textContent !== before", arg=before)
    if file:
        page.click(f"dialog .places button:has(span:text-is('{file}'))")
    else:
        page.click("dialog button:text-is('Choose this folder')")
    page.wait_for_selector("dialog", state="detached")


def _until(is_so: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end, "did not happen in time"
        time.sleep(0.2)


@pytest.fixture
def row(tmp_path: Path) -> Path:
    """A part of the sample, which takes less time."""
    for side in ("east", "west"):
        (tmp_path / "row" / side).mkdir(parents=True)
        for photo in sorted((SAMPLE / side).glob("*.jpg"))[3:10]:
            shutil.copy(photo, tmp_path / "row" / side)
    (tmp_path / "row" / "empty").mkdir()
    shutil.copy(SAMPLE / "markers.csv", tmp_path / "row")
    return tmp_path / "row"


@pytest.mark.timeout(1500)
def test_from_an_empty_list_to_a_corrected_survey(page: Any, server: AppServer, tmp_path: Path, row: Path) -> None:
    page.wait_for_selector("text=No surveys yet")
    page.click("a:text-is('New survey') >> nth=0")

    # A bad folder is said at once, in words.
    _choose(page, "text=Choose a folder", row / "empty")
    page.wait_for_selector(".problem")
    assert "photo" in page.inner_text(".problem")
    page.click("button:text-is('Remove')")

    _choose(page, "text=Choose a folder", row / "east")
    page.wait_for_selector(".check .good")
    _choose(page, "text=Add the other side", row / "west")
    page.wait_for_selector("text=Sides: east (7), west (7)")
    page.select_option("select >> nth=1", "apple")
    page.check("input[name=metres] >> nth=1")
    _choose(page, "text=Table of the markers", row, file="markers.csv")
    page.fill("input[maxlength]", "Row 1")
    page.click("summary:text-is('The same without this page')")
    page.wait_for_selector("pre:has-text('--markers')")
    page.click("button:text-is('Start')")

    _state(page, "running")
    folder = tmp_path / "surveys" / "Row 1"
    page.wait_for_selector(".photos .soft:has-text('possible fruit')", timeout=_RUN_MS)
    page.click("button:text-is('Stop')")
    _state(page, "stopped")
    kept = len(list((folder / "work" / "segment").rglob("*.json")))
    assert 1 <= kept < 14
    # A page that is closed and opened again, or a second one, finds all as it is.
    page.reload()
    _state(page, "stopped")
    second = page.context.new_page()
    second.goto(page.url)
    second.wait_for_selector(".head .state.stopped")
    page.click("button:text-is('Go on')")
    second.wait_for_selector(".head .state.running")
    second.close()
    page.click("#tab-scene")
    page.wait_for_selector("canvas.scene", timeout=_RUN_MS)
    page.click("#tab-result")
    page.wait_for_selector("iframe.view", timeout=_RUN_MS)
    _state(page, "finished")
    fruits = SurveyFolder.open(folder).records["results"].info["fruits"]
    assert 20 < fruits < 90
    assert f"{fruits} Apples" in page.inner_text("main")

    # Correct it, then take the table along.
    view = page.frame_locator("iframe.view")
    view.locator("html.has-webgl").wait_for(state="attached")
    view.locator("#tool-correct").click()
    view.locator("#find-id").fill("1")
    view.locator("#find button").click()
    view.locator("#card h3").wait_for()
    view.locator("#correct-delete").click()
    _until(lambda: len(read_corrections(folder / "corrections.json").done) == 1, 60)
    page.click("#tab-files")
    with page.expect_download(timeout=60_000) as downloading:
        page.click("button:text-is('Fruits, trees and row, for QGIS')")
    assert downloading.value.suggested_filename.endswith("fruits.gpkg")
    with (folder / "fruits.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == fruits - 1
    page.click("button:text-is('Bring up to date')")
    _until(lambda: "1 correction" in (folder / "report.html").read_text(encoding="utf-8"), 120)

    page.click("text=Close Pomona")
    page.click("dialog .main")
    page.wait_for_selector("text=Pomona has ended")


def test_dropped_photos_are_copied_and_checked(page: Any, server: AppServer, tmp_path: Path) -> None:
    page.click("a:text-is('New survey') >> nth=0")
    photos = sorted((SAMPLE / "east").glob("*.jpg"))[:4]
    page.set_input_files("input[type=file]", [*map(str, photos), str(SAMPLE / "markers.csv")])
    page.wait_for_selector("text=1 file is no photo and was left out")
    page.wait_for_selector(".check .good")
    (drop,) = (tmp_path / "surveys" / "photos").iterdir()
    assert {path.name: path.read_bytes() for path in drop.iterdir()} == {p.name: p.read_bytes() for p in photos}


def test_texts_are_in_the_language_of_the_browser_and_can_be_switched(
    browser: Any,  # noqa: F811
    server: AppServer,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    Fakes().install(monkeypatch)
    run([make_photos(tmp_path / "photos")], tmp_path / "surveys" / "row", RunOptions())
    server.service.add(str(tmp_path / "surveys" / "row"))
    context = browser.new_context(viewport={"width": 820, "height": 1180}, locale="de-AT")
    page = context.new_page()
    page.goto(server.url)
    page.wait_for_selector("h1:text-is('Aufnahmen')")
    assert page.evaluate("document.documentElement.lang") == "de"
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "brand"
    page.click(".card")
    page.wait_for_selector(".state:text-is('fertig')")
    for tab in ("photos", "scene", "trees", "compare", "files", "result"):
        page.click(f"#tab-{tab}")
        page.wait_for_selector("#panel > *")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), tab
    page.focus("#tab-result")
    page.keyboard.press("ArrowRight")
    page.wait_for_selector("#tab-trees[aria-selected=true]")
    unnamed = page.evaluate(
        "[...document.querySelectorAll('button, a, input, select, iframe')].filter(each => !(each.textContent.trim() "
        "|| each.ariaLabel || each.title || each.labels?.length || each.placeholder)).map(each => each.outerHTML)"
    )
    assert unnamed == []
    page.select_option("header select", "en")
    page.wait_for_selector(".state:text-is('finished')")
    page.reload()
    page.wait_for_selector(".state:text-is('finished')")
    context.close()
