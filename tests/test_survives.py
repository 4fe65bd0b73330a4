"""What happens to a survey when the power, another run or the clock comes in between."""

from __future__ import annotations

import builtins
import errno
import io
import json
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fuzz.campaign import scratch
from pipeline_fakes import Fakes, make_photos
from pomona.errors import FormatError, LostFileError, PomonaError, SurveyError
from pomona.pipeline import run
from pomona.progress import Silent
from pomona.stages.capture import read_pixels
from pomona.stages.sfm.pieces import Reconstruction
from pomona.survey import SurveyFolder


@pytest.fixture
def tmp_path() -> Iterator[Path]:
    """A folder in memory: these tests wait for the disk very often."""
    with scratch() as folder:
        yield folder


def test_the_manifest_names_nothing_that_is_not_on_the_disk(
    fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    photos, out = make_photos(tmp_path / "photos"), tmp_path / "out"
    flushed: set[tuple[int, int]] = set()  # which file, as it was when it was changed last
    named, real_fsync, real_replace = 0, os.fsync, Path.replace

    def fsync(handle: int) -> None:
        stat = os.fstat(handle)
        flushed.add((stat.st_ino, stat.st_mtime_ns))
        real_fsync(handle)

    def replace(self: Path, target: Path) -> Path:
        nonlocal named
        if Path(target).name == "survey.json":
            own = self.stat()
            assert (own.st_ino, own.st_mtime_ns) in flushed
            for record in json.loads(self.read_text(encoding="utf-8"))["stages"].values():
                for name in record["outputs"]:
                    for file in [out / name] if (out / name).is_file() else (out / name).rglob("*"):
                        stat = file.stat()
                        assert (stat.st_ino, stat.st_mtime_ns) in flushed, file
                        named += 1
        return real_replace(self, target)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(Path, "replace", replace)
    run([photos], out)
    assert named > 20


def test_a_second_run_is_told_of_the_first_and_touches_nothing(fakes: Fakes, tmp_path: Path) -> None:
    photos = make_photos(tmp_path / "photos")
    run([photos], tmp_path / "out")
    first = SurveyFolder.open(tmp_path / "out")
    before = first.manifest_path.read_bytes()
    with first.locked(), pytest.raises(SurveyError, match="Another run is working"):
        run([photos], tmp_path / "out")
    assert first.manifest_path.read_bytes() == before


def test_two_runs_that_begin_a_survey_at_once_leave_it_to_the_first(tmp_path: Path) -> None:
    first, second = (SurveyFolder(tmp_path / "out", {"format": "pomona-survey", "stages": {}}) for _ in range(2))
    (tmp_path / "out").mkdir()
    for survey in (first, second):  # both saw that nothing was there
        survey._made = (survey.folder,)
        survey._write(new=True)
    with first.locked():
        with pytest.raises(SurveyError, match="Another run is working"), second.locked():
            pass
        second.withdraw()
        first.note(sources=["photos"])
    assert SurveyFolder.open(tmp_path / "out").get("sources") == ["photos"]


@pytest.mark.parametrize("what", ["removed", "renamed", "disk taken away"])
@pytest.mark.parametrize("when", ["tiles", "sfm", "second_look", "measure", "report"])
def test_a_survey_that_goes_away_during_a_run_is_told_and_not_made_anew_by_halves(
    fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str, when: str
) -> None:
    photos, out, elsewhere = make_photos(tmp_path / "photos"), tmp_path / "disk" / "out", tmp_path / "elsewhere"
    count = fakes.count

    def goes(name: str) -> None:
        count(name)
        if name != when or not out.is_dir():
            return
        if what == "removed":
            shutil.rmtree(out)
        elif what == "renamed":
            out.rename(elsewhere)
        else:
            out.parent.rename(elsewhere)
            out.parent.mkdir()  # where it was mounted

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fakes, "count", goes)
        with pytest.raises(PomonaError, match=r"is no longer there|it was taken away") as raised:
            run([photos], out)
    assert str(out) in str(raised.value)
    assert not out.exists()
    if what == "disk taken away":
        out.parent.rmdir()
        elsewhere.rename(out.parent)
    elif what == "renamed":
        elsewhere.rename(out)
    run([photos], out)
    run([photos], tmp_path / "undisturbed")
    for name in ("fruits.csv", "observations.csv", "detections.json", "cameras/images.txt"):
        assert (out / name).read_bytes() == (tmp_path / "undisturbed" / name).read_bytes(), name


def test_a_run_that_comes_later_goes_on_from_what_another_wrote(tmp_path: Path) -> None:
    one = SurveyFolder.create(tmp_path)
    other = SurveyFolder.open(tmp_path)
    with one.locked():
        one.note(answer=42)
    with other.locked():
        other.note(more=1)
    assert SurveyFolder.open(tmp_path).get("answer") == 42


def test_a_clock_that_jumps_redoes_nothing(fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    photos = make_photos(tmp_path / "photos")
    run([photos], tmp_path / "out")
    calls = dict(fakes.calls)
    monkeypatch.setattr("pomona.survey.record.now", lambda: "1970-01-01T00:00:00+00:00")
    run([photos], tmp_path / "out")
    assert fakes.calls == calls


@pytest.mark.parametrize("stopped", ["scale", "second_look", "results"])
def test_stages_take_the_same_whether_or_not_a_run_was_stopped_before_them(
    fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stopped: str
) -> None:
    from pomona.pipeline import results
    from pomona.stages import scale, second_look
    from pomona.stages.sfm import reconstruct

    def turned(*given: Any, **options: Any) -> Reconstruction:
        """A reconstruction whose cameras look in directions that no round numbers are."""
        found = reconstruct(*given, **options)
        angles = np.random.default_rng(2).normal(0, 0.3, (4, 3))
        (piece,) = found.pieces
        poses = np.concatenate(
            [Rotation.from_rotvec(angles).as_matrix(), piece.cameras.cam_from_world[:, :, 3:]], axis=2
        )
        return replace(found, pieces=(replace(piece, cameras=replace(piece.cameras, cam_from_world=poses)),))

    def watched(name: str, function: Callable[..., Any], arrays: Callable[..., list[Any]]) -> Callable[..., Any]:
        def watching(*given: Any, **options: Any) -> Any:
            taken.append((name, [np.asarray(array).tobytes() for array in arrays(*given)]))
            if name == stop:
                raise KeyboardInterrupt
            return function(*given, **options)

        return watching

    taken: list[tuple[str, list[bytes]]] = []
    stop = ""
    monkeypatch.setattr("pomona.stages.sfm.reconstruct", turned)
    for module, name, stage, arrays in (
        (scale, "place_in_world", "scale", lambda found, *_: [found.pieces[0].cameras.cam_from_world]),
        (second_look, "look_again", "second_look", lambda fused, masks, photos, cameras: [cameras.cam_from_world]),
        (results, "scene_cloud", "results", lambda scene, cameras, *_: [scene.points_in_world, cameras.cam_from_world]),
    ):
        monkeypatch.setattr(module, name, watched(stage, getattr(module, name), arrays))
    photos = make_photos(tmp_path / "photos")
    run([photos], tmp_path / "undisturbed")
    undisturbed = dict(taken)
    assert undisturbed.keys() == {"scale", "second_look", "results"}
    stop = stopped
    with pytest.raises(KeyboardInterrupt):
        run([photos], tmp_path / "out")
    stop = ""
    taken.clear()
    run([photos], tmp_path / "out")
    assert dict(taken)[stopped] == undisturbed[stopped]


def _damaged(content: bytes) -> bytes:
    """A file in which some bytes changed, and none was lost."""
    middle = len(content) // 2
    return content[:middle] + bytes(byte ^ 0x15 for byte in content[middle : middle + 8]) + content[middle + 8 :]


def test_files_between_stages_that_changed_are_made_again(fakes: Fakes, tmp_path: Path) -> None:
    photos, out = make_photos(tmp_path / "photos"), tmp_path / "out"
    run([photos], out)
    whole = {path.relative_to(out): path.read_bytes() for path in out.rglob("*") if path.is_file()}
    kept = sorted(name for name in whole if name.parts[0] == "work")
    assert {"digests.json", "fuse.npz", "measure.npz", "reconstruction.json"} <= {name.name for name in kept}
    for name in kept:
        (out / name).write_bytes(_damaged(whole[name]))
        # All that is handed over is asked for, and so is what a stopped stage kept of each photo.
        for asked in ("fruits.csv", "detections.json", "cameras/images.txt", "report.html"):
            (out / asked).unlink()
        run([photos], out)
        for results in ("fruits.csv", "detections.json", "cameras/images.txt", "observations.csv"):
            assert (out / results).read_bytes() == whole[Path(results)], name


def test_detections_of_a_photo_that_changed_are_not_gone_on_from(fakes: Fakes, tmp_path: Path) -> None:
    photos, out = make_photos(tmp_path / "photos"), tmp_path / "out"
    run([photos], out)
    (kept, *_) = sorted((out / "work" / "segment").rglob("*.json"))
    text, whole = kept.read_text(), (out / "detections.json").read_bytes()
    assert "0.9" in text
    for damaged in (text.replace("0.9", "0.8"), text[:-2], "", '{"sha256": 3}'):
        kept.write_text(damaged)
        (out / "detections.json").unlink()
        before = fakes.calls["tiles"]
        run([photos], out)
        assert fakes.calls["tiles"] > before
        assert (out / "detections.json").read_bytes() == whole


def test_overwrite_begins_a_survey_with_a_damaged_manifest_anew(fakes: Fakes, tmp_path: Path) -> None:
    photos, out = make_photos(tmp_path / "photos"), tmp_path / "out"
    run([photos], out)
    fruits = (out / "fruits.csv").read_bytes()
    for text in ("", "{", '{"format": "pomona-survey", "stages": 3}', (out / "survey.json").read_text()[:-200]):
        (out / "survey.json").write_text(text)
        (out / "fruits.csv").write_text("old")
        with pytest.raises(FormatError, match="begin this one anew with `overwrite`"):
            run([photos], out)
        assert (out / "fruits.csv").read_text() == "old"
        run([photos], out, overwrite=True)
        assert (out / "fruits.csv").read_bytes() == fruits
    (out / "survey.json").write_text('{"format": "of somebody else"}')
    with pytest.raises(SurveyError, match="holds something else"):
        run([photos], out, overwrite=True)


def test_a_run_that_was_stopped_at_its_very_beginning_leaves_an_empty_folder(fakes: Fakes, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".survey.part.json").write_text("")
    run([make_photos(tmp_path / "photos")], tmp_path / "out")


class Meddling(Silent):
    """Does something to the photos when a step is begun."""

    def __init__(self, label: str, meddle: Callable[[], None]) -> None:
        super().__init__()
        self._label, self._meddle, self.begun = label, meddle, False

    def start(self, label: str, total: int | None = None) -> None:
        if label == self._label and not self.begun:
            self.begun = True
            self._meddle()


STEPS = ("Reading photo headers", "looking for changes in photos", "segmenting")


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("gone", "was there and is gone"),
        ("changed", "was changed while it was worked with"),
        ("damaged", "was changed while it was worked with"),
        ("away", "cannot be reached any more"),
    ],
)
def test_photos_that_are_lost_during_a_run_are_told_and_not_mixed(
    fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str, how: str, said: str
) -> None:
    photos, others = make_photos(tmp_path / "photos"), make_photos(tmp_path / "others", seed=1, fruit=False)
    before = {path.name: path.read_bytes() for path in photos.iterdir()}
    lost, out = photos / "IMG_0003.jpg", tmp_path / "out"
    real_open = builtins.open

    def away(file: Any, *args: Any, **kwargs: Any) -> Any:
        if str(file) == str(lost):
            raise OSError(errno.ESTALE, os.strerror(errno.ESTALE), str(file))
        return real_open(file, *args, **kwargs)

    def meddle() -> None:
        if how == "gone":
            lost.unlink()
        elif how == "changed":
            lost.write_bytes((others / lost.name).read_bytes())
        elif how == "damaged":
            lost.write_bytes(before[lost.name][:500])
        else:
            patch.setattr(builtins, "open", away)
            patch.setattr(io, "open", away)

    progress = Meddling(step, meddle)
    with pytest.MonkeyPatch.context() as patch:
        if step == STEPS[0] and how in ("changed", "damaged"):  # it is read as it is then
            progress = Meddling(STEPS[1], meddle)
        with pytest.raises(PomonaError, match=said) as raised:
            run([photos], out, progress=progress)
    assert progress.begun
    assert lost.name in str(raised.value)
    assert "the same command goes on from there" in str(raised.value)
    lost.write_bytes(before[lost.name])
    run([photos], out)
    run([photos], tmp_path / "undisturbed")
    assert (out / "detections.json").read_bytes() == (tmp_path / "undisturbed" / "detections.json").read_bytes()
    assert SurveyFolder.open(out).record_of("segment").info["photos"] == 4


@pytest.mark.parametrize("how", ["gone", "changed", "damaged"])
def test_photos_that_are_other_ones_in_the_next_run_are_taken_as_they_are(
    fakes: Fakes, tmp_path: Path, how: str
) -> None:
    photos, others = make_photos(tmp_path / "photos"), make_photos(tmp_path / "others", seed=1, fruit=False)
    run([photos], tmp_path / "out")
    lost = photos / "IMG_0003.jpg"
    if how == "gone":
        lost.unlink()
    else:
        lost.write_bytes((others / lost.name).read_bytes() if how == "changed" else lost.read_bytes()[:500])
    summary = run([photos], tmp_path / "out")
    run([photos], tmp_path / "anew")
    for name in ("fruits.csv", "observations.csv", "detections.json"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "anew" / name).read_bytes()
    assert [file for file, _ in summary.skipped] == ([lost.name] if how == "damaged" else [])


def test_a_photo_that_changes_while_it_is_decoded_is_told(tmp_path: Path) -> None:
    from pomona.stages.capture import load_photos

    (photo, *_) = load_photos([make_photos(tmp_path / "photos")])
    assert read_pixels(photo).shape == (photo.height_px, photo.width_px, 3)
    os.utime(photo.path, ns=(1, 1))
    with pytest.raises(LostFileError, match="was changed"):
        read_pixels(photo)
