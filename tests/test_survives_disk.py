"""Runs on disks that are full, fail, go away for a while or lose their power: told in words, and gone on from."""

from __future__ import annotations

import errno
import gc
import shutil
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from faulty_disk import FaultyDisk, Operation, PoweredDisk, failing_during, failing_once, write_image
from fuzz.campaign import scratch
from pipeline_fakes import Fakes, make_photos
from pomona.errors import PomonaError, SurveyError
from pomona.formats.npz import read_npz, write_npz
from pomona.pipeline import run
from pomona.survey.files import disk_errors

pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # half-open archives

RESULTS = ("fruits.csv", "observations.csv", "trees.csv", "segments.csv", "fruits.geojson", "detections.json")
FEW = 8


@pytest.fixture
def place() -> Iterator[Path]:
    """A folder in memory: these tests wait for the disk very often."""
    with scratch() as folder:
        yield folder


def results(survey: Path) -> dict[str, bytes]:
    return {name: (survey / name).read_bytes() for name in RESULTS}


class Row:
    """Three photos, the results of an undisturbed run of them, and what that run does to its disk."""

    def __init__(self, place: Path, fakes: Fakes) -> None:
        self._fakes = fakes
        self.photos, self.place = make_photos(place / "photos", 3), place
        fakes.calls.clear()
        with FaultyDisk(place / "undisturbed") as disk:
            self.run(place / "undisturbed")
        self.operations, self.calls = disk.operations, dict(fakes.calls)
        self.results = results(place / "undisturbed")
        self._count = 0

    def run(self, out: Path) -> None:
        run([self.photos], out)

    def out(self) -> Path:
        self._count += 1
        return self.place / f"out{self._count}"

    def disturbed(self, disk: FaultyDisk) -> str:
        """Run on a disk that fails, then on one that does not, which has to end as the undisturbed run; return what
        was said, "" where nothing had to be."""
        self._fakes.calls.clear()
        said = ""
        try:
            with disk:
                self.run(disk.folder)
        except PomonaError as error:
            said = str(error)
        self.run(disk.folder)
        assert results(disk.folder) == self.results
        assert not [path for path in disk.folder.rglob("*") if ".part" in path.name]
        again = Counter(self._fakes.calls) - Counter(self.calls)
        assert len(again) <= 1, f"{again} were done again, of which one alone was not finished"
        assert max(again.values(), default=0) <= self.calls.get("tiles", 1)
        return said


@pytest.fixture
def row(place: Path, fakes: Fakes) -> Row:
    return Row(place, fakes)


def some(operations: list[Operation], count: int, seed: int = 0) -> list[int]:
    """Some operations, of every kind of file and of every file in turn, the same in every run."""
    order = np.random.default_rng(seed).permutation(len(operations)).tolist()
    seen: Counter[tuple[str, str]] = Counter()
    turns = []
    for k in order:
        what = operations[k].kind, operations[k].path.name
        turns.append((seen[what], len(turns), k))
        seen[what] += 1
    return [operations[k].number for _, _, k in sorted(turns)[:count]]


# Making a folder that is there, or removing a file that is not, may fail; so may the log, which nothing depends on.
MATTER = ("open", "write", "fsync", "replace")


def check_every_write_fails_once(row: Row, numbers: list[int], code: int) -> None:
    told = 0
    for number in numbers:
        out = row.out()
        disk = FaultyDisk(out, failing_once(number, code))
        said = row.disturbed(disk)
        failed = disk.operations[number]
        if failed.kind in MATTER and failed.path.name != "run.jsonl":
            assert said, failed
        if said:
            told += 1
            assert str(out) in said, said
            advice = {
                errno.ENOSPC: "free some space and run the same command again",
                errno.EROFS: "choose another folder",
                errno.EIO: "the same command goes on where it was",
            }[code]
            assert advice in said, said
    assert told > len(numbers) / 2


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EIO], ids=["full", "read-only", "broken"])
def test_a_write_that_fails_is_told_and_gone_on_from(row: Row, code: int) -> None:
    matter = [operation for operation in row.operations if operation.kind in MATTER]
    others = [operation for operation in row.operations if operation.kind not in MATTER]
    numbers = some(matter, FEW - 2, seed=code) + some(others, 2, seed=code)
    check_every_write_fails_once(row, numbers, code)


@pytest.mark.slow
def test_each_write_fails_once_and_nothing_is_lost(row: Row) -> None:
    """Each file at each of its operations, and at some of the many writes of the larger ones."""
    numbers = some(row.operations, 200)
    named = {(operation.kind, operation.path.name) for operation in row.operations}
    assert {(row.operations[k].kind, row.operations[k].path.name) for k in numbers} == named
    check_every_write_fails_once(row, numbers, errno.ENOSPC)


@pytest.mark.parametrize("code", [errno.ESTALE, errno.ENOENT, errno.EIO])
def test_a_share_that_goes_away_for_a_while_is_gone_on_from(row: Row, code: int) -> None:
    rng = np.random.default_rng(code)
    everything = ("open", "write", "fsync", "replace", "mkdir", "unlink", "rmdir", "truncate", "read")
    for first in rng.integers(0, len(row.operations), FEW // 2).tolist():
        out = row.out()
        said = row.disturbed(FaultyDisk(out, failing_during(first, first + 30, code), everything))
        assert not said or (str(out) in said and "the same command goes on" in said), said


def check_power(row: Row, often: int) -> None:
    """Take what the disk holds at operations of a run, each time with names first or contents first, and go on."""
    images: dict[frozenset[tuple[str, bytes]], dict[str, bytes]] = {}

    def look(operation: Operation) -> None:
        if operation.number % often == 0:
            for image in (disk.as_flushed(), disk.as_named()):
                images[frozenset(image.items())] = image

    out = row.place / "powered"
    with PoweredDisk(out, look) as disk:
        row.run(out)
    assert results(out) == row.results
    assert len(images) > 12
    for image in images.values():
        again = write_image(image, row.out())
        row.run(again)
        assert results(again) == row.results


def test_a_power_cut_loses_nothing_that_was_said_to_be_there(row: Row) -> None:
    check_power(row, often=59)


@pytest.mark.slow
def test_a_power_cut_at_any_moment_loses_nothing(row: Row) -> None:
    check_power(row, often=1)


@pytest.mark.parametrize(("free", "said"), [(4096, True), (10_000_000, False)])
def test_an_engine_that_fails_on_a_full_disk_without_saying_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int, said: bool
) -> None:
    """COLMAP says "No registered database factory succeeded" where its database has no room."""
    usage = shutil.disk_usage(tmp_path)._replace(free=free)
    monkeypatch.setattr("pomona.survey.files.shutil.disk_usage", lambda path: usage)
    with pytest.raises(SurveyError if said else RuntimeError) as raised, disk_errors(tmp_path):
        raise RuntimeError("No registered database factory succeeded.")
    assert ("The disk is full" in str(raised.value)) == said


def test_arrays_that_find_no_room_complain_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arrays = {"a": np.arange(5000), "b": np.asarray(0.5)}
    write_npz(tmp_path / "a.npz", arrays)
    for name, array in read_npz(tmp_path / "a.npz", "arrays").items():
        np.testing.assert_array_equal(array, arrays[name])
    later: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", later.append)
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    with pytest.raises(OSError, match="No space left"):
        write_npz(Path("/dev/full"), arrays)
    gc.collect()
    assert later == []
