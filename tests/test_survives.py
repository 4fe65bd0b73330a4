"""What happens to a survey when the power, another run or the clock comes in between."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from pipeline_fakes import Fakes, make_photos
from pomona.errors import SurveyError
from pomona.pipeline import run
from pomona.survey import SurveyFolder


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch) -> Fakes:
    return Fakes().install(monkeypatch)


def test_the_manifest_names_nothing_that_is_not_on_the_disk(
    fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    photos, out = make_photos(tmp_path / "photos"), tmp_path / "out"
    flushed: set[tuple[int, int]] = set()  # which file, as it was when it was changed last
    named, real_fsync, real_replace = 0, os.fsync, Path.replace

    def fsync(handle: int) -> None:
        stat = os.fstat(handle)
        flushed.add((stat.st_ino, stat.st_mtime_ns))
        real_fsync(handle)

    def replace(self: Path, target: Path) -> Path:
        nonlocal named
        if Path(target).name == "survey.json":
            own = self.stat()
            assert (own.st_ino, own.st_mtime_ns) in flushed
            for record in json.loads(self.read_text(encoding="utf-8"))["stages"].values():
                for name in record["outputs"]:
                    for file in [out / name] if (out / name).is_file() else (out / name).rglob("*"):
                        stat = file.stat()
                        assert (stat.st_ino, stat.st_mtime_ns) in flushed, file
                        named += 1
        return real_replace(self, target)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(Path, "replace", replace)
    run([photos], out)
    assert named > 20


def test_a_second_run_is_told_of_the_first_and_touches_nothing(fakes: Fakes, tmp_path: Path) -> None:
    photos = make_photos(tmp_path / "photos")
    run([photos], tmp_path / "out")
    first = SurveyFolder.open(tmp_path / "out")
    before = first.manifest_path.read_bytes()
    with first.locked(), pytest.raises(SurveyError, match="Another run is working"):
        run([photos], tmp_path / "out")
    assert first.manifest_path.read_bytes() == before


def test_a_run_that_comes_later_goes_on_from_what_another_wrote(tmp_path: Path) -> None:
    one = SurveyFolder.create(tmp_path)
    other = SurveyFolder.open(tmp_path)
    with one.locked():
        one.note(answer=42)
    with other.locked():
        other.note(more=1)
    assert SurveyFolder.open(tmp_path).get("answer") == 42


def test_a_clock_that_jumps_redoes_nothing(fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    photos = make_photos(tmp_path / "photos")
    run([photos], tmp_path / "out")
    calls = dict(fakes.calls)
    monkeypatch.setattr("pomona.survey.record.now", lambda: "1970-01-01T00:00:00+00:00")
    run([photos], tmp_path / "out")
    assert fakes.calls == calls
