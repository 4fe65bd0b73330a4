"""From an empty list to a corrected survey in a real browser, with stop and resume; bad folders; both languages."""

from __future__ import annotations

import csv
import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pomona
from chromium import PATIENCE_MS, page_until
from correct_scenes import write_scene
from pipeline_fakes import Fakes, make_photos
from pomona import sample_folder
from pomona.browser.app.folders import Folders
from pomona.browser.app.pages import AppServer
from pomona.browser.app.request import folder_name
from pomona.browser.app.service import Homes
from pomona.browser.view import Corrector
from pomona.corrections import read_corrections
from pomona.errors import InputError, SurveyError
from pomona.evaluate.detections import EvaluateDetectionsOptions
from pomona.learning.marks import read_marks
from pomona.learning.self_training.learnt import Learnt, read_learnt, taught, write_learnt
from pomona.pipeline import RunOptions, run
from pomona.stages.report.contract import CorrectionRequest
from pomona.survey import SurveyFolder
from serving import running
from waiting import until

pytestmark = pytest.mark.slow
SAMPLE = sample_folder()
_RUN_MS = 900_000


@pytest.fixture
def server(tmp_path: Path) -> Iterator[AppServer]:
    homes = Homes(tmp_path / "data" / "surveys.json", tmp_path / "surveys", tmp_path / "surveys" / "photos")
    with running(AppServer(homes, Folders([tmp_path]))) as started:
        yield started


@pytest.fixture
def page(browser: Any, server: AppServer) -> Iterator[Any]:
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
        page_until(page, "before => document.querySelector('dialog .path').textContent !== before", arg=before)
    if file:
        page.click(f"dialog .places button:has(span:text-is('{file}'))")
    else:
        page.click("dialog button:text-is('Choose this folder')")
    page.wait_for_selector("dialog", state="detached")


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
    until(lambda: len(read_corrections(folder / "corrections.json").done) == 1)
    page.click("#tab-files")
    with page.expect_download(timeout=60_000) as downloading:
        page.click("button:text-is('Fruits, trees and row, for QGIS')")
    assert downloading.value.suggested_filename.endswith("fruits.gpkg")
    with (folder / "fruits.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == fruits - 1
    page.click("button:text-is('Bring up to date')")
    corrected = re.compile(r">1</data> correction by hand")
    until(lambda: corrected.search((folder / "report.html").read_text(encoding="utf-8")) is not None, 120)

    page.click("text=Close Pomona")
    page.click("dialog .main")
    page.wait_for_selector("text=Pomona has ended")


def test_what_is_typed_is_asked_for_or_told_of(page: Any, row: Path) -> None:
    page.click("a:text-is('New survey') >> nth=0")
    _choose(page, "text=Choose a folder", row / "east")
    page.fill("input[maxlength]", "Row 1")
    page.fill("label:has-text('Usual diameter') input", "7 cm")
    assert "'7 cm' is no number" in page.inner_text(".problem")
    assert page.is_disabled("button:text-is('Start')")
    page.fill("label:has-text('Usual diameter') input", "70 mm")
    page.fill("label:has-text('Distance of the trees') input", "2,5")
    page.wait_for_selector(".problem", state="detached")
    page.click("summary:text-is('The same without this page')")
    command = page.inner_text("pre >> nth=0")
    assert "--fruit-diameter 0.07 " in command
    assert "--tree-spacing 2.5" in command
    assert page.is_enabled("button:text-is('Start')")


def test_dropped_photos_are_copied_and_checked(page: Any, server: AppServer, tmp_path: Path) -> None:
    page.click("a:text-is('New survey') >> nth=0")
    photos = sorted((SAMPLE / "east").glob("*.jpg"))[:4]
    page.set_input_files("input[type=file]", [*map(str, photos), str(SAMPLE / "markers.csv")])
    page.wait_for_selector("text=1 file is no photo and was left out")
    page.wait_for_selector(".check .good")
    (drop,) = (tmp_path / "surveys" / "photos").iterdir()
    assert {path.name: path.read_bytes() for path in drop.iterdir()} == {p.name: p.read_bytes() for p in photos}
    assert page.input_value("input[type=file]") == ""  # else a browser does not tell that they are chosen again


def test_photos_whose_names_are_no_names_everywhere_are_copied_with_the_others(
    page: Any, server: AppServer, tmp_path: Path
) -> None:
    page.click("a:text-is('New survey') >> nth=0")
    photos = [path.read_bytes() for path in sorted((SAMPLE / "east").glob("*.jpg"))[:3]]
    names = ['12:30 "a"?.jpg', "12:30 *a*?.jpg", "b.jpg"]
    page.set_input_files(
        "input[type=file]",
        [{"name": n, "mimeType": "image/jpeg", "buffer": p} for n, p in zip(names, photos, strict=True)],
    )
    page.wait_for_selector('text=2 photos have other names here, the first 12-30 -a-.jpg: that of 12:30 "a"?.jpg')
    page.wait_for_selector(".check:has-text('3 photos')")
    (drop,) = (tmp_path / "surveys" / "photos").iterdir()
    copies = {path.name: path.read_bytes() for path in drop.iterdir()}
    assert copies == dict(zip(["12-30 -a-.jpg", "12-30 -a--.jpg", "b.jpg"], photos, strict=True))
    # Where the survey goes is told as it will be.
    page.fill("input[maxlength]", " Row 7/8: east. ")
    assert page.is_visible(f"text=The results go to {tmp_path / 'surveys'}/{folder_name(' Row 7/8: east. ')}.")


def test_photos_dropped_one_side_after_the_other_are_both_sides(page: Any, server: AppServer, tmp_path: Path) -> None:
    page.click("a:text-is('New survey') >> nth=0")
    sides = [[str(path) for path in sorted((SAMPLE / side).glob("*.jpg"))[:3]] for side in ("east", "west")]
    for photos in sides:  # the second before the first are copied
        page.set_input_files("input[type=file]", photos)
    page.wait_for_selector(".chosen li:nth-child(2)")
    page.wait_for_selector(".check:has-text('6 photos')")
    drops = [Path(path) for path in page.locator(".chosen .path").all_inner_texts()]
    assert [sorted(photo.name for photo in drop.iterdir()) for drop in drops] == [
        [Path(photo).name for photo in photos] for photos in sides
    ]


def test_where_a_run_ended_early_no_stage_is_at_work(
    page: Any, server: AppServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fakes, survey = Fakes().install(monkeypatch), tmp_path / "surveys" / "row"
    fakes.raising["sfm"] = 1, InputError("The photos have nothing in common")
    with pytest.raises(InputError):
        run([make_photos(tmp_path / "photos")], survey, RunOptions())
    page.goto(page.url.partition("#")[0] + f"#/survey/{server.service.add(str(survey))}")
    page.wait_for_selector(".problem:has-text('nothing in common')")
    assert page.inner_text(".stages .now").split("\n")[0] == "Where the camera stood"
    assert page.locator(".stages .now .hidden").text_content() == "stopped here"
    assert page.locator("[aria-current=step]").count() == 0


def test_results_can_be_looked_at_though_a_later_run_failed(
    page: Any, server: AppServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Fakes().install(monkeypatch)
    photos = make_photos(tmp_path / "photos")
    run([photos], tmp_path / "surveys" / "row", RunOptions())
    photos.rename(tmp_path / "card")  # the memory card was taken out
    survey_id = server.service.add(str(tmp_path / "surveys" / "row"))
    page.goto(page.url.partition("#")[0] + f"#/survey/{survey_id}")
    page.click("button:text-is('Bring up to date')")
    _state(page, "failed")
    assert "does not exist" in page.inner_text(".problem")
    page.frame_locator("iframe.view").locator("html.has-webgl").wait_for(state="attached")
    page.click("#tab-files")
    with page.expect_download() as download:
        page.click("button:text-is('Fruits, for a spreadsheet')")
    assert download.value.suggested_filename == "row-fruits.csv"


def test_two_dates_that_are_compared_again_are_shown_anew(page: Any, server: AppServer, tmp_path: Path) -> None:
    later = write_scene(tmp_path / "august").survey
    earlier = Path(shutil.copytree(later, tmp_path / "july"))
    server.service.add(str(earlier))
    page.goto(page.url.partition("#")[0] + f"#/survey/{server.service.add(str(later))}/compare")
    page.click("button:text-is('Compare')")
    cards = page.frame_locator("iframe.view").locator(".totals")
    cards.locator("text=of 16 and 16 fruits").wait_for()
    corrector = Corrector.of(pomona.open(later))
    first = corrector.data.fruits.ids[:1].tolist()
    corrector.do(CorrectionRequest("delete", corrector.state.revision, first, [], [], 0))
    page.click("button:text-is('Compare')")
    cards.locator("text=of 16 and 15 fruits").wait_for()


def test_the_keyboard_goes_on_where_a_window_was_opened(
    page: Any, server: AppServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def at(selector: str) -> None:
        page_until(page, "each => document.activeElement.matches(each)", arg=selector)

    Fakes().install(monkeypatch)
    photos = make_photos(tmp_path / "photos")
    run([photos], tmp_path / "surveys" / "row", RunOptions())
    server.service.add(str(tmp_path / "surveys" / "row"))
    page.reload()
    page.click("a:text-is('New survey')")
    page.focus(".drop .main")
    page.keyboard.press("Enter")
    page.wait_for_selector("dialog .places button")
    page.focus("dialog .places button:has(span:text-is('photos'))")
    page.keyboard.press("Enter")
    page.wait_for_selector(f"dialog .path:text-is('{photos}')")
    at("dialog .foot .main")  # no folder is in there: it is chosen by the same key
    page.keyboard.press("Enter")
    page.wait_for_selector("dialog", state="detached")
    at(".drop .main")
    page.goto(page.url.partition("#")[0] + f"#/survey/{server.service.everything().surveys[0].id}/teach")
    page.focus(".photos li:nth-child(1) button")
    page.keyboard.press("Enter")
    page.wait_for_selector("svg.marking")
    page.focus("button[aria-label='Photo after']")
    page.keyboard.press("Enter")
    at("svg.marking")
    page.focus("dialog .plain")
    page.keyboard.press("Enter")
    page.wait_for_selector("dialog", state="detached")
    at(".photos li:nth-child(1) button")


def test_a_pomona_that_has_ended_is_told_of(browser: Any, tmp_path: Path) -> None:
    homes = Homes(tmp_path / "data" / "surveys.json", tmp_path / "surveys", tmp_path / "surveys" / "photos")
    page = browser.new_page(locale="en-GB")
    page.set_default_timeout(PATIENCE_MS)
    with running(AppServer(homes, Folders([tmp_path]))) as server:
        port = server.port
        page.goto(server.url)
        page.wait_for_selector("h2:text-is('No surveys yet')")
    page.wait_for_selector(".lost:has-text('Pomona does not answer')")
    page.click("text=Try it with the sample")
    assert page.inner_text(".problem p").startswith("Pomona does not answer.")
    page.click("a:text-is('New survey') >> nth=0")
    page.set_input_files("input[type=file]", str(SAMPLE / "east" / "east_003.jpg"))
    page.wait_for_selector(".problem:has-text('Pomona does not answer.')")
    # Another one does not know the token of this page.
    with running(AppServer(homes, Folders([tmp_path]), port=port)):
        page.wait_for_selector(".lost:has-text('Go on in the page that opened when it was started again')")
        page.close()


def test_texts_are_in_the_language_of_the_browser_and_can_be_switched(
    browser: Any,
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


def opened_for_marks(page: Any, server: AppServer, row: Path) -> tuple[dict[str, float], float, float]:
    """Open the second photo of a survey to mark fruits in; return its box on the page, and the middle of that."""
    page.evaluate(f"location.hash = '#/survey/{server.service.add(str(row))}/teach'")
    page.click(".photos button >> nth=1")
    page.wait_for_selector("svg.marking image")
    box = page.locator("svg.marking").bounding_box()
    return box, box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_fruits_are_marked_by_two_clicks_and_kept(
    page: Any, server: AppServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Fakes().install(monkeypatch)
    row = run([make_photos(tmp_path / "photos")], tmp_path / "surveys" / "row", RunOptions()).survey
    box, x, y = opened_for_marks(page, server, row)

    def mark(across: float) -> None:
        page.mouse.click(x - across, y)
        page.mouse.click(x + across, y + 1)

    def marks(count: str) -> None:
        page.wait_for_selector(f"dialog h2:has-text(': {count}')")

    mark(30)
    marks("1 mark")
    page.click("button:text-is('Undo')")
    marks("0 marks")
    page.mouse.click(x, y)
    page.keyboard.press("Escape")  # takes the click back, and does not close the window
    mark(30)
    marks("1 mark")
    page.mouse.click(x - 30, y)  # its line
    page.wait_for_selector("svg .mark.on")
    page.click("button:text-is('Delete mark')")
    marks("0 marks")
    page.mouse.move(x, y)
    page.mouse.wheel(0, -300)
    mark(60)
    marks("1 mark")
    page.check("text=All fruits in this photo are marked.")
    page.click("dialog .plain")
    page.wait_for_selector(".photos .marked:has-text('1 mark · all marked')")
    page.reload()
    page.wait_for_selector("text=1 mark in 1 photo, all fruits in 1 of these. Corrections made in the view: 0.")
    (photo,) = read_marks(row / "marks.json").values()
    assert photo.complete
    (fruit,) = photo.fruits
    assert fruit.circle_px is not None
    # Twice as near and twice as wide on the screen as what was taken back.
    scale = max(photo.width_px / box["width"], photo.height_px / box["height"])
    assert 20 * scale < fruit.circle_px[2] < 40 * scale


def test_a_mark_that_could_not_be_kept_is_not_shown(
    page: Any, server: AppServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Fakes().install(monkeypatch)
    row = run([make_photos(tmp_path / "photos")], tmp_path / "surveys" / "row", RunOptions()).survey
    _, x, y = opened_for_marks(page, server, row)

    def mark(down: float) -> None:
        page.mouse.click(x - 30, y + down)
        page.mouse.click(x + 30, y + down)

    def full(*args: Any, **more: Any) -> None:
        raise SurveyError("The disk is full: free some space, then mark the fruit again")

    mark(-60)
    page.wait_for_selector("dialog h2:has-text(': 1 mark')")
    with monkeypatch.context() as patched:
        patched.setattr("pomona.browser.app.pages.keep_marks", full)
        mark(60)
        page.wait_for_selector("dialog .problem:has-text('mark the fruit again')")
        page.wait_for_selector("dialog h2:has-text(': 1 mark')")
    mark(60)
    page.wait_for_selector("dialog h2:has-text(': 2 marks')")
    page.wait_for_selector("dialog .problem", state="detached")
    page.click("dialog .plain")
    page.wait_for_selector(".photos .marked:has-text('2 marks')")
    (photo,) = read_marks(row / "marks.json").values()
    assert len(photo.fruits) == 2


def test_a_browser_without_webgl_shows_the_row_and_the_table(
    page: Any, server: AppServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Fakes().install(monkeypatch)
    row = run([make_photos(tmp_path / "photos")], tmp_path / "surveys" / "row", RunOptions()).survey
    page.context.add_init_script(
        "const all = HTMLCanvasElement.prototype.getContext;"
        "HTMLCanvasElement.prototype.getContext = function (kind, ...more) {"
        " return kind.startsWith('webgl') ? null : all.call(this, kind, ...more); }"
    )
    survey_id = server.service.add(str(row))
    page.goto(f"{page.url.split('#')[0]}#/survey/{survey_id}/scene")
    page.reload()
    page.wait_for_selector("canvas.scene")
    page.click("#tab-result")
    view = page.frame_locator("iframe.view")
    view.locator("text=This browser gives no WebGL").wait_for()
    assert view.locator("#fruits tbody tr").count() > 0


# Runs as the app starts them, but learning takes a tenth of its steps: minutes less, and the same on the way.
SHORT_LEARNING = (
    "import runpy; from pomona.learning.self_training.options import AdaptOptions; "
    "AdaptOptions.__init__.__kwdefaults__['steps'] = 12; "
    "runpy.run_module('pomona.cli.leash', run_name='__main__', alter_sys=True)"
)


@pytest.mark.timeout(1500)
def test_a_survey_learns_from_fruits_marked_by_clicks(
    page: Any, server: AppServer, tmp_path: Path, row: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch")
    monkeypatch.setattr(server.service._jobs, "_command", (sys.executable, "-c", SHORT_LEARNING))
    options = RunOptions(markers=row / "markers.csv", scene=False)
    folder = run([row / "east", row / "west"], tmp_path / "surveys" / "row", options).survey
    survey_id = server.service.add(str(folder))
    page.evaluate(f"location.hash = '#/survey/{survey_id}/teach'")
    found, narrowest_px = pomona.open(folder).detections, EvaluateDetectionsOptions().min_size_px
    wanted, scored = {}, set()
    for idx in (3, 10):  # one of each side
        page.click(f".photos button >> nth={idx}")
        page.wait_for_selector("svg.marking image")
        photo = page.inner_text("dialog h2").split(":")[0]
        box, of_photo = page.locator("svg.marking").bounding_box(), found.by_photo[photo]
        scale = min(box["width"] / of_photo.width_px, box["height"] / of_photo.height_px)
        left = box["x"] + (box["width"] - scale * of_photo.width_px) / 2
        top = box["y"] + (box["height"] - scale * of_photo.height_px) / 2
        drawn: list[tuple[float, float, float]] = []  # circles on the screen
        narrow = 0
        for mask in [m for m, score in zip(of_photo.masks, of_photo.scores, strict=True) if score >= 0.5]:
            x0, y0, x1, y1 = (scale * v for v in mask.box_px)
            x, y, radius = left + (x0 + x1) / 2, top + (y0 + y1) / 2, (x1 - x0 + y1 - y0) / 4
            # A click on the line of another mark would choose that one.
            for angle in np.linspace(0, 2 * np.pi, 24, endpoint=False):
                dx, dy = radius * np.cos(angle), radius * np.sin(angle)
                if all(abs(np.hypot(x - dx - cx, y - dy - cy) - r) > 10 for cx, cy, r in drawn):
                    page.mouse.click(x - dx, y - dy)
                    page.mouse.click(x + dx, y + dy)
                    drawn.append((x, y, radius))
                    narrow += mask.box_px[2] - mask.box_px[0] < narrowest_px
                    page.wait_for_selector(f"dialog h2:has-text(': {len(drawn)} mark')")
                    break
        wanted[photo] = len(drawn)
        scored.add(len(drawn) - narrow)
        assert len(drawn) > 5
        page.check("text=All fruits in this photo are marked.")
        page.click("dialog .plain")
        page.wait_for_selector("dialog", state="detached")
    marked = read_marks(folder / "marks.json")
    assert {name: len(photo.fruits) for name, photo in marked.items()} == wanted
    page.click("button:text-is('Learn from these')")
    _state(page, "running")
    _state(page, "finished", timeout=_RUN_MS)
    learnt = read_learnt(SurveyFolder.open(folder))
    assert learnt is not None
    assert learnt.marked == sum(wanted.values())
    assert learnt.by_hand in scored  # one photo was kept aside to measure on; narrower fruits are learnt, not scored
    page.wait_for_selector(".learnt table" if learnt.kept else "text=so nothing was changed")
    assert SurveyFolder.open(folder).adapted_model.is_file() == learnt.kept
    assert 20 < SurveyFolder.open(folder).records["results"].info["fruits"] < 90


def test_before_and_after_learning_stand_side_by_side(
    page: Any, server: AppServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Fakes().install(monkeypatch)
    row = run([make_photos(tmp_path / "photos")], tmp_path / "surveys" / "row", RunOptions()).survey
    survey = SurveyFolder.open(row)
    survey.keep_results()
    (tmp_path / "learnt.onnx").touch()
    survey.take_adapted(tmp_path / "learnt.onnx")
    learnt = Learnt(True, taught(survey), 40, (0.81, 0.9), 12, (0.5, 0.75), (0.8, 0.85), (50, 53), (300, 322))
    write_learnt(survey, learnt)
    survey_id = server.service.add(str(row))
    page.evaluate(f"location.hash = '#/survey/{survey_id}/teach'")
    page.wait_for_selector(".learnt table")
    rows = [line.split("\t") for line in page.inner_text(".learnt tbody").splitlines()]
    assert [[cell for cell in line if cell][1:] for line in rows] == [
        ["0.810", "0.900"],
        ["0.500", "0.750"],
        ["80 %", "85 %"],
        ["300", "322"],
        ["50", "53"],
    ]
    loaded = "[...document.querySelectorAll('.pair img')].filter(image => image.naturalWidth > 0).length === 2"
    page.locator(".pair").scroll_into_view_if_needed()
    page_until(page, loaded)
    write_learnt(survey, replace(learnt, kept=False))
    page.reload()
    page.wait_for_selector("text=so nothing was changed")
    assert page.locator(".pair").count() == 0


def test_what_was_learnt_in_vain_is_told_when_learning_ends(
    page: Any, server: AppServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Fakes().install(monkeypatch)
    row = run([make_photos(tmp_path / "photos")], tmp_path / "surveys" / "row", RunOptions()).survey
    survey = SurveyFolder.open(row)
    learnt = Learnt(False, taught(survey), 40, (0.81, 0.8), 12, (0.5, 0.5), (0.8, 0.8), (50, 50), (300, 300))
    write_learnt(survey, learnt)
    written = tmp_path / "learnt.json"
    survey.learnt.rename(written)
    survey_id = server.service.add(str(row))
    page.evaluate(f"location.hash = '#/survey/{survey_id}/teach'")
    page.wait_for_selector("text=Learn from these")
    # Learning that is not kept changes nothing that the report shows.
    ends = f"import shutil; shutil.copy({str(written)!r}, {str(survey.learnt)!r})"
    monkeypatch.setattr(server.service._jobs, "_command", (sys.executable, "-c", ends))
    page.click("button:text-is('Learn from these')")
    page.wait_for_selector("text=so nothing was changed")
