"""The formats that results can be written in: each one's file, what it is made of, and what writes it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pomona.errors import InputError
from pomona.export.source import ExportSource, Part
from pomona.survey.files import disk_errors, write_file
from pomona.values.cameras import Cameras

Content = Literal["fruits", "cloud", "masks", "cameras", "scene"]
"""What an export is of; "scene": cameras, cloud and fruits, to look at."""


_MORE_SUFFIXES = {"csv": (".txt",), "geojson": (".json",), "geoparquet": (".geoparquet",)}


@dataclass(frozen=True)
class ExportFormat:
    """One format: `file_name` is its file's, or its folder's where there is no suffix; `needs` must have been written.

    `write` takes what the export is made of and the path to write to.
    """

    kind: str
    title: str
    file_name: str
    content: Content
    needs: Part
    write: Callable[[ExportSource, Path], None]

    @property
    def is_folder(self) -> bool:
        """Whether it is written as a folder."""
        return not Path(self.file_name).suffix

    @property
    def suffixes(self) -> tuple[str, ...]:
        """The suffixes, in lower case, by which other programs know its file; none of a folder."""
        return (Path(self.file_name).suffix, *_MORE_SUFFIXES.get(self.kind, ())) if not self.is_folder else ()


def export_format(kind: str) -> ExportFormat:
    """Return the format of a kind; raises `InputError` where there is none."""
    if kind not in EXPORT_FORMATS:
        known = ", ".join(f"{each.kind} ({each.title})" for each in EXPORT_FORMATS.values())
        raise InputError(f"`to`: expected one of {known}, found '{kind}'")
    return EXPORT_FORMATS[kind]


def check_suffix(chosen: ExportFormat, path: Path) -> None:
    """Raise `InputError` for a file that other programs would take for something else by its name."""
    suffix = path.suffix.lower()
    if chosen.is_folder or not suffix or suffix in chosen.suffixes:
        return
    fitting = [each for each in EXPORT_FORMATS.values() if suffix in each.suffixes]
    of_others = f"; {suffix} is of `to` {' or '.join(each.kind for each in fitting)}" if fitting else ""
    known = ", ".join(
        f"{' or '.join(each.suffixes)} ({each.kind})" for each in EXPORT_FORMATS.values() if each.suffixes
    )
    raise InputError(
        f"`out` {path}: `to` {chosen.kind} is written to a file ending in {' or '.join(chosen.suffixes)}{of_others}. "
        f"Known are {known}; {', '.join(each.kind for each in EXPORT_FORMATS.values() if each.is_folder)} are folders"
    )


def write_export(kind: str, source: ExportSource, path: Path) -> None:
    """Write results to `path` in one of `EXPORT_FORMATS`; a file is complete or not there.

    Raises `InputError` for an unknown kind, a suffix of something else, or where the results lack what the format needs
    (a place on Earth for KML), `SurveyError` where the disk is full or write-protected, and `MissingExtraError` where
    an optional package is not installed.
    """
    chosen = export_format(kind)
    check_suffix(chosen, path)
    with disk_errors(path.parent):
        if chosen.is_folder:
            chosen.write(source, path)
        else:
            write_file(path, lambda temporary: chosen.write(source, temporary))


def _copy_of(part: Part) -> Callable[[ExportSource, Path], None]:
    """Write the survey's own file, which is in this format already."""

    def copy(source: ExportSource, path: Path) -> None:
        shutil.copyfile(source.file(part), path)

    return copy


def _coco(source: ExportSource, path: Path) -> None:
    from pomona.corrections.training import write_training

    write_training(path, source.labelled_masks())


def _las(source: ExportSource, path: Path) -> None:
    from pomona.formats.las import write_las

    write_las(path, source.cloud, frame=source.frame, with_altitudes=True)


def _ply(source: ExportSource, path: Path) -> None:
    from pomona.formats.ply import write_ply

    write_ply(path, source.cloud)


def _geojson(source: ExportSource, path: Path) -> None:
    from pomona.formats.geojson import write_geojson

    write_geojson(path, source.fruits, source.frame, source.trees, source.segments)


def _gpkg(source: ExportSource, path: Path) -> None:
    from pomona.formats.gpkg import write_gpkg

    write_gpkg(path, source.fruits, source.frame, source.trees, source.segments)


def _geoparquet(source: ExportSource, path: Path) -> None:
    from pomona.formats.geoparquet import write_geoparquet

    write_geoparquet(path, source.fruits, source.frame, source.trees, source.segments)


def _kml(source: ExportSource, path: Path) -> None:
    from pomona.formats.kml import write_kml

    write_kml(path, source.fruits, source.frame, source.trees, source.segments)


def _colmap(source: ExportSource, path: Path) -> None:
    from pomona.formats.cameras.colmap import write_colmap
    from pomona.formats.cameras.onto_photos import as_stored

    cameras = source.cameras
    photos = source.photos_of(cameras)
    _warn_of_missing_points(source, cameras)
    write_colmap(path, as_stored(cameras, photos), photos, upright=False, binary=True)


def _nerfstudio(source: ExportSource, path: Path) -> None:
    from pomona.formats.cameras.nerfstudio_export import write_nerfstudio

    cameras = source.cameras
    photos = source.photos_of(cameras)
    _warn_of_missing_points(source, cameras)
    write_nerfstudio(path, cameras, photos, source.progress)


def _metashape(source: ExportSource, path: Path) -> None:
    from pomona.formats.cameras.metashape_export import write_metashape

    cameras = source.cameras
    write_metashape(path, cameras, source.photos_of(cameras))


def _rerun(source: ExportSource, path: Path) -> None:
    from pomona.formats.rerun import write_rerun

    write_rerun(path, source.cameras, source.fruits, source.cloud)


def _warn_of_missing_points(source: ExportSource, cameras: Cameras) -> None:
    """Gaussian splatting begins with the sparse points and needs to know which photos saw them."""
    if not len(cameras.points_in_world):
        source.progress.warn(
            "There are no sparse points, by which Gaussian splatting begins: the cameras were given without"
        )
    elif not len(cameras.track_point_idx):
        source.progress.warn("The sparse points have no tracks (which photos saw them): the cameras were given without")


_FORMATS = (
    ExportFormat("csv", "a table of fruits", "fruits.csv", "fruits", "fruits", _copy_of("fruits")),
    ExportFormat("geojson", "GeoJSON", "fruits.geojson", "fruits", "fruits", _geojson),
    ExportFormat("gpkg", "GeoPackage", "fruits.gpkg", "fruits", "fruits", _gpkg),
    ExportFormat("geoparquet", "GeoParquet", "fruits.parquet", "fruits", "fruits", _geoparquet),
    ExportFormat("kml", "KML", "fruits.kml", "fruits", "fruits", _kml),
    ExportFormat("las", "LAS", "cloud.las", "cloud", "cloud", _las),
    ExportFormat("laz", "LAZ, compressed LAS", "cloud.laz", "cloud", "cloud", _las),
    ExportFormat("ply", "PLY", "cloud.ply", "cloud", "cloud", _ply),
    ExportFormat("coco", "COCO", "detections.json", "masks", "fruits", _coco),
    ExportFormat("colmap", "COLMAP's models, text and binary", "colmap", "cameras", "cameras", _colmap),
    ExportFormat("nerfstudio", "nerfstudio's transforms.json", "nerfstudio", "cameras", "cameras", _nerfstudio),
    ExportFormat("metashape", "Agisoft XML", "metashape.xml", "cameras", "cameras", _metashape),
    ExportFormat("rerun", "a recording of Rerun", "survey.rrd", "scene", "cloud", _rerun),
)

EXPORT_FORMATS: Mapping[str, ExportFormat] = {each.kind: each for each in _FORMATS}
"""Every format by its kind, in the order in which a person is shown them."""
