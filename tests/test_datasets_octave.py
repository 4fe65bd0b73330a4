"""What the scripts beside the authors' program write and read; GNU Octave loads it where it is installed."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from datasets_scenes import write_fuji_spheres
from fuse_scenes import cameras_in_a_row, cloud_of, detections_of, sphere_points
from pomona.formats.cameras.bundler import cameras_of, parse_bundle
from pomona.formats.xyz import read_xyz, write_xyz
from pomona.stages.fuse.paper import PaperOptions, fuse

OCTAVE = Path(__file__).resolve().parent.parent / "benchmarks" / "octave"


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"octave_{name}", OCTAVE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_bundler_text_of_a_survey_comes_back(tmp_path: Path) -> None:
    cameras = cameras_in_a_row(count=4)
    points = np.random.default_rng(0).uniform([-0.3, -0.2, -0.3], [0.3, 0.4, 0.3], (12, 3))
    cameras = replace(
        cameras, points_in_world=points, points_rgb=np.full((12, 3), 90, np.uint8), points_error_px=np.zeros(12),
        track_point_idx=np.tile(np.arange(12), 4), track_photo_idx=np.repeat(np.arange(4), 12),
        track_xy_px=np.concatenate([cameras.project(i, points)[0] for i in range(4)]),
    )  # fmt: skip
    lines = script("write_survey").bundler_lines(cameras, [1, 3])
    (tmp_path / "a.out").write_text("\n".join(lines) + "\n")
    back = cameras_of(parse_bundle(tmp_path / "a.out"), ["b", "d"], [(320, 240)] * 2)
    np.testing.assert_allclose(back.cam_from_world, cameras.cam_from_world[[1, 3]], atol=1e-9)
    assert len(back.points_in_world) == 12
    for i in range(2):
        mine = back.track_photo_idx == i
        xy, _ = back.project(i, back.points_in_world[back.track_point_idx[mine]])
        np.testing.assert_allclose(xy, back.track_xy_px[mine], atol=1e-3)


def test_surer_detections_lie_over_others_in_label_images() -> None:
    cameras = cameras_in_a_row(count=1)
    found = detections_of(cameras, np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]), np.array([0.08, 0.07]))["000.jpg"]
    both = replace(found, masks=(found.masks[0], found.masks[0]), scores=np.array([0.9, 0.7]), boxes_px=None)
    labels, scores = script("write_survey").label_image(both)
    assert labels.max() == 1
    assert scores.tolist() == pytest.approx([0.9, 0.7])


def test_agreement_of_points_by_fruit() -> None:
    theirs = np.array([1, 1, 1, 1, 2, 2, 0, 0])
    ours = np.array([5, 5, 5, 0, 3, 3, 3, 0])
    found = script("compare").agreement(theirs, ours)
    assert (found.theirs, found.ours) == (2, 2)
    assert found.overlaps.tolist() == pytest.approx([0.75, 2 / 3])


def test_what_the_program_writes_is_read_back(tmp_path: Path) -> None:
    write_fuji_spheres(tmp_path, n_trees=2)
    compare = script("compare")
    row = compare.read_fuji_row(compare.find_fuji_files(tmp_path / "data"), compare.Silent())
    fused = fuse(row.detections, row.cameras, row.cloud, options=PaperOptions.as_published_code())
    write_xyz(tmp_path / "ours.txt", fused.cloud)
    assert read_xyz(tmp_path / "ours.txt").fruit_id.max() == len(fused.fruits)
    found = compare.compare(tmp_path, tmp_path / "ours.txt")
    assert found.theirs == found.ours == len(fused.fruits) > 8
    assert found.overlaps.min() == 1
    write_xyz(tmp_path / "other.txt", cloud_of(sphere_points(np.array([9.0, 9.0, 9.0]), 0.08)))
    with pytest.raises(ValueError, match="points of the clouds"):
        compare.compare(tmp_path, tmp_path / "other.txt")


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="GNU Octave is not installed")
def test_octave_loads_every_file(tmp_path: Path) -> None:
    write_fuji_spheres(tmp_path, n_trees=1)
    call = f"addpath('{OCTAVE}'); smoke('{tmp_path}')"
    done = subprocess.run(["octave-cli", "--no-gui", "--eval", call], capture_output=True, text=True, check=True)
    lines = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    for side in ("west", "east"):
        assert lines[f"{side}_side_cameras.out"] == "cameras 7 tie points 60"
        assert lines[f"{side}_side_masks"].startswith("masks 7 labels ")
        points = read_xyz(tmp_path / "data" / "pt_clouds" / f"{side}_side_pc.txt")
        assert lines[f"{side}_side_pc.txt"] == f"points {len(points)}"
