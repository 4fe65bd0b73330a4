"""Surveys opened to be looked at, and opened again only when their manifest has changed."""

from __future__ import annotations

import threading
from pathlib import Path

from pomona.errors import PomonaError
from pomona.survey import SurveyFolder
from pomona.survey.manifest import MANIFEST

# A list of surveys is looked through every second; their manifests seldom change.
_known: dict[Path, tuple[tuple[int, int], SurveyFolder | None]] = {}
_lock = threading.Lock()


def opened(folder: Path) -> SurveyFolder | None:
    """Return the survey in a folder, for reading alone; None where there is none, or none that can be read."""
    try:
        stat = (folder / MANIFEST).stat()
    except (OSError, ValueError):  # of names that no folder can have
        return None
    seen = stat.st_mtime_ns, stat.st_size
    with _lock:
        found = _known.get(folder)
    if found is not None and found[0] == seen:
        return found[1]
    try:
        survey = SurveyFolder.open(folder)
    except (PomonaError, OSError):
        survey = None
    with _lock:
        _known[folder] = seen, survey
    return survey
