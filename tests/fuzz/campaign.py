"""Damaged files read one after another in a process of their own, which memory and time are limited of."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from fuzz.mutations import mutated
from fuzz.readers import Example, Reader
from pomona.errors import PomonaError

MOST_MEMORY_MB = 1024
MOST_SECONDS = 10.0  # of computing, so that a busy machine changes nothing
_HANGS_S = 600.0  # of waiting, for what cannot be interrupted; a busy machine may take minutes for a second


@dataclass(frozen=True)
class Finding:
    """A damaged file that was not read, and not refused as it should be: which, and what happened."""

    case: int
    what: str
    where: str

    @property
    def kind(self) -> str:
        """What several findings have in common that have one cause."""
        return f"{self.what.partition(':')[0]} at {self.where}"


@dataclass
class Tally:
    """What became of the files of one reader."""

    name: str
    files: int = 0
    read: int = 0
    findings: list[Finding] = field(default_factory=list)
    slowest_s: float = 0.0
    peak_mb: float = 0.0
    wall_s: float = 0.0

    @property
    def refused(self) -> int:
        """The files that got one of Pomona's own errors."""
        return self.files - self.read - len(self.findings)


@dataclass(frozen=True)
class Damaged:
    """A case: an example, the one of its files that is damaged, and what it holds then."""

    example: Example
    file: Path
    content: bytes


def damaged(reader: Reader, examples: Sequence[tuple[Example, Path]], case: int) -> Damaged:
    """Return case number `case` of a reader, the same in every run; `examples` lie in the folders beside them."""
    rng = np.random.default_rng([zlib.crc32(reader.name.encode()), case])
    example, folder = examples[case % len(examples)]
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file.name not in example.whole]
    file = files[(case // len(examples)) % len(files)]
    return Damaged(example, file.relative_to(folder), mutated(file.read_bytes(), rng))


def write_examples(reader: Reader, folder: Path) -> list[tuple[Example, Path]]:
    """Write a reader's examples, each into a folder of its own below `folder`; return them with these."""
    found = []
    for k, example in enumerate(reader.examples):
        (folder / str(k)).mkdir()
        example.write(folder / str(k))
        found.append((example, folder / str(k)))
    return found


@contextlib.contextmanager
def scratch() -> Iterator[Path]:
    """Give a folder, in memory where there is one, that is removed afterwards."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as name:
        yield Path(name)


def run(reader: Reader, cases: Sequence[int]) -> Tally:
    """Read the cases of one reader in a child process; one that dies or hangs is a finding."""
    tally, start = Tally(reader.name), time.monotonic()
    context = multiprocessing.get_context("fork")
    at = 0
    while at < len(cases):
        with scratch() as folder:
            here, there = context.Pipe()
            child = context.Process(target=_child, args=(reader, folder, cases[at:], there), daemon=True)
            child.start()
            there.close()
            at += _follow(tally, child, here, cases[at:])
    tally.wall_s = time.monotonic() - start
    return tally


def _follow(tally: Tally, child: multiprocessing.process.BaseProcess, here: Connection, cases: Sequence[int]) -> int:
    """Take what a child tells of its cases; return how many it has done, the one it died of included."""
    done = 0
    try:
        while done < len(cases):
            if not here.poll(_HANGS_S):
                child.kill()
                _note(tally, cases[done], f"no answer in {_HANGS_S:.0f} s", "")
                return done + 1
            what, where, seconds, peak_mb = here.recv()
            tally.slowest_s, tally.peak_mb = max(tally.slowest_s, seconds), max(tally.peak_mb, peak_mb)
            if what in ("read", "refused"):
                tally.files += 1
                tally.read += what == "read"
            else:
                _note(tally, cases[done], what, where)
            done += 1
    except EOFError:
        child.join()
        _note(tally, cases[done], f"the process died ({child.exitcode})", "")
        return done + 1
    child.join()
    return done


def _note(tally: Tally, case: int, what: str, where: str) -> None:
    tally.files += 1
    tally.findings.append(Finding(case, what, where))


def _child(reader: Reader, folder: Path, cases: Sequence[int], there: Connection) -> None:
    _be_quiet()
    # Here and not in the parent: pools of threads that a library starts do not outlive a fork.
    examples = write_examples(reader, folder)
    for example, place in examples:  # whatever is imported at the first use is so before memory is limited
        reader.read(example.path(place))
    limit_memory(MOST_MEMORY_MB)
    signal.signal(signal.SIGPROF, _stop)
    base_mb = _peak_mb()
    for case in cases:
        one = damaged(reader, examples, case)
        start = time.process_time()
        what, where = try_to_read(reader, dict(examples)[one.example], one)
        there.send((what, where, time.process_time() - start, _peak_mb() - base_mb))


def try_to_read(reader: Reader, folder: Path, one: Damaged) -> tuple[str, str]:
    """Return "read", "refused", or the error that came instead, and where it was raised."""
    whole = (folder / one.file).read_bytes()
    (folder / one.file).write_bytes(one.content)
    try:
        signal.setitimer(signal.ITIMER_PROF, MOST_SECONDS)
        reader.read(one.example.path(folder))
    except PomonaError:
        return "refused", ""
    except (Exception, _TooLong) as error:
        places = [f for f in traceback.extract_tb(error.__traceback__) if "/pomona/" in f.filename]
        where = f"{places[-1].filename.rpartition('/pomona/')[2]}:{places[-1].lineno}" if places else "the test"
        return f"{type(error).__name__}: {error}"[:200], where
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        (folder / one.file).write_bytes(whole)
        if reader.leaves:
            for left in reader.leaves:
                shutil.rmtree(folder / left, ignore_errors=True)
    return "read", ""


class _TooLong(BaseException):
    """So much has been computed that a reader has to be stopped."""


def _stop(number: int, frame: object) -> None:
    raise _TooLong(f"more than {MOST_SECONDS:.0f} s of computing")


def _be_quiet() -> None:
    """Drop what libraries in C say of damaged files on stderr."""
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), 2)


def limit_memory(more_mb: float) -> None:
    """Let this process have so much more memory than it has."""
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[0])
        most = pages * resource.getpagesize() + int(more_mb * 2**20)
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
