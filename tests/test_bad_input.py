"""Bad input gets a clear error or a clear warning, and loses nothing."""

from __future__ import annotations

import errno
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline_fakes import Fakes, make_photos
from pomona.errors import InputError, MissingFileError, PomonaError, ReconstructionError, SurveyError
from pomona.formats.tables import read_fruits
from pomona.pipeline import RunOptions, run
from pomona.survey import SurveyFolder


def test_an_empty_folder(fakes: Fakes, tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    with pytest.raises(InputError, match="holds no photo"):
        run([tmp_path / "photos"], tmp_path / "out")


def test_a_run_that_is_refused_leaves_nothing_where_nothing_was(fakes: Fakes, tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "empty").mkdir()
    for out in (tmp_path / "some" / "out", tmp_path / "empty"):
        for photos in (tmp_path / "photos", make_photos(tmp_path / "two", 2)):
            with pytest.raises(InputError, match=r"holds no photo|found 2 photos"):
                run([photos], out)
            assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "photos", "two"]
            assert not list((tmp_path / "empty").iterdir())
    # A survey that was there stays as it is.
    good = make_photos(tmp_path / "good", 3)
    run([good], tmp_path / "out")
    with pytest.raises(InputError, match="holds no photo"):
        run([tmp_path / "photos"], tmp_path / "out")
    assert (tmp_path / "out" / "fruits.csv").is_file()
    assert SurveyFolder.open(tmp_path / "out").get("sources") == [str(good)]


def test_a_folder_that_is_not_there(fakes: Fakes, tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="does not exist"):
        run([tmp_path / "photos"], tmp_path / "out")


def test_one_photo(fakes: Fakes, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="photo"):
        run([make_photos(tmp_path / "photos", 1)], tmp_path / "out")


def test_too_few_photos_of_every_side_are_said_before_any_is_looked_at(fakes: Fakes, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found 2 photos that can be used, expected at least 3"):
        run([make_photos(tmp_path / "two", 2)], tmp_path / "out")
    sides = [make_photos(tmp_path / side, 2, seed=k) for k, side in enumerate(("east", "west"))]
    with pytest.raises(InputError, match="from 3 photos that overlap or more; found: east has 2, west has 2"):
        run(sides, tmp_path / "out")
    assert not fakes.calls
    assert run(sides, tmp_path / "out", until="select").detections == 4
    make_photos(tmp_path / "west", 3, seed=1)
    assert run(sides, tmp_path / "out").fruits == 1


def test_one_photo_is_enough_for_its_masks(fakes: Fakes, tmp_path: Path) -> None:
    assert run([make_photos(tmp_path / "photos", 1)], tmp_path / "out", until="select").detections == 1


def test_photos_without_overlap(fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()  # the real thing: structure from motion of noise
    photos = make_photos(tmp_path / "photos", 3)
    fakes = Fakes()
    with monkeypatch.context() as patch:
        fakes.install(patch)
        patch.undo()
        patch.setattr("pomona.stages.segment.load_segmenter", lambda model=None, score_floor=None: _red(fakes))
        with pytest.raises(ReconstructionError, match="None of the 3 photos could be placed"):
            run([photos], tmp_path / "out")
    record = SurveyFolder.open(tmp_path / "out").record_of("segment")
    assert record is not None
    assert record.finished  # what was found before is kept


def _red(fakes: Fakes) -> object:
    from pipeline_fakes import RedSegmenter

    return RedSegmenter(fakes)


def test_a_truncated_jpeg_among_good_ones(fakes: Fakes, tmp_path: Path) -> None:
    photos = make_photos(tmp_path / "photos", 5)
    whole = (photos / "IMG_0002.jpg").read_bytes()
    (photos / "IMG_0002.jpg").write_bytes(whole[: len(whole) // 2])
    summary = run([photos], tmp_path / "out")
    assert summary.fruits == 1
    named = [*summary.warnings, *(name for name, _ in summary.skipped)]
    assert any("IMG_0002.jpg" in text for text in named)
    images = json.loads((tmp_path / "out" / "detections.json").read_text())["images"]
    assert "IMG_0002.jpg" not in [image["file_name"] for image in images]


def test_two_cameras_mixed(fakes: Fakes, tmp_path: Path) -> None:
    photos = make_photos(tmp_path / "photos", 6)
    for k in range(3):
        exif = Image.Exif()
        exif[0x0110] = "Camera A" if k else "Camera B"
        exif[0x010F] = "Maker"
        Image.open(photos / f"IMG_{k:04}.jpg").save(photos / f"IMG_{k:04}.jpg", exif=exif)
    assert any("camera" in warning for warning in run([photos], tmp_path / "out").warnings)


def test_photos_without_exif(fakes: Fakes, tmp_path: Path) -> None:
    summary = run([make_photos(tmp_path / "photos")], tmp_path / "out")
    assert summary.fruits == 1
    assert any("EXIF" in warning or "focal" in warning for warning in summary.warnings)


def test_a_video_that_cannot_be_decoded(fakes: Fakes, tmp_path: Path) -> None:
    (tmp_path / "row.mp4").write_bytes(b"\0\0\0\x18ftypisom" + bytes(2000))
    with pytest.raises(InputError, match=r"row\.mp4"):
        run([tmp_path / "row.mp4"], tmp_path / "out")


def test_no_fruit_in_any_photo_is_an_empty_valid_result(fakes: Fakes, tmp_path: Path) -> None:
    summary = run([make_photos(tmp_path / "photos", fruit=False)], tmp_path / "out")
    assert (summary.fruits, summary.detections, summary.photos_used) == (0, 0, 4)
    assert any("No fruit" in warning for warning in summary.warnings)
    assert len(read_fruits(tmp_path / "out" / "fruits.csv")) == 0
    assert json.loads((tmp_path / "out" / "fruits.geojson").read_text())["features"] == []
    for name in ("observations.csv", "cloud.laz", "report.html", "detections.json"):
        assert (tmp_path / "out" / name).stat().st_size > 0


def test_no_fruit_and_no_cameras_is_an_empty_valid_result(fakes: Fakes, tmp_path: Path) -> None:
    fakes.raising["sfm"] = 1, ReconstructionError("None of the 4 photos could be placed")
    summary = run([make_photos(tmp_path / "photos", fruit=False)], tmp_path / "out")
    assert (summary.fruits, summary.photos_used) == (0, 0)
    assert summary.report is not None


def test_fruit_but_no_cameras_is_an_error(fakes: Fakes, tmp_path: Path) -> None:
    fakes.raising["sfm"] = 1, ReconstructionError("None of the 4 photos could be placed")
    with pytest.raises(ReconstructionError):
        run([make_photos(tmp_path / "photos")], tmp_path / "out")


def test_markers_that_are_never_seen(fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pomona.stages.scale.world_frame import place_in_world

    monkeypatch.setattr("pomona.stages.scale.place_in_world", place_in_world)
    (tmp_path / "markers.csv").write_text("id,x,y,z\n0,0,0,0\n1,1,0,0\n2,0,0,1\n")
    photos = make_photos(tmp_path / "photos")
    # Nothing else gives a scale here: the cameras of the stand-in have no fruits whose size could.
    with pytest.raises(InputError, match=r"3 of 3 markers named in markers\.csv were not seen in any photo: 0, 1, 2"):
        run([photos], tmp_path / "out", RunOptions(markers=tmp_path / "markers.csv"))


def test_a_markers_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"`markers`: .*nowhere\.csv does not exist"):
        run([make_photos(tmp_path / "photos")], tmp_path / "out", RunOptions(markers=tmp_path / "nowhere.csv"))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("stage", "kept"),
    [("sfm", ["segment"]), ("dense", ["segment", "sfm", "scale"]), ("report", ["fuse", "measure", "results"])],
)
def test_a_full_disk_loses_nothing(fakes: Fakes, tmp_path: Path, stage: str, kept: list[str]) -> None:
    photos = make_photos(tmp_path / "photos")
    fakes.raising[stage] = 1, OSError(errno.ENOSPC, "No space left on device")
    with pytest.raises(SurveyError, match="disk is full") as error:
        run([photos], tmp_path / "out")
    assert str(tmp_path / "out") in str(error.value)
    survey = SurveyFolder.open(tmp_path / "out")
    assert all((record := survey.record_of(name)) and record.finished for name in kept)
    assert not list((tmp_path / "out").rglob(".*.part*"))
    calls = dict(fakes.calls)
    assert run([photos], tmp_path / "out").fruits == 1
    assert fakes.calls["tiles"] == calls["tiles"]


@pytest.mark.parametrize(
    "error",
    [
        MemoryError("Unable to allocate 3.10 GiB for an array"),
        MemoryError(),
        RuntimeError("OpenCV(4.11.0) alloc.cpp:73: error: (-4:Insufficient memory) Failed to allocate 9216 bytes"),
        RuntimeError("bad allocation"),
    ],
)
def test_too_little_memory_is_told_and_gone_on_from(fakes: Fakes, tmp_path: Path, error: Exception) -> None:
    photos = make_photos(tmp_path / "photos")
    fakes.raising["fuse"] = 1, error
    with pytest.raises(SurveyError, match=r"not enough memory here \(.+\).*run the same command again"):
        run([photos], tmp_path / "out")
    run([photos], tmp_path / "out")
    assert fakes.calls["sfm"] == 1


def test_a_disk_that_is_full_while_a_table_is_written(
    fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    photos = make_photos(tmp_path / "photos")
    run([photos], tmp_path / "out")
    table = (tmp_path / "out" / "fruits.csv").read_text()
    real = Path.open

    def full(self: Path, mode: str = "r", *args: object, **kwargs: object) -> object:
        if "w" in mode and self.name.startswith(".fruits"):
            real(self, "wb").close()
            raise OSError(errno.ENOSPC, "No space left on device", str(self))
        return real(self, mode, *args, **kwargs)  # type: ignore[call-overload]

    (tmp_path / "out" / "observations.csv").unlink()
    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", full)
        with pytest.raises(SurveyError, match="disk is full"):
            run([photos], tmp_path / "out")
    assert (tmp_path / "out" / "fruits.csv").read_text() == table
    run([photos], tmp_path / "out")
    assert (tmp_path / "out" / "observations.csv").is_file()


def test_a_manifest_that_cannot_be_written_stays_what_it_was(
    fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    photos = make_photos(tmp_path / "photos")
    run([photos], tmp_path / "out")
    before = SurveyFolder.open(tmp_path / "out").records

    def full(self: Path, *args: object, **kwargs: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device", str(self))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_text", full)
        with pytest.raises(SurveyError, match="disk is full"):
            run([photos], tmp_path / "out", RunOptions(fruit_diameter_m=0.06))
    assert SurveyFolder.open(tmp_path / "out").records == before


def test_an_output_folder_that_holds_something_else(fakes: Fakes, tmp_path: Path) -> None:
    photos = make_photos(tmp_path / "photos")
    shutil.copytree(photos, tmp_path / "holiday")
    for overwrite in (False, True):
        with pytest.raises(SurveyError, match="holds something else"):
            run([photos], tmp_path / "holiday", overwrite=overwrite)
    assert len(list((tmp_path / "holiday").iterdir())) == 4
    with pytest.raises(SurveyError, match="holds something else"):
        run([photos], photos)


def test_paths_that_can_be_none(fakes: Fakes, tmp_path: Path) -> None:
    photos = make_photos(tmp_path / "photos")
    (tmp_path / "one").symlink_to(tmp_path / "other")
    (tmp_path / "other").symlink_to(tmp_path / "one")
    nobody = Path("~nobody-of-this-name")
    for out, said in (
        (tmp_path / "one", "its links lead round in a circle"),
        (tmp_path / "one" / "out", "circle|cannot be the path of a file or a folder"),
        (nobody / "out", "~nobody-of-this-name.out: .*no such home folder is known here: give the whole path"),
        (tmp_path / ("a" * 300), "a{300} cannot be the path of a file or a folder .*: choose another"),
        (photos / "IMG_0000.jpg" / "out", "IMG_0000.jpg is a file: expected a new or empty folder"),
    ):
        with pytest.raises(PomonaError, match=said):
            run([photos], out)
    for given in (tmp_path / "one", nobody, tmp_path / ("a" * 300)):
        with pytest.raises(PomonaError, match=r"circle|no such home folder|does not exist|cannot be the path"):
            run([given], tmp_path / "out")
        with pytest.raises(PomonaError, match=r"circle|no such home folder|does not exist|cannot be the path"):
            run([photos], tmp_path / "out", RunOptions(markers=given))
    with pytest.raises(InputError, match="no such home folder"):
        RunOptions(model=f"{nobody}/mine.onnx")
    with pytest.raises(PomonaError, match="no such home folder"):
        SurveyFolder.open(nobody)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "`method`: expected one of object, paper, found 'magic'"),
        ({"engine": "magic"}, "`engine`: expected one of auto, opencv, patchmatch, found 'magic'"),
        ({"fruit_diameter_m": -1.0}, "`fruit_diameter_m`: expected metres"),
        ({"fruit_diameter_m": float("nan")}, "`fruit_diameter_m`: expected metres"),
        ({"score_threshold": 1.5}, "`score_threshold`: expected 0 to 1, found 1.5"),
        ({"scale_bar": (1, 1, 0.85)}, "`scale_bar`: expected two different"),
    ],
)
def test_unknown_option_values(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        RunOptions(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sides": "left"}, "left"),
        ({"model": "magic"}, r"`model` 'magic': expected a file ending in \.onnx"),
        ({"marker_dictionary": "DICT_9"}, "DICT_9"),
    ],
)
def test_unknown_option_values_that_stages_know(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: dict[str, str], message: str
) -> None:
    from pomona.stages.scale.world_frame import place_in_world
    from pomona.stages.segment.load import load_segmenter

    Fakes().install(monkeypatch)
    monkeypatch.setattr("pomona.stages.scale.place_in_world", place_in_world)
    if "model" in options:
        monkeypatch.setattr("pomona.stages.segment.load_segmenter", load_segmenter)
    (tmp_path / "markers.csv").write_text("id,x,y,z\n0,0,0,0\n1,1,0,0\n2,0,0,1\n")
    with pytest.raises(InputError, match=message):
        run(
            [make_photos(tmp_path / "photos")],
            tmp_path / "out",
            RunOptions(markers=tmp_path / "markers.csv", **options),  # type: ignore[arg-type]
        )


def test_an_unknown_stage(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Stage 'everything': expected one of segment, select, sfm"):
        run([tmp_path], tmp_path / "out", until="everything")
    assert not (tmp_path / "out").exists()


def test_damaged_work_is_done_again(fakes: Fakes, tmp_path: Path) -> None:
    photos = make_photos(tmp_path / "photos")
    run([photos], tmp_path / "out")
    (tmp_path / "out" / "work" / "dense.npz").write_bytes(b"broken")
    (tmp_path / "out" / "work" / "fuse.npz").write_bytes(b"broken")
    (tmp_path / "out" / "work" / "second_look.npz").write_bytes(b"broken")
    summary = run([photos], tmp_path / "out", RunOptions(filter_false_positives=False))
    assert summary.fruits == 1
    assert (fakes.calls["fuse"], fakes.calls["second_look"], fakes.calls["sfm"]) == (2, 2, 1)


def test_photos_of_other_sizes_and_depths(fakes: Fakes, tmp_path: Path) -> None:
    photos = make_photos(tmp_path / "photos")
    Image.fromarray(np.full((40, 60), 128, np.uint8)).save(photos / "IMG_0009.png")
    assert run([photos], tmp_path / "out").photos == 5
