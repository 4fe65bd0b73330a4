"""The registry of camera formats: each is titled, documented, and recognises its own files and no other's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from camera_scenes import WRITERS, make_scene
from conftest import REPOSITORY
from pomona.formats.cameras.format import CameraFile, CameraFormat
from pomona.formats.cameras.read import KNOWN, find_cameras
from pomona.formats.cameras.registry import CAMERA_FORMATS, recognised

PAGE = REPOSITORY / "docs" / "reference" / "camera-formats.md"
JSON = {each.kind: each.json_name for each in CAMERA_FORMATS if each.json_name}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_recognises_its_own_files_and_no_others(tmp_path: Path, name: str) -> None:
    written = WRITERS[name](make_scene(5, cameras=3, points=6), tmp_path, np.random.default_rng(5)).path
    kind = name.split()[0]
    assert [each.kind for each in CAMERA_FORMATS if each.recognise(CameraFile(written))] == [kind]
    assert find_cameras(written).format.kind == kind
    assert find_cameras(tmp_path).format.kind == kind  # in the folder of its project as well


def test_every_format_is_written_by_a_test() -> None:
    assert {name.split()[0] for name in WRITERS} == {each.kind for each in CAMERA_FORMATS}


@pytest.mark.parametrize("one", CAMERA_FORMATS, ids=lambda one: one.kind)
def test_every_format_has_a_title_and_is_documented(one: CameraFormat) -> None:
    assert one.title in KNOWN
    assert one.title.split()[0] in PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize("kind", JSON)
def test_damaged_json_is_known_by_its_name_or_its_first_keys(tmp_path: Path, kind: str) -> None:
    named = tmp_path / JSON[kind]
    named.write_text('{"broken": ')
    found = recognised(CameraFile(named))
    assert found is not None
    assert found.kind == kind
    other = tmp_path / "cameras_of_may.json"
    other.write_text('{"broken": ')
    assert recognised(CameraFile(other)) is None
    key = {"opensfm": "shots", "nerfstudio": "frames", "openmvg": "sfm_data_version"}[kind]
    other.write_text(f'{{"{key}": ')
    found = recognised(CameraFile(other))
    assert found is not None
    assert found.kind == kind
