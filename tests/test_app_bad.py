"""What goes wrong around `pomona app`: a full disk, photos that go away, very many photos."""

from __future__ import annotations

import asyncio
import os
import shutil
import subprocess
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from pipeline_fakes import Fakes, make_photos
from pomona.browser.app import dropped
from pomona.browser.app.checks import check_photos
from pomona.browser.app.contract import GivenMarks, MarkView, NewSurvey
from pomona.browser.app.first_results import FirstResults
from pomona.browser.app.folders import Folders
from pomona.browser.app.service import Homes, Service
from pomona.browser.app.teaching import keep_marks, marked_view
from pomona.errors import MissingFileError, PomonaError, SurveyError
from pomona.pipeline import RunOptions, run
from pomona.survey import SurveyFolder
from waiting import until

_MANY = 10_000


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of a megabyte."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(place)], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip(f"no small disk can be mounted here: {mounted.stderr.decode().strip()}")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def _fill(disk: Path) -> Path:
    path = disk / "filling"
    with path.open("wb", buffering=0) as file:
        try:
            while file.write(bytes(4096)) == 4096:
                pass
        except OSError:
            return path
    return path


async def _pieces(count: int, size: int) -> AsyncIterator[bytes]:
    for _ in range(count):
        yield bytes(size)


def test_photos_dropped_on_a_full_disk_are_not_kept_by_halves(small_disk: Path) -> None:
    folder = small_disk / "drop"
    first = asyncio.run(dropped.keep(folder, "a.jpg", _pieces(4, 65_536), 4 * 65_536))

    with pytest.raises(SurveyError, match=r"The disk is full: cannot write .*drop .*drop the photos again"):
        asyncio.run(dropped.keep(folder, "b.jpg", _pieces(32, 65_536), 32 * 65_536))

    assert [path.name for path in folder.iterdir()] == ["a.jpg"]
    assert first.stat().st_size == 4 * 65_536
    asyncio.run(dropped.keep(folder, "c.jpg", _pieces(4, 65_536), 4 * 65_536))


def test_marks_on_a_full_disk_are_those_from_before(
    small_disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Fakes().install(monkeypatch)
    survey = SurveyFolder.open(run([make_photos(tmp_path / "photos")], small_disk / "row", RunOptions()).survey)
    mark = MarkView([1.0, 2.0, 21.0, 32.0], None)
    keep_marks(survey, 0, GivenMarks(complete=False, marks=[mark]))
    filling = _fill(small_disk)

    with pytest.raises(SurveyError, match="The disk is full"):
        keep_marks(survey, 0, GivenMarks(complete=False, marks=[mark] * 300))

    assert marked_view(survey, 0).marks == [mark]
    filling.unlink()
    keep_marks(survey, 0, GivenMarks(complete=True, marks=[]))
    assert marked_view(survey, 0).complete


def test_a_survey_that_was_removed_meanwhile_is_not_made_anew_by_a_mark(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Fakes().install(monkeypatch)
    survey = SurveyFolder.open(run([make_photos(tmp_path / "photos")], tmp_path / "row", RunOptions()).survey)
    shutil.rmtree(tmp_path / "row")
    with pytest.raises(PomonaError):
        keep_marks(survey, 0, GivenMarks(complete=False, marks=[]))
    assert not (tmp_path / "row").exists()


def test_a_run_on_a_full_disk_fails_in_words(small_disk: Path, tmp_path: Path) -> None:
    make_photos(tmp_path / "photos")
    _fill(small_disk)
    homes = Homes(tmp_path / "data" / "surveys.json", small_disk, small_disk / "photos")
    service = Service(homes, Folders([tmp_path]))
    try:
        asked = NewSurvey("row", [str(tmp_path / "photos")], True, "", None, "gnss", "", [], None, False)
        survey_id = service.begin(asked)
        until(lambda: service.view(survey_id).state in ("failed", "stopped"), 120)
        view = service.view(survey_id)
        assert view.state == "failed"
        assert view.run is not None
        assert "The disk is full" in view.run.message
        assert "Traceback" not in "\n".join(view.run.log)
    finally:
        service.close()


def test_photos_that_go_away_are_named_and_the_rest_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Fakes().install(monkeypatch)
    photos = make_photos(tmp_path / "photos")
    survey = SurveyFolder.open(run([photos], tmp_path / "row", RunOptions()).survey)
    gone = sorted(photos.iterdir())[1]
    gone.unlink()
    results = FirstResults(survey)

    assert len(results.photos()) == 4
    assert results.picture(0, 320)[:2] == b"\xff\xd8"
    for ask in (lambda: results.picture(1, 320), lambda: results.whole(1), lambda: marked_view(survey, 1)):
        with pytest.raises(MissingFileError, match=f"{gone.name} is not where it was"):
            ask()


def test_ten_thousand_photos_are_counted_without_being_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The chooser reads names alone."""
    (tmp_path / "many").mkdir()
    for k in range(_MANY):
        (tmp_path / "many" / f"IMG_{k:05}.jpg").touch()
    monkeypatch.setattr(Path, "open", lambda *given, **named: pytest.fail("a photo was opened"))

    folders = Folders([tmp_path])

    assert folders.listing(tmp_path / "many").photos == _MANY
    (place,) = folders.listing(tmp_path).places
    assert (place.photos, place.name) == (_MANY, "many")


def test_what_is_said_of_very_many_photos_can_be_read(tmp_path: Path) -> None:
    photo = next(make_photos(tmp_path / "one", count=1).iterdir())
    (tmp_path / "many").mkdir()
    for k in range(600):
        path = tmp_path / "many" / f"IMG_{k:05}.jpg"
        path.write_bytes(photo.read_bytes() + b"%05d" % k)  # what follows a photo's end is no part of it
        os.link(path, path.with_stem(f"{path.stem} copy"))

    check = check_photos([tmp_path / "many"], one_side=True)

    assert check.photos == 600
    assert check.looked_at <= 240
    assert all(len(warning) < 600 for warning in check.warnings)
    (copies,) = [warning for warning in check.warnings if "a copy of" in warning]
    assert copies.startswith("600 files")
    assert copies.endswith("and 592 more")
