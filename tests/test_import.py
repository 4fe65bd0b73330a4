"""`import pomona` is quick and loads no engine; nor do the command line's help and its errors."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

ENGINES = ("torch", "pycolmap", "onnxruntime", "cv2", "sklearn", "laspy", "bpy")


def loaded_by(statement: str) -> set[str]:
    code = f"{statement}\nimport sys\nprint(*[name for name in {ENGINES!r} if name in sys.modules])"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


@pytest.mark.parametrize(
    "statement", ["import pomona", "import pomona.cli.app", "import pomona.survey", "import pomona.export"]
)
def test_no_engine_is_loaded(statement: str) -> None:
    assert loaded_by(statement) == set()


def test_import_is_quick() -> None:
    code = "import time; start = time.process_time(); import pomona; print(time.process_time() - start)"
    times = []
    for _ in range(5):  # time of the processor, since others may keep the machine busy; the best of five
        start = time.perf_counter()
        out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        times.append(float(out))
        assert 0 < times[-1] < time.perf_counter() - start
    assert min(times) < 0.5
