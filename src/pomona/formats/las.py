"""Clouds of fruit as LAS or LAZ: colours, the fruit of each point as extra dimension `fruit_id`, and a CRS.

Coordinates are stored in steps of 0.1 mm around an offset. With GNSS the survey's frame is local metres around an
origin, and the file's CRS is that frame's own, as WKT, so that a GIS puts the cloud in its place on Earth.
"""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
from pyproj import CRS
from pyproj.exceptions import CRSError

from pomona.arrays import FloatArray
from pomona.cameras import WorldFrame
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.fruits import FruitCloud

FRUIT_ID = "fruit_id"
_STEP_M = 1e-4  # a tenth of a millimetre: finer than any cloud is, and room for 200 km
# LAS keeps coordinates as 32-bit integers of steps: what is further from the offset than this cannot be written.
_REACH_M = _STEP_M * (2**31 - 1)


def write_las(path: Path, cloud: FruitCloud, *, frame: WorldFrame | None = None) -> None:
    """Write a cloud to `path`, compressed where its name ends in `.laz`; written under a temporary name first.

    Raises `InputError` where a point is not finite, lies too far away to be written, or where the CRS is not known.
    """
    points = cloud.points_in_world
    if not np.isfinite(points).all():
        raise InputError(
            f"{path}: expected finite points, found {int((~np.isfinite(points)).any(1).sum())} that are not"
        )
    header = _header(path, points, frame)
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    # LAS has colours of 16 bits: 257 = 65535 / 255 keeps white white.
    las.red, las.green, las.blue = (cloud.rgb.astype(np.uint16) * 257).T
    las[FRUIT_ID] = cloud.fruit_id.astype(np.uint32)
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")
    las.write(str(temporary), do_compress=path.suffix.lower() == ".laz")
    temporary.replace(path)


def read_las(path: Path) -> FruitCloud:
    """Read a cloud; without colours it is grey, without `fruit_id` no point is of a fruit.

    Raises `MissingFileError`, and `FormatError` where the file is not LAS or LAZ or is cut short.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file; expected a LAS or LAZ cloud")
    try:
        las = laspy.read(str(path))
    except Exception as error:  # laspy and its decompressors raise many kinds, all of them about this file
        raise FormatError(f"{path}: expected a LAS or LAZ file, could not read it: {error}") from error
    names = set(las.point_format.dimension_names)
    points = np.asarray(las.xyz, float).reshape(-1, 3)
    if {"red", "green", "blue"} <= names:
        colours = np.stack([np.asarray(las[name]) for name in ("red", "green", "blue")], axis=1)
        # Some programs write 8-bit colours into the 16-bit fields.
        rgb = (colours // 257 if colours.max(initial=0) > 255 else colours).astype(np.uint8)
    else:
        rgb = np.full((len(points), 3), 128, np.uint8)
    fruit_id = np.asarray(las[FRUIT_ID], np.int64) if FRUIT_ID in names else np.zeros(len(points), np.int64)
    return FruitCloud(points, rgb, fruit_id)


def _header(path: Path, points: FloatArray, frame: WorldFrame | None) -> laspy.LasHeader:
    header = laspy.LasHeader(version="1.4", point_format=7)
    header.add_extra_dim(
        laspy.ExtraBytesParams(name=FRUIT_ID, type=np.uint32, description="Fruit of the point, 0: none")
    )
    header.scales = np.full(3, _STEP_M)
    header.offsets = np.round(points.mean(0)) if len(points) else np.zeros(3)
    if len(points) and np.abs(points - header.offsets).max() > _REACH_M:
        raise InputError(
            f"{path}: expected points within {_REACH_M / 1000:.0f} km of each other, found some further apart"
        )
    if frame is not None and frame.crs is not None:
        try:
            header.add_crs(CRS.from_user_input(frame.crs))
        except CRSError as error:
            raise InputError(f"{path}: the frame's CRS is not one that PROJ knows: {frame.crs}") from error
    return header
