"""Seconds of processors and memory: of this process, and of commands with all processes that they start."""

import os
import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Usage:
    """What a command took: seconds of the wall clock and of processors, and the most memory held at once."""

    wall_s: float
    processor_s: float
    memory_mb: float


def used_by(command: list[str]) -> Usage:
    """Run a command to its end; its processes' memory is summed as /proc shows it (shared pages by parts)."""
    begun, before = time.monotonic(), os.times()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    most_mb, over = [0.0], threading.Event()

    def watch() -> None:
        while not over.wait(0.1):
            most_mb[0] = max(most_mb[0], sum(map(_proportional_mb, _family(process.pid))))

    watcher = threading.Thread(target=watch)
    watcher.start()
    code = process.wait()
    over.set()
    watcher.join()
    after = os.times()
    if code:
        raise SystemExit(f"{' '.join(command)}: exit status {code}")
    processor_s = after.children_user + after.children_system - before.children_user - before.children_system
    return Usage(time.monotonic() - begun, processor_s, most_mb[0])


def processor_s() -> float:
    """Seconds of this process so far, and of those that it started and that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def peak_mb(process: int | str = "self") -> float:
    """The most memory that a process alone held so far: what `getrusage` says begins with what its parent needed."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


def _family(pid: int) -> list[int]:
    try:
        children = [(task / "children").read_text() for task in Path(f"/proc/{pid}/task").iterdir()]
    except OSError:
        return []
    return [pid, *(member for text in children for child in text.split() for member in _family(int(child)))]


def _proportional_mb(pid: int) -> float:
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="utf-8").splitlines()
    except OSError:
        return 0.0
    return sum(int(line.split()[1]) for line in lines if line.startswith("Pss:")) * 1024 / 1e6
