"""What every stage of one run shares: the survey, the photos with their digests, the options, who listens."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from pomona.errors import InputError
from pomona.photos import Photos
from pomona.pipeline.options import RunOptions
from pomona.progress import Progress, track
from pomona.survey import Stage, Survey
from pomona.survey.digest import digest, file_digest, plain
from pomona.survey.files import write_file
from pomona.survey.stage import KeptStage, StageWork

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Context:
    """One run. `digests` are of the photos' contents, by name; `on_stage` hears the name of each stage that begins.

    `warnings` are those that the person was told of so far, in this run. Stages named in `kept` are taken as an earlier
    run left them.
    """

    survey: Survey
    photos: Photos
    digests: Mapping[str, str]
    options: RunOptions
    progress: Progress
    on_stage: Callable[[str], None]
    warnings: Sequence[str] = ()
    kept: frozenset[str] = frozenset()

    def stage(self, name: str, key: Callable[[], Any], work: StageWork[T], *, rooms: Sequence[str]) -> Stage[T]:
        """Return a stage of this run. Its result depends on `key` and on the code of `rooms`, packages of Pomona."""

        def full_key() -> Any:
            return [key(), [code_digest(room) for room in rooms]]

        kind = KeptStage if name in self.kept else Stage
        return kind(self.survey, name, full_key, work, self.progress, self.on_stage)

    @property
    def photo_details(self) -> list[Any]:
        """All that is known of the photos except where they lie, for keys of stages."""
        return [
            {**{k: v for k, v in plain(photo).items() if k != "path"}, "digest": self.digests[photo.name]}
            for photo in self.photos
        ]


@cache
def code_digest(room: str) -> str:
    """Return a digest of the code (and trained values) of one of Pomona's packages, so that new code redoes it."""
    folder = Path(__file__).parent.parent / room
    files = sorted(path for path in folder.rglob("*") if path.suffix in (".py", ".json"))
    return digest({path.relative_to(folder).as_posix(): file_digest(path) for path in files})


def load_photos(
    survey: Survey, sources: Sequence[Path], sides: str, progress: Progress, *, min_photos: int
) -> tuple[Photos, dict[str, str]]:
    """Return the photos and the digests of their contents; a photo is read for its digest only when it is new."""
    from pomona import capture

    for source in sources:
        if source.is_dir() and source.resolve() == survey.folder:
            raise InputError(f"{source} is the survey itself: give the folder of the photos")
    photos = capture.load_photos(
        sources, sides=sides, frames_dir=survey.work("frames"), min_photos=min_photos, progress=progress
    )
    return photos, _digests(survey, photos, progress)


def _digests(survey: Survey, photos: Photos, progress: Progress) -> dict[str, str]:
    cache_path = survey.work("digests.json")
    try:
        cache = json.loads(cache_path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        cache = {}
    digests, fresh = {}, {}
    for photo in track(photos, progress, "looking for changes in photos", len(photos)):
        stat = photo.path.stat()
        place = f"{photo.path} {stat.st_size} {stat.st_mtime_ns}"
        digests[photo.name] = fresh[place] = cache.get(place) or file_digest(photo.path)
    if fresh != cache:
        write_file(cache_path, lambda path: _write_json(path, fresh))
    return digests


def _write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
