"""What `pomona export` can write: each form's file, what of the survey it is made of, and what writes it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from pomona.cameras import Cameras, WorldFrame
from pomona.errors import PomonaError, few
from pomona.photos import Photos
from pomona.progress import Progress
from pomona.survey import Survey


@dataclass(frozen=True)
class Job:
    """A survey to be exported, with the folder of the photos if they are not where they were."""

    survey: Survey
    photos_folder: Path | None
    progress: Progress

    @property
    def frame(self) -> WorldFrame:
        """What the survey's coordinates mean."""
        from pomona.survey.values import frame_from

        scale = self.survey.record_of("scale")
        return frame_from(scale.info["frame"]) if scale and scale.finished else WorldFrame()

    def cameras(self) -> Cameras:
        """The survey's cameras, in its frame."""
        from pomona.formats.cameras.colmap import read_colmap

        return replace(read_colmap(self.survey.cameras), frame=self.frame)

    def photos(self, cameras: Cameras) -> Photos:
        """The photos of the cameras. Those that are not found are told of; their files do not exist."""
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


@dataclass(frozen=True)
class Form:
    """One form: the name of its file or folder, the part of the survey that it needs, and what writes it."""

    name: str
    needs: Callable[[Survey], Path]
    write: Callable[[Job, Path], None]
    of_fruits: bool = True


def _copied(source: Callable[[Survey], Path]) -> Callable[[Job, Path], None]:
    def copy(job: Job, target: Path) -> None:
        shutil.copyfile(source(job.survey), target)

    return copy


def _coco(job: Job, target: Path) -> None:
    """The masks, and where a person corrected what they became, masks for training."""
    if not job.survey.corrections.is_file():
        return _detections(job, target)
    from pomona.corrections.training import write_training
    from pomona.pipeline.kept import kept_correcting

    correcting = kept_correcting(job.survey)
    if correcting.value is None:  # all was undone
        return _detections(job, target)
    return write_training(target, correcting.found, correcting.value)


def _las(job: Job, target: Path) -> None:
    from pomona.formats.las import read_las, write_las

    write_las(target, read_las(job.survey.cloud), frame=job.frame)


def _ply(job: Job, target: Path) -> None:
    from pomona.formats.las import read_las
    from pomona.formats.ply import write_ply

    write_ply(target, read_las(job.survey.cloud))


def _gpkg(job: Job, target: Path) -> None:
    from pomona.formats.gpkg import write_gpkg
    from pomona.formats.tables import read_fruits

    write_gpkg(target, read_fruits(job.survey.fruits), job.frame)


def _kml(job: Job, target: Path) -> None:
    from pomona.formats.kml import write_kml
    from pomona.formats.tables import read_fruits

    write_kml(target, read_fruits(job.survey.fruits), job.frame)


def _colmap(job: Job, target: Path) -> None:
    from pomona.formats.cameras.colmap import write_colmap
    from pomona.formats.cameras.onto_photos import as_stored

    cameras = job.cameras()
    photos = job.photos(cameras)
    _tell_of_points(job, cameras)
    write_colmap(target, as_stored(cameras, photos), photos, upright=False)


def _nerfstudio(job: Job, target: Path) -> None:
    from pomona.formats.cameras.nerfstudio_export import write_nerfstudio

    cameras = job.cameras()
    photos = job.photos(cameras)
    _tell_of_points(job, cameras)
    write_nerfstudio(target, cameras, photos)


def _metashape(job: Job, target: Path) -> None:
    from pomona.formats.cameras.metashape_export import write_metashape

    cameras = job.cameras()
    write_metashape(target, cameras, job.photos(cameras))


def _rerun(job: Job, target: Path) -> None:
    from pomona.formats.las import read_las
    from pomona.formats.rerun import write_rerun
    from pomona.formats.tables import read_fruits

    write_rerun(target, job.cameras(), read_fruits(job.survey.fruits), read_las(job.survey.cloud))


def _tell_of_points(job: Job, cameras: Cameras) -> None:
    """Say what a program that makes a scene of it would stumble over."""
    if not len(cameras.points_in_world):
        job.progress.warn(
            "There are no sparse points, by which Gaussian splatting begins: the cameras were given without"
        )
    elif not len(cameras.track_point_idx):
        job.progress.warn("The sparse points have no tracks (which photos saw them): the cameras were given without")


_detections = _copied(lambda survey: survey.detections)

FORMS: Mapping[str, Form] = {
    "csv": Form("fruits.csv", lambda survey: survey.fruits, _copied(lambda survey: survey.fruits)),
    "geojson": Form("fruits.geojson", lambda survey: survey.geojson, _copied(lambda survey: survey.geojson)),
    "gpkg": Form("fruits.gpkg", lambda survey: survey.fruits, _gpkg),
    "kml": Form("fruits.kml", lambda survey: survey.fruits, _kml),
    "las": Form("cloud.las", lambda survey: survey.cloud, _las),
    "laz": Form("cloud.laz", lambda survey: survey.cloud, _copied(lambda survey: survey.cloud)),
    "ply": Form("cloud.ply", lambda survey: survey.cloud, _ply),
    "coco": Form("detections.json", lambda survey: survey.detections, _coco),
    "colmap": Form("colmap", lambda survey: survey.cameras, _colmap, of_fruits=False),
    "nerfstudio": Form("nerfstudio", lambda survey: survey.cameras, _nerfstudio, of_fruits=False),
    "metashape": Form("metashape.xml", lambda survey: survey.cameras, _metashape, of_fruits=False),
    "rerun": Form("survey.rrd", lambda survey: survey.cloud, _rerun),
}
