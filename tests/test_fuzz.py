"""Damaged files are read or refused in words by every reader: a few of each here, all of them by `make fuzz`."""

from __future__ import annotations

from pathlib import Path

import pytest

from fuzz.campaign import MOST_MEMORY_MB, MOST_SECONDS, run, scratch, try_to_read, write_examples
from fuzz.kept import FOLDER, read_kept
from fuzz.readers import READERS, Reader

FEW = 24


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_examples_are_read(reader: Reader) -> None:
    with scratch() as folder:
        for example, place in write_examples(reader, folder):
            reader.read(example.path(place))


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_damaged_files_are_read_or_refused(reader: Reader) -> None:
    tally = run(reader, range(FEW))
    assert tally.findings == []
    assert tally.files == FEW
    assert tally.refused > 0
    assert 0 <= tally.slowest_s < MOST_SECONDS
    assert 0 <= tally.peak_mb < MOST_MEMORY_MB


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.json")), ids=lambda path: path.stem)
def test_what_was_found_once_stays_found(path: Path) -> None:
    reader, one = read_kept(path)
    with scratch() as folder:
        places = dict(write_examples(reader, folder))
        assert try_to_read(reader, places[one.example], one)[0] in ("read", "refused")
