"""The photos of a run, digests of their contents, and what they give to the stages."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from pomona.corrections import Corrections
from pomona.errors import InputError, few
from pomona.pipeline.options import RunOptions
from pomona.pipeline.runner import SourceValue
from pomona.pipeline.stage import CORRECTIONS, DIGESTS, PHOTOS, SIDES, SKIPPED, Source
from pomona.progress import Progress, track
from pomona.survey import SurveyFolder
from pomona.survey.digest import digest, file_digest, is_digest, plain
from pomona.survey.files import write_text_file
from pomona.survey.manifest import MANIFEST
from pomona.values.photos import Photo, Photos

# What is known of a photo's file, and says nothing of the photo.
_OF_FILE = ("path", "file_state")


def load_photos(
    survey: SurveyFolder,
    paths: Sequence[Path],
    options: RunOptions,
    progress: Progress,
    *,
    min_photos: int,
    are_all: bool = True,
) -> tuple[Photos, dict[str, str]]:
    """Return the photos and the digests of their contents; a photo is read for its digest only when it is new.

    Where these are not all (`are_all`), as others still arrive, options may speak of photos that are not there.
    Raises as `capture.load_photos` does, and `FormatError` or `InputError` for points clicked where no photo is.
    """
    from pomona.stages import capture

    for path in paths:
        if path.is_dir() and path.resolve() == survey.folder:
            raise InputError(f"{path} is the survey itself: give the folder of the photos")
        if (path / MANIFEST).is_file():
            raise InputError(f"{path} is a survey: give the folder of its photos{_known_photos(path)}")
    photos = capture.load_photos(
        paths,
        sides=options.sides,
        frames_dir=survey.work("frames"),
        min_photos=min_photos,
        key_frames=options.key_frames,
        leave_out_copies=True,
        are_all=are_all,
        progress=progress,
    )
    if options.positions is not None:
        from pomona.stages.capture.positions import with_positions

        photos = with_positions(photos, options.positions, progress, are_all=are_all)
    if options.gcp is not None and are_all:
        from pomona.stages.scale.control_points import read_control_points

        read_control_points(options.gcp, photos)  # a mistake in it is said before hours of work
    return photos, _digests(survey, photos, progress)


def _known_photos(folder: Path) -> str:
    """Where another survey says that its photos are; "" where it does not."""
    survey = SurveyFolder.find(folder)
    sources = [] if survey is None else survey.get("sources") or []
    return f", {few(sources, 2)}" if sources else ""


def sources_of(photos: Photos, digests: Mapping[str, str], corrections: Corrections) -> dict[Source, SourceValue]:
    """Return what the photos of a run, and the corrections in its folder, give to the stages.

    All that is known of the photos counts, except where they lie. `digests` are those of their contents, by name; a
    survey that is opened without its photos has none.
    """
    details = [
        {**{k: v for k, v in plain(photo).items() if k not in _OF_FILE}, "digest": digests.get(photo.name)}
        for photo in photos
    ]
    sides = {photo.name: photo.side for photo in photos}
    return {
        PHOTOS: SourceValue(replace(photos, skipped=()), digest([details, photos.from_video])),
        DIGESTS: SourceValue(digests, digest(digests)),
        SKIPPED: SourceValue(photos.skipped, digest(photos.skipped)),
        SIDES: SourceValue(sides, digest(sides)),
        CORRECTIONS: SourceValue(corrections, digest(corrections.done)),
    }


def _digests(survey: SurveyFolder, photos: Photos, progress: Progress) -> dict[str, str]:
    cache_path = survey.work("digests.json")
    cache = read_digests(cache_path)
    digests, fresh = {}, {}
    for photo in track(photos, progress, "looking for changes in photos", len(photos)):
        assert photo.file_state is not None
        size, changed_at = photo.file_state
        place = f"{photo.path} {size} {changed_at}"
        digests[photo.name] = fresh[place] = cache.get(place) or _digest_of(photo)
    if fresh != cache:
        write_text_file(cache_path, json.dumps(fresh, indent=1, ensure_ascii=False) + "\n")
    return digests


def _digest_of(photo: Photo) -> str:
    """The digest of a photo's file, which is still the one that its header was read from."""
    from pomona.stages.capture.images import check_unchanged

    try:
        content = file_digest(photo.path)
    except OSError as error:
        check_unchanged(photo, error)
        raise
    check_unchanged(photo)
    return content


def read_digests(path: Path) -> dict[str, str]:
    """Return what `digests.json` holds, by place, size and time of a file; nothing where it is damaged or not there."""
    try:
        cache = json.loads(path.read_text(encoding="utf-8"))
        return {str(place): content for place, content in cache.items() if is_digest(content)}
    except (OSError, ValueError, AttributeError, RecursionError):
        return {}
