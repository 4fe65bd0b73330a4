"""The same photos and options give the same bytes in every file, whenever, wherever and on however many processors.

What may differ is named here: times, memory and the paths that a person gave.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import pomona
from pipeline_fakes import Fakes, make_photos
from pomona.export.formats import EXPORT_FORMATS
from pomona.pipeline import run

# Entries of survey.json, of each stage or of all, that are times, the memory that happened to be free, or the digest of
# the report, which shows both.
TIMES = {"created", "changed", "finished_at", "wall_s", "processor_s", "peak_memory_mb", "report.html"}
# Of work/: events with times, the number of a process, where photos' files lie and how old they are, and what COLMAP's
# threads write in the order in which they come to an end.
LEFT_OUT = re.compile(r"work/(run\.jsonl|lock|digests\.json|sfm/.*(\.db|\.log|settings\.json))")
# The bars of the stages' times in the report, and when a GeoPackage was made.
BARS = re.compile(rb"<h2>Time per stage</h2>.*?</div></div>", re.DOTALL)
WHEN = re.compile(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z")


def _content(file: Path, own: Path) -> Any:
    """What is compared of a file: paths below `own` are those of any folder."""
    content = file.read_bytes().replace(str(own).encode(), b"FOLDER")
    if file.name == "survey.json":
        return _without_times(json.loads(content))
    if file.name == "report.html":
        return BARS.sub(b"", content)
    return WHEN.sub(b"", content) if file.suffix == ".gpkg" else content


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_times(item) for key, item in value.items() if key not in TIMES}
    return [_without_times(item) for item in value] if isinstance(value, list) else value


def _files(survey: Path) -> dict[str, Path]:
    found = {path.relative_to(survey).as_posix(): path for path in survey.rglob("*") if path.is_file()}
    return {name: path for name, path in found.items() if not LEFT_OUT.fullmatch(name)}


def _differing(one: Path, other: Path) -> list[str]:
    """Names of files that differ between the surveys in two folders, or are in one of them only."""
    ours, theirs = _files(one / "survey"), _files(other / "survey")
    both = ours.keys() & theirs.keys()
    changed = {name for name in both if _content(ours[name], one) != _content(theirs[name], other)}
    return sorted(changed | (ours.keys() ^ theirs.keys()))


def test_a_run_in_another_folder_at_another_time_writes_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for k, name in enumerate(("one", "anders ü")):
        own = tmp_path / name
        Fakes().install(monkeypatch)
        for photo in make_photos(own / "photos").iterdir():
            os.utime(photo, (1e9 + k, 1e9 + k))
        run([own / "photos"], own / "survey")
        survey = pomona.open(own / "survey")
        for kind, form in EXPORT_FORMATS.items():
            if kind not in ("kml", "rerun"):  # for surveys with a place on Earth; an extra
                survey.export(kind, own / "survey" / f"as-{kind}-{form.file_name}")
    assert len(_files(tmp_path / "one" / "survey")) > 25
    assert _differing(tmp_path / "one", tmp_path / "anders ü") == []


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="processors cannot be chosen here")
def test_other_threads_and_processors_write_the_same(tmp_path: Path) -> None:
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) < 2:
        pytest.skip("needs two processors")
    for name, threads, taken in (("one", "1", cores[:1]), ("anders ü", "3", cores)):
        own = tmp_path / name
        for side in ("east", "west"):
            (own / side).mkdir(parents=True)
            for k in range(3, 8):
                shutil.copy(pomona.sample_folder() / side / f"{side}_{k:03}.jpg", own / side)
        shutil.copy(pomona.sample_folder() / "markers.csv", own)
        command = [sys.executable, "-m", "pomona", "run", "east", "west", "--markers", "markers.csv", "--out", "survey"]
        done = subprocess.run(
            command, cwd=own, preexec_fn=lambda taken=taken: os.sched_setaffinity(0, taken), check=False,
            env={**os.environ, "OMP_NUM_THREADS": threads, "PYTHONHASHSEED": threads, "TZ": f"UTC+{threads}"},
            capture_output=True, encoding="utf-8",
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
    assert len(_files(tmp_path / "one" / "survey")) > 40
    assert _differing(tmp_path / "one", tmp_path / "anders ü") == []
