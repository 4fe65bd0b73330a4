"""The results in a survey folder as values, each read when it is first asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pomona.basics.arrays import counted
from pomona.errors import PomonaError, SurveyError, few
from pomona.progress import Progress, Silent
from pomona.survey.digest import file_digest
from pomona.survey.folder import SurveyFolder
from pomona.survey.fused import fused_path, read_fused
from pomona.survey.photos import SAY_WHERE, photos_of, placeholder
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.crop import Crop, RowSegments
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.photos import Photos, Skipped
from pomona.values.trees import Trees, Trunks

if TYPE_CHECKING:
    from pomona.stages.scale.report import ScaleReport
    from pomona.stages.sfm.pieces import Unregistered
    from pomona.survey.record import StageRecord

_Fact = TypeVar("_Fact")
_LOOKED_AT = 4  # photos, to tell whether they are the survey's: another row's differ in all


class SurveyReader:
    """Reads one survey. `photos_folder` is where its photos are, if they are not where they were; `if_moved` says in
    words what to do where they are not found.

    Whatever is asked for and not there raises `MissingFileError`, naming the command that writes it; damaged files
    raise `FormatError`. Photos that are not found are no error: there is a warning through `progress`.
    """

    def __init__(
        self,
        files: SurveyFolder,
        *,
        photos_folder: Path | None = None,
        progress: Progress | None = None,
        if_moved: str = SAY_WHERE,
    ) -> None:
        self.files = files
        self._photos_folder, self._if_moved = photos_folder, if_moved
        self._progress = progress or Silent()

    def forget(self) -> None:
        """Read everything again when it is asked for next: the files were changed."""
        for name in [name for name, value in vars(SurveyReader).items() if isinstance(value, cached_property)]:
            self.__dict__.pop(name, None)

    @property
    def folder(self) -> Path:
        """The survey's folder."""
        return self.files.folder

    @property
    def progress(self) -> Progress:
        """What is warned of photos that are not found."""
        return self._progress

    @cached_property
    def fruits(self) -> Fruits:
        """The fruits of `fruits.csv`, as corrected."""
        from pomona.formats.tables import read_fruits

        self.files.need(self.files.fruits)
        return read_fruits(self.files.fruits)

    @cached_property
    def observations(self) -> Observations:
        """Which detection in which photo saw which fruit, of `observations.csv`."""
        from pomona.formats.tables import read_observations

        self.files.need(self.files.observations)
        return read_observations(self.files.observations)

    @cached_property
    def trees(self) -> Trees:
        """The trees of `trees.csv`; none where they are not known."""
        from pomona.formats.tables import read_trees

        self.files.need(self.files.trees)
        return read_trees(self.files.trees)

    @property
    def trunks(self) -> Trunks:
        """Where trunks stand; none where they are not known. `trees` has those, too, that only a person named."""
        record = self._finished("planting")
        return self._fact(record, "ids", lambda _: Trunks.from_json(record.info)) if record else Trunks.unknown()

    @cached_property
    def segments(self) -> RowSegments:
        """The parts of the row of `segments.csv`; none of a survey that has no such table."""
        from pomona.formats.tables import read_segments

        return read_segments(self.files.segments) if self.files.segments.is_file() else RowSegments.empty()

    @property
    def crop(self) -> Crop | None:
        """All that hangs there, hidden fruits too, with intervals; None where too few were found to say."""
        record = self._finished("results")
        return self._fact(record, "crop", Crop.from_json) if record and "crop" in record.info else None

    @cached_property
    def detections(self) -> SurveyDetections:
        """All detections of `detections.json` by photo, weak ones too: `at_least(survey.score_threshold)` count."""
        from pomona.formats.detections.coco import read_coco

        self.files.need(self.files.detections)
        return read_coco(self.files.detections)

    @cached_property
    def cameras(self) -> Cameras:
        """The cameras in the world frame, with the sparse points of the scene."""
        from pomona.formats.cameras.colmap import read_colmap

        self.files.need(self.files.cameras)
        return self._in_frame(read_colmap(self.files.cameras))

    @cached_property
    def poses(self) -> Cameras:
        """The cameras in the world frame, without points: quicker to read."""
        from pomona.formats.cameras.colmap import read_poses

        self.files.need(self.files.cameras)
        return self._in_frame(read_poses(self.files.cameras))

    @cached_property
    def cloud(self) -> FruitCloud:
        """The points of `cloud.laz`: of the scene (`fruit_id` 0) and of the fruits."""
        from pomona.formats.las import read_las

        self.files.need(self.files.cloud)
        return read_las(self.files.cloud)

    @cached_property
    def photos(self) -> Photos:
        """The photos with all that is known of each.

        Those that cannot be found keep their place where a camera of them is known: their files do not exist.
        """
        sides = self.sides
        poses = self.poses if self.files.cameras.is_dir() else Cameras.empty()
        placed = dict.fromkeys(poses.photos)
        names = [*sides, *(name for name in placed if name not in sides)]
        found = self._found_photos(names)
        by_name = found.by_name()
        missing = [name for name in placed if name not in by_name]
        if found and missing:
            self._warn_of_missing(missing, len(placed))
        items = [
            replace(by_name[name], side=sides.get(name, ""))
            if name in by_name
            else placeholder(name, poses, sides.get(name, ""))
            for name in names
            if name in by_name or name in placed
        ]
        return Photos(tuple(items), self.skipped, from_video=found.from_video)

    def photos_of(self, cameras: Cameras) -> Photos:
        """Return the photos of `cameras`, in their order; those that are not found have a file that does not exist."""
        by_name = self._found_photos(cameras.photos).by_name()
        missing = [name for name in cameras.photos if name not in by_name]
        if missing and by_name:
            self._warn_of_missing(missing, len(cameras))
        return Photos(tuple(by_name.get(name) or placeholder(name, cameras) for name in cameras.photos))

    def _found_photos(self, names: list[str] | tuple[str, ...]) -> Photos:
        try:
            found = photos_of(self.files, tuple(names), self._photos_folder)
        except PomonaError as error:
            self._progress.warn(f"The photos were not found: {error}. {self._if_moved}")
            return Photos(())
        if names and len(found) == 0:  # other photos are there
            self._warn_of_missing(list(names), len(names))
        self._warn_of_others(found)
        return found

    def _warn_of_others(self, found: Photos) -> None:
        """Cameras count from the same name on, and cards are used again: a few are held against their digests."""
        known = {entry["name"]: entry.get("digest") for entry in self.files.get("photos", ())}
        those = [photo for photo in found if known.get(photo.name) and photo.path.is_file()]
        looked_at = those[:: max(1, len(those) // _LOOKED_AT)]
        others = [photo for photo in looked_at if file_digest(photo.path) != known[photo.name]]
        if others:
            self._progress.warn(
                f"{self._photos_folder or others[0].path.parent} has photos that are called as those of the survey and "
                f"are not the same: {few([photo.name for photo in others])} of {len(looked_at)} that were compared. "
                "Say with `photos` where the survey's own are"
            )

    def _warn_of_missing(self, missing: list[str], count: int) -> None:
        self._progress.warn(
            f"{len(missing)} of {counted(count, 'photo')} were not found: {few(missing)}. {self._if_moved}"
        )

    @property
    def sides(self) -> Mapping[str, str]:
        """The side of the row of each photo, by name; photos of one side are of "row"."""
        return {entry["name"]: entry.get("side", "") for entry in self.files.get("photos", ())}

    @property
    def skipped(self) -> tuple[Skipped, ...]:
        """Files among the photos that could not be used."""
        return tuple(Skipped(entry["name"], entry["reason"]) for entry in self.files.get("skipped", ()))

    @property
    def frame(self) -> WorldFrame:
        """What the survey's coordinates mean: as the manifest has it, else as the cameras' folder does."""
        return self.poses.frame if self.files.cameras.is_dir() else self._in_frame(Cameras.empty()).frame

    def _in_frame(self, cameras: Cameras) -> Cameras:
        """The cameras in the frame that the manifest has; as they were read where it has none."""
        from pomona.survey.facts import frame_from

        record = self._finished("scale")
        return replace(cameras, frame=self._fact(record, "frame", frame_from)) if record else cameras

    @property
    def scale(self) -> ScaleReport | None:
        """How metres were found; None where no stage, or one of another version, says so."""
        from pomona.survey.facts import scale_report_from

        record = self._finished("scale")
        try:
            return self._fact(record, "report", scale_report_from) if record else None
        except SurveyError:
            return None

    @property
    def unplaced(self) -> tuple[Unregistered, ...]:
        """Photos without a camera, and why."""
        from pomona.survey.facts import unregistered_from

        for name, entry in (("scale", "lost"), ("sfm", "unregistered")):
            stage = self._finished(name)
            if stage is not None and entry in stage.info:
                return self._fact(stage, entry, unregistered_from)
        return ()

    @property
    def score_threshold(self) -> float:
        """The score from which a detection counts as fruit in its photo; 0 where the survey does not say."""
        return self._score("score_threshold")

    @property
    def least_score(self) -> float:
        """The score from which a detection may become a fruit when all photos are seen together; 0 where the survey
        does not say."""
        return self._score("least_score")

    def _score(self, name: str) -> float:
        record = self._finished("select")
        return self._fact(record, name, float) if record and name in record.info else 0.0

    @cached_property
    def before_filter(self) -> tuple[Fruits, Observations] | None:
        """The fruits before the filter, with what saw them; None where the survey has not kept those of its tables."""
        return self.before_filter_of(self.fruits)

    def before_filter_of(self, left: Fruits) -> tuple[Fruits, Observations] | None:
        """Return the fruits before the filter, with what saw them; None where the survey has not kept those of `left`.

        `left` are the fruits that the filter left, as they were found: corrections may have changed those of tables.
        """
        record = self._finished("second_look")
        stage = "second_look" if record is not None and fused_path(self.files, "second_look").is_file() else "fuse"
        if not fused_path(self.files, stage).is_file():
            return None
        before = read_fused(self.files, stage)
        kept = set(left.ids.tolist()) <= set(before.fruits.ids.tolist())
        return (before.fruits, before.observations) if kept else None

    @property
    def around_second_look(self) -> tuple[Fruits, Fruits] | None:
        """The fruits before and after the second look; None where there was none, or they are not kept."""
        paths = [fused_path(self.files, stage) for stage in ("fuse", "second_look")]
        if self._finished("second_look") is None or not all(path.is_file() for path in paths):
            return None
        before, after = (read_fused(self.files, stage).fruits for stage in ("fuse", "second_look"))
        return before, after

    def _fact(self, record: StageRecord, name: str, read: Callable[[Any], _Fact]) -> _Fact:
        """An entry of a stage's facts as a value; raises `SurveyError` where it is none."""
        try:
            return read(record.info[name])
        except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
            raise SurveyError(
                f"{self.files.manifest_path}: {name}: not what a stage notes there ({error!r}): "
                "`pomona run` with the photos again writes it anew"
            ) from None

    def _finished(self, stage: str) -> StageRecord | None:
        record = self.files.record_of(stage)
        return record if record is not None and record.finished else None
