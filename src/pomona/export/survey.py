"""A survey folder as the source of exports."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pomona.cameras import Cameras, WorldFrame
from pomona.errors import PomonaError, few
from pomona.export.formats import export_format, write_export
from pomona.export.source import Part
from pomona.fruits import FruitCloud, Fruits
from pomona.photos import Photos
from pomona.progress import Progress, Silent
from pomona.survey import Survey

if TYPE_CHECKING:
    from pomona.corrections import Corrected, Found


@dataclass(frozen=True)
class SurveySource:
    """A survey to be exported; `photos_folder` is where its photos are, if they are not where they were."""

    survey: Survey
    photos_folder: Path | None = None
    progress: Progress = field(default_factory=Silent)

    @property
    def frame(self) -> WorldFrame:
        """What the survey's coordinates mean."""
        from pomona.survey.values import frame_from

        scale = self.survey.record_of("scale")
        return frame_from(scale.info["frame"]) if scale and scale.finished else WorldFrame()

    @property
    def fruits(self) -> Fruits:
        """The fruits of `fruits.csv`."""
        from pomona.formats.tables import read_fruits

        return read_fruits(self.survey.fruits)

    @property
    def cloud(self) -> FruitCloud:
        """The points of `cloud.laz`."""
        from pomona.formats.las import read_las

        return read_las(self.survey.cloud)

    @property
    def cameras(self) -> Cameras:
        """The survey's cameras, in its frame."""
        from pomona.formats.cameras.colmap import read_colmap

        return replace(read_colmap(self.survey.cameras), frame=self.frame)

    def photos_of(self, cameras: Cameras) -> Photos:
        """Return the photos of the cameras, with a warning for those that are not found; their files do not exist."""
        from pomona.survey.photos import photos_of, placeholder

        try:
            found = photos_of(self.survey, cameras.photos, self.photos_folder).by_name()
        except PomonaError as error:
            self.progress.warn(f"The photos were not found: {error}")
            found = {}
        missing = [name for name in cameras.photos if name not in found]
        if missing:
            self.progress.warn(
                f"{len(missing)} of {len(cameras)} photos were not found: {few(missing)}. Say where they are with "
                "--photos FOLDER"
            )
        return Photos(tuple(found.get(name) or placeholder(name, cameras) for name in cameras.photos))

    def corrected(self) -> tuple[Found, Corrected] | None:
        """Return the fruits as found and as corrected; None where nothing is, or all of it was undone."""
        if not self.survey.corrections.is_file():
            return None
        from pomona.pipeline.kept import kept_correcting

        correcting = kept_correcting(self.survey)
        return None if correcting.value is None else (correcting.found, correcting.value)

    def file(self, part: Part) -> Path:
        """Return the survey's own file of a part."""
        path: Path = getattr(self.survey, part)
        return path


def export_survey(kind: str, source: SurveySource, path: Path | None = None) -> Path:
    """Write a survey in the format of that kind to `path`, by default in its folder `export/`; return the path.

    Tables, map and cloud are first brought up to date with the survey's corrections. Raises what `write_export` raises,
    and `MissingFileError` where the survey has not got so far, naming the command that goes on.
    """
    from pomona.pipeline.kept import settle

    survey, chosen = source.survey, export_format(kind)
    target = path or survey.folder / "export" / chosen.file_name
    if chosen.content != "cameras":
        settle(survey, source.progress)
    survey.need(source.file(chosen.needs))
    write_export(kind, source, target)
    return target
