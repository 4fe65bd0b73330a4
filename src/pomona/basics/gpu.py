"""Whether there is an NVIDIA GPU here, and whether COLMAP can use it."""

from __future__ import annotations

import shutil
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache


@contextmanager
def own_signals() -> Iterator[None]:
    """Import pycolmap inside: it would print a trace of its own where the program is told to end (SIGTERM)."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    if before is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, before)


@cache
def what_is_missing() -> str:
    """Say in words what is missing for a GPU to be used, "" where there is one."""
    return _listed_by(shutil.which("nvidia-smi"))


@cache
def what_colmap_lacks() -> str:
    """Say in words what COLMAP lacks for a GPU here, "" where it has one."""
    with own_signals():
        import pycolmap

    return reason_against(pycolmap.has_cuda, shutil.which("nvidia-smi"))


def reason_against(has_cuda: bool, tool: str | None) -> str:
    """Say why there is no GPU for COLMAP, by whether it was built with CUDA, and what NVIDIA's `tool` lists."""
    if not has_cuda:
        return "this pycolmap was built without CUDA; install pycolmap-cuda12 in its place"
    return _listed_by(tool)


def _listed_by(tool: str | None) -> str:
    if tool is None or subprocess.run([tool, "-L"], capture_output=True, check=False).returncode != 0:
        return "no NVIDIA GPU was found"
    return ""
