"""Corrections applied to fruits that are known: each kind, by place, and what no longer matches."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from correct_scenes import DIAMETER_M, FALSE_ONE, GRID, MISSED, TWIN_DIAMETER_M, TWINS, disc, found_fruits
from pomona.corrections import Applier, Corrected, Corrections, Found, apply, read_corrections, write_corrections
from pomona.corrections.clicks import diameter_from_edges, lines_in_photos, place_at_depth, place_from_marks
from pomona.corrections.log import Added, Correction, Deleted, Mark, Merged, Moved, Split, in_words, place_of
from pomona.corrections.training import LabelledMasks, write_training
from pomona.errors import FormatError, InputError
from pomona.formats.detections.coco_file import parse_coco
from pomona.stages.planting import on_trees
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.trees import Trunks


@pytest.fixture(scope="module")
def found() -> Found:
    return found_fruits()


def at(place: np.ndarray, off_m: float = 0.0) -> tuple[float, float, float]:
    return place_of((place + np.array([off_m, 0, 0])).tolist())


def fruit_at(fruits: Fruits, place: np.ndarray, within_m: float = 0.02) -> int | None:
    away = np.linalg.norm(fruits.centers_in_world - place, axis=1)
    return int(fruits.ids[away.argmin()]) if away.min() < within_m else None


def mark(found: Found, k: int, place: np.ndarray, off_px: float = 0.0) -> Mark:
    (x, y) = found.cameras.project(k, place[None])[0][0]
    return Mark(found.cameras.photos[k], float(x) + off_px, float(y))


def two_marks(found: Found, place: np.ndarray) -> tuple[Mark, Mark]:
    return mark(found, 0, place), mark(found, 1, place)


def photos_twice(observations: Observations) -> int:
    pairs = list(zip(observations.fruit_id.tolist(), observations.photo, strict=True))
    return len(pairs) - len(set(pairs))


def test_a_false_fruit_is_deleted_and_its_detections_are_false(found: Found) -> None:
    done = apply([Deleted(at=at(GRID[FALSE_ONE]))], found)
    assert len(done.fruits) == len(found.fruits) - 1
    assert fruit_at(done.fruits, GRID[FALSE_ONE]) is None
    gone = fruit_at(found.fruits, GRID[FALSE_ONE])
    assert gone not in done.observations.fruit_id
    assert done.false_ids == set(found.observations.detection_id[found.observations.fruit_id == gone].tolist())
    assert done.detections.total == found.detections.total


def test_a_missed_fruit_is_added_with_the_survey_s_size_and_drawn_where_it_was_clicked(found: Found) -> None:
    done = apply([Added(at=at(MISSED), marks=two_marks(found, MISSED))], found)
    id_ = fruit_at(done.fruits, MISSED)
    assert id_ == found.fruits.ids.max() + 1
    row = done.fruits[done.fruits.ids == id_]
    assert abs(row.diameters_m[0] - DIAMETER_M) < 1e-6
    assert (row.views[0], row.scores[0], row.sides) == (2, 1.0, ("east",))
    mine = done.observations[done.observations.fruit_id == id_]
    assert mine.photo == found.cameras.photos[:2]
    for photo, detection in zip(mine.photo, mine.detection_id.tolist(), strict=True):
        masks = done.detections[photo]
        drawn = masks.masks[masks.ids.tolist().index(detection)]
        true = Mask.from_pixels(disc(found.cameras, found.cameras.photos.index(photo), MISSED))
        assert drawn.iou(true) > 0.85
        assert done.made[detection].how == "drawn"
    assert not set(mine.detection_id.tolist()) & set(done.detected.detection_id.tolist())


def test_a_clicked_size_is_taken(found: Found) -> None:
    done = apply([Added(at=at(MISSED), diameter_m=0.06, diameter_sd_m=0.004)], found)
    row = done.fruits[done.fruits.ids == fruit_at(done.fruits, MISSED)]
    assert (row.diameters_m[0], row.diameter_sds_m[0]) == (0.06, 0.004)


def test_an_added_fruit_takes_detections_that_are_nobody_s(found: Found) -> None:
    photo = found.cameras.photos[2]
    mask = Mask.from_pixels(disc(found.cameras, 2, MISSED))
    before = found.detections[photo]
    more = Detections(
        photo, before.width_px, before.height_px, (*before.masks, mask), np.append(before.scores, 0.6),
        np.append(before.ids, 5000),
    )  # fmt: skip
    free = replace(found, detections=SurveyDetections({**found.detections, photo: more}))
    done = apply([Added(at=at(MISSED), marks=two_marks(found, MISSED))], free)
    mine = done.observations[done.observations.fruit_id == fruit_at(done.fruits, MISSED)]
    assert 5000 in mine.detection_id
    assert len(mine) == 3
    weak = replace(free, least_score=0.7)
    assert 5000 not in apply([Added(at=at(MISSED))], weak).observations.detection_id


def test_an_added_fruit_that_a_run_finds_by_itself_is_not_there_twice(found: Found) -> None:
    done = apply([Added(at=at(GRID[3], 0.02))], found)
    assert len(done.fruits) == len(found.fruits)
    assert done.outcomes[0].problem == ""


def test_two_that_were_taken_for_one_are_split(found: Found) -> None:
    old = fruit_at(found.fruits, TWINS.mean(0))
    done = apply([Split(at=at(TWINS.mean(0)), parts=(at(TWINS[0]), at(TWINS[1])))], found)
    ids = [fruit_at(done.fruits, twin, 0.006) for twin in TWINS]
    assert ids == [old, found.fruits.ids.max() + 1]
    for id_ in ids:
        row = done.fruits[done.fruits.ids == id_]
        assert abs(row.diameters_m[0] - TWIN_DIAMETER_M) < 0.004
        assert row.views[0] == len(found.cameras)
    assert photos_twice(done.observations) == 0
    one, other = (done.observations[done.observations.fruit_id == id_] for id_ in ids)
    for photo, a, b in zip(one.photo, one.detection_id.tolist(), other.detection_id.tolist(), strict=True):
        masks = done.detections[photo]
        first, second = (masks.masks[masks.ids.tolist().index(i)] for i in (a, b))
        assert first.intersection_px(second) == 0
        assert len(done.made[a].of) == 1
    detected = done.detected
    assert np.isin(detected.detection_id, np.concatenate([d.ids for d in found.detections.values()])).all()
    assert done.became == {old: tuple(ids)}


def test_two_that_are_one_are_merged_also_where_a_photo_saw_both(found: Found) -> None:
    # One of the grid as two: east saw the one, west and one of east the other.
    cameras = found.cameras
    whole = fruit_at(found.fruits, GRID[4])
    seen = found.observations
    mine = np.flatnonzero(seen.fruit_id == whole)
    ids = seen.fruit_id.copy()
    west = np.array([i for i in mine if seen.photo[i].startswith("west")])
    ids[west] = 900
    split = Observations(
        np.append(ids, 900), (*seen.photo, cameras.photos[0]), np.append(seen.detection_id, 9000),
        np.concatenate([seen.xy_px, seen.xy_px[mine[:1]]]),
    )  # fmt: skip
    before = found.detections[cameras.photos[0]]
    lower = disc(cameras, 0, GRID[4])
    lower[: int(seen.xy_px[mine[0], 1])] = False
    more = Detections(
        before.photo, before.width_px, before.height_px, (*before.masks, Mask.from_pixels(lower)),
        np.append(before.scores, 0.9), np.append(before.ids, 9000),
    )  # fmt: skip
    other = replace_rows(found.fruits, GRID[4] + [0.07, 0, 0.0], 900)
    twice = replace(
        found, fruits=other, observations=split, detections=SurveyDetections({**found.detections, before.photo: more})
    )
    done = apply([Merged(at=(at(GRID[4]), at(GRID[4], 0.07)))], twice)
    assert len(done.fruits) == len(found.fruits)
    id_ = fruit_at(done.fruits, GRID[4], 0.01)
    row = done.fruits[done.fruits.ids == id_]
    assert (row.views[0], row.sides) == (len(cameras), ("both",))
    assert abs(row.diameters_m[0] - DIAMETER_M) < 0.006
    assert photos_twice(done.observations) == 0
    (made,) = done.made.values()
    assert (made.how, 9000 in made.of, len(made.of)) == ("joined", True, 2)
    # No detection of the survey's file is lost: the photo that saw both has a line for each, at the middle of both.
    detected = done.detected[done.detected.fruit_id == id_]
    assert len(detected) == len(set(detected.detection_id.tolist())) == len(cameras) + 1
    both = np.flatnonzero([photo == cameras.photos[0] for photo in detected.photo])
    assert set(detected.detection_id[both].tolist()) == set(made.of)
    assert len(np.unique(detected.xy_px[both], axis=0)) == 1
    assert sorted(done.became) == sorted([whole, 900])


def test_two_that_hang_far_apart_are_not_merged(found: Found) -> None:
    far = Merged(at=(at(GRID[2]), at(GRID[3])))
    done = apply([far, Merged(at=(at(GRID[0]), at(GRID[1])))], found)  # 0.35 and 0.11 m apart
    assert done.applied == 1
    assert len(done.fruits) == len(found.fruits) - 1
    ids = " and ".join(str(fruit_at(found.fruits, place)) for place in GRID[[2, 3]])
    assert f"fruits {ids} are 0.350 apart" in done.outcomes[0].warning()
    assert "at most 0.120 (1.5 usual diameters) apart" in done.outcomes[0].warning()


def replace_rows(fruits: Fruits, place: np.ndarray, id_: int) -> Fruits:
    """The fruits with one more."""
    return Fruits(
        np.append(fruits.ids, id_), np.concatenate([fruits.centers_in_world, place[None]]),
        np.append(fruits.diameters_m, DIAMETER_M), np.append(fruits.scores, 0.9), np.append(fruits.views, 1),
    )  # fmt: skip


def test_a_fruit_is_moved_to_another_tree(found: Found) -> None:
    done = apply([Moved(at=at(GRID[2]), tree_id=7)], found)
    id_ = fruit_at(found.fruits, GRID[2])
    assert done.fruits.tree_ids[done.fruits.ids == id_].tolist() == [7]
    assert (done.fruits.tree_ids == 7).sum() == 1
    assert done.how == {id_: "moved"}


def test_a_fruit_between_two_trees_hangs_on_the_one_where_a_person_puts_it(found: Found) -> None:
    k = int(np.flatnonzero(found.fruits.ids == fruit_at(found.fruits, GRID[2]))[0])
    trees, others = np.ones(len(found.fruits), np.int64), np.zeros(len(found.fruits), np.int64)
    others[k] = 2
    between = replace(found, fruits=replace(found.fruits, tree_ids=trees, other_tree_ids=others))
    for tree in (0, 1, 2, 3):
        done = apply([Moved(at=at(GRID[2]), tree_id=tree)], between)
        mine = done.fruits[done.fruits.ids == found.fruits.ids[k]]
        assert (mine.tree_ids.tolist(), mine.other_tree_ids.tolist()) == ([tree], [0])


def test_two_that_are_merged_hang_where_the_one_of_known_tree_does(found: Found) -> None:
    one, other = (int(np.flatnonzero(found.fruits.ids == fruit_at(found.fruits, GRID[k]))[0]) for k in (0, 1))
    for known, beside in ((one, 0), (other, 0), (one, 2), (other, 2)):
        trees, others = np.zeros(len(found.fruits), np.int64), np.zeros(len(found.fruits), np.int64)
        trees[known], others[known] = 1, beside
        planted = replace(found, fruits=replace(found.fruits, tree_ids=trees, other_tree_ids=others))
        done = apply([Merged(at=(at(GRID[0]), at(GRID[1])))], planted)
        ((id_, how),) = done.how.items()
        assert how == "merged"
        mine = done.fruits[done.fruits.ids == id_]
        assert (mine.tree_ids.tolist(), mine.other_tree_ids.tolist()) == ([1], [beside])


@pytest.mark.parametrize("diameter_m", [None, 0.07])
def test_an_added_fruit_hangs_on_the_nearest_trunk(found: Found, diameter_m: float | None) -> None:
    trunks = Trunks(np.array([1, 2]), np.array([[-1.0, 0.0], [0.6, 0.0]]))
    planted = replace(found, fruits=on_trees(found.fruits, trunks), trunks=trunks)
    hangs = []
    for x in (-0.5, -0.25, 0.4, 5.0):  # that at -0.25 is between trees, and the fruit nearest to it on the other one
        place = np.array([x, 0.0, 2.3])
        done = apply([Added(at=at(place), marks=two_marks(found, place), diameter_m=diameter_m)], planted)
        new = done.fruits[done.fruits.ids > found.fruits.ids.max()]
        hangs.append((new.tree_ids.tolist(), new.other_tree_ids.tolist()))
    assert hangs == [([1], [0]), ([1], [2]), ([2], [0]), ([0], [0])]


def every_kind(found: Found) -> list[Correction]:
    return [
        Deleted(at=at(GRID[FALSE_ONE])),
        Added(at=at(MISSED), marks=two_marks(found, MISSED)),
        Split(at=at(TWINS.mean(0)), parts=(at(TWINS[0]), at(TWINS[1])), marks=(mark(found, 0, TWINS[0]),)),
        Merged(at=(at(GRID[0]), at(GRID[1]))),
        Moved(at=at(GRID[14]), tree_id=3),
    ]


def test_what_is_not_known_of_a_corrected_fruit_has_a_reason(found: Found) -> None:
    ripe = np.full(len(found.fruits), 0.9)
    measured = replace(found, fruits=replace(found.fruits, visibilities=ripe, heights_m=ripe * DIAMETER_M))
    done = apply([*every_kind(found), Added(at=(2.0, 0.0, 2.0), diameter_m=0.06)], measured)
    fruits, said = done.fruits, np.array([bool(reason) for reason in done.fruits.reasons])
    known = np.stack([fruits.diameters_m, fruits.visibilities, fruits.heights_m, fruits.weights_g])
    assert said.tolist() == (~np.isfinite(known).all(axis=0)).tolist()
    by_person = [reason for reason in fruits.reasons if "by a person" in reason]
    assert any("as large as it was clicked" in reason for reason in by_person)
    assert any("as large as the others" in reason for reason in by_person)


def test_after_another_run_with_other_numbers_all_is_found_again_by_place(found: Found) -> None:
    log = every_kind(found)
    first = apply(log, found)
    again = apply(log, found_fruits(first_id=300, off_m=0.015))
    assert [outcome.problem for outcome in again.outcomes] == [""] * 5
    assert again.fruits.ids.min() >= 300
    assert len(again.fruits) == len(first.fruits)
    for place in first.fruits.centers_in_world:
        assert fruit_at(again.fruits, place, 0.03) is not None


def test_what_matches_nothing_says_so_and_changes_nothing(found: Found) -> None:
    nowhere = (9.0, 9.0, 9.0)
    log = [
        Deleted(at=nowhere), Moved(at=nowhere, tree_id=1), Merged(at=(at(GRID[0]), nowhere)),
        Split(at=nowhere, parts=(nowhere, (9.0, 9.0, 9.1))),
    ]  # fmt: skip
    done = apply(log, found)
    assert all(outcome.problem for outcome in done.outcomes)
    assert "delete the fruit at 9.00, 9.00, 9.00" in done.outcomes[0].warning()
    same(done, apply([], found))
    # Just within half a diameter, and just not.
    assert apply([Deleted(at=at(GRID[2], 0.039))], found).outcomes[0].problem == ""
    assert apply([Deleted(at=at(GRID[2], 0.041))], found).outcomes[0].problem != ""


def same(one: Corrected, other: Corrected) -> None:
    for name in ("ids", "tree_ids", "views"):
        assert np.array_equal(getattr(one.fruits, name), getattr(other.fruits, name))
    # One run in a hundred differs in the last bit, as sums of products do by where in memory their arrays begin.
    for name in ("centers_in_world", "diameters_m"):
        np.testing.assert_allclose(getattr(one.fruits, name), getattr(other.fruits, name), rtol=0, atol=1e-14)
    assert one.observations.detection_id.tolist() == other.observations.detection_id.tolist()
    assert one.fruits.sides == other.fruits.sides


def test_going_on_is_the_same_as_beginning_anew(found: Found) -> None:
    log, applier = every_kind(found), Applier(found)
    for count in (1, 3, 5, 2, 5):
        same(applier.to(log[:count]), apply(log[:count], found))


def test_a_correction_of_a_corrected_fruit(found: Found) -> None:
    log = [*every_kind(found), Deleted(at=at(MISSED)), Deleted(at=at(TWINS[1]))]
    done = apply(log, found)
    assert [outcome.problem for outcome in done.outcomes] == [""] * 7
    assert fruit_at(done.fruits, MISSED) is None
    assert fruit_at(done.fruits, TWINS[1]) is None
    assert fruit_at(done.fruits, TWINS[0]) is not None


def test_points_follow_their_fruits(found: Found) -> None:
    log = every_kind(found)
    ids = [fruit_at(found.fruits, place) for place in (GRID[FALSE_ONE], GRID[5], GRID[0], GRID[1])]
    twin = fruit_at(found.fruits, TWINS.mean(0))
    points = np.concatenate([GRID[[FALSE_ONE, 5, 0, 1]], TWINS])
    cloud = FruitCloud(points, np.zeros((6, 3), np.uint8), np.array([*ids, twin, twin]))
    done = apply(log, found)
    merged = done.outcomes[3].fruits[0]
    assert done.relabelled(cloud).fruit_id.tolist() == [0, ids[1], merged, merged, *done.outcomes[2].fruits]


def test_undo_and_redo() -> None:
    one, other = Deleted(at=(0.0, 0.0, 1.0)), Moved(at=(1.0, 0.0, 1.0), tree_id=2)
    log = Corrections().with_one(one).with_one(other)
    assert log.undo() == Corrections((one,), (other,))
    assert log.undo().undo().redo() == log.undo()
    assert log.undo().undo().redo().redo() == log
    assert log.undo().with_one(one).undone == ()
    with pytest.raises(InputError, match="nothing to undo"):
        Corrections().undo()
    with pytest.raises(InputError, match="nothing to redo"):
        log.redo()


def test_the_log_is_read_as_it_was_written(found: Found, tmp_path: Path) -> None:
    log = Corrections(tuple(every_kind(found))).undo()
    path = tmp_path / "corrections.json"
    write_corrections(path, log)
    again = read_corrections(path)
    assert again.undone == log.undone
    assert [in_words(c) for c in again.done] == [in_words(c) for c in log.done]
    assert isinstance(again.done[1], Added)
    assert again.done[1].marks[0].photo == found.cameras.photos[0]
    assert json.loads(path.read_text())["corrections"][0]["kind"] == "delete"
    assert read_corrections(tmp_path / "none.json") == Corrections()


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"kind": "eat", "at": [0, 0, 0]}, "kind: expected one of delete, add"),
        ({"kind": "delete"}, "'at' is missing"),
        ({"kind": "delete", "at": [0, 0]}, "expected x, y, z"),
        ({"kind": "delete", "at": "here"}, "expected a place"),
        ({"kind": "merge", "at": [[0, 0, 0]]}, "expected two places"),
        ({"kind": "move", "at": [0, 0, 0], "tree_id": 1.5}, "tree_id: expected a whole number"),
        ({"kind": "move", "at": [0, 0, 0], "tree_id": -1}, "expected a positive number"),
        ({"kind": "add", "at": [0, 0, 0], "diameter_m": 0}, "diameter_m: expected a positive number"),
        ({"kind": "add", "at": [0, 0, 0], "marks": [{"photo": "a"}]}, "'x_px' is missing"),
        ("delete", "expected an object"),
    ],
)
def test_a_log_with_a_mistake_says_where(tmp_path: Path, entry: object, said: str) -> None:
    path = tmp_path / "corrections.json"
    good = {"kind": "delete", "at": [0, 0, 1]}
    path.write_text(json.dumps({"format": "pomona-corrections", "version": 1, "corrections": [good, entry]}))
    with pytest.raises(FormatError, match=r"corrections\.json: corrections\[1\]: .*" + said.replace("(", r"\(")):
        read_corrections(path)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"format": "other"}', '{"format": "pomona-corrections", "version": 2}']
)
def test_what_is_no_log_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "corrections.json"
    path.write_text(text)
    with pytest.raises(FormatError, match=r"corrections\.json"):
        read_corrections(path)


def test_clicks_become_a_place(found: Found) -> None:
    exact = place_from_marks(found.cameras, two_marks(found, MISSED), DIAMETER_M)
    assert np.linalg.norm(exact - MISSED) < 1e-4
    three = [mark(found, k, MISSED, off_px=off) for k, off in ((0, 1.5), (1, -1.5), (2, 1.0))]
    assert 0 < np.linalg.norm(place_from_marks(found.cameras, three, DIAMETER_M) - MISSED) < 0.03


@pytest.mark.parametrize(("apart", "refused"), [(0.9, False), (1.1, True)])
def test_lines_that_pass_each_other_by_more_than_a_fruit_are_refused(found: Found, apart: float, refused: bool) -> None:
    across = np.cross(*(MISSED - found.cameras.centers_in_world[:2]))  # both lines
    aside = MISSED + apart * DIAMETER_M * across / np.linalg.norm(across)
    marks = [mark(found, 0, MISSED), mark(found, 1, aside)]
    if refused:
        with pytest.raises(InputError, match="their lines pass each other"):
            place_from_marks(found.cameras, marks, DIAMETER_M)
    else:
        place = place_from_marks(found.cameras, marks, DIAMETER_M)
        assert np.linalg.norm(place - (MISSED + aside) / 2) < DIAMETER_M


def test_clicks_that_say_nothing_of_a_place_are_refused(found: Found) -> None:
    one = mark(found, 0, MISSED)
    with pytest.raises(InputError, match="two photos"):
        place_from_marks(found.cameras, [one, one], DIAMETER_M)
    with pytest.raises(InputError, match="not of the same fruit"):
        place_from_marks(found.cameras, [one, mark(found, 1, GRID[0])], DIAMETER_M)
    poses = found.cameras.cam_from_world.copy()
    poses[1] = poses[0]
    poses[1, 0, 3] += 0.01
    near = replace(found.cameras, cam_from_world=poses)
    with pytest.raises(InputError, match="nearly the same place"):
        place_from_marks(near, two_marks(replace(found, cameras=near), MISSED), DIAMETER_M)
    with pytest.raises(InputError, match="not a photo"):
        place_from_marks(found.cameras, [one, Mark("moon.jpg", 1, 1)], DIAMETER_M)


def test_a_size_from_two_edges(found: Found) -> None:
    eye = found.cameras.centers_in_world[0]
    towards = (MISSED - eye) / np.linalg.norm(MISSED - eye)
    across = np.cross(towards, [0, 0, 1.0])
    across /= np.linalg.norm(across)
    distance, radius = np.linalg.norm(MISSED - eye), DIAMETER_M / 2
    tangent = radius * np.sqrt(1 - (radius / distance) ** 2)
    middle = MISSED - towards * radius**2 / distance
    edges = [mark(found, 0, middle + s * tangent * across) for s in (-1, 1)]
    diameter, sd = diameter_from_edges(found.cameras, edges, MISSED)
    assert abs(diameter - DIAMETER_M) < 1e-5
    assert 0 < sd < 0.03
    with pytest.raises(InputError, match="same place"):
        diameter_from_edges(found.cameras, [edges[0], edges[0]], MISSED)
    with pytest.raises(InputError, match="opposite edges"):
        diameter_from_edges(found.cameras, [edges[0], mark(found, 1, MISSED)], MISSED)


def test_lines_run_through_the_fruit_in_other_photos(found: Found) -> None:
    lines = dict(lines_in_photos(found.cameras, mark(found, 0, MISSED), (2.0, 5.0)))
    assert 0 not in lines
    assert len(lines) >= 3
    for k, line in lines.items():
        xy = found.cameras.project(k, MISSED[None])[0][0]
        steps = [np.linspace(a, b, 20) for a, b in pairwise(line)]
        assert np.linalg.norm(np.concatenate(steps) - xy, axis=1).min() < 3


def test_a_place_at_a_known_depth(found: Found) -> None:
    place = place_at_depth(found.cameras, mark(found, 0, TWINS[1]), TWINS[0])
    assert np.linalg.norm(place - TWINS[1]) < 0.02


def test_training_data_have_corrected_masks(found: Found, tmp_path: Path) -> None:
    loose = found.cameras.photos[0]
    before = found.detections[loose]
    more = Detections(
        loose, before.width_px, before.height_px,
        (*before.masks, Mask.from_pixels(np.ones((9, 9), bool)), Mask.from_pixels(np.ones((5, 5), bool))),
        np.concatenate([before.scores, [0.8, 0.2]]), np.concatenate([before.ids, [7000, 7001]]),
    )  # fmt: skip
    free = replace(found, detections=SurveyDetections({**found.detections, loose: more}))
    done = apply(every_kind(found), free)
    path = tmp_path / "masks.json"
    seen = {"detections": free.detections, "observations": free.observations, "least_score": free.least_score}
    write_training(path, LabelledMasks(photos=free.cameras.photos, **seen))  # nobody corrected it
    uncorrected = {entry["id"]: entry["iscrowd"] for entry in json.loads(path.read_text())["annotations"]}
    assert uncorrected[7000] == 1
    assert 7001 not in uncorrected
    assert sum(crowd == 0 for crowd in uncorrected.values()) == len(free.observations)
    write_training(path, LabelledMasks.of(free, done))
    content = json.loads(path.read_text())
    by_id = {entry["id"]: entry for entry in content["annotations"]}
    assert not set(by_id) & done.false_ids
    assert (by_id[7000]["iscrowd"], by_id[7000]["attributes"]["fruit_id"]) == (1, None)
    assert 7001 not in by_id
    kinds = {(e["attributes"]["correction"], e["attributes"]["mask"]) for e in by_id.values()}
    assert {("added", "drawn"), ("split", "divided"), ("moved", "detected"), ("none", "detected")} <= kinds
    assert len({e["attributes"]["fruit_id"] for e in by_id.values()} - {None}) == len(done.fruits)
    read = parse_coco(path)
    assert len(read.images) == len(found.cameras)
    assert sum(not a.crowd for a in read.annotations) == len(done.observations)
