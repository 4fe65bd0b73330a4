"""`pomona watch`: files that arrive, what is said of photos at once, places that grow, the same survey at the end."""

from __future__ import annotations

import http.client
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import cv2
import numpy as np
import pytest

import pomona
from fuse_scenes import HEIGHT, WIDTH, cameras_in_a_row, detections_of
from pipeline_fakes import Fakes
from pomona.basics.geometry import estimate_similarity
from pomona.browser.live import Watch, WatchOptions, WatchServer
from pomona.browser.live.arrivals import Arrivals
from pomona.browser.live.checks import Checks, Hint
from pomona.browser.live.coverage import Walk, coverage_of
from pomona.browser.live.provisional import provisional
from pomona.errors import InputError, MissingFileError
from pomona.pipeline import RunOptions, run
from pomona.pipeline.segment import Segmented
from pomona.progress import Silent
from pomona.stages.capture.quality import quality_of
from pomona.stages.filter import shipped
from pomona.stages.report import ReportData
from pomona.stages.report.contract import WatchState
from pomona.stages.sfm import SfmOptions, reconstruct
from pomona.stages.sfm.features import extract
from pomona.stages.sfm.growing import GrowingSide, largest
from pomona.stages.sfm.pieces import Piece
from pomona.stages.sfm.reconstruction import kept_features
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.photos import Photo, Photos
from report_scenes import row_cameras, row_fruits
from serving import get, running
from sfm_scenes import boards, centres, photograph, render, row_poses, save

QUICK = SfmOptions(max_features=800, threads=1)
# Nothing is waited for: files are whole at the second look.
AT_ONCE = WatchOptions(poll_s=0.001)


@pytest.fixture(scope="module")
def row(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Photo], np.ndarray]:
    poses = row_poses(8)
    return photograph(tmp_path_factory.mktemp("row"), poses), poses


# Files that arrive


def test_a_file_is_whole_when_it_no_longer_grows(tmp_path: Path) -> None:
    clock = [0.0]
    arrivals = Arrivals(tmp_path, 1.0, lambda: clock[0])
    photo = tmp_path / "IMG_1.jpg"

    def look() -> list[str]:
        clock[0] += 1
        arrivals.look()
        return sorted(path.name for path in arrivals.whole)

    assert look() == []
    photo.touch()
    assert look() == look() == []  # created, and nothing in it yet
    photo.write_bytes(b"half")
    assert look() == []
    photo.write_bytes(b"half and whole")
    assert look() == []
    assert look() == ["IMG_1.jpg"]
    (tmp_path / "IMG_2.jpg").write_bytes(b"next")
    assert not arrivals.look()  # that was just done
    assert look() == ["IMG_1.jpg"]
    assert look() == ["IMG_1.jpg", "IMG_2.jpg"]
    photo.unlink()
    assert look() == ["IMG_2.jpg"]


def test_folders_that_are_none_are_told_of(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="arrive in"):
        Arrivals(tmp_path / "none", 1.0)
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="is a file"):
        Arrivals(tmp_path / "file", 1.0)


# What is said of a photo


@pytest.mark.parametrize(("factor", "offset", "matter"), [(1, 0, None), (0.01, 0, "dark"), (1, 200, "bright")])
def test_light_is_told_of(row: tuple[list[Photo], np.ndarray], tmp_path: Path, factor, offset, matter) -> None:
    pixels = cv2.imread(str(row[0][0].path)).astype(float) * factor + offset
    photo = save(tmp_path, "p.png", np.clip(pixels, 0, 255).astype(np.uint8))
    assert [hint.matter for hint in Checks(WatchOptions()).exposure(quality_of(photo))] == ([matter] if matter else [])


def test_a_blurred_photo_is_named_once_also_when_it_was_the_first() -> None:
    checks = Checks(WatchOptions())
    said = [(f"p{k}", checks.sharpness(f"p{k}", s)) for k, s in enumerate([0.02, 0.3, 0.28, 0.31, 0.05, 0.29])]
    named = {after: [hint.photo for hint in hints] for after, hints in said if hints}
    assert named == {"p2": ["p0"], "p4": ["p4"]}
    assert "18 % of the usual" in dict(said)["p4"][0].text


def test_photos_that_share_little_are_told_of() -> None:
    checks = Checks(WatchOptions(overlap=40))
    checks.sharpness("p0", 1.0)
    assert checks.overlap("p0", {}) == []  # nothing is before it
    checks.sharpness("p1", 1.0)
    assert checks.overlap("p1", {"p0": 40}) == []
    assert "only 39 points with p0" in checks.overlap("p1", {"p0": 39})[0].text
    assert "shares nothing" in checks.overlap("p1", {})[0].text


def test_coverage_of_a_row() -> None:
    cameras, fruits = row_cameras(5), row_fruits(12)
    fruits = replace(fruits, views=np.array([1, 2, 3] * 4))
    covered = coverage_of(cameras, fruits)
    extent = np.ptp(cameras.centers_in_world, axis=0)
    assert extent.max() <= covered.length_m <= np.linalg.norm(extent)
    assert covered.well_seen == pytest.approx(1 / 3)
    assert np.isnan(coverage_of(cameras, fruits[np.zeros(0, int)]).well_seen)


def test_the_step_of_a_row_walked_there_and_back_is_that_of_one_walk() -> None:
    there, fruits = row_cameras(9), row_fruits(12)
    names = (*there.photos, *(f"back-{name}" for name in there.photos[::-1]))
    poses = np.concatenate([there.cam_from_world, there.cam_from_world[::-1]])
    both = Cameras(names, there.intrinsics, np.zeros(len(names), np.int64), poses, frame=there.frame)
    once, twice = coverage_of(there, fruits), coverage_of(both, fruits)
    assert twice.length_m == pytest.approx(once.length_m)
    assert twice.step_m == pytest.approx(once.step_m, rel=0.1)


def _walks(*offs: np.ndarray, about: np.ndarray) -> Cameras:
    """Walks of 8 photos, 1.4 m long and with steps of 0.2 m, each elsewhere; all but the first look back."""
    first = cameras_in_a_row(8, step_m=0.2)
    poses = [first.cam_from_world]
    for off in offs:
        turned = first.cam_from_world[:, :, :3] @ about
        poses.append(np.concatenate([turned, (first.cam_from_world[:, :, 3] - turned @ off)[:, :, None]], axis=2))
    names = tuple(f"{k}-{name}" for k in range(len(poses)) for name in first.photos)
    return Cameras(names, first.intrinsics, np.zeros(len(names), np.int64), np.concatenate(poses), frame=first.frame)


@pytest.mark.parametrize("moved_m", [0.0, 0.01])
def test_two_sides_far_apart_are_as_long_as_one_and_its_steps_as_wide(moved_m: float) -> None:
    both = _walks(np.array([moved_m, 3.0, 0.0]), about=np.diag([-1.0, -1.0, 1.0]))
    assert np.ptp(both.centers_in_world[:, 1]) == pytest.approx(6.0)
    walks = [Walk("east", both.photos[:8]), Walk("west", both.photos[8:])]
    covered = coverage_of(both, row_fruits(12), walks)
    assert covered.length_m == pytest.approx(1.4 + moved_m, abs=1e-6)
    assert covered.step_m == pytest.approx(0.2)


def test_sides_that_lie_anywhere_are_one_row_and_parts_of_a_side_are_added() -> None:
    cameras = _walks(np.array([5.0, 0.0, 0.0]), np.array([10.0, 0.0, 0.0]), about=np.eye(3))
    names = cameras.photos
    walks = [Walk("east", names[:8]), Walk("east", names[8:16]), Walk("west", names[16:])]
    covered = coverage_of(cameras, row_fruits(12), walks, in_one_frame=False)
    assert (covered.length_m, covered.step_m) == (pytest.approx(2.8), pytest.approx(0.2))
    assert coverage_of(cameras, row_fruits(12), walks).length_m == pytest.approx(11.4)


def test_coverage_of_a_bent_row_goes_along_it() -> None:
    angle = np.linspace(-0.53, 0.53, 121)  # 60 m of chord and 8 m of sagitta: 2.8 m more along it
    eyes = np.column_stack([59.3 * np.sin(angle), 59.3 * (1 - np.cos(angle)), np.full(121, 1.5)])
    few, fruits = row_cameras(5), row_fruits(12)
    poses = np.concatenate([np.tile(np.eye(3), (121, 1, 1)), -eyes[:, :, None]], axis=2)
    names = tuple(f"{k:03}.jpg" for k in range(121))
    lenses = np.zeros(121, np.int64)
    row = Cameras(names, few.intrinsics, lenses, poses, frame=few.frame)
    assert coverage_of(row, fruits).length_m == pytest.approx(59.3 * 1.06, abs=0.3)


# Places that grow


def test_a_row_grows_photo_by_photo(row: tuple[list[Photo], np.ndarray], tmp_path: Path) -> None:
    photos, poses = row
    growing = GrowingSide(tmp_path / "row", "", QUICK)
    placed = []
    for photo in photos:
        shared = growing.add(photo, extract(photo, QUICK))
        assert all(name < photo.name for name in shared)
        assert list(shared.values()) == sorted(shared.values(), reverse=True)
        placed.append([len(piece.cameras) for piece in growing.place()])
    assert placed == [[], [], *([k] for k in range(3, 9))]
    (piece,) = growing.place()
    truth = centres(poses)[[int(name[-7:-4]) for name in piece.cameras.photos]]
    found = piece.cameras.centers_in_world
    errors = estimate_similarity(found, truth).apply(found) - truth
    assert 1e-6 < float(np.sqrt((errors**2).sum(1).mean())) < 0.03


@pytest.mark.slow
def test_after_a_gap_another_piece_begins(row: tuple[list[Photo], np.ndarray], tmp_path: Path) -> None:
    elsewhere = boards(3.0, seed=5)
    others = [save(tmp_path / "more", f"q {i}.png", render(elsewhere, pose)) for i, pose in enumerate(row_poses(5))]
    growing = GrowingSide(tmp_path / "row", "", QUICK)
    for photo in row[0][:5]:
        growing.add(photo, extract(photo, QUICK))
    assert [len(piece.cameras) for piece in growing.place()] == [5]
    assert growing.add(others[0], extract(others[0], QUICK)) == {}
    for photo in others[1:]:
        assert growing.add(photo, extract(photo, QUICK))
    assert [len(piece.cameras) for piece in growing.place()] == [5, 5]


def test_the_largest_features_are_kept_in_order(row: tuple[list[Photo], np.ndarray]) -> None:
    features = extract(row[0][0], QUICK)
    few = largest(features, 50)
    assert len(few.keypoints) == len(few.descriptors) == len(few.rgb) == 50
    assert few.keypoints[:, 2].min() >= np.sort(features.keypoints[:, 2])[-50]


# The count so far


@pytest.mark.parametrize("options", [{}, {"filter_model": "object"}, {"filter_model": "second-look"}])
def test_the_count_so_far_is_filtered_whatever_machine_the_run_will_have(options: dict[str, str]) -> None:
    cameras = replace(cameras_in_a_row(8), frame=WorldFrame())
    centers = np.array([[-0.2, 0.0, 0.1], [0.0, 0.0, -0.1], [0.2, 0.0, 0.05]])
    masks = detections_of(cameras, centers, np.full(3, 0.075))
    models = {"object": shipped("object"), "second-look": shipped("object", "second-look")}
    chosen = RunOptions(**{name: models[value] for name, value in options.items()})
    chosen.check_files()
    photos = Photos(tuple(Photo(name, Path(name), WIDTH, HEIGHT) for name in cameras.photos))
    answer = provisional([Piece("", cameras, 0.5)], Segmented(masks, 0.5), photos, chosen.of_stages)
    assert len(answer.fruits) == 3
    assert answer.coverage.length_m == pytest.approx(7 * 0.15, rel=0.1)


# The survey at the end


def test_a_run_finds_features_that_were_kept(
    row: tuple[list[Photo], np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    photos = row[0][:4]
    kept = kept_features(tmp_path, QUICK, "key")
    for photo in photos:
        assert kept.get(photo) is None
        kept.keep(photo, extract(photo, QUICK))
    assert kept_features(tmp_path, QUICK, "other code").get(photos[0]) is None
    assert kept_features(tmp_path, replace(QUICK, max_features=900), "key").get(photos[0]) is None

    def again(*_: object) -> NoReturn:
        raise AssertionError("features are found again")

    fresh = reconstruct(Photos(tuple(photos)), options=QUICK, work_dir=tmp_path / "fresh", code_key="key")
    monkeypatch.setattr("pomona.stages.sfm.reconstruction.extract", again)
    reused = reconstruct(Photos(tuple(photos)), options=QUICK, work_dir=tmp_path, code_key="key")
    one, other = (result.pieces[0].cameras for result in (fresh, reused))
    assert np.allclose(one.centers_in_world, other.centers_in_world)


@pytest.mark.slow
def test_photos_are_taken_in_as_they_come_and_nothing_is_looked_for_twice(
    row: tuple[list[Photo], np.ndarray], fakes: Fakes, tmp_path: Path
) -> None:
    folder, source = tmp_path / "in", row[0][0].path.parent
    folder.mkdir()
    coming = sorted(source.glob("*.png"))
    blurred = cv2.GaussianBlur(cv2.imread(str(coming[5])), (0, 0), 8)
    (folder / "broken.jpg").write_bytes(b"no photo")
    states: list[WatchState] = []
    hints: list[Hint] = []
    answers: list[tuple[ReportData, int]] = []

    def told(state: WatchState) -> None:
        """Copy the next photo whenever one is waited for."""
        states.append(state)
        if state.phase == "waiting" and coming:
            photo = coming.pop(0)
            if photo.name == "p_005.png":
                cv2.imwrite(str(folder / photo.name), blurred)
            else:
                shutil.copy(photo, folder)

    watch = Watch(
        folder,
        tmp_path / "out",
        RunOptions(sfm=QUICK),
        replace(AT_ONCE, until=9),
        on_state=told,
        on_hint=hints.append,
        on_answer=lambda data, revision: answers.append((data, revision)),
    )
    for photo in [coming.pop(0) for _ in range(4)]:
        shutil.copy(photo, folder)
    watch.follow()
    assert [photo.name for photo in watch.photos] == [f"p_{k:03}.png" for k in range(8)]
    assert {(hint.photo, hint.matter) for hint in hints} == {("broken.jpg", "unreadable"), ("p_005.png", "blurred")}
    (text,) = (hint.text for hint in hints if hint.matter == "unreadable")
    assert text.startswith("cannot be used: this is no image")
    assert states[-1].phase == "waiting"
    assert states[-1].fruits == 1
    assert [revision for _, revision in answers] == list(range(1, len(answers) + 1))
    assert states[-1].revision == len(answers) >= 1
    assert watch.answer is not None
    shown = watch.answer.page_data("row", watch.photos, RunOptions(fruit="orange"))
    assert (shown.fruit_words, shown.packing) == ("oranges", "citrus")
    assert watch.answer.page_data("row", watch.photos, RunOptions(packing="60,70")).packing == "60,70"
    before = fakes.calls["tiles"]
    assert before >= 8
    summary = watch.finish(Silent())
    assert fakes.calls["tiles"] == before
    assert (summary.fruits, states[-1].phase, states[-1].fruits) == (1, "finished", 1)
    again = run([folder], tmp_path / "again", RunOptions(sfm=QUICK))
    assert fakes.calls["tiles"] > before
    assert again.detections == summary.detections


def _arrived(row: list[Photo], folder: Path, names: dict[str, int]) -> Path:
    folder.mkdir(exist_ok=True)
    for name, k in names.items():
        shutil.copy(row[k].path, folder / name)
    return folder


@pytest.mark.parametrize("option", ["sides", "positions", "gcp"])
def test_options_may_speak_of_photos_that_have_yet_to_come(
    row: tuple[list[Photo], np.ndarray], fakes: Fakes, tmp_path: Path, option: str
) -> None:
    folder = _arrived(row[0], tmp_path / "in", {f"east_{k}.png": k for k in range(3)})
    (folder / "broken.png").write_bytes(b"no photo")
    (tmp_path / "positions.csv").write_text("photo,latitude,longitude\nwest_9.png,47.1,8.1\n")
    (tmp_path / "gcp.txt").write_text("EPSG:32632\n" + "500000 5200000 400 100 100 west_9.png a\n" * 3)
    given = {"sides": "east_*,west_*", "positions": tmp_path / "positions.csv", "gcp": tmp_path / "gcp.txt"}
    hints: list[Hint] = []
    options = RunOptions(sfm=QUICK, **{option: given[option]})  # type: ignore[arg-type]
    watch = Watch(folder, tmp_path / "out", options, replace(AT_ONCE, until=4, idle_s=20.0), on_hint=hints.append)
    watch.follow()
    assert [photo.name for photo in watch.photos] == [f"east_{k}.png" for k in range(3)]
    assert {photo.side for photo in watch.photos} == {"east" if option == "sides" else "row"}
    assert [hint.photo for hint in hints] == ["broken.png"]


def test_photos_that_do_not_go_with_the_options_are_told_of_until_they_do(
    row: tuple[list[Photo], np.ndarray], fakes: Fakes, tmp_path: Path
) -> None:
    folder = _arrived(row[0], tmp_path / "in", {"east_0.png": 0, "IMG_1.png": 1})
    hints: list[Hint] = []
    states: list[WatchState] = []

    def told(state: WatchState) -> None:
        states.append(state)
        if hints and (folder / "IMG_1.png").exists():
            assert state.photos == 0
            _arrived(row[0], folder, {"east_2.png": 2, "west_3.png": 3})
            (folder / "IMG_1.png").unlink()

    options = RunOptions(sfm=QUICK, sides="east_*,west_*")
    watch = Watch(folder, tmp_path / "out", options, replace(AT_ONCE, until=3), on_state=told, on_hint=hints.append)
    watch.follow()
    (hint,) = (hint for hint in hints if hint.matter == "unreadable")
    assert hint.photo == "in"
    assert "IMG_1.png matches neither pattern" in hint.text
    assert {photo.name: photo.side for photo in watch.photos} == {
        "east_0.png": "east", "east_2.png": "east", "west_3.png": "west",
    }  # fmt: skip


@pytest.mark.slow
def test_a_photo_may_be_deleted_while_it_is_worked_on(
    row: tuple[list[Photo], np.ndarray], fakes: Fakes, tmp_path: Path
) -> None:
    folder = tmp_path / "in"
    shutil.copytree(row[0][0].path.parent, folder)

    def told(state: WatchState) -> None:
        if state.doing == "Placed p_003.png":
            (folder / "p_003.png").unlink()

    watch = Watch(folder, tmp_path / "out", RunOptions(sfm=QUICK), replace(AT_ONCE, until=8), on_state=told)
    watch.follow()
    others = [f"p_{k:03}.png" for k in range(8) if k != 3]
    assert [photo.name for photo in watch.photos] == others
    assert watch.answer is not None
    assert sorted(watch.answer.cameras.photos) == others
    assert watch.finish(Silent()).photos == 7


@pytest.mark.slow
def test_a_photo_that_was_deleted_does_not_count_any_more(
    row: tuple[list[Photo], np.ndarray], fakes: Fakes, tmp_path: Path
) -> None:
    folder = tmp_path / "in"
    shutil.copytree(row[0][0].path.parent, folder)
    (folder / "broken.jpg").write_bytes(b"no photo")
    states: list[WatchState] = []

    def told(state: WatchState) -> None:
        states.append(state)
        if state.phase != "waiting" or not state.revision:
            return
        if len(watch.photos) < 8:
            watch.stop()
        elif state.photos == 9 and (folder / "p_003.png").exists():
            (folder / "p_003.png").unlink()
            (folder / "broken.jpg").unlink()

    watch = Watch(folder, tmp_path / "out", RunOptions(sfm=QUICK), replace(AT_ONCE, idle_s=600.0), on_state=told)
    watch.follow()
    others = [f"p_{k:03}.png" for k in range(8) if k != 3]
    assert watch.answer is not None
    assert sorted(watch.answer.cameras.photos) == others
    assert (states[-1].photos, states[-1].placed) == (7, 7)


def test_watching_can_be_stopped_and_ends_when_nothing_comes(tmp_path: Path, fakes: Fakes) -> None:
    (tmp_path / "in").mkdir()
    watch = Watch(tmp_path / "in", tmp_path / "out", RunOptions(), AT_ONCE)
    watch.stop()
    watch.follow()
    assert watch.answer is None
    with pytest.raises(InputError, match="no photo"):
        watch.finish(Silent())


@pytest.mark.parametrize(
    ("options", "said"),
    [({"method": "paper"}, "`method` object"), ({"cameras": Path(__file__)}, "without")],
)
def test_what_cannot_be_watched_is_told_of(tmp_path: Path, options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        Watch(tmp_path, tmp_path / "out", RunOptions(**options))


def test_nonsense_is_told_of() -> None:
    with pytest.raises(InputError, match="at least 3 photos, found 2"):
        WatchOptions(until=2)
    with pytest.raises(InputError, match="more than 0 minutes, found 0"):
        WatchOptions(idle_s=0)


# Its page


def _state(**more: Any) -> WatchState:
    usual = {"photos": 3, "placed": 2, "fruits": 5, "length": 1.5, "step": 0.2, "well_seen": 0.5, "hints": []}
    return WatchState(**{"phase": "waiting", "doing": "Waiting", "revision": 1, **usual, **more})


def test_the_page_follows_by_addresses_of_each_answer() -> None:
    data = ReportData(title="row", photos=Photos(()), cameras=row_cameras(4), fruits=row_fruits(6))
    with running(WatchServer("row")) as server:
        assert server.url == f"http://127.0.0.1:{server.port}/"
        assert get(server, "/favicon.ico")[0] == 200
        status, headers, _ = get(server, "/")
        assert (status, headers["Location"]) == (303, "/at/0/")
        assert get(server, "/at/0/")[0] == 200  # nothing is known yet
        server.show(data, 1)
        assert get(server, "/")[1]["Location"] == "/at/1/"
        assert b"data/survey.bin" in get(server, "/at/1/")[2]
        assert get(server, "/at/1/data/survey.bin")[0] == 200
        assert get(server, "/at/0/data/survey.bin")[0] == 200  # somebody may still be loading it
        data_of_none = ("/data/survey.bin", "/at/7/data/survey.bin", "/at/1/photos/0/1024.jpg")
        for path in (*data_of_none, "/at/-1/", "/at/1/../../etc/passwd"):
            assert get(server, path)[0] == 404
        for revision in (2, 3):
            server.show(data, revision)
        assert get(server, "/at/0/data/survey.bin")[0] == 404
        server.tell(_state())
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
        connection.request("GET", "/events")
        line = connection.getresponse().readline()
        assert json.loads(line.removeprefix(b"data: "))["wellSeen"] == 0.5
        connection.close()


@pytest.mark.parametrize("path", ["/at/0/", "/at/7/"])  # of long ago, and of a watch before this one
def test_a_page_whose_answer_is_gone_is_that_of_the_newest(path: str) -> None:
    data = ReportData(title="row", photos=Photos(()), cameras=row_cameras(4), fruits=row_fruits(6))
    with running(WatchServer("row")) as server:
        for revision in (1, 2, 3):
            server.show(data, revision)
        status, headers, _ = get(server, path)
        assert (status, headers["Location"]) == (303, "/")


def test_only_its_own_page_stops_it() -> None:
    wanted: list[str] = []
    with running(WatchServer("row")) as server:
        server.on_stop_wanted = lambda: wanted.append("stop")

        def ask(origin: str) -> int:
            connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
            connection.request("POST", "/stop", headers={"Origin": origin})
            status = connection.getresponse().status
            connection.close()
            return status

        assert ask("http://evil.example") == 403
        assert wanted == []
        assert ask(server.url.rstrip("/")) == 204
        assert wanted == ["stop"]
        assert get(server, "/stop")[0] == 405


def test_others_in_the_network_need_the_token() -> None:
    with running(WatchServer("row", host="0.0.0.0")) as server:
        token = server.url.partition("?token=")[2]
        assert len(token) >= 16
        assert get(server, "/")[0] == get(server, "/events")[0] == get(server, "/at/0/")[0] == 403
        status, headers, _ = get(server, f"/?token={token}")
        assert status == 303
        cookie = headers["Set-Cookie"].partition(";")[0]
        assert get(server, "/at/0/", Cookie=cookie)[0] == 200


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_photos_of_the_sample_one_after_another_give_the_same_fruits(tmp_path: Path, sample_survey: Path) -> None:
    sample, folder = pomona.sample_folder(), tmp_path / "in"
    folder.mkdir()
    coming = [*sorted((sample / "east").iterdir()), *sorted((sample / "west").iterdir())]
    counts: list[int] = []

    def copy_next() -> None:
        photo = coming.pop(0)
        (folder / photo.parent.name).mkdir(exist_ok=True)
        shutil.copy(photo, folder / photo.parent.name)

    def told(state: WatchState) -> None:
        if state.phase == "waiting" and coming:
            copy_next()
        counts.append(state.fruits or 0)

    options = RunOptions(markers=sample / "markers.csv")
    watching = replace(AT_ONCE, until=len(coming))
    watch = Watch(folder, tmp_path / "watched", options, watching, on_state=told)
    for _ in range(4):
        copy_next()
    watch.follow()
    assert watch.answer is not None
    assert len(watch.answer.cameras) == watching.until
    # Both sides are counted by themselves: fruits that both see count twice until the end.
    assert 0.7 * 61 <= max(counts) <= 2 * 61
    watched = watch.finish(Silent())
    found, expected = (pomona.open(of).fruits.centers_in_world for of in (tmp_path / "watched", sample_survey))
    assert abs(watched.fruits - len(expected)) <= 0.02 * len(expected)
    distances_m = np.linalg.norm(found[:, None] - expected, axis=2)
    assert (distances_m.min(0) < 0.001).mean() >= 0.98
    assert (distances_m.min(1) < 0.001).mean() >= 0.98
