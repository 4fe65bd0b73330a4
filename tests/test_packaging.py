"""What is shipped: one version, and a wheel, made of the sdist, that works without the repository."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import pytest
import yaml

import pomona
from conftest import REPOSITORY

PYPROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))


def test_the_version_is_said_in_one_place() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", pomona.__version__)
    assert PYPROJECT["project"]["dynamic"] == ["version"]
    assert "version" not in PYPROJECT["project"]
    assert REPOSITORY / PYPROJECT["tool"]["hatch"]["version"]["path"] == Path(pomona.__file__).resolve()
    citation = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == pomona.__version__
    assert citation["license"] == PYPROJECT["project"]["license"]
    changes = (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")
    headings = re.findall(r"^## (.+)$", changes, re.MULTILINE)
    assert all(re.fullmatch(r"\d+\.\d+\.\d+ \((unreleased|\d{4}-\d\d-\d\d)\)", heading) for heading in headings)
    assert headings[0].split()[0] == pomona.__version__


def test_every_extra_is_tried_before_a_release() -> None:
    script = (REPOSITORY / "packaging" / "check_extras.py").read_text(encoding="utf-8")
    tried = re.findall(r'^    "([\w-]+)":', script, re.MULTILINE)
    assert set(tried) - {"none"} == set(PYPROJECT["project"]["optional-dependencies"]) - {"dev", "docs"}


def test_the_nightly_table_has_a_column_a_revision(tmp_path: Path) -> None:
    path = str(REPOSITORY / ".ci" / "nightly")
    loader = SourceFileLoader("nightly", path)
    spec = spec_from_loader("nightly", loader)
    assert spec is not None
    nightly = module_from_spec(spec)
    sys.modules["nightly"] = nightly  # which its dataclasses look for
    loader.exec_module(nightly)
    assert nightly.of_tests("..\n3 failed, 12 passed, 1 skipped in 9s\n") == {"failed": 3, "passed": 12, "skipped": 1}
    assert nightly.of_sample('Warning: x\n{\n "all": {"F1": 0.9, "T": 64}}') == {"F1": 0.9}
    lines = ["date,revision,check,figure,value", "2026-07-01T01,aaa,scores,F1,0.9", "2026-07-02T01,bbb,scores,F1,0.94"]
    (tmp_path / "figures.csv").write_text("\n".join([*lines, "2026-07-02T01,bbb,slow,passed,1"]) + "\n")
    nightly.write_table(tmp_path / "figures.csv", tmp_path / "table.md")
    assert (tmp_path / "table.md").read_text().splitlines() == [
        "|  | aaa (2026-07-01) | bbb (2026-07-02) |",
        "| --- | --- | --- |",
        "| scores: F1 | 0.9 | 0.94 |",
        "| slow: passed |  | 1 |",
    ]


@pytest.mark.slow
def test_a_wheel_of_the_sdist_works_without_the_repository(tmp_path: Path) -> None:
    pytest.importorskip("build", reason="the package build is not installed")
    pytest.importorskip("hatchling", reason="the package hatchling is not installed")
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(tmp_path), str(REPOSITORY)]
    subprocess.run(build, check=True, capture_output=True)  # the sdist, and the wheel from it
    (sdist,), (wheel,) = tmp_path.glob("*.tar.gz"), tmp_path.glob("*.whl")
    assert f"pomona-{pomona.__version__}-py3-none-any.whl" == wheel.name
    with tarfile.open(sdist) as archive:
        inside = {name.split("/", 1)[1] for name in archive.getnames() if "/" in name}
    assert {"LICENSE", "README.md", "CHANGELOG.md", "CITATION.cff", "tests/test_packaging.py"} <= inside
    names = set(zipfile.ZipFile(wheel).namelist())
    needed = (
        "stages/segment/weights/fruit.onnx", "stages/segment/weights/citrus.onnx",
        "stages/second_look/weights/second_look.onnx", "stages/measure/weights/circles.onnx",
        "stages/filter/weights/object_svm.json",
        "stages/report/static/viewer.js", "stages/report/static/viewer.css", "stages/report/template.html",
        "orchard/page.html", "demo/markers.csv", "demo/truth/fruits.csv", "py.typed",
    )  # fmt: skip
    assert {f"pomona/{name}" for name in needed} <= names
    assert sum(name.startswith("pomona/demo/east/") for name in names) >= 10
    assert not [name for name in names if not name.startswith(("pomona/", "pomona-"))]
    assert 1e6 < wheel.stat().st_size < 40e6
    installed = tmp_path / "installed"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(installed), str(wheel)]
    subprocess.run(install, check=True, capture_output=True)
    code = "import pomona; print(pomona.__file__); print(pomona.sample_folder()); print(len(pomona.__all__))"
    for command in (["-c", code], ["-m", "pomona", "--version"], ["-m", "pomona", "demo", "--help"]):
        done = subprocess.run(
            [sys.executable, *command], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(installed)},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        if command[0] == "-c":
            assert all(line.startswith(str(installed)) for line in done.stdout.splitlines()[:2])
