"""`pomona app` in Firefox: a survey begun, stopped and gone on with, one looked at in 3D, fruits marked by keys."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from firefox import Firefox
from pipeline_fakes import Fakes, make_photos
from pomona import sample_folder
from pomona.browser.app.folders import Folders
from pomona.browser.app.pages import AppServer
from pomona.browser.app.service import Homes
from pomona.learning.marks import read_marks
from pomona.pipeline import RunOptions, run
from serving import running

pytestmark = pytest.mark.slow
_RUN_S = 300.0


@pytest.fixture(scope="module")
def firefox(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Firefox]:
    started = Firefox(tmp_path_factory.mktemp("profile"))
    yield started
    started.close()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[AppServer]:
    homes = Homes(tmp_path / "data" / "surveys.json", tmp_path / "surveys", tmp_path / "surveys" / "photos")
    with running(AppServer(homes, Folders([tmp_path, sample_folder()]))) as started:
        yield started


def _click(firefox: Firefox, selector: str, text: str = "") -> None:
    """Click the first element of a selector with this text, when it is there."""
    found = f"[...document.querySelectorAll({selector!r})].find(e => e.textContent.includes({text!r}) && !e.disabled)"
    firefox.wait(found)
    firefox.run(f"{found}.click();")


def test_a_survey_is_begun_stopped_and_gone_on_with(firefox: Firefox, server: AppServer) -> None:
    firefox.open(server.url)
    _click(firefox, "a", "New survey")
    _click(firefox, "button", "Choose a folder")
    firefox.wait("document.querySelector('dialog select option:nth-child(2)')")
    firefox.run(
        "const s = document.querySelector('dialog select');"
        f"s.value = {str(sample_folder().resolve())!r}; s.dispatchEvent(new Event('change', {{bubbles: true}}));"
    )
    _click(firefox, "dialog .places button", "east")
    firefox.wait("document.querySelector('dialog .path').textContent.endsWith('east')")
    _click(firefox, "dialog button", "Choose this folder")
    firefox.wait("document.querySelector('.check .good')", _RUN_S)
    firefox.run(
        "const n = document.querySelector('input[maxlength]'); n.value = 'Row 1';"
        "n.dispatchEvent(new Event('input', {bubbles: true}));"
    )
    _click(firefox, "button.main", "Start")
    firefox.wait("document.querySelector('.head .state.running')", _RUN_S)
    firefox.wait("document.querySelector('.photos .soft')?.textContent.includes('possible')", _RUN_S)
    _click(firefox, "button", "Stop")
    firefox.wait("document.querySelector('.head .state.stopped')", _RUN_S)
    _click(firefox, "button", "Go on")
    firefox.wait("document.querySelector('.head .state.running')", _RUN_S)
    _click(firefox, "button", "Stop")
    firefox.wait("document.querySelector('.head .state.stopped')", _RUN_S)
    assert firefox.said() == []


def test_a_survey_is_looked_at_and_fruits_are_marked_by_keys(
    firefox: Firefox, server: AppServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Fakes().install(monkeypatch)
    row = run([make_photos(tmp_path / "photos")], tmp_path / "surveys" / "row", RunOptions()).survey
    survey_id = server.service.add(str(row))
    firefox.open(server.url)
    firefox.wait("document.querySelector('.card')")
    firefox.run(f"location.hash = '#/survey/{survey_id}/result';")
    firefox.wait("document.querySelector('iframe.view')?.contentDocument?.querySelector('html.has-webgl')")
    firefox.run(f"location.hash = '#/survey/{survey_id}/teach';")
    _click(firefox, ".photos button")
    firefox.wait("document.querySelector('svg.marking image')")

    keys = ["Enter", *["ArrowRight"] * 4, "Enter"]
    for key in keys:
        firefox.run(
            "document.querySelector('svg.marking').dispatchEvent("
            f"new KeyboardEvent('keydown', {{key: {key!r}, bubbles: true, cancelable: true}}));"
            "return new Promise(done => requestAnimationFrame(() => setTimeout(done, 30)));"
        )
    firefox.wait("document.querySelector('dialog h2').textContent.endsWith('1 mark')")
    _click(firefox, "dialog .plain")
    firefox.wait("document.querySelector('.photos .marked')")

    (photo,) = read_marks(row / "marks.json").values()
    (mark,) = photo.fruits
    assert mark.circle_px is not None
    assert 3 < mark.circle_px[2] < 0.3 * photo.width_px
    assert not photo.complete
    assert firefox.said() == []
