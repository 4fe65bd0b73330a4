"""Models that their own matches contradict come apart, and what matches bring together is joined; truth is known."""

from dataclasses import replace

import numpy as np
import pytest

from pomona.basics.geometry import Similarity
from pomona.stages.sfm.colmap.two_views import Overlap
from pomona.stages.sfm.joining import Group, MatchedPhotos, join_groups
from pomona.stages.sfm.models import Model
from pomona.stages.sfm.seams import parted
from pomona.stages.sfm.selection import explained
from test_sfm_parts import LENS, model, overlaps_of

COUNT, STEP = 10, 5  # photos, and the first of the second half
WHOLE = model(COUNT, points=500)
NEAR = [o for o in overlaps_of(WHOLE)[0] if o.second - o.first <= 2]
KEYPOINTS = overlaps_of(WHOLE)[1]


def scene(overlaps: list[Overlap]) -> MatchedPhotos:
    rays = [LENS.cam_from_px(xy) for xy in KEYPOINTS]
    return MatchedPhotos(overlaps, rays, np.full(COUNT, LENS.focal_px))


def halves(similarity: Similarity) -> list[Group]:
    """The first half of the photos, and the second in a frame of its own."""
    moved = WHOLE.cameras.transformed(similarity).cam_from_world
    poses = WHOLE.cameras.cam_from_world
    return [Group({i: poses[i] for i in range(STEP)}), Group({i: moved[i] for i in range(STEP, COUNT)})]


def elsewhere() -> Similarity:
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    return Similarity(0.37, turn, np.array([3.0, -1, 2]))


def by_chance(overlap: Overlap, count: int, seed: int) -> Overlap:
    """As many matches as `count` between keypoints that have nothing to do with each other."""
    random = np.random.default_rng(seed)
    sizes = len(KEYPOINTS[overlap.first]), len(KEYPOINTS[overlap.second])
    return replace(overlap, idx=np.stack([random.integers(0, size, count) for size in sizes], axis=1))


def bent(offset_m: float) -> Model:
    """The row with its second half moved aside."""
    poses = WHOLE.cameras.cam_from_world.copy()
    poses[STEP:, :, 3] -= poses[STEP:, :, :3] @ np.array([0.0, offset_m, offset_m])
    return replace(WHOLE, cameras=replace(WHOLE.cameras, cam_from_world=poses))


def test_a_model_that_its_matches_agree_with_stays_whole() -> None:
    shares = explained([WHOLE], NEAR, KEYPOINTS)
    assert shares.min() > 0.99
    assert parted(WHOLE, NEAR, shares, 20) == [WHOLE]
    false = [by_chance(Overlap(0, 9, np.zeros((0, 2), int)), 60, 1)]
    overlaps = NEAR + false
    assert len(parted(WHOLE, overlaps, explained([WHOLE], overlaps, KEYPOINTS), 20)) == 1


def test_a_bent_model_comes_apart_where_it_is_bent() -> None:
    model = bent(0.4)
    shares = explained([model], NEAR, KEYPOINTS)
    parts = parted(model, NEAR, shares, 20)
    assert sorted(part.photo_idx.tolist() for part in parts) == [list(range(STEP)), list(range(STEP, COUNT))]


def test_a_photo_at_a_wrong_place_is_cut_off() -> None:
    poses = WHOLE.cameras.cam_from_world.copy()
    poses[3, :, 3] += [0.0, 0.5, 0.3]
    model = replace(WHOLE, cameras=replace(WHOLE.cameras, cam_from_world=poses))
    parts = parted(model, NEAR, explained([model], NEAR, KEYPOINTS), 20)
    assert sorted(part.photo_idx.tolist() for part in parts) == [[0, 1, 2, 4, 5, 6, 7, 8, 9], [3]]


def test_two_pieces_are_joined_to_scale_and_in_place() -> None:
    (whole,) = join_groups(halves(elsewhere()), scene(NEAR))
    for photo, pose in whole.poses.items():
        centre = -pose[:, :3].T @ pose[:, 3]
        assert np.linalg.norm(centre - WHOLE.cameras.centers_in_world[photo]) < 0.01  # steps are 0.2
        np.testing.assert_allclose(pose[:, :3], WHOLE.cameras.cam_from_world[photo, :, :3], atol=0.005)


def test_photos_without_a_place_are_joined_one_after_the_other() -> None:
    poses = WHOLE.cameras.cam_from_world
    groups = [Group({i: poses[i] for i in range(7)}), *(Group.of_photo(i) for i in (7, 8, 9))]
    (whole,) = join_groups(groups, scene(NEAR))
    assert sorted(whole.poses) == list(range(COUNT))
    off = [np.linalg.norm(-p[:, :3].T @ p[:, 3] - WHOLE.cameras.centers_in_world[i]) for i, p in whole.poses.items()]
    assert max(off) < 0.02


@pytest.mark.parametrize("count", [20, 80])
def test_matches_by_chance_join_nothing(count: int) -> None:
    inside = [o for o in NEAR if (o.first < STEP) == (o.second < STEP)]
    across = [by_chance(o, count, i) for i, o in enumerate(NEAR) if o not in inside]
    assert len(across) == 3
    assert len(join_groups(halves(elsewhere()), scene(inside + across))) == 2


def test_points_that_two_photos_alone_see_do_not_say_how_far() -> None:
    """With no depth known on either side, distance and scale would be made up."""
    last, first = STEP - 1, STEP
    across = next(o for o in NEAR if (o.first, o.second) == (last, first))
    inside = [o for o in NEAR if (o.first < STEP) == (o.second < STEP)]
    lonely = [
        k for k, (a, b) in enumerate(across.idx)
        if not any((o.first == last and a in o.idx[:, 0]) or (o.second == last and a in o.idx[:, 1]) for o in inside)
    ]  # fmt: skip
    only = replace(across, idx=across.idx[lonely])
    assert len(join_groups(halves(elsewhere()), scene([*inside, only]))) == 2
