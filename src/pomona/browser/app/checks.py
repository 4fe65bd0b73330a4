"""Photos looked at before a run: what a person should mend before an hour is spent on them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from pomona.browser.app.contract import PhotoCheck, PhotoProblem, SideView
from pomona.errors import InputError
from pomona.progress import Silent
from pomona.stages import capture
from pomona.stages.capture.files import VIDEO_SUFFIXES
from pomona.stages.capture.quality import look_at, problems_of


def check_photos(paths: Sequence[Path], *, one_side: bool) -> PhotoCheck:
    """Return what is to be said of photos; of a video, whose frames a run chooses, just that it is there.

    Raises `InputError` and `MissingFileError` for what is no folder of photos.
    """
    if paths and all(path.is_file() and path.suffix.lower() in VIDEO_SUFFIXES for path in paths):
        return PhotoCheck(0, 0, [SideView(path.name, 0) for path in paths], 0, 0, "", [], [])
    if any(path.is_file() for path in paths):
        raise InputError("Choose the folder that the photos are in, not a photo")
    heard = Silent()
    photos = capture.load_photos(paths, sides="none" if one_side else "auto", leave_out_copies=True, progress=heard)
    seen = look_at(photos)
    found = problems_of(seen)
    days = sorted(photo.taken_at.date() for photo in photos if photo.taken_at is not None)
    return PhotoCheck(
        photos=len(photos),
        looked_at=len(seen),
        sides=[SideView(side, count) for side, count in Counter(photo.side for photo in photos).items()],
        positions=sum(photo.gnss is not None for photo in photos),
        focal_lengths=sum(photo.focal_px is not None for photo in photos),
        day=days[0].isoformat() if days else "",
        warnings=heard.warnings,
        problems=[
            *(PhotoProblem(name, "blurred") for name in found.blurred),
            *(PhotoProblem(name, "dark") for name in found.dark),
            *(PhotoProblem(name, "bright") for name in found.bright),
            *(PhotoProblem(name, "gap") for name in found.gap),
        ],
    )
