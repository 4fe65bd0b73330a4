"""Points on Earth of known places: markers surveyed in a CRS, and ground control points clicked in photos."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.errors import FormatError, InputError, few
from pomona.formats.gcp_list import GcpLine, GcpList, read_gcp_list
from pomona.stages.scale.aruco import PlateSighting
from pomona.stages.scale.gnss import LocalFrame, in_local_metres
from pomona.stages.scale.marker_table import Markers, check_apart, read_markers
from pomona.values.cameras import WorldFrame
from pomona.values.photo_names import PhotoNames
from pomona.values.photos import Photos

# A point is a plate without a size: its corners lie so many pixels about it.
_POINT = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_SAME_PLACE_M = 1e-3  # lines of one name have the same place


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """Markers in local metres with z up; where `frame` is not None, it says where on Earth these are.

    `sightings` are those that a person clicked, in photos by the survey's names; none of plates that are to be found.
    `names`: what a person calls them, by id, where that is not the number on a plate.
    """

    markers: Markers
    frame: LocalFrame | None = None
    sightings: tuple[PlateSighting, ...] = ()
    names: Mapping[int, str] = field(default_factory=dict)

    def in_world(self, frame: WorldFrame) -> WorldFrame:
        """Return the frame of the markers with its place on Earth."""
        return frame if self.frame is None else replace(frame, crs=self.frame.crs, origin=self.frame.origin)


def surveyed_markers(table: Path, crs: str | None) -> ControlPoints:
    """Return the markers of a table, whose places are metres, or coordinates of `crs` and metres of height.

    Raises what `read_markers` raises, and `InputError` for a CRS that does not exist.
    """
    if crs is None:
        return ControlPoints(read_markers(table))
    markers = read_markers(table, in_metres=False)
    points, frame = in_local_metres(markers.points_in_world, crs, "`markers_crs`")
    local = replace(markers, points_in_world=points)
    check_apart(local, table)
    return ControlPoints(local, frame)


def read_control_points(path: Path, photos: Photos | None = None) -> ControlPoints:
    """Return the points of a `gcp_list.txt`, numbered in the order in which they come, and where photos show them.

    Without `photos`, the file is read and checked alone. Raises `MissingFileError`, `FormatError` naming the line, and
    `InputError` for a CRS that does not exist, or where no line is of one of the photos.
    """
    given = read_gcp_list(path)
    crs, lines = given.crs, given.lines
    keys = [line.name or line.place for line in lines]  # points without a name are told apart by their places
    ids = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    point_ids = [ids[key] for key in keys]
    _check_places(path, given, point_ids)
    first = {k: line.place for k, line in reversed(list(zip(point_ids, lines, strict=True)))}
    points, frame = in_local_metres(np.array([first[k] for k in range(len(ids))], float), crs, str(path))
    unknown = np.full(len(ids), np.nan)
    markers = Markers(np.arange(len(ids)), points, unknown, unknown)
    sightings = [] if photos is None else _sightings(path, lines, point_ids, photos)
    return ControlPoints(markers, frame, tuple(sightings), {k: _name(key) for key, k in ids.items()})


def _name(key: str | tuple[float, float, float]) -> str:
    return f"point {key}" if isinstance(key, str) else "point at " + " ".join(f"{value:.10g}" for value in key)


def _check_places(path: Path, given: GcpList, point_ids: Sequence[int]) -> None:
    metres = in_local_metres(np.array([line.place for line in given.lines]), given.crs, str(path))[0]
    first: dict[int, FloatArray] = {}
    for line, k, place in zip(given.lines, point_ids, metres, strict=True):
        if np.abs(place - first.setdefault(k, place)).max() > _SAME_PLACE_M:
            raise FormatError(f"{path}, line {line.number}: point {line.name} has another place than further above")


def _sightings(path: Path, lines: Sequence[GcpLine], ids: list[int], photos: Photos) -> list[PlateSighting]:
    names, sizes = PhotoNames(photos.names), {photo.name: (photo.width_px, photo.height_px) for photo in photos}
    found: list[PlateSighting] = []
    missing: dict[str, int] = defaultdict(int)
    for line, point_id in zip(lines, ids, strict=True):
        meant = names.meant_by(line.photo)
        if len(meant) > 1:
            raise InputError(f"{path}, line {line.number}: {line.photo} may be {few(meant)}: give its name in full")
        if not meant:
            missing[line.photo] += 1
            continue
        width, height = sizes[meant[0]]
        if not (0 <= line.pixel[0] <= width and 0 <= line.pixel[1] <= height):
            raise FormatError(
                f"{path}, line {line.number}: pixel {line.pixel[0]:g} {line.pixel[1]:g} is not in {meant[0]}, "
                f"which has {width} × {height}"
            )
        found.append(PlateSighting(meant[0], point_id, np.array(line.pixel) + _POINT))
    if not found:
        raise InputError(f"{path}: expected points in some of the {len(photos)} photos, found {few(list(missing))}")
    return found
