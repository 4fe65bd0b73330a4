"""The parts of structure from motion, on tiny values."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image

from pomona.basics.gpu import reason_against
from pomona.stages.sfm import SfmOptions
from pomona.stages.sfm.colmap.database import is_whole, missing_features
from pomona.stages.sfm.colmap.mapping import open_models
from pomona.stages.sfm.colmap.two_views import (
    Overlap,
    clear_matches,
    count_matches,
    match_pairs,
    read_matched,
    read_overlaps,
    write_further,
    write_verified,
)
from pomona.stages.sfm.features import Features, extract, root_sift
from pomona.stages.sfm.kept_features import KeptFeatures
from pomona.stages.sfm.models import Model
from pomona.stages.sfm.pairs import candidate_pairs, lookalike_pairs, sequential_pairs, spatial_pairs
from pomona.stages.sfm.seams import held_parts
from pomona.stages.sfm.selection import credible, distinct, explained, explicable, sampson_distance, support, take
from pomona.stages.sfm.thinning import thinned
from pomona.stages.sfm.unregistered import RegistrationEvidence, explain_unregistered
from pomona.stages.sfm.workspace import Workspace
from pomona.values.cameras import Cameras
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo
from sfm_scenes import as_photos, centres, row_poses, with_gnss

LENS = Intrinsics("SIMPLE_RADIAL", 400, 300, np.array([350.0, 200.0, 150.0, 0.02]))


def photos(count: int) -> list[Photo]:
    return [Photo(f"{i}.jpg", Path(f"{i}.jpg"), 400, 300) for i in range(count)]


def model(count: int, points: int = 60, seed: int = 0, first: int = 0) -> Model:
    """Cameras along a row that see random points exactly."""
    random = np.random.default_rng(seed)
    poses = row_poses(count, seed=seed)
    where = random.uniform((-0.6, -0.6, 2), (count * 0.2 + 0.4, 0.6, 4), (points, 3))
    idx, xy = [], []
    cameras = Cameras(tuple(f"{first + i}.jpg" for i in range(count)), (LENS,), np.zeros(count, int), poses)
    for i in range(count):
        seen, _ = cameras.project(i, where)
        inside = np.flatnonzero((seen > 0).all(1) & (seen < (400, 300)).all(1))
        idx += [(point, i) for point in inside]
        xy.append(seen[inside])
    track = np.array(idx)
    order = np.lexsort((track[:, 1], track[:, 0]))
    full = Cameras(
        cameras.photos, (LENS,), np.zeros(count, int), poses, where, np.zeros((points, 3), np.uint8), np.ones(points),
        track[order, 0], track[order, 1], np.concatenate(xy)[order],
    )  # fmt: skip
    return Model(full, np.arange(first, first + count), np.full(count, 0.5))


def overlaps_of(m: Model) -> tuple[list[Overlap], list[np.ndarray]]:
    """Matches between all photos of a model that see the same points; keypoints are the observations."""
    c = m.cameras
    keypoints, where = [], []
    for i in range(len(c)):
        mine = c.track_photo_idx == i
        keypoints.append(c.track_xy_px[mine])
        where.append({int(p): k for k, p in enumerate(c.track_point_idx[mine])})
    found = []
    for i in range(len(c)):
        for j in range(i + 1, len(c)):
            both = sorted(set(where[i]) & set(where[j]))
            if both:
                found.append(Overlap(i, j, np.array([(where[i][p], where[j][p]) for p in both])))
    return found, keypoints


@pytest.mark.parametrize("count", [40, 400])
def test_pairs_grow_with_the_row_not_with_its_square(count: int) -> None:
    empty = [np.zeros((0, 128), np.uint8)] * count
    pairs = candidate_pairs(photos(count), empty, SfmOptions())
    assert 6 * (count - 6) < len(pairs) < 8 * count
    assert all(0 <= i < j < count for i, j in pairs)
    assert len(set(pairs)) == len(pairs)


def test_a_small_folder_is_matched_all_with_all() -> None:
    assert len(candidate_pairs(photos(5), [np.zeros((0, 128), np.uint8)] * 5, SfmOptions())) == 10


def test_sequential_pairs() -> None:
    assert sequential_pairs(4, 1) == {(0, 1), (1, 2), (2, 3), (0, 2), (1, 3)}


def test_photos_taken_nearby_are_pairs_whatever_their_order() -> None:
    # There along the row and back on the same way: photo i and photo 19 - i were taken at the same place.
    located = [with_gnss(p, min(i, 19 - i) * 2.0, 0.0) for i, p in enumerate(photos(20))]
    pairs = spatial_pairs(located, 2)
    assert all((i, 19 - i) in pairs for i in range(10))
    assert (0, 10) not in pairs
    assert spatial_pairs(photos(20), 4) == set()


def test_photos_that_look_alike_are_pairs() -> None:
    random = np.random.default_rng(0)
    places = [root_sift(random.gamma(0.3, size=(300, 128))) for _ in range(12)]
    again = [
        np.clip(place.astype(int) + random.integers(-3, 4, place.shape), 0, 255).astype(np.uint8) for place in places
    ]
    pairs = lookalike_pairs([*places, *again], 1, apart=3)
    assert sum((i, i + 12) in pairs for i in range(12)) >= 11


def test_sampson_distance_is_zero_for_true_poses_and_grows_with_the_error() -> None:
    poses = row_poses(2)
    world = np.random.default_rng(1).uniform((-1, -1, 2), (1, 1, 4), (50, 3))
    rays = [(world @ pose[:, :3].T + pose[:, 3]) for pose in poses]
    rays = [ray / ray[:, 2:] for ray in rays]
    assert sampson_distance(poses[0], poses[1], *rays).max() < 1e-12
    shifted = rays[1] + (0, 0.01, 0)
    distance = sampson_distance(poses[0], poses[1], rays[0], shifted)
    # An error across the epipolar lines is shared between the two photos: 0.01 / sqrt(2).
    assert 0.004 < np.median(distance) < 0.0085


def test_the_criterion_falls_with_a_missing_and_with_a_misplaced_photo() -> None:
    whole = model(6)
    overlaps, keypoints = overlaps_of(whole)
    best = explained([whole], overlaps, keypoints)
    np.testing.assert_allclose(best, 1.0, atol=1e-6)
    without = take(whole, np.arange(6) != 2)
    fewer = explained([without], overlaps, keypoints)
    assert {(o.first, o.second) for o, s in zip(overlaps, fewer, strict=True) if s == 0} == {
        (o.first, o.second) for o in overlaps if 2 in (o.first, o.second)
    }
    poses = whole.cameras.cam_from_world.copy()
    poses[2, :, 3] += (0.0, 0.15, 0.0)
    moved = Model(Cameras(whole.cameras.photos, (LENS,), np.zeros(6, int), poses), whole.photo_idx, whole.scale)
    worse = explained([moved], overlaps, keypoints)
    assert fewer.sum() - 1 < worse.sum() < 0.9 * best.sum()


def seen_less(m: Model, keep: np.ndarray) -> Model:
    """The model with a part of its observations."""
    c = m.cameras
    tracks = c.track_point_idx[keep], c.track_photo_idx[keep], c.track_xy_px[keep]
    fewer = replace(c, track_point_idx=tracks[0], track_photo_idx=tracks[1], track_xy_px=tracks[2])
    return Model(fewer, m.photo_idx, m.scale)


@pytest.mark.parametrize("bridging", [0, 3, 12])
def test_a_model_comes_apart_where_no_points_say_how_large_the_rest_is(bridging: int) -> None:
    whole = model(9, points=900)
    photo, point = whole.cameras.track_photo_idx, whole.cameras.track_point_idx
    assert held_parts(whole) == [whole]
    # Points that photos 0 to 4 see, and those that 4 to 8 see, have photo 4 in common and no more.
    east, west = (np.unique(point[side]) for side in (photo < 4, photo > 4))
    both = np.intersect1d(np.intersect1d(east, west), point[photo == 4])
    kept = np.isin(point, both[:bridging]) | ~np.isin(point, np.intersect1d(east, west))
    parts = held_parts(seen_less(whole, kept))
    if bridging >= 5:
        assert len(parts) == 1
    else:
        assert sorted(sorted(part.photo_idx.tolist()) for part in parts) in (
            [[0, 1, 2, 3, 4], [5, 6, 7, 8]],
            [[0, 1, 2, 3], [4, 5, 6, 7, 8]],
        )


def test_photos_that_see_nothing_in_common_are_parts_of_their_own() -> None:
    whole = model(4)
    parts = held_parts(seen_less(whole, whole.cameras.track_photo_idx != 2))
    assert [part.photo_idx.tolist() for part in parts] == [[0, 1, 3], [2]]
    nothing = held_parts(seen_less(whole, np.zeros(len(whole.cameras.track_photo_idx), bool)))
    assert sorted(part.photo_idx.tolist() for part in nothing) == [[0], [1], [2], [3]]


def test_a_photo_is_in_the_largest_piece_only_and_leftovers_are_dropped() -> None:
    large, bogus, other = model(8), model(4, first=5, seed=2), model(3, first=20, seed=3)
    kept = distinct([bogus, other, large], 3)
    assert [m.photo_idx.tolist() for m in kept] == [list(range(8)), [20, 21, 22]]
    kept = distinct([large, model(6, first=5, seed=2)], 3)
    assert [m.photo_idx.tolist() for m in kept] == [list(range(8)), [8, 9, 10]]


def test_what_pairs_of_photos_explain_by_themselves() -> None:
    """With true geometry all but noise; of matches half of which are wrong, the other half."""
    whole, calibration = model(6), np.array([[350.0, 0, 200], [0, 350, 150], [0, 0, 1]])
    overlaps, keypoints = overlaps_of(whole)
    noise = np.random.default_rng(0)
    seen = [(LENS.cam_from_px(xy) @ calibration.T)[:, :2] + noise.normal(0, 0.3, xy.shape) for xy in keypoints]
    inverse = np.linalg.inv(calibration)
    verified = []
    for overlap in overlaps:
        first, second = whole.cameras.cam_from_world[[overlap.first, overlap.second]]
        turn = second[:, :3] @ first[:, :3].T
        x, y, z = second[:, 3] - turn @ first[:, 3]
        essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn
        verified.append(replace(overlap, fundamental=inverse.T @ essential @ inverse))
    shares = explicable(verified, seen)
    assert ((shares > 0.98) & (shares < 1)).all()
    every_other = (np.arange(o.idx.shape[0]) % 2 == 0 for o in verified)
    wrong = [
        replace(o, idx=np.stack([o.idx[:, 0], np.where(here, np.roll(o.idx[:, 1], 7), o.idx[:, 1])], axis=1))
        for o, here in zip(verified, every_other, strict=True)
    ]
    assert 0.48 < explicable(wrong, seen).mean() < 0.6
    assert (explicable(overlaps, seen) == 1).all()  # nothing is known of their geometry


def test_small_overlaps_weigh_less() -> None:
    overlaps = [Overlap(0, 1, np.zeros((k, 2), int)) for k in (20, 100, 5000)]
    assert support(np.ones(3), overlaps) == 1.0
    assert np.isclose(support(np.array([0.0, 1, 1]), overlaps), 200 / 220)
    assert np.isclose(support(np.array([1.0, 1, 0]), overlaps), 120 / 220)
    assert support(np.zeros(0), []) == 0.0


def test_a_piece_at_odds_with_its_matches_is_dropped() -> None:
    good = model(6)
    overlaps, _ = overlaps_of(good)
    assert credible([good], overlaps, np.full(len(overlaps), 0.8), 0.3) == [good]
    assert credible([good], overlaps, np.full(len(overlaps), 0.1), 0.3) == []


def test_taking_photos_keeps_points_that_two_of_them_see() -> None:
    whole = model(6)
    part = take(whole, np.array([True, False, True, True, False, False]))
    cameras = part.cameras
    assert cameras.photos == ("0.jpg", "2.jpg", "3.jpg")
    assert np.bincount(cameras.track_point_idx, minlength=len(cameras.points_in_world)).min() >= 2
    for i in range(3):
        mine = cameras.track_photo_idx == i
        seen, _ = cameras.project(i, cameras.points_in_world[cameras.track_point_idx[mine]])
        np.testing.assert_allclose(seen, cameras.track_xy_px[mine], atol=1e-9)


def test_thinning_keeps_whole_tracks_and_enough_of_each_photo() -> None:
    whole = model(6, points=400)
    overlaps, keypoints = overlaps_of(whole)
    counts = [len(xy) for xy in keypoints]
    fewer = thinned(overlaps, counts, 40)
    assert [(o.first, o.second) for o in fewer] == [(o.first, o.second) for o in overlaps]
    for photo in range(6):
        mine = [o.idx[:, 0] for o in fewer if o.first == photo] + [o.idx[:, 1] for o in fewer if o.second == photo]
        assert 40 <= len(np.unique(np.concatenate(mine))) < 0.7 * counts[photo]
    # A track that is kept is kept in every overlap that has it.
    kept = {(photo, int(k)) for o in fewer for photo, k in zip((o.first,) * len(o.idx), o.idx[:, 0], strict=True)}
    for before, after in zip(overlaps, fewer, strict=True):
        assert {int(k) for k in before.idx[:, 0] if (before.first, int(k)) in kept} == set(after.idx[:, 0].tolist())


def test_few_matches_are_not_thinned() -> None:
    overlaps, keypoints = overlaps_of(model(4))
    assert thinned(overlaps, [len(xy) for xy in keypoints], 1000) == overlaps


def evidence(overlaps: list[tuple[int, int, int]], **changes: object) -> RegistrationEvidence:
    values: dict[str, object] = {
        "photos": photos(6),
        "features": np.full(6, 3000),
        "sharpness": np.full(6, 1.0),
        "unreadable": {},
        "overlaps": [Overlap(i, j, np.zeros((k, 2), int)) for i, j, k in overlaps],
        "placed": frozenset({0, 1, 2, 3, 4}),
        "dropped": frozenset(),
    }
    return RegistrationEvidence(**{**values, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (evidence([]), "matches no other photo"),
        (evidence([], sharpness=np.array([1, 1, 1, 1, 1, 0.1])), "blurred"),
        (evidence([], features=np.array([3000] * 5 + [20])), "only 20 features"),
        (evidence([(4, 5, 30)]), "overlaps too little.*4.jpg with 30"),
        (evidence([(4, 5, 400)]), "too few points in depth"),
        (evidence([(4, 5, 400)], placed=frozenset({0, 1, 2})), "only with photos that have no place"),
        (evidence([(4, 5, 400)], dropped=frozenset({5})), "too few other photos"),
        (evidence([], unreadable={5: "the file is gone"}), "the file is gone"),
    ],
)
def test_reasons(found: RegistrationEvidence, words: str) -> None:
    import re

    last = explain_unregistered(found)[-1]
    assert last.photo == "5.jpg"
    assert re.search(words, last.reason)
    assert last.advice.endswith(".")


def stored(workspace: Workspace) -> tuple[list[int], int]:
    """Which photos have no features, and how many pairs have matches."""
    return missing_features(workspace.database, len(workspace.photos)), len(read_overlaps(workspace.database))


def matched_workspace(folder: Path) -> Workspace:
    """A work folder with features of all of three photos, and matches of all pairs."""
    workspace = Workspace(folder, photos(3), SfmOptions(), "code 1")
    random = np.random.default_rng(0)
    xy = random.uniform((20, 20), (380, 280), (200, 2))
    descriptors = root_sift(random.gamma(0.3, size=(200, 128)))
    for i in range(3):
        keypoints = np.column_stack([xy[:, 0] + 10 * i, xy[:, 1], np.ones(200), np.zeros(200)]).astype(np.float32)
        workspace.save_features({i: Features(keypoints, descriptors, np.zeros((200, 3), np.uint8), 1.0)})
    match_pairs(workspace.database, [("0.jpg", "1.jpg"), ("0.jpg", "2.jpg"), ("1.jpg", "2.jpg")], SfmOptions())
    return workspace


@pytest.mark.parametrize(
    ("changes", "code_key", "left"),
    [
        ({}, "code 1", ([], 3)),
        ({"good_enough": 0.5, "mappers": ("global",), "threads": 1, "enough_tracks": 500}, "code 1", ([], 3)),
        ({"window": 3}, "code 1", ([], 0)),
        ({"min_matches": 30}, "code 1", ([], 0)),
        ({"max_features": 900}, "code 1", ([0, 1, 2], 0)),
        ({"contrast_threshold": 0.04}, "code 1", ([0, 1, 2], 0)),
        ({}, "code 2", ([0, 1, 2], 0)),
    ],
)
def test_a_work_folder_keeps_what_still_holds(
    tmp_path: Path, changes: dict[str, Any], code_key: str, left: tuple[list[int], int]
) -> None:
    assert stored(matched_workspace(tmp_path / "w")) == ([], 3)
    again = Workspace(tmp_path / "w", photos(3), SfmOptions(**changes), code_key)
    assert stored(again) == left
    assert stored(Workspace(tmp_path / "w", photos(3), SfmOptions(**changes), code_key)) == left


def test_every_option_has_its_place_in_the_work_folder(tmp_path: Path) -> None:
    """An option that is forgotten there would leave old features or matches behind."""
    of_mapping = {"enough_tracks", "min_piece_photos", "least_explained", "first_pair_angle_deg", "mappers"}
    of_mapping |= {"good_enough", "threads", "least_known_points", "least_points"}
    Workspace(tmp_path / "w", photos(3), SfmOptions())
    settings = json.loads((tmp_path / "w" / "settings.json").read_text())
    named = [*settings["features"]["options"], *settings["matches"]["options"], *of_mapping]
    assert sorted(named) == sorted(field.name for field in fields(SfmOptions))


@pytest.mark.parametrize("text", ["", "{", "[]", '{"features": 3}'])
def test_a_work_folder_that_does_not_say_what_it_holds_is_begun_anew(tmp_path: Path, text: str) -> None:
    workspace = matched_workspace(tmp_path / "w")
    (workspace.folder / "settings.json").write_text(text)
    assert stored(Workspace(tmp_path / "w", photos(3), SfmOptions(), "code 1")) == ([0, 1, 2], 0)


@pytest.mark.parametrize("name", ["features.db", "features/000001.npz"])
@pytest.mark.parametrize("how", ["cut", "overwritten", "empty"])
def test_a_work_folder_with_a_damaged_file_is_begun_anew(tmp_path: Path, name: str, how: str) -> None:
    workspace = matched_workspace(tmp_path / "w")
    path = workspace.folder / name
    content = path.read_bytes()
    middle = len(content) // 2
    damaged = {
        "cut": content[:middle],
        "overwritten": content[:50] + bytes(middle) + content[50 + middle :],
        "empty": b"",
    }
    path.write_bytes(damaged[how])
    assert stored(Workspace(tmp_path / "w", photos(3), SfmOptions(), "code 1")) == ([0, 1, 2], 0)


_ON_A_FULL_DISK = """
import contextlib, resource, signal, sys
from pathlib import Path
import numpy as np
from pomona.stages.sfm import SfmOptions
from pomona.stages.sfm.colmap import two_views

path = Path(sys.argv[1])
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # writes beyond the limit fail, as on a disk that is full
limit = 40_000 if sys.argv[2] == "match" else path.stat().st_size // 2
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
with contextlib.suppress(Exception):
    if sys.argv[2] == "match":
        two_views.match_pairs(path, [("0.jpg", "1.jpg"), ("0.jpg", "2.jpg"), ("1.jpg", "2.jpg")], SfmOptions())
    elif sys.argv[2] == "clear":
        two_views.clear_matches(path)
    else:
        idx = np.repeat(np.arange(200)[:, None], 2, axis=1)
        two_views.write_further(path, {(i, j): idx for i in range(3) for j in range(i + 1, 3)}, SfmOptions())
print("goes on")
"""


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="limits of files and room on disks are not known here")
@pytest.mark.parametrize("what", ["match", "clear", "further"])
def test_a_database_that_finds_no_room_does_not_end_the_program(tmp_path: Path, what: str) -> None:
    """COLMAP ends it where its threads cannot write, and where it cannot write a whole database anew, as it does after
    anything in it was deleted."""
    workspace = matched_workspace(tmp_path / "w")
    overlaps = read_overlaps(workspace.database)
    few = {(overlap.first, overlap.second): overlap.idx[:30] for overlap in overlaps}
    clear_matches(workspace.database)
    if what != "match":
        write_verified(workspace.database, few, SfmOptions())
    command = [sys.executable, "-c", _ON_A_FULL_DISK, str(workspace.database), what]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (0, "goes on\n"), done.stderr
    assert is_whole(workspace.database)
    assert stored(workspace)[0] == []


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="how much room a disk has is not asked here")
def test_models_on_a_full_disk_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """COLMAP does not say that it could write a part of them only."""
    assert open_models(tmp_path) == []

    def full(*of: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.posix_fallocate", full)
    with pytest.raises(OSError, match="No space left"):
        open_models(tmp_path)
    assert not list(tmp_path.iterdir())


def test_further_matches_take_the_place_of_fewer_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace = matched_workspace(tmp_path / "w")
    of_all = {(overlap.first, overlap.second): overlap.idx for overlap in read_overlaps(workspace.database)}
    clear_matches(workspace.database)
    assert stored(workspace) == ([], 0)
    few = {pair: idx[:30] if pair == (0, 1) else idx for pair, idx in of_all.items()}
    write_verified(workspace.database, few, SfmOptions())
    further = {pair: idx if pair == (0, 1) else idx[:30] for pair, idx in of_all.items()}
    write_further(workspace.database, further, SfmOptions())
    counted = count_matches(workspace.database, list(of_all))
    assert counted == [len(idx) for idx in of_all.values()]
    verified, verify = [], pycolmap.estimate_two_view_geometry

    def spy(*views: Any) -> Any:
        verified.append(len(views[4]))
        return verify(*views)

    monkeypatch.setattr("pycolmap.estimate_two_view_geometry", spy)
    assert len(read_matched(workspace.database, list(of_all), SfmOptions())) == len(of_all)
    assert verified == [30]  # by those that were there first; what took nobody's place is not verified again
    assert not [path for path in workspace.folder.iterdir() if "better" in path.name]


def test_damaged_features_are_found_anew(tmp_path: Path) -> None:
    write_photo = Image.fromarray(np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8))
    write_photo.save(tmp_path / "a.png")
    photo, kept = Photo("a.png", tmp_path / "a.png", 80, 60), KeptFeatures(tmp_path / "kept", SfmOptions(), "code")
    kept.keep(photo, extract(photo, SfmOptions()))
    assert kept.get(photo) is not None
    (path,) = kept.folder.iterdir()
    content = path.read_bytes()
    for damaged in (b"", content[:-40], content[:300] + bytes(200) + content[500:]):
        path.write_bytes(damaged)
        assert kept.get(photo) is None


def test_the_scene_of_these_tests() -> None:
    assert centres(row_poses(3)).shape == (3, 3)
    assert len(as_photos(*photos(2))) == 2


def test_a_gpu_is_used_only_where_all_that_it_takes_is_there(tmp_path: Path) -> None:
    def tool(status: int) -> str:
        path = tmp_path / f"lists-{status}"
        path.write_text(f"#!/bin/sh\nexit {status}\n")
        path.chmod(0o755)
        return str(path)

    assert "without CUDA" in reason_against(False, tool(0))
    assert "no NVIDIA GPU" in reason_against(True, None)
    assert "no NVIDIA GPU" in reason_against(True, tool(9))
    assert reason_against(True, tool(0)) == ""
