"""Fixtures that every test may use."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from pipeline_fakes import Fakes

# Threads of OpenMP (PyTorch, scikit-learn, COLMAP) that wait for each other by spinning hold the very cores that the
# others need when something else runs too. It is read when these libraries are loaded, here and in child processes.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# Tests run in a process for each core. Two threads of PyTorch beside another test wait for each other: a step of
# training then takes five times as long as on one thread.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# The same examples in each run, however long one takes: what passes once passes on a busy machine too.
settings.register_profile("pomona", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("pomona")

# No test pulls the plug, and a small survey waits longer for the disk than it computes. Tests of what is written when
# replace it themselves.
os.fsync = lambda handle: None

# Files whose slow tests take longest, first: what begins last should be short, or one core waits for the other.
LONGEST_FIRST = (
    "test_app_browser.py",
    "test_sfm.py",
    "test_datasets_fuji.py",
    "test_watch.py",
    "test_orchard_dev.py",
    "test_camera_bed.py",
    "test_adapt.py",
)

REPOSITORY = Path(__file__).resolve().parent.parent


def pytest_configure(config: pytest.Config) -> None:
    # Files in the order below, not in one that xdist chooses; where it does not run, nobody reads this.
    config.option.loadscopereorder = False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort files by the list above, and then those with most tests first."""
    order = {name: place for place, name in enumerate(LONGEST_FIRST)}
    count = Counter(item.path.name for item in items)
    items.sort(key=lambda item: (order.get(item.path.name, len(order)), -count[item.path.name]))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of shared data beside the checkout; skips the test, saying so, where it is missing."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("shared data not found at ../shared/data")
    return folder


@pytest.fixture(scope="session")
def sample_survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The survey of the whole bundled sample, made once for all processes that run tests: copy it to change it."""
    from filelock import FileLock

    import pomona

    of_process = tmp_path_factory.getbasetemp()
    folder = of_process.parent if "PYTEST_XDIST_WORKER" in os.environ else of_process
    sample, survey, done = pomona.sample_folder(), folder / "sample-survey", folder / "sample-survey.done"
    with FileLock(folder / "sample-survey.lock"):
        if not done.exists():
            pomona.run([sample / "east", sample / "west"], survey, markers=sample / "markers.csv")
            done.touch()
    return survey


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch) -> Fakes:
    """Quick stand-ins for the slow stages of a run, which count how often each is called."""
    from pipeline_fakes import Fakes  # it loads NumPy, which reads the variables above

    return Fakes().install(monkeypatch)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from chromium import chromium  # it loads NumPy, which reads the variables above

    with chromium() as started:
        yield started
