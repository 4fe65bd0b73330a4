"""A survey folder as the source of exports."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pomona.export.formats import export_format, write_export
from pomona.export.source import Part
from pomona.survey.reader import SurveyReader

if TYPE_CHECKING:
    from pomona.corrections import Corrected, Found
    from pomona.corrections.training import LabelledMasks


class SurveySource(SurveyReader):
    """A survey to be exported."""

    def bring_up_to_date(self) -> None:
        """Write tables, map and cloud again where they lack corrections; all is read again when it is asked for next.

        Raises what `pomona.pipeline.reopen.bring_up_to_date` raises.
        """
        from pomona.pipeline.reopen import bring_up_to_date

        bring_up_to_date(self.files, self.progress)
        self.forget()

    def corrected(self) -> tuple[Found, Corrected] | None:
        """Return the fruits as found and as corrected; None where nothing is, or all of it was undone."""
        if not self.files.corrections.is_file():
            return None
        from pomona.pipeline.reopen import last_found

        last = last_found(self.files)
        return None if last.corrected is None else (last.found, last.corrected)

    def labelled_masks(self) -> LabelledMasks:
        """Return the masks of the fruits, as corrected."""
        from pomona.corrections.training import LabelledMasks

        if (both := self.corrected()) is not None:
            return LabelledMasks.of(*both)
        return LabelledMasks(
            photos=self.poses.photos,
            detections=self.detections,
            observations=self.observations,
            least_score=self.least_score,
        )

    def file(self, part: Part) -> Path:
        """Return the survey's own file of a part."""
        path: Path = getattr(self.files, part)
        return path


def export_survey(kind: str, source: SurveySource, path: Path | None = None) -> Path:
    """Write a survey in the format of that kind to `path`, by default in its folder `export/`; return the path.

    Tables, map and cloud, and the values of `source`, are first brought up to date with the survey's corrections.
    Raises what `write_export` raises, and `MissingFileError` where the survey has not got so far, naming the command
    that goes on.
    """
    chosen = export_format(kind)
    target = path or source.files.exports / chosen.file_name
    if chosen.content != "cameras":
        source.bring_up_to_date()
    source.files.need(source.file(chosen.needs))
    write_export(kind, source, target)
    return target
