"""The pages in Firefox: from disk and served, without an error on the console, with a picture in 3D."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from firefox import Firefox
from pomona.browser.view import ViewServer, export_folder, read_survey
from pomona.stages.report import write_report
from serving import running
from view_scenes import write_view_survey

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def firefox(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Firefox]:
    started = Firefox(tmp_path_factory.mktemp("profile"))
    yield started
    started.close()


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_view_survey(tmp_path_factory.mktemp("view"))


def _works(firefox: Firefox, address: str) -> None:
    firefox.open(address)
    firefox.wait("document.querySelector('html.has-webgl, html.no-webgl')")
    assert firefox.run("return document.documentElement.className;") == "has-webgl"
    firefox.wait("document.querySelector('#view').dataset.picture === 'whole'")
    assert firefox.run("return document.querySelectorAll('#fruits tbody tr').length;") == 24
    pixels = firefox.picture("#view canvas")
    assert ((pixels[:, :, 2] > 90) & (pixels[:, :, 2] > 2 * pixels[:, :, 1])).sum() > 300
    firefox.run("document.querySelector(\"tr[data-id='20'] button\").click();")
    firefox.wait("document.querySelector('.crop img')?.naturalWidth > 0")
    firefox.wait("document.querySelector('.crop path.mine')")
    paper = "return getComputedStyle(document.body).backgroundColor;"
    before = firefox.run(paper)
    firefox.run("document.querySelector('#tool-light').click();")
    assert firefox.run(paper) != before


def test_report_from_disk(firefox: Firefox, survey: Path, tmp_path: Path) -> None:
    write_report(read_survey(survey), tmp_path / "report.html")
    _works(firefox, (tmp_path / "report.html").as_uri())
    assert firefox.said() == []


def test_exported_folder_from_disk(firefox: Firefox, survey: Path, tmp_path: Path) -> None:
    _works(firefox, export_folder(read_survey(survey), tmp_path / "out").as_uri())
    firefox.run("document.querySelector('.crop').click();")
    firefox.wait("document.querySelector('#photo img').naturalWidth > 0")
    assert firefox.said() == []


def test_served(firefox: Firefox, survey: Path) -> None:
    with running(ViewServer(read_survey(survey))) as server:
        _works(firefox, server.url)
        firefox.run("document.querySelector('.crop').click();")
        firefox.wait("document.querySelector('#photo img').naturalWidth > 0")
        firefox.run("document.querySelector('#photo-through').click();")
        firefox.wait("document.querySelector('#through-photo').naturalWidth > 0")
        assert firefox.said() == []
