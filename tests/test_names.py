"""Names of files and folders: any that a disk can hold, in any locale, with the letters of any language."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline_fakes import Fakes, make_photos
from pomona.errors import SurveyError
from pomona.pipeline import RunOptions, run

LONGEST = 255  # bytes of a name on the file systems of Linux; letters on those of Windows and macOS
NAMES = (
    "süd 🍎.jpg", "-dash.jpg", "100%20 'it' \"it\".jpg", "=1+1.jpg", "a#b?c&d.jpg", "CON.jpg", "two\nlines.. .jpg",
    "ü" * ((LONGEST - 4) // 2) + ".jpg",
)  # fmt: skip


def _named(folder: Path, names: tuple[str, ...]) -> Path:
    for made, name in zip(sorted(make_photos(folder, len(names)).iterdir()), names, strict=True):
        made.rename(made.with_name(name))
    return folder


def _photos_in(survey: Path) -> set[str]:
    with (survey / "observations.csv").open(encoding="utf-8", newline="") as file:
        observed = {row["photo"].removeprefix("'") for row in csv.DictReader(file)}
    images = json.loads((survey / "detections.json").read_text(encoding="utf-8"))["images"]
    assert observed == {image["file_name"] for image in images}
    return observed


@pytest.mark.skipif(sys.platform == "win32", reason="Windows allows fewer letters in names")
def test_photos_and_folders_are_called_as_people_call_them(fakes: Fakes, tmp_path: Path) -> None:
    photos = _named(tmp_path / "-Reihe 'süd' 🍎 100%\n\"x\"", NAMES)
    out = tmp_path / "aus 🍐 #1 %20 'q'."
    assert run([photos], out).fruits == 1
    assert _photos_in(out) == set(NAMES)
    again = run([photos], out)
    assert all(stage.kept for stage in again.stages)


@pytest.mark.skipif(sys.platform != "linux", reason="needs names that differ in case only, and paths of 4,000 bytes")
def test_names_that_differ_in_case_and_paths_as_long_as_there_are(fakes: Fakes, tmp_path: Path) -> None:
    deep = tmp_path
    while len(str(deep)) < 3600:
        deep = deep / ("x" * 200)
    photos = _named(deep / "photos", ("A.jpg", "a.jpg", "A.JPG", "a.JPG"))
    run([photos], deep / "out")
    assert _photos_in(deep / "out") == {"A.jpg", "a.jpg", "A.JPG", "a.JPG"}


@pytest.mark.skipif(sys.platform != "linux", reason="needs names of any bytes")
def test_names_that_are_not_utf8_are_said_to_be(fakes: Fakes, tmp_path: Path) -> None:
    photos = make_photos(tmp_path / "photos", 4)
    latin = os.fsdecode(b"s\xfcd")
    (photos / "IMG_0000.jpg").rename(photos / f"{latin}.jpg")
    summary = run([photos], tmp_path / "out")
    assert summary.skipped == (("s\\udcfcd.jpg", "its name is not UTF-8: rename the file"),)
    assert len(_photos_in(tmp_path / "out")) == 3
    with pytest.raises(SurveyError, match="expected a name in UTF-8 for `out`"):
        run([photos], tmp_path / latin)
    markers = tmp_path / f"{latin}.csv"
    markers.write_text("id,x,y,z\n0,0,0,0\n", encoding="utf-8")
    with pytest.raises(SurveyError, match="name is not UTF-8: rename it"):
        run([photos], tmp_path / "other", RunOptions(markers=markers))
    photos.rename(tmp_path / latin)
    with pytest.raises(SurveyError, match="name is not UTF-8: rename it"):
        run([tmp_path / latin], tmp_path / "third")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no locales of ASCII alone")
def test_a_locale_without_utf8_changes_nothing(tmp_path: Path) -> None:
    photos, out = make_photos(tmp_path / "süd 🍎"), tmp_path / "aus ü"
    code = (
        "import sys, pytest\nfrom pipeline_fakes import Fakes\nFakes().install(pytest.MonkeyPatch())\n"
        "from pomona.cli import main\nsys.argv[0] = 'pomona'\nmain()"
    )
    paths = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    plain = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONPATH": paths}
    done = subprocess.run(
        [sys.executable, "-c", code, "run", str(photos), "--out", str(out)], env=plain, capture_output=True,
        encoding="utf-8", check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "1 fruit found" in done.stdout
    assert str(out) in done.stdout
    assert len(_photos_in(out)) == 4


@pytest.mark.skipif(sys.platform != "linux", reason="lscpu is a program of Linux")
def test_other_programs_are_asked_in_utf8_too_where_the_locale_is_another(tmp_path: Path) -> None:
    """NumPy, as SciPy imports it, asks lscpu, which answers in the language and the encoding of the locale."""
    lscpu = tmp_path / "lscpu"
    lscpu.write_text("""#!/bin/sh\n[ "$(locale charmap)" = UTF-8 ] || printf '\\335ndirect\\n'\n""")
    lscpu.chmod(0o755)
    code = "import pomona.cli, os; pomona.cli._speak_utf8(); import numpy.testing; print(os.environ['LC_MESSAGES'])"
    paths = {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": os.pathsep.join(sys.path)}
    plain = {**os.environ, **paths, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run([sys.executable, "-c", code], env=plain, capture_output=True, encoding="utf-8", check=False)
    assert (done.stdout, done.stderr) == ("C\n", "")
