"""Rendered rows: what is laid out, seen and written, known beforehand; one tiny real render marked slow."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from typer.testing import CliRunner

from pomona.cli.app import app
from pomona.errors import FormatError, InputError, MissingExtraError, MissingFileError, SurveyError
from pomona.learning.synth import LIGHTS, VARIETIES, RowOptions, render, render_row, truth
from pomona.learning.synth.cameras import RowCamera, row_cameras
from pomona.learning.synth.encoding import colours_of_ids, ids_from_colours, visible_pixels
from pomona.learning.synth.layout import lay_out_row
from pomona.learning.synth.meshes import fruit, ground, hedge, plate
from pomona.learning.synth.presets import (
    DEMO,
    ROWS,
    bunched_options,
    dense_options,
    rough_options,
    shaded_options,
    training_options,
)

SMALL = RowOptions(seed=3, trees=2, fruits_per_tree=20, leaves_per_tree=200, photos_per_side=5)


@pytest.fixture(scope="module")
def row():
    return lay_out_row(SMALL)


def test_the_same_seed_gives_the_same_row_and_another_seed_another(row):
    again, other = lay_out_row(SMALL), lay_out_row(RowOptions(seed=4, trees=2, fruits_per_tree=20, leaves_per_tree=200))
    assert np.array_equal(row.fruits.centres_in_world, again.fruits.centres_in_world)
    assert np.array_equal(row.foliage[1].vertices, again.foliage[1].vertices)
    assert not np.array_equal(row.fruits.centres_in_world, other.fruits.centres_in_world)


def test_the_hedge_on_the_horizon_is_far_beyond_both_ends_of_a_row_of_any_length():
    for length_m in (0.0, 5.0, 14.0):
        rim = hedge(length_m, (0.1, 0.1, 0.1), np.random.default_rng(1)).vertices[:, :2]
        assert np.allclose(np.linalg.norm(rim, axis=1), 45)
    for length_m in (20.0, 50.0, 300.0):
        rim = hedge(length_m, (0.1, 0.1, 0.1), np.random.default_rng(1)).vertices[:, :2]
        earth = ground(length_m, (0.1, 0.1, 0.1)).vertices
        assert np.linalg.norm(rim, axis=1).min() == pytest.approx(45)
        assert np.linalg.norm(rim - [length_m, 0], axis=1).min() == pytest.approx(30)
        assert earth[:, 0].max() == pytest.approx(rim[:, 0].max() + 15)


def test_leaves_grow_as_long_and_as_far_about_as_asked():
    def off_wood_m(**leaves: float) -> float:
        row = lay_out_row(replace(SMALL, **leaves))
        wood = cKDTree(np.concatenate([line for wood in row.woods for line in wood.lines]))
        return float(np.median(wood.query(np.concatenate([tree.vertices for tree in row.foliage]))[0]))

    usual = off_wood_m()
    assert 1.3 * usual < off_wood_m(leaf_length_m=0.156) < 2.2 * usual
    assert 1.3 * usual < off_wood_m(leaf_scatter_m=0.08) < 3.0 * usual


def test_cameras_do_not_depend_on_the_fruits():
    more = RowOptions(seed=3, trees=2, fruits_per_tree=50, leaves_per_tree=200, photos_per_side=5)
    for a, b in zip(row_cameras(SMALL), row_cameras(more), strict=True):
        assert np.array_equal(a.rotation_cam_from_world, b.rotation_cam_from_world)
        assert np.array_equal(a.translation_m, b.translation_m)


def test_cameras_look_at_the_row_from_their_side():
    cameras = row_cameras(SMALL)
    assert [c.name for c in cameras] == [f"{s}_{i:03d}" for s in ("east", "west") for i in range(5)]
    for camera in cameras:
        rotation = camera.rotation_cam_from_world
        assert np.allclose(rotation @ rotation.T, np.eye(3))
        assert np.linalg.det(rotation) == pytest.approx(1)
        east = camera.name.startswith("east")
        assert camera.centre_in_world[1] * (-1 if east else 1) == pytest.approx(2.8, abs=0.2)
        at = camera.centre_in_world
        px, depth = camera.project(np.array([[at[0], 0, at[2]], [at[0] + 0.5, 0, at[2]], [at[0], 0, at[2] + 0.5]]))
        assert depth == pytest.approx(2.8, abs=0.3)
        assert (px[1, 0] > px[0, 0]) == east  # +x is to the right from the east
        assert px[2, 1] < px[0, 1] - 100  # up is up


def test_a_walk_round_the_end_goes_on_from_side_to_side_and_looks_at_the_row():
    options = RowOptions(
        trees=2, photos_per_side=6, photos_round_end=9, step_m=0.4, distance_m=2, jitter_m=0, jitter_deg=0
    )
    cameras = row_cameras(options)
    assert [c.name for c in cameras] == [f"walk_{i:03d}" for i in range(21)]
    places = np.array([c.centre_in_world for c in cameras])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps == pytest.approx(0.4, abs=0.09)  # the end is about as long as nine steps
    round_end = places[6:15]
    assert (np.diff(round_end[:, 1]) > 0).all()  # from east to west
    assert round_end[:, 0].max() == pytest.approx(places[10, 0], abs=0.01)  # farthest out half-way
    assert places[10, 0] > options.length_m + 1.3
    ahead = np.array([c.rotation_cam_from_world[2] for c in cameras])
    assert ahead[[0, 10, 20]] == pytest.approx(np.array([[0, 1, 0], [-1, 0, 0], [0, -1, 0]]), abs=0.02)
    middle = np.array([[options.length_m / 2, 0, options.camera_height_m]])
    assert all(c.project(middle)[1][0] > 0.8 for c in cameras)


def test_fruits_hang_apart_from_each_other_and_from_the_trunks(row):
    fruits = row.fruits
    assert list(fruits.ids) == list(range(1, 41))
    assert np.bincount(fruits.trees).tolist() == [0, 20, 20]
    gaps = np.linalg.norm(fruits.centres_in_world[:, None] - fruits.centres_in_world[None], axis=-1)
    np.fill_diagonal(gaps, 9)
    assert (gaps > (fruits.diameters_m[:, None] + fruits.diameters_m) / 2).all()
    for wood in row.woods:
        trunk = wood.lines[0]
        away = np.linalg.norm(fruits.centres_in_world[:, None] - trunk[None], axis=-1).min(axis=1)
        assert (away > fruits.diameters_m / 2).all()
    assert 0.07 < fruits.diameters_m.mean() < 0.08
    assert 0.002 < fruits.diameters_m.std() < 0.008


@pytest.mark.parametrize("name", VARIETIES)
def test_a_fruit_is_as_wide_as_it_says_and_about_a_sphere(name):
    mesh = fruit(VARIETIES[name], 0.08, np.random.default_rng(1))
    width = 2 * np.linalg.norm(mesh.vertices[:, :2], axis=1).max()
    height = np.ptp(mesh.vertices[:, 2])
    assert width == pytest.approx(0.08)
    assert 0.8 < height / width < 1.1
    assert abs(mesh.vertices[:, 2].max() + mesh.vertices[:, 2].min()) < 1e-9
    assert mesh.colours.min() >= 0
    assert mesh.colours.max() <= 1


def test_plates_carry_their_marker_and_face_their_side(row):
    for sides, count in (("east",), 6), (("east", "west"), 12):
        plates = lay_out_row(RowOptions(trees=2, fruits_per_tree=0, leaves_per_tree=5, sides=sides)).plates
        assert len(plates.ids) == count
        centred = plates.centres_in_world[plates.yaw == 0]
        spread = np.linalg.svd(centred - centred.mean(axis=0))[1]
        assert spread[1] > 0.3  # not on one line
    cells = render.marker_cells(row.plates)
    assert len(cells) == 12
    assert {c.shape for c in cells} == {(6, 6)}
    mesh = plate(cells[0], 0.12)
    black = mesh.vertices[mesh.colours[:, 0] < 0.1]
    assert np.ptp(black[:, 0]) == pytest.approx(0.12)
    assert np.ptp(mesh.vertices[:, 2]) == pytest.approx(0.16)


def test_a_plate_seen_by_a_camera_is_read_as_its_marker(row):
    """Paint the plates' cells through a true camera, far to near, and let OpenCV read them."""
    cv2 = pytest.importorskip("cv2")
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    for camera in row_cameras(SMALL)[2], row_cameras(SMALL)[7]:
        image = np.full((camera.height_px, camera.width_px), 128, np.uint8)
        facing = 0.0 if camera.name.startswith("east") else np.pi
        for cells, centre, yaw in zip(
            render.marker_cells(row.plates), row.plates.centres_in_world, row.plates.yaw, strict=True
        ):
            if abs(yaw - facing) > 0.1:
                continue
            mesh = plate(cells, row.plates.size_m)
            turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
            px, _ = camera.project(mesh.vertices @ turn.T + centre)
            for face in mesh.faces[:-1]:
                shade = int(255 * mesh.colours[face[0], 0])
                cv2.fillConvexPoly(image, np.round(px[face]).astype(np.int32), shade)
        corners, ids, _ = detector.detectMarkers(image)
        assert ids is not None
        assert len(ids) >= 2
        for corner, found in zip(corners, ids.ravel(), strict=True):
            px, _ = camera.project(row.plates.centres_in_world[[found]])
            assert np.linalg.norm(corner[0].mean(axis=0) + 0.5 - px[0]) < 2


def test_truth_is_read_as_it_was_written(row, tmp_path):
    folder = truth.RowFolder(tmp_path)
    folder.make()
    cameras = row_cameras(SMALL)
    truth.write_fruits(folder.truth("fruits.csv"), row.fruits)
    truth.write_cameras(folder.truth("cameras.json"), cameras)
    truth.write_markers(folder.truth("markers.csv"), row.plates)
    fruits = truth.read_fruits(folder.truth("fruits.csv"))
    assert np.array_equal(fruits.ids, row.fruits.ids)
    assert np.abs(fruits.centres_in_world - row.fruits.centres_in_world).max() < 1e-5
    for a, b in zip(truth.read_cameras(folder.truth("cameras.json")), cameras, strict=True):
        assert a.name == b.name
        assert np.array_equal(a.translation_m, b.translation_m)
    ids = np.array([[0, 1], [300, 65535]], np.uint16)
    truth.write_mask(folder.mask("east_000"), ids)
    assert np.array_equal(truth.read_mask(folder.mask("east_000")), ids)
    truth.write_visible_pixels(folder, ["east_000"])
    counts = json.loads(folder.truth("visible_pixels.json").read_text())
    assert counts == {"east_000": {"1": 1, "300": 1, "65535": 1}}


def test_broken_truth_is_named(tmp_path):
    path = tmp_path / "fruits.csv"
    with pytest.raises(MissingFileError, match=r"fruits\.csv"):
        truth.read_fruits(path)
    path.write_text("id,tree,x,y,z,diameter\n1,1,0,0,zwei,0.08\n")
    with pytest.raises(FormatError, match="line 2"):
        truth.read_fruits(path)
    path.write_text("id,x\n1,1\n")
    with pytest.raises(FormatError, match="expected the columns"):
        truth.read_fruits(path)
    cameras = tmp_path / "cameras.json"
    cameras.write_text('{"east_000": {"R": 1}}')
    with pytest.raises(FormatError, match=r"cameras\.json"):
        truth.read_cameras(cameras)


def test_ids_survive_being_colours():
    ids = np.array([[0, 1, 255], [256, 4097, 65535]])
    rgb = np.stack([ids % 256, ids // 256, np.zeros_like(ids)], axis=-1).astype(np.uint8)
    assert np.array_equal(ids_from_colours(rgb), ids)
    assert np.array_equal(colours_of_ids(ids.astype(np.uint16)), rgb)
    assert visible_pixels(ids_from_colours(rgb)) == {1: 1, 255: 1, 256: 1, 4097: 1, 65535: 1}
    with pytest.raises(FormatError, match="blue"):
        ids_from_colours(np.full((2, 2, 3), 7, np.uint8))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [({"variety": "pear"}, "pear"), ({"light": "night"}, "night"), ({"sides": ()}, "sides"), ({"trees": 0}, "trees"),
     ({"distance_m": -1.0}, "distance_m"), ({"seed": -1}, "seed"), ({"jpeg_quality": 0}, "jpeg_quality"),
     ({"trees": 100, "fruits_per_tree": 1000}, "65535"), ({"photos_round_end": -1}, "photos_round_end"),
     ({"bunch_share": 1.1}, "bunch_share"),
     ({"photos_round_end": 3, "sides": ("west", "east")}, "east then west"), ({"wind_m": 0.01}, "rough"),
     ({"wind_m": float("nan"), "rough": True}, "wind_m"), ({"leaf_length_m": 0.0}, "leaf_length_m"),
     ({"leaf_scatter_m": -0.1}, "leaf_scatter_m"), ({"exposure": float("inf")}, "exposure")],
)  # fmt: skip
def test_wrong_options_are_named(wrong, said):
    with pytest.raises(InputError, match=said):
        RowOptions(**wrong)


def test_presets_share_no_seed_and_cover_varieties_and_lights():
    scenes = [training_options(n) for n in range(40)]
    dense = [dense_options(n) for n in range(40)]
    bunched = [bunched_options(n) for n in range(40)]
    rough = [rough_options(n) for n in range(40)]
    shaded = [shaded_options(n) for n in range(7)]
    seeds = [s.seed for s in scenes + dense + bunched + rough + shaded] + [DEMO.seed] + [r.seed for r in ROWS.values()]
    assert len(set(seeds)) == len(seeds)
    assert {s.variety for s in scenes} == set(VARIETIES)
    assert {s.light for s in scenes} == set(LIGHTS)
    assert scenes[7] == training_options(7)
    assert {s.variety for s in dense} == set(VARIETIES)
    assert min(s.leaves_per_tree for s in dense) > max(s.leaves_per_tree for s in scenes)
    assert dense[7] == dense_options(7)
    assert bunched[7] == bunched_options(7)
    assert rough[7] == rough_options(7)
    assert all(row.rough and row.sides == ("east", "west") for row in rough)
    assert 0.6 < np.mean([row.bunch_share > 0 for row in rough]) < 1
    assert {s.variety for s in bunched} == set(VARIETIES)
    assert all(0.3 <= s.bunch_share <= 0.9 for s in bunched)
    assert all(s.sides == ("east", "west") and s.bunch_share and s.exposure < 0 for s in shaded)
    assert not any(s.bunch_share for s in scenes + dense)


def test_without_blender_the_extra_is_named(monkeypatch, tmp_path):
    monkeypatch.delitem(sys.modules, "pomona.learning.synth.blender", raising=False)
    monkeypatch.setitem(sys.modules, "bpy", None)
    with pytest.raises(MissingExtraError, match=r"pomona\[synth\]"):
        render_row(SMALL, tmp_path / "row")
    assert list(tmp_path.iterdir()) == []
    said = CliRunner().invoke(app, ["synth", "--out", str(tmp_path / "row")]).stderr
    assert said.count("pip install") == 1


def test_a_finished_row_and_a_foreign_unfinished_one_are_left_alone(tmp_path):
    with pytest.raises(SurveyError, match="exists already"):
        render._unfinished(SMALL, tmp_path)
    out = tmp_path / "row"
    folder = render._unfinished(SMALL, out)
    assert render._unfinished(SMALL, out).root == folder.root  # goes on
    with pytest.raises(SurveyError, match="other options"):
        render._unfinished(RowOptions(seed=9), out)


def _agreement(cameras: tuple[RowCamera, ...], fruits, read) -> np.ndarray:
    """Return (n, 3): offsets x, y of a mask's centroid from the projected centre, and the mask's share of the disc."""
    rows = []
    for camera in cameras:
        ids = read(camera.name)
        px, depth = camera.project(fruits.centres_in_world)
        for i, p, z, size in zip(fruits.ids, px, depth, fruits.diameters_m, strict=True):
            y, x = np.nonzero(ids == i)
            share = len(x) / (np.pi * (camera.focal_px * size / 2 / z) ** 2)
            if share > 0.78:
                rows.append((x.mean() + 0.5 - p[0], y.mean() + 0.5 - p[1], share))
    return np.array(rows)


def test_our_conventions_are_those_of_the_shared_row(shared_data):
    folder = truth.RowFolder(shared_data / "orchard-dev")
    fruits = truth.read_fruits(folder.truth("fruits.csv"))
    cameras = truth.read_cameras(folder.truth("cameras.json"))[::6]
    found = _agreement(cameras, fruits, lambda name: truth.read_mask(folder.mask(name)))
    assert len(found) > 15
    assert np.abs(np.median(found[:, :2], axis=0)).max() < 0.4


@pytest.mark.slow
def test_a_tiny_row_is_rendered_and_its_masks_lie_on_its_fruits(tmp_path):
    pytest.importorskip("bpy")
    options = RowOptions(
        seed=5,
        trees=1,
        fruits_per_tree=25,
        leaves_per_tree=150,
        photos_per_side=1,
        width_px=200,
        height_px=300,
        samples=2,
    )
    out = render_row(options, tmp_path / "row")
    folder = truth.RowFolder(out)
    assert sorted(p.name for p in out.iterdir()) == ["images", "options.json", "truth"]
    assert sorted(p.name for p in (out / "images").iterdir()) == ["east_000.jpg", "west_000.jpg"]
    cameras = truth.read_cameras(folder.truth("cameras.json"))
    fruits = truth.read_fruits(folder.truth("fruits.csv"))
    found = _agreement(cameras, fruits, lambda name: truth.read_mask(folder.mask(name)))
    assert len(found) >= 5
    assert np.abs(np.median(found[:, :2], axis=0)).max() < 0.5
    assert 0.78 < np.median(found[:, 2]) < 1.05
    again = render_row(options, tmp_path / "again")
    assert (again / "truth/masks/east_000.png").read_bytes() == (out / "truth/masks/east_000.png").read_bytes()


def test_fruits_in_bunches_touch_and_none_is_in_another():
    with_bunches = replace(SMALL, fruits_per_tree=60, bunch_share=0.6)
    shares = []
    for options in (replace(with_bunches, bunch_share=0.0), with_bunches):
        fruits = lay_out_row(options).fruits
        assert len(fruits.ids) == 120
        away = np.linalg.norm(fruits.centres_in_world[:, None] - fruits.centres_in_world[None], axis=-1)
        np.fill_diagonal(away, 9)
        gaps = away - (fruits.diameters_m[:, None] + fruits.diameters_m) / 2
        assert gaps.min() > 0
        shares.append((gaps.min(axis=1) < 0.005).mean())
    assert shares[0] < 0.15
    assert 0.5 < shares[1] < 0.9


def test_a_row_some_weeks_later_has_the_same_fruits_grown_and_fewer_of_them():
    later = replace(SMALL, days_later=30, grow_m=0.012, grow_sd_m=0.002, drop_share=0.25)
    before, after = lay_out_row(SMALL), lay_out_row(later)
    one, other = before.fruits, after.fruits
    assert len(other.ids) == 30
    assert set(other.ids) < set(one.ids)
    same = np.isin(one.ids, other.ids)
    assert np.array_equal(one.trees[same], other.trees)
    growth = other.diameters_m - one.diameters_m[same]
    assert growth.mean() == pytest.approx(0.012, abs=0.001)
    assert 0.001 < growth.std() < 0.003
    # They hang lower by half of it, but for those that push each other aside.
    moved = other.centres_in_world - one.centres_in_world[same]
    assert np.median(moved[:, 2] + growth / 2) == pytest.approx(0, abs=1e-9)
    assert np.linalg.norm(moved, axis=1).max() < 0.03
    gaps = np.linalg.norm(other.centres_in_world[:, None] - other.centres_in_world[None], axis=-1)
    np.fill_diagonal(gaps, 9)
    assert (gaps > (other.diameters_m[:, None] + other.diameters_m) / 2).all()
    assert np.array_equal(before.woods[0].lines[0], after.woods[0].lines[0])
    walks = [np.array([c.centre_in_world for c in row_cameras(options)]) for options in (SMALL, later)]
    assert 0.02 < np.linalg.norm(walks[0] - walks[1], axis=1).mean() < 0.2  # by hand, another time


def test_growth_without_days_and_shares_beyond_reason_are_errors():
    for wrong in ({"grow_m": 0.01}, {"grow_sd_m": 0.002}, {"drop_share": 0.2}, {"days_later": 9, "drop_share": 1.0},
                  {"days_later": 9, "grow_m": float("nan")}, {"days_later": -1}):  # fmt: skip
        with pytest.raises(InputError, match=next(iter(reversed(wrong)))):
            RowOptions(**wrong)
