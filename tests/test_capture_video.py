"""Key frames of videos: a step apart, the sharp ones, made once."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from pomona.errors import InputError
from pomona.pipeline import RunOptions
from pomona.pipeline.sources import load_photos as load_photos_of_run
from pomona.progress import Silent
from pomona.stages.capture import KeyFrameOptions, load_photos, read_pixels
from pomona.stages.capture.keyframes import Frame, choose, corners, picture_move, sharpness
from pomona.survey import SurveyFolder
from pomona.survey.photos import photos_of

WIDTH, HEIGHT = 128, 96


def scene(width: int = 1200) -> np.ndarray:
    """A textured wall (HEIGHT, width), grey."""
    noise = np.random.default_rng(0).integers(0, 255, (HEIGHT // 6, width // 6), np.uint8)
    return cv2.resize(noise, (width, HEIGHT), interpolation=cv2.INTER_CUBIC)


def frames_at(positions: list[float], blurred: set[int] = frozenset()) -> list[Frame]:  # type: ignore[assignment]
    """Frames of a camera that moves along the wall, some of them blurred."""
    wall = scene(round(max(positions)) + WIDTH + 12)
    frames = []
    for i, x in enumerate(positions):
        shift = np.array([[1, 0, -x], [0, 1, 0]], float)
        grey = cv2.warpAffine(wall, shift, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT)
        if i in blurred:
            grey = cv2.GaussianBlur(grey, (0, 0), 2.5)
        frames.append(Frame(i, i / 30, np.repeat(grey[:, :, None], 3, 2), grey, sharpness(grey)))
    return frames


def test_picture_move_is_measured_as_share_of_the_width() -> None:
    one, other = frames_at([0.0, 8.0])
    move, found = picture_move(one.grey, other.grey, corners(one.grey))
    assert move == pytest.approx(8 / WIDTH, rel=0.05)
    assert found > 0.8


def test_key_frames_are_a_step_apart_however_fast_the_walk() -> None:
    options = KeyFrameOptions(move=0.05)
    for pixels_per_frame in (1.0, 2.0, 4.0):
        positions = list(np.arange(0, 30 * pixels_per_frame + 60, pixels_per_frame))
        chosen = [positions[frame.frame_idx] for frame in choose(frames_at(positions), options)]
        steps = np.diff(chosen) / WIDTH
        assert steps.min() > 0.6 * options.move
        assert steps.max() < 1.4 * options.move + pixels_per_frame / WIDTH


def test_standing_still_with_a_trembling_hand_gives_one_key_frame() -> None:
    tremble = np.random.default_rng(1).normal(0, 0.4, 30)
    assert len(list(choose(frames_at(list(200 + tremble)), KeyFrameOptions()))) == 1


def test_blurred_frames_are_passed_over() -> None:
    positions = list(np.arange(0, 90, 1.0))
    blurred = {i for i in range(90) if i % 4}
    chosen = [frame.frame_idx for frame in choose(frames_at(positions, blurred), KeyFrameOptions(move=8 / WIDTH))]
    assert 9 <= len(chosen) <= 14
    assert not blurred & set(chosen)


def test_a_cut_gives_a_key_frame() -> None:
    chosen = [frame.frame_idx for frame in choose(frames_at([0.0] * 6 + [700.0] * 6), KeyFrameOptions())]
    assert len(chosen) == 2
    assert chosen[0] < 6 <= chosen[1]


def test_frames_of_another_size_give_a_key_frame_of_their_own() -> None:
    frames = frames_at([0.0] * 12)
    for i, frame in enumerate(frames[6:], 6):
        grey = cv2.resize(frame.grey, (WIDTH // 2, HEIGHT // 2))
        frames[i] = Frame(i, i / 30, np.repeat(grey[:, :, None], 3, 2), grey, sharpness(grey))
    assert np.isnan(picture_move(frames[0].grey, frames[6].grey, corners(frames[0].grey))[0])
    chosen = [frame.frame_idx for frame in choose(frames, KeyFrameOptions())]
    assert len(chosen) == 2
    assert chosen[0] < 6 <= chosen[1]


def write_video(path: Path, positions: list[float]) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30, (WIDTH, HEIGHT))
    for frame in frames_at(positions):
        writer.write(frame.pixels)
    writer.release()
    return path


def test_a_video_becomes_photos_once(tmp_path: Path) -> None:
    video, frames = write_video(tmp_path / "row.mp4", list(np.arange(0, 60, 1.5))), tmp_path / "frames"
    photos = load_photos([video], frames_dir=frames)
    assert photos.from_video
    assert 8 < len(photos) < 30
    assert photos.names[0].startswith("frame_0000")
    assert all(photo.path.parent == frames for photo in photos)
    assert read_pixels(photos.items[0]).shape == (HEIGHT, WIDTH, 3)
    manifest = json.loads((frames / "frames.json").read_text())
    assert [frame["time_s"] for frame in manifest["frames"]] == pytest.approx(
        [frame["frame_idx"] / 30 for frame in manifest["frames"]], abs=1e-3
    )
    made = [photo.path.stat().st_mtime_ns for photo in photos]
    again = load_photos([video], frames_dir=frames)
    assert again.names == photos.names
    assert [photo.path.stat().st_mtime_ns for photo in again] == made
    fewer = load_photos([video], frames_dir=frames, key_frames=KeyFrameOptions(move=0.1))
    assert len(fewer) < len(photos)
    assert len(list(frames.glob("*.jpg"))) == len(fewer)


def write_matroska(
    path: Path,
    positions: list[float],
    times_ms: list[int],
    duration_ms: float | None = None,
    shown: tuple[int, int] = (WIDTH, HEIGHT),
) -> Path:
    """A video whose frames come when they come, as browsers and screen recorders write it: no rate is said.

    `shown` is the size, in square pixels, at which it is to be shown.
    """

    def element(name: str, content: bytes) -> bytes:
        return bytes.fromhex(name) + (1 << 56 | len(content)).to_bytes(8, "big") + content

    def number(name: str, value: int) -> bytes:
        return element(name, value.to_bytes(4, "big"))

    head = number("4286", 1) + number("42f7", 1) + number("42f2", 4) + number("42f3", 8)
    head += element("4282", b"matroska") + number("4287", 4) + number("4285", 2)
    info = number("2ad7b1", 1_000_000)  # times are in milliseconds
    if duration_ms is not None:
        info += element("4489", struct.pack(">d", duration_ms))
    track = number("d7", 1) + number("73c5", 1) + number("83", 1) + element("86", b"V_MJPEG")
    sizes = {"b0": WIDTH, "ba": HEIGHT, "54b0": shown[0], "54ba": shown[1]}
    track += element("e0", b"".join(number(name, size) for name, size in sizes.items()))
    segment = element("1549a966", info) + element("1654ae6b", element("ae", track))
    for time_ms, frame in zip(times_ms, frames_at(positions), strict=True):
        jpeg = cv2.imencode(".jpg", frame.pixels)[1].tobytes()
        segment += element("1f43b675", number("e7", time_ms) + element("a3", b"\x81\0\0\x80" + jpeg))
    path.write_bytes(element("1a45dfa3", head) + element("18538067", segment))
    return path


def test_frames_are_looked_at_by_their_times_where_a_video_has_no_rate(tmp_path: Path) -> None:
    """At first a second's frames come 125 times a second, then 30 times: the rate is taken for that of the first."""
    times_ms = [8 * k for k in range(60)] + [480 + 33 * k for k in range(120)]
    steps = [0.2] * 60 + [2.0] * 120
    video = write_matroska(tmp_path / "row.mkv", list(np.cumsum(steps)), times_ms)
    photos = load_photos([video], frames_dir=tmp_path / "frames", progress=(progress := Silent()))
    assert not any("could be decoded" in warning for warning in progress.warnings)
    listed = json.loads((tmp_path / "frames" / "frames.json").read_text())["frames"]
    late = [frame["frame_idx"] for frame in listed if frame["frame_idx"] >= 60]
    assert len(photos) == len(listed)
    assert max(np.diff(late)) <= 2  # each moves by 1.7 % of the width, of which 1.4 to 2.6 % are a step
    assert [frame["time_s"] for frame in listed] == [times_ms[frame["frame_idx"]] / 1000 for frame in listed]


def test_a_whole_video_of_changing_rate_is_not_said_to_be_incomplete(tmp_path: Path) -> None:
    times_ms = np.cumsum([50 if k % 3 == 0 else 25 for k in range(90)]).tolist()
    video = write_matroska(tmp_path / "row.mkv", list(np.arange(90) * 1.5), times_ms, times_ms[-1])
    load_photos([video], frames_dir=tmp_path / "frames", progress=(progress := Silent()))
    assert not any("could be decoded" in warning for warning in progress.warnings)
    cut = write_matroska(tmp_path / "cut.mkv", list(np.arange(60) * 1.5), times_ms[:60], times_ms[-1])
    load_photos([cut], frames_dir=tmp_path / "cut", progress=(progress := Silent()))
    assert any("could be decoded; is the file complete?" in warning for warning in progress.warnings)


@pytest.mark.parametrize(
    ("shown", "size"),
    [((256, 144), (171, 96)), ((128, 144), (128, 144)), ((129, 96), (WIDTH, HEIGHT)), ((1280, 96), (WIDTH, HEIGHT))],
    ids=["wide", "high", "rounded", "nonsense"],
)
def test_frames_have_square_pixels(shown: tuple[int, int], size: tuple[int, int], tmp_path: Path) -> None:
    """HDV and AVCHD store 1440 × 1080 pixels of what is 1920 × 1080: fruits came out narrower than high."""
    positions = list(np.arange(8) * 4.0)
    video = write_matroska(tmp_path / "row.mkv", positions, list(range(0, 264, 33)), shown=shown)
    photos = load_photos([video], frames_dir=tmp_path / "frames")
    assert {(photo.width_px, photo.height_px) for photo in photos} == {size}
    frame = frames_at(positions)[int(photos.items[0].path.stem.removeprefix("frame_"))]
    expected = cv2.resize(frame.grey, size, interpolation=cv2.INTER_CUBIC)
    found = cv2.cvtColor(read_pixels(photos.items[0]), cv2.COLOR_RGB2GRAY)
    assert np.abs(found.astype(float) - expected).mean() < 4


def test_frames_that_are_not_as_they_were_written_are_made_again(tmp_path: Path) -> None:
    video, frames = write_video(tmp_path / "row.mp4", list(np.arange(0, 60, 1.5))), tmp_path / "frames"
    options = KeyFrameOptions(move=0.1)
    made = {p.name: p.path.read_bytes() for p in load_photos([video], frames_dir=frames, key_frames=options)}
    first, *_, last = sorted(made)
    (frames / first).write_bytes(b"")
    (frames / last).write_bytes(made[last][:-3] + b"\0" + made[last][-2:])
    again = load_photos([video], frames_dir=frames, key_frames=options)
    assert {photo.name: photo.path.read_bytes() for photo in again} == made


def test_a_survey_finds_the_frames_that_its_run_chose(tmp_path: Path) -> None:
    video = write_video(tmp_path / "row.mp4", list(np.arange(0, 60, 1.5)))
    survey, options = SurveyFolder.create(tmp_path / "out"), RunOptions(key_frames=KeyFrameOptions(move=0.1))
    survey.note(sources=[video], options=options.to_json())
    photos, _ = load_photos_of_run(survey, [video], options, Silent(), min_photos=2)
    usual = load_photos([video], frames_dir=tmp_path / "frames")
    assert 2 <= len(photos) < len(usual)
    made = [photo.path.stat().st_mtime_ns for photo in photos]
    found = photos_of(SurveyFolder.open(tmp_path / "out"), photos.names)
    assert found.names == photos.names
    assert [photo.path.stat().st_mtime_ns for photo in found] == made


@pytest.mark.parametrize("names", [("row.mp4",), ("east.mp4", "west.mp4")])
@pytest.mark.parametrize("then", ["moved", "another one"])
def test_a_survey_keeps_its_frames_whatever_becomes_of_the_video(
    tmp_path: Path, names: tuple[str, ...], then: str
) -> None:
    videos = [write_video(tmp_path / name, list(np.arange(0, 60, 1.5))) for name in names]
    survey = SurveyFolder.create(tmp_path / "out")
    survey.note(sources=videos, options=RunOptions().to_json())
    photos, _ = load_photos_of_run(survey, videos, RunOptions(), Silent(), min_photos=2)
    made = {photo.name: photo.path.read_bytes() for photo in photos}
    for video in videos:
        video.unlink()
        if then == "another one":
            write_video(video, list(np.arange(300, 0, -3.0)))
    found = photos_of(SurveyFolder.open(tmp_path / "out"), photos.names)
    assert found.from_video
    assert {photo.name: photo.path.read_bytes() for photo in found} == made
    some = photos_of(SurveyFolder.open(tmp_path / "out"), photos.names[2:4])
    assert {photo.name: photo.path.read_bytes() for photo in some} == {name: made[name] for name in photos.names[2:4]}
    assert len(list(survey.work("frames").rglob("*.jpg"))) == len(made)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"move": 0.0}, "`move`: expected over 0"),
        ({"earliest": 1.4}, "0 < earliest ≤ latest, found 1.4, 1.3"),
        ({"least_found": 1.5}, "`least_found`: expected 0 to 1"),
        ({"most_per_s": 0.0}, "`most_per_s`: expected a positive number"),
        ({"work_side_px": 10}, "`work_side_px`: expected at least 64"),
    ],
)
def test_senseless_options_of_key_frames_are_refused(fields: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        KeyFrameOptions(**fields)  # type: ignore[arg-type]


def test_two_videos_are_two_sides(tmp_path: Path) -> None:
    videos = [write_video(tmp_path / f"{name}.mp4", list(np.arange(0, 40, 2.0))) for name in ("east", "west")]
    photos = load_photos(videos, frames_dir=tmp_path / "frames")
    assert photos.sides == ("east", "west")
    assert photos.names[0].startswith("east/frame_")


@pytest.mark.parametrize("names", [("east/a.mp4", "west/a.mp4"), ("east/a.mp4", "west/b.mp4")])
def test_each_video_has_a_lens_of_its_own_whatever_it_is_called(tmp_path: Path, names: tuple[str, str]) -> None:
    for name in names:
        (tmp_path / name).parent.mkdir()
    videos = [write_video(tmp_path / name, list(np.arange(0, 40, 2.0))) for name in names]
    photos = load_photos(videos, frames_dir=tmp_path / "frames")
    lenses = [{photo.lens_key for photo in photos if photo.side == side} for side in photos.sides]
    assert [len(of_side) for of_side in lenses] == [1, 1]
    assert not lenses[0] & lenses[1]


@pytest.mark.parametrize("content", [b"\0\0\0\x18ftypmp42" + bytes(5000), b"nothing like a video" * 99])
def test_a_video_that_cannot_be_decoded_is_named(tmp_path: Path, content: bytes) -> None:
    video = tmp_path / "walk.mp4"
    video.write_bytes(content)
    with pytest.raises(InputError, match=r"walk\.mp4 cannot be decoded as a video"):
        load_photos([video], frames_dir=tmp_path / "frames", progress=Silent())


def test_the_decoders_own_words_are_kept_from_the_terminal(tmp_path: Path) -> None:
    (tmp_path / "walk.mp4").write_bytes(b"\0\0\0\x18ftypmp42" + bytes(5000))
    run = (
        "import sys, pathlib; from pomona.stages.capture import load_photos; load_photos([pathlib.Path(sys.argv[1])], "
    )
    run += "frames_dir=pathlib.Path(sys.argv[2]))"
    # FFmpeg reads how much it may say once in a process.
    command = [sys.executable, "-c", run, str(tmp_path / "walk.mp4"), str(tmp_path / "frames")]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stderr
    assert "cannot be decoded as a video" in said
    assert "moov atom" not in said


def test_an_empty_video_is_said_to_be_empty(tmp_path: Path) -> None:
    (tmp_path / "walk.mp4").touch()
    with pytest.raises(InputError, match=r"walk\.mp4 cannot be decoded: the file is empty \(0 bytes\)"):
        load_photos([tmp_path / "walk.mp4"], frames_dir=tmp_path / "frames")


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    table = tmp_path / "markers.csv"
    table.write_text("id,x,y,z")
    with pytest.raises(InputError, match="neither a folder of photos nor a video"):
        load_photos([table])
    with pytest.raises(InputError, match="frames_dir"):
        load_photos([write_video(tmp_path / "a.mp4", [0.0, 1.0])])


@pytest.mark.slow
def test_apple_tree_video(shared_data: Path, tmp_path: Path) -> None:
    photos = load_photos([shared_data / "apple-tree-video" / "apple-tree.mp4"], frames_dir=tmp_path)
    assert 40 <= len(photos) <= 90
    assert {(photo.width_px, photo.height_px) for photo in photos} == {(720, 1280)}
