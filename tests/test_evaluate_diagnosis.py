"""The page of mistakes: what went wrong is known beforehand, and so is what the page has to say of it."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner, Result

from diagnosis_scenes import CENTERS, HEIGHT, KINDS_AND_STAGES, WIDTH, Scene, make_scene, write_survey
from pomona.cli.app import app
from pomona.errors import FormatError, InputError
from pomona.evaluate.diagnosis import (
    Mistake,
    MistakeOptions,
    Mistakes,
    MistakeView,
    crops,
    find_mistakes,
    masks_beside,
    write_mistakes,
)
from pomona.evaluate.diagnosis.crops import brightened, window_around
from pomona.evaluate.diagnosis.find import choose_views
from pomona.evaluate.diagnosis.mistakes import KINDS, STAGES
from pomona.evaluate.diagnosis.spheres import DrawnSpheres
from pomona.evaluate.fruits import Truth, evaluate_fruits
from pomona.evaluate.tables import mistakes_table
from pomona.progress import Silent
from pomona.values import drawing
from pomona.values.detections import Mask, SurveyDetections


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return make_scene(tmp_path_factory.mktemp("row") / "row")


def mistakes_of(scene: Scene, *, masks: bool = True, truth: Truth | None = None, crops: int = 6) -> Mistakes:
    truth = truth or scene.truth
    return find_mistakes(
        scene.survey,
        truth,
        evaluate_fruits(scene.survey.fruits, truth),
        masks=scene.masks if masks else None,
        options=MistakeOptions(crops=crops),
    )


def by_name(mistakes: Mistakes) -> dict[str, Mistake]:
    return {mistake.name: mistake for mistake in mistakes.items}


def page_of(scene: Scene, folder: Path, *, options: MistakeOptions | None = None) -> tuple[Path, Silent]:
    heard = Silent()
    scores = evaluate_fruits(scene.survey.fruits, scene.truth)
    found = find_mistakes(scene.survey, scene.truth, scores, masks=scene.masks, options=options)
    page = write_mistakes(
        folder, scene.survey, scene.truth, scores, found, masks=scene.masks, options=options, progress=heard
    )
    return page, heard


def hidden(truth: Truth) -> Truth:
    """The same fruits, of which nobody knows what photos show."""
    return Truth(truth.ids, truth.centers_in_world, truth.diameters_m)


# What went wrong, and at which stage


def test_kinds_and_stages(scene: Scene) -> None:
    found = mistakes_of(scene)
    assert found.label == "visible"
    assert {name: (m.kind, m.stage) for name, m in by_name(found).items()} == KINDS_AND_STAGES
    assert {kind: sum(of.values()) for kind, of in found.counts().items()} == Counter(
        kind for kind, _ in KINDS_AND_STAGES.values()
    )
    tally = evaluate_fruits(scene.survey.fruits, scene.truth).visible
    assert tally is not None
    assert len(found) == sum(outcome.kind in KINDS for outcome in tally.outcomes)


def test_without_true_masks_discs_tell_the_same(scene: Scene) -> None:
    with_pixels, without = mistakes_of(scene, masks=False), mistakes_of(scene, masks=False, truth=hidden(scene.truth))
    for found in (with_pixels, without):
        assert {name: (m.kind, m.stage) for name, m in by_name(found).items()} == KINDS_AND_STAGES
    assert (with_pixels.label, without.label) == ("visible", "all")
    assert "pixels" in by_name(with_pixels)["true fruit 2"].facts
    assert "if leaves do not hide it" in by_name(without)["true fruit 2"].reason


def test_reasons_say_what_is_known(scene: Scene) -> None:
    reasons = {name: mistake.reason for name, mistake in by_name(mistakes_of(scene)).items()}
    assert reasons["true fruit 2"] == "Not detected in any of 6 photos."
    assert "Detected in 2 of 6 photos; found as fruit 108 from 2 photos, 10 mm off" in reasons["true fruit 6"]
    assert reasons["true fruit 7"] == "Detected in 3 of 6 photos; none of these detections became part of a fruit."
    assert "with scores of up to 0.30, and those below 0.40 are not used" in reasons["true fruit 8"]
    assert "3 of 3 detections make fruit 110, 90 mm off its place" in reasons["true fruit 10"]
    assert "2 of 2 detections went to fruit 104, whose detections mostly show true fruit 4" in reasons["true fruit 3"]
    assert reasons["true fruit 3"].endswith(" Fruit 104 covers its centre.")
    assert reasons["fruit 107"] == "3 of its 3 detections show no true fruit."
    assert reasons["fruit 110"] == "3 of its 3 detections show true fruit 10, 90 mm away."
    assert "this one was seen from west, the other from east" in reasons["fruit 106"]


def test_a_fruit_inside_its_neighbours_detections(scene: Scene) -> None:
    """The detections of true fruit 1 reach over true fruit 2, of which there is less to see: none is of it alone."""
    observations = scene.survey.observations
    detections = dict(scene.survey.detections)
    for photo, detection_id in zip(observations.photo, observations.detection_id.tolist(), strict=True):
        ids = cv2.imread(str(scene.masks[photo]), cv2.IMREAD_UNCHANGED)
        of, row = detections[photo], int(np.flatnonzero(detections[photo].ids == detection_id)[0])
        if ids[tuple(np.floor(of.masks[row].center_px[::-1]).astype(int))] == 1:
            masks = list(of.masks)
            masks[row] = Mask.from_pixels(np.isin(ids, (1, 2)))
            detections[photo] = replace(of, masks=tuple(masks), boxes_px=None)
    changed = scene.with_(detections=SurveyDetections(detections))
    mistake = by_name(mistakes_of(changed))["true fruit 2"]
    assert mistake.stage == "covered"
    assert mistake.reason.endswith("in 3 a neighbour's detection covers it.")
    assert sum(view.note.endswith("inside a detection of true fruit 1") for view in mistake.views) == 3


def test_a_fruit_detected_in_pieces(scene: Scene) -> None:
    detections = dict(scene.survey.detections)
    of = detections["east_000.jpg"]
    ids = cv2.imread(str(scene.masks["east_000.jpg"]), cv2.IMREAD_UNCHANGED) == 7
    piece = Mask.from_pixels(ids & (np.arange(WIDTH) % 2 == 0))
    more = replace(
        of, masks=(*of.masks, piece), scores=np.append(of.scores, 0.7), ids=np.append(of.ids, 999), boxes_px=None
    )
    detections["east_000.jpg"] = more
    mistake = by_name(mistakes_of(scene.with_(detections=SurveyDetections(detections))))["true fruit 7"]
    assert mistake.reason.startswith("Detected in 3 of 6 photos, in pieces in 1; ")
    assert len(next(view for view in mistake.views if view.photo == "east_000.jpg").detection_ids) == 2


def test_a_fruit_that_no_placed_photo_shows(scene: Scene) -> None:
    cameras = scene.survey.cameras
    away = replace(cameras, cam_from_world=cameras.cam_from_world - np.eye(3, 4, 1) * 9)
    mistake = by_name(mistakes_of(scene.with_(cameras=away), masks=False, truth=hidden(scene.truth)))["true fruit 2"]
    assert (mistake.stage, mistake.views) == ("unplaced", ())


def test_found_twice_from_one_side(scene: Scene) -> None:
    everywhere = scene.with_(sides=dict.fromkeys(scene.survey.sides, "row"))
    mistake = by_name(mistakes_of(everywhere))["fruit 106"]
    assert mistake.stage == "twice"
    assert mistake.reason == "It and fruit 105 both are true fruit 5, and photos of row saw both."


def test_a_found_fruit_of_several_or_of_unknown_detections(scene: Scene) -> None:
    """Fruit 107 is given a detection of each of fruits 101, 105 and 110, and keeps one that shows no true fruit."""
    observations = scene.survey.observations
    first = np.array([photo == "east_000.jpg" for photo in observations.photo])
    given = first & np.isin(observations.fruit_id, (101, 105, 110))
    own = observations.fruit_id == 107
    changed = replace(observations, fruit_id=np.where(given, 107, observations.fruit_id))
    mixed = scene.with_(observations=changed[first | ~own], unfiltered=None)
    mistake = by_name(mistakes_of(mixed))["fruit 107"]
    assert mistake.stage == "mixed"
    assert mistake.reason.startswith("Its 4 detections show several true fruits: 1 true fruit ")
    assert mistake.reason.endswith(", 1 none.")
    without = scene.with_(observations=observations[~own], unfiltered=None)
    assert by_name(mistakes_of(without))["fruit 107"].stage == "unknown"


def test_what_a_person_removed_is_not_the_filters_fault(scene: Scene) -> None:
    """Fruit 101 was right, and a person deleted it; fruit 105 became 205 by a correction, at another place."""
    fruits, observations = scene.survey.fruits, scene.survey.observations
    gone = np.isin(fruits.ids, [101, 105])
    centers = fruits.centers_in_world.copy()
    centers[fruits.ids == 101] += [0.003, 0, 0]  # measuring moved it
    measured = replace(fruits, centers_in_world=centers)
    made = replace(fruits[fruits.ids == 105], ids=np.array([205]), centers_in_world=np.array([[0.2, -0.07, 0.12]]))
    after = [*np.flatnonzero(~gone), *np.flatnonzero(fruits.ids == 105)]
    kept = replace(
        fruits[np.array(after)],
        ids=np.append(fruits.ids[~gone], made.ids),
        centers_in_world=np.concatenate([fruits.centers_in_world[~gone], made.centers_in_world]),
    )
    seen = observations[observations.fruit_id != 101]
    seen = replace(seen, fruit_id=np.where(seen.fruit_id == 105, 205, seen.fruit_id))
    corrected = scene.with_(fruits=kept, observations=seen, removed=measured[gone])

    mistakes = by_name(mistakes_of(corrected))

    assert mistakes["true fruit 1"].stage == "removed"
    assert mistakes["true fruit 1"].reason == (
        "Detected in 3 of 6 photos; found as fruit 101 from 3 photos, 3 mm off its place, and then removed by a "
        "correction."
    )
    assert (mistakes["true fruit 6"].stage, mistakes["fruit 205"].stage) == ("dropped", "misplaced")
    assert mistakes["fruit 205"].reason == "3 of its 3 detections show true fruit 5, 70 mm away."


def test_distances_are_those_of_fruits_as_they_were_measured(scene: Scene) -> None:
    """Fruit 110 was 90 mm off before it was measured, and is 60 mm off in the table."""
    centers = scene.survey.fruits.centers_in_world.copy()
    centers[scene.survey.fruits.ids == 110] += [0, 0.03, 0]
    mistakes = by_name(mistakes_of(scene.with_(fruits=replace(scene.survey.fruits, centers_in_world=centers))))
    assert mistakes["fruit 110"].reason == "3 of its 3 detections show true fruit 10, 60 mm away."
    assert "3 of 3 detections make fruit 110, 60 mm off its place" in mistakes["true fruit 10"].reason


def test_what_the_filter_dropped_may_be_unknown(scene: Scene) -> None:
    assert by_name(mistakes_of(scene.with_(unfiltered=None)))["true fruit 6"].stage == "apart"


def test_nothing_wrong(scene: Scene, tmp_path: Path) -> None:
    fruits = scene.survey.fruits[scene.survey.fruits.ids == 101]
    truth = Truth(scene.truth.ids[:1], scene.truth.centers_in_world[:1], scene.truth.diameters_m[:1])
    right = scene.with_(fruits=fruits)
    found = mistakes_of(right, truth=truth)
    assert len(found) == 0
    page = write_mistakes(tmp_path, right.survey, truth, evaluate_fruits(fruits, truth), found)
    assert "Nothing is wrong: all 1 true fruits were found" in page.read_text()


def test_a_fruit_that_was_joined_with_another_when_both_were_measured_is_said_to_be(scene: Scene) -> None:
    unfiltered = scene.survey.unfiltered
    assert unfiltered is not None
    seen = unfiltered[1]
    owners = np.where(seen.fruit_id == 108, 105, seen.fruit_id)
    one = scene.with_(observations=replace(seen, fruit_id=owners))
    missed = by_name(mistakes_of(one))["true fruit 6"]
    assert missed.stage == "taken"
    assert missed.reason.endswith("10 mm off its place, and then joined with fruit 105 when both were measured.")


# The photos that tell


def test_photos_that_show_most_come_first_and_from_both_sides(scene: Scene) -> None:
    told = json.loads((scene.folder / "truth" / "visible_pixels.json").read_text())
    for name in ("true fruit 2", "true fruit 7"):
        views = by_name(mistakes_of(scene, crops=4))[name].views
        best = {
            side: sorted((p for p in told if p.startswith(side)), key=lambda p: (-told[p][name[11:]], p))[:2]
            for side in ("east", "west")
        }
        assert {view.photo for view in views} == {f"{p}.jpg" for of in best.values() for p in of}
        assert {view.photo[:4] for view in views[:2]} == {"east", "west"}
        assert views[0].weight == max(view.weight for view in views)


def test_nearest_photos_where_nobody_knows_what_can_be_seen(scene: Scene) -> None:
    views = by_name(mistakes_of(scene, masks=False, truth=hidden(scene.truth), crops=2))["true fruit 2"].views
    # Fruit 2 is at x = -0.3: nearest are the cameras at x = -0.1 of either side.
    assert {view.photo for view in views} == {"east_000.jpg", "west_000.jpg"}


def test_found_fruits_are_shown_in_the_photos_that_saw_them(scene: Scene) -> None:
    mistakes = by_name(mistakes_of(scene))
    assert {view.photo for view in mistakes["fruit 107"].views} == {f"east_{k:03}.jpg" for k in range(3)}
    assert {view.photo[:4] for view in mistakes["fruit 106"].views} == {"east", "west"}  # and of the fruit it doubles
    assert all("shows true fruit 5" in view.note for view in mistakes["fruit 106"].views)
    notes = {view.photo: view.note for view in mistakes["true fruit 6"].views}
    assert notes["east_000.jpg"].endswith("detected (0.90), in fruit 108 (dropped by the filter)")
    assert notes["west_000.jpg"].endswith("not detected")


def test_choice_of_photos() -> None:
    views = [
        MistakeView("a", "", 100, group="east"),
        MistakeView("b", "", 90, group="east"),
        MistakeView("c", "", 9, group="west"),
    ]
    views += [
        MistakeView("d", "", 5, group="west"),
        MistakeView("a", "", 8, group="west"),
        MistakeView("gone", "", 500, group="west"),
    ]
    names = [view.photo for view in choose_views(views, 9, {"a", "b", "c", "d"})]
    assert names == ["a", "c", "b", "d"]
    assert [view.photo for view in choose_views(views, 2, {"b", "c", "d"})] == ["b", "c"]
    assert choose_views([], 3, set()) == ()


# Crops


def test_crops_show_the_circle_where_the_fruit_projects(scene: Scene, tmp_path: Path) -> None:
    """Around a fruit that nobody detected, a crop is `around` times as wide as it: the circle must be there."""
    options = MistakeOptions(around=2.5, crop_px=300, jpeg_quality=95)
    page_of(scene, tmp_path, options=options)
    for number in (1, 2):
        drawn = cv2.imread(str(tmp_path / "crops" / f"missed-2-{number}-drawn.jpg"))[:, :, ::-1].astype(int)
        plain = cv2.imread(str(tmp_path / "crops" / f"missed-2-{number}.jpg"))
        assert drawn.shape == (300, 300, 3)
        yellow = (drawn[:, :, 0] > 190) & (drawn[:, :, 1] > 150) & (drawn[:, :, 2] < 120)
        rows, columns = np.nonzero(yellow)
        radius = np.hypot(columns - 149.5, rows - 149.5)
        thick = radius[(radius > 40) & (radius < 80)]
        assert len(thick) > 300
        assert 56 < np.median(thick) < 64  # 300 / 2.5 / 2 = 60
        turn = np.degrees(np.arctan2(rows - 149.5, columns - 149.5)) // 30
        assert len(np.unique(turn)) == 12  # all around
        red = plain[plain.shape[0] // 2, plain.shape[1] // 2].astype(int)
        assert red[2] > red[1] + 60  # the fruit itself is in the middle of the photo's part


def test_circles_respect_the_lens(scene: Scene) -> None:
    """What a true mask shows, by rays through the bent lens, fills the circle."""
    tally = evaluate_fruits(scene.survey.fruits, scene.truth).all
    spheres = DrawnSpheres(scene.survey, scene.truth, tally)
    circles = {(c.true, c.fruit_id): c for c in spheres.circles(0)}
    ids = cv2.imread(str(scene.masks["east_000.jpg"]), cv2.IMREAD_UNCHANGED)
    for fruit_id in (1, 7, 11):  # at the photo's edge
        disc = np.zeros((HEIGHT, WIDTH), np.uint8)
        corners = np.round((circles[True, fruit_id].outline_px - 0.5) * 16).astype(np.int32)
        cv2.fillPoly(disc, [corners], 1, cv2.LINE_8, 4)
        shared, union = (disc & (ids == fruit_id)).sum(), (disc | (ids == fruit_id)).sum()
        assert 0.88 < shared / union <= 1
    pinhole = replace(scene.survey.cameras.intrinsics[0], params=np.array([420.0, WIDTH / 2, HEIGHT / 2, 0]))
    straight = replace(scene.survey.cameras, intrinsics=(pinhole,))
    other = DrawnSpheres(replace(scene.survey, cameras=straight), scene.truth, tally).circles(0)[0]
    assert 0.5 < np.linalg.norm(other.center_px - circles[True, 1].center_px) < 10


def test_colours_of_circles(scene: Scene) -> None:
    tally = evaluate_fruits(scene.survey.fruits, scene.truth).all
    circles = {(c.true, c.fruit_id): c for c in DrawnSpheres(scene.survey, scene.truth, tally).circles(0)}
    wanted = {101: drawing.RIGHT, 107: drawing.FALSE, 106: drawing.DOUBLE, 108: drawing.DROPPED}
    assert {i: circles[False, i].colour for i in wanted} == wanted
    assert circles[True, 2].colour == drawing.MISSED
    assert (circles[True, 2].seen, circles[True, 1].seen) == (True, False)  # a fruit that was found needs no second one
    assert (circles[False, 101].seen, circles[False, 106].seen) == (True, False)  # 106 is seen from the west
    about = circles[False, 106].about(None, (106,))
    assert (about.thick, circles[True, 2].about(3, (2,)).thick, about.label) == (True, False, "106")


def test_window_and_cut() -> None:
    pixels = np.arange(60 * 80 * 3, dtype=np.uint32).reshape(60, 80, 3).astype(np.uint8)
    box = np.array([[10.0, 20], [20, 28]])
    window = window_around(box, 2.0, 8, (80, 60), 100)
    assert (window.left, window.top, window.side) == (5, 14, 20)
    assert np.allclose(window.picture_from_photo.at(np.array([[15.0, 24.0]])), [[49.5, 49.5]])  # the middle
    assert np.array_equal(drawing.cut(pixels, window), pixels[14:34, 5:25])
    corner = window_around(np.array([[0.0, 0], [4, 4]]), 2.0, 30, (80, 60), 100)
    assert (corner.left, corner.top, corner.side) == (0, 0, 30)
    wide = window_around(np.array([[0.0, 0], [80, 60]]), 2.0, 30, (80, 60), 40)
    cut = drawing.cut(pixels, wide)
    assert (wide.side, cut.shape) == (80, (40, 40, 3))
    assert (cut[0] == cut[0, 0]).all()  # above the photo


def test_only_what_may_be_in_a_crop_is_drawn_and_the_pictures_are_as_if_all_were(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = Counter[str]()

    def written(name: str) -> dict[str, bytes]:
        def counted(function: Any) -> Any:
            def draw(*arguments: Any, **options: Any) -> None:
                drawn[name] += 1
                function(*arguments, **options)

            return draw

        with monkeypatch.context() as patch:
            for function in ("draw_mask", "draw_sphere", "label_sphere"):
                patch.setattr(crops, function, counted(getattr(crops, function)))
            scores = evaluate_fruits(scene.survey.fruits, scene.truth)
            options = MistakeOptions(around=1.2)
            write_mistakes(
                tmp_path / name, scene.survey, scene.truth, scores, mistakes_of(scene), masks=scene.masks,
                options=options,
            )  # fmt: skip
        return {path.name: path.read_bytes() for path in (tmp_path / name / "crops").iterdir()}

    some = written("some")
    monkeypatch.setattr(crops, "_reaches", lambda box_px, window: True)
    assert some == written("all")
    assert 0 < drawn["some"] < 0.6 * drawn["all"]


def test_only_dark_crops_are_brightened() -> None:
    dark, light = np.full((9, 9, 3), 20, np.uint8), np.full((9, 9, 3), 120, np.uint8)
    assert brightened(light)[1] is False
    brighter, changed = brightened(dark)
    assert (changed, 60 < brighter.mean() < 150) == (True, True)
    black = np.zeros((9, 9, 3), np.uint8)
    assert brightened(black)[1] is False


def test_each_photo_is_read_once(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pomona.stages.capture import read_pixels

    read: Counter[str] = Counter()

    def counting(photo, **options):
        read[photo.name] += 1
        return read_pixels(photo, **options)

    monkeypatch.setattr("pomona.evaluate.diagnosis.crops.read_pixels", counting)
    page_of(scene, tmp_path)
    assert set(read.values()) == {1}
    assert len(read) == 6


# The page


class _Page(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.images: list[tuple[str, str]] = []
        self.tags: Counter[str] = Counter()
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = dict(attributes)
        self.tags[tag] += 1
        if tag not in ("meta", "img", "input"):
            self.open.append(tag)
        if values.get("id"):
            self.ids.append(str(values["id"]))
        if tag == "a":
            self.links.append(str(values["href"]))
        if tag == "img":
            self.images.append((str(values["src"]), str(values["alt"])))

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_page_is_whole_and_fetches_nothing(scene: Scene, tmp_path: Path) -> None:
    path, heard = page_of(scene, tmp_path)
    text = path.read_text()
    page = _Page(text)
    assert page.open == []
    assert heard.warnings == []
    assert (page.tags["article"], page.tags["script"], page.tags["link"]) == (len(KINDS_AND_STAGES), 0, 0)
    assert "://" not in text
    assert "a &lt;small&gt; row" in text
    assert len(set(page.ids)) == len(page.ids)
    for link in page.links:
        assert link[1:] in page.ids if link.startswith("#") else (tmp_path / link).is_file()
    assert all((tmp_path / source).is_file() for source, _ in page.images)
    alts = [alt for source, alt in page.images if source.endswith("-drawn.jpg")]
    assert len(alts) == len(page.images) / 2 > 40
    assert any(alt.startswith("true fruit 2, missed, in east_000.jpg: ") for alt in alts)
    for kind, stage in KINDS_AND_STAGES.values():
        assert f'id="{kind}-{stage}"' in text
        assert STAGES[stage] in text


def test_only_the_worst_are_shown(scene: Scene, tmp_path: Path) -> None:
    path, _ = page_of(scene, tmp_path, options=MistakeOptions(worst=2, crops=1))
    page = _Page(path.read_text())
    assert page.tags["article"] == 2 + 1 + 2 + 1
    assert len(page.images) == 2 * page.tags["article"]
    assert "the worst 2 of 7" in path.read_text()


def test_crops_of_an_earlier_page_go_and_nothing_else(scene: Scene, tmp_path: Path) -> None:
    (tmp_path / "crops").mkdir(parents=True)
    for name in ("missed-999-1.jpg", "missed-999-1-drawn.jpg", "mine.jpg"):
        (tmp_path / "crops" / name).write_bytes(b"old")
    page_of(scene, tmp_path)
    assert not (tmp_path / "crops" / "missed-999-1.jpg").exists()
    assert (tmp_path / "crops" / "mine.jpg").read_bytes() == b"old"


def test_a_fruit_without_diameter_is_a_cross(scene: Scene, tmp_path: Path) -> None:
    fruits = scene.survey.fruits
    unmeasured = replace(fruits, diameters_m=np.where(fruits.ids == 107, np.nan, fruits.diameters_m))
    path, _ = page_of(scene.with_(fruits=unmeasured), tmp_path)
    assert "diameter not measured" in path.read_text()
    assert (tmp_path / "crops" / "false-107-1-drawn.jpg").is_file()


def test_table(scene: Scene) -> None:
    console = Console(width=120, record=True, file=open("/dev/null", "w", encoding="utf-8"))  # noqa: SIM115
    console.print(mistakes_table(mistakes_of(scene)))
    text = console.export_text()
    for word in ("missed", "no detection in any photo", "one true fruit, found once from each side"):
        assert word in text


# What cannot be used


def test_photos_that_are_missing_or_damaged_are_warned_about(scene: Scene, tmp_path: Path) -> None:
    photos = dict(scene.survey.photos)
    del photos["east_001.jpg"]
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"no photo")
    photos["east_002.jpg"] = replace(photos["east_002.jpg"], path=broken)
    photos["west_001.jpg"] = replace(photos["west_001.jpg"], width_px=WIDTH // 2)
    path, heard = page_of(scene.with_(photos=photos), tmp_path / "page")
    text = "\n".join(heard.warnings)
    assert "Photos that were not found have no crops: east_001.jpg" in text
    assert "east_002.jpg: no crops" in text
    assert "expected 400 × 240 pixels, as its camera has, found 200 × 240" in text
    assert {alt.split(" in ")[1][:8] for _, alt in _Page(path.read_text()).images if alt} == {
        "east_000", "west_000", "west_002"
    }  # fmt: skip


def test_truth_in_another_frame_is_warned_about(scene: Scene, tmp_path: Path) -> None:
    moved = replace(scene.truth, centers_in_world=scene.truth.centers_in_world + np.array([5.0, 0, 0]))
    _, heard = page_of(replace(scene, truth=moved), tmp_path)
    assert any("Are survey and truth in one frame" in warning for warning in heard.warnings)


def test_true_masks_of_another_size(scene: Scene, tmp_path: Path) -> None:
    small = tmp_path / "east_000.png"
    cv2.imwrite(str(small), np.zeros((10, 20), np.uint16))
    with pytest.raises(FormatError, match="as large as the photo, 400 × 240, found 20 × 10"):
        find_mistakes(
            scene.survey,
            scene.truth,
            evaluate_fruits(scene.survey.fruits, scene.truth),
            masks={"east_000.jpg": small},
        )


def test_where_true_masks_are(scene: Scene) -> None:
    photos = scene.survey.cameras.photos
    for place in (scene.folder, scene.folder / "truth", scene.folder / "truth" / "fruits.csv"):
        assert masks_beside(place, photos) == scene.masks
    assert masks_beside(scene.folder / "images", photos) == {}


def test_options_that_cannot_be() -> None:
    for wrong in ({"worst": 0}, {"crops": 0}, {"crop_px": 10}, {"around": 0.5}, {"jpeg_quality": 101}):
        with pytest.raises(InputError, match="expected"):
            MistakeOptions(**wrong)  # type: ignore[arg-type]


# The command


@pytest.fixture
def survey(scene: Scene, tmp_path: Path) -> Path:
    return write_survey(scene, tmp_path / "survey")


def pomona(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["evaluate", *map(str, arguments)], env={"COLUMNS": "160"})


def test_command_prints_a_table(scene: Scene, survey: Path, tmp_path: Path) -> None:
    result = pomona(survey, "--truth", scene.folder, "--pictures", tmp_path / "page")
    assert result.exit_code == 0, result.stderr
    for text in ("F1", "What went wrong, and where", "found, and then dropped by the filter", "11 fruits that went"):
        assert text in result.stdout
    assert "Warning" not in result.stderr
    assert _Page((tmp_path / "page" / "index.html").read_text()).tags["article"] == 11


def test_command_prints_json(scene: Scene, survey: Path, tmp_path: Path) -> None:
    arguments = (survey, "--truth", scene.folder / "truth", "--pictures", tmp_path / "page", "--worst", 1, "--json")
    scores = json.loads(pomona(*arguments, "--outcomes").stdout)
    assert scores["visible"]["TP"] == 3
    assert scores["mistakes"]["page"] == str(tmp_path / "page" / "index.html")
    assert scores["mistakes"]["of"] == "visible"
    assert scores["mistakes"]["kinds"]["double"] == {"fruits": 1, "stages": {"sides": 1}}
    assert {(m["kind"], m["stage"]) for m in scores["mistakes"]["fruits"]} == set(KINDS_AND_STAGES.values())
    assert "fruits" not in json.loads(pomona(*arguments).stdout)["mistakes"]


def test_command_finds_photos_elsewhere(scene: Scene, survey: Path, tmp_path: Path) -> None:
    moved = tmp_path / "moved"
    shutil.copytree(scene.folder / "images", moved)
    shutil.copytree(scene.folder / "truth", tmp_path / "truth")
    manifest = json.loads((survey / "survey.json").read_text())
    (survey / "survey.json").write_text(json.dumps({**manifest, "sources": [str(tmp_path / "gone")]}))
    arguments = (survey, "--truth", tmp_path / "truth", "--pictures", tmp_path / "page")
    result = pomona(*arguments)
    assert result.exit_code == 1
    said = " ".join(result.stderr.split())
    assert f"The photos of {survey} were not found in {tmp_path / 'gone'}, {tmp_path / 'truth'}: say where" in said
    assert "say where they are with --photos" in said
    (moved / "west_002.jpg").unlink()
    result = pomona(*arguments, "--photos", moved)
    assert result.exit_code == 0, result.stderr
    assert "Photos that were not found have no crops: west_002.jpg" in result.stderr
    assert pomona(survey, "--truth", scene.folder, "--pictures", tmp_path / "page").exit_code == 0  # beside the truth


def test_command_takes_the_key_frames_that_a_survey_has_of_a_video_that_is_elsewhere(
    scene: Scene, survey: Path, tmp_path: Path
) -> None:
    shutil.copytree(scene.folder / "images", survey / "work" / "frames")
    shutil.copytree(scene.folder / "truth", tmp_path / "truth")
    manifest = json.loads((survey / "survey.json").read_text())
    (survey / "survey.json").write_text(json.dumps({**manifest, "sources": [str(tmp_path / "gone.mp4")]}))
    result = pomona(survey, "--truth", tmp_path / "truth", "--pictures", tmp_path / "page")
    assert result.exit_code == 0, result.stderr
    assert "have no crops" not in result.stderr


def test_command_says_what_a_survey_lacks(scene: Scene, survey: Path, tmp_path: Path) -> None:
    arguments = (survey, "--truth", scene.folder, "--pictures", tmp_path / "page")
    (survey / "work" / "fuse.npz").unlink()
    assert "What the filter dropped is not known" in pomona(*arguments).stderr
    for name, stage in (("observations.csv", "measure"), ("detections.json", "segment")):
        (survey / name).unlink()
        result = pomona(*arguments)
        assert (result.exit_code, f"`pomona {stage}" in result.stderr) == (1, True)
    shutil.rmtree(survey / "cameras")
    assert "`pomona reconstruct" in pomona(*arguments).stderr
    assert "expected at least 1" in pomona(*arguments, "--worst", 0).stderr
    assert "is not a survey" in pomona(scene.folder, *arguments[1:]).stderr


def test_evidence_before_the_filter(scene: Scene) -> None:
    survey = scene.survey
    assert survey.before_filter[0].ids.tolist() == [*survey.fruits.ids.tolist(), 108]
    assert replace(survey, unfiltered=None).before_filter[0] is survey.fruits


def test_what_the_second_look_did_and_whether_rightly(scene: Scene, tmp_path: Path) -> None:
    before = scene.survey.fruits
    # 110 was 90 mm before its true fruit and goes there, 101 leaves its place, 107 was nothing and goes.
    centers = before.centers_in_world.copy()
    centers[before.ids == 110] = CENTERS[10]
    centers[before.ids == 101] += [0, -0.09, 0]
    after = replace(before, centers_in_world=centers)[before.ids != 107]
    looked = scene.with_(looked=(before, after))

    found = mistakes_of(looked)

    effect = found.second_look
    assert effect is not None
    assert (effect.fruits, effect.moved, effect.nearer, effect.farther) == (len(before), 2, 1, 1)
    assert (effect.removed, effect.rightly) == (1, 1)
    assert (effect.gained, effect.lost) == ((10,), (1,))
    assert found.to_json()["second_look"]["gained"] == (10,)
    page, _ = page_of(looked, tmp_path)
    assert "The second look moved 2 of 6 fruits: 1 nearer to a true fruit, 1 farther away." in page.read_text()
    assert mistakes_of(scene).second_look is None
