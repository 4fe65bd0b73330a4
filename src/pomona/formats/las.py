"""Clouds of fruit as LAS or LAZ: colours, the fruit of each point as extra dimension `fruit_id`, and a CRS.

Coordinates are stored in steps of 0.1 mm around an offset. With GNSS the survey's frame is local metres around an
origin, and the file's CRS is that frame's own, so that a GIS puts the cloud in its place on Earth. It is well-known
text of the first version (OGC 01-009), the one that LAS 1.4 has and that all its readers know. A CRS says nothing of
where heights begin: for maps z can be the altitude, and a record of ours then says what was added to the frame's z.
"""

from __future__ import annotations

import io
import math
import struct
from pathlib import Path
from typing import BinaryIO

import laspy
import lazrs
import numpy as np
from laspy.vlrs.known import WktCoordinateSystemVlr
from pyproj import CRS
from pyproj.exceptions import CRSError

from pomona.basics.arrays import FloatArray
from pomona.errors import FormatError, InputError, MissingFileError, is_away
from pomona.formats.files import lost, write_whole
from pomona.values.cameras import WorldFrame
from pomona.values.fruits import FruitCloud

FRUIT_ID = "fruit_id"
_ALTITUDE_RECORD = ("pomona", 1)
_ALTITUDE = struct.Struct("<d")
_PANIC = "PanicException"  # of Rust: it can be imported from nowhere, and is no `Exception`
_STEP_M = 1e-4  # a tenth of a millimetre: finer than any cloud is, and room for 200 km
# LAS keeps coordinates as 32-bit integers of steps: what is further from the offset than this cannot be written.
_REACH_M = _STEP_M * (2**31 - 1)
# LAZ makes real clouds 5 to 20 times smaller; a file that says more than this is made to fill the memory.
_MOST_COMPRESSED, _ALWAYS_FINE_BYTES = 500, 64_000_000
# Where the header has the day of its making. laspy always gives one; without it, the same cloud is the same file.
_DATE_AT = 90
# LASzip's compressor of layers, and how many layers items of a kind have; those of extra bytes have one for each byte.
_LAYERED, _LAYERS = 3, {10: 9, 11: 1, 12: 2, 13: 1}
_VLR_BYTES, _EVLR_BYTES, _LEAST_CHUNK_BYTES = 54, 60, 1


def write_las(path: Path, cloud: FruitCloud, *, frame: WorldFrame | None = None, with_altitudes: bool = False) -> None:
    """Write a cloud to `path`, compressed where its name ends in `.laz`; written under a temporary name first.

    `with_altitudes`: where `frame` has a place on Earth, z is the altitude in the file, not the frame's z. Raises
    `InputError` where a point is not finite, lies too far away to be written, or where the CRS is not known.
    """
    zero_m = frame.zero_altitude_m if with_altitudes and frame is not None else 0.0
    points = cloud.points_in_world + np.array([0.0, 0.0, zero_m])
    if not np.isfinite(points).all():
        raise InputError(
            f"{path}: expected finite points, found {int((~np.isfinite(points)).any(1).sum())} that are not"
        )
    header = _header(path, points, frame)
    if zero_m:
        header.vlrs.append(laspy.VLR(*_ALTITUDE_RECORD, "altitude of the survey's z = 0", _ALTITUDE.pack(zero_m)))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    # LAS has colours of 16 bits: 257 = 65535 / 255 keeps white white.
    las.red, las.green, las.blue = (cloud.rgb.astype(np.uint16) * 257).T
    las[FRUIT_ID] = cloud.fruit_id.astype(np.uint32)
    # Each is the first and only return: 0 is none, and what works on first or last returns takes no such point.
    las.return_number, las.number_of_returns = (np.ones(len(cloud), np.uint8) for _ in range(2))
    # By way of memory: what compresses does not say why a disk took no more.
    content = io.BytesIO()
    las.write(content, do_compress=path.suffix.lower() == ".laz")
    content.seek(_DATE_AT)
    content.write(bytes(4))
    write_whole(path, content.getbuffer(), path.with_name(f".{path.stem}.part{path.suffix}"))


def read_las(path: Path) -> FruitCloud:
    """Read a cloud, in the frame that it was written from; without colours it is grey, without `fruit_id` no point is
    of a fruit.

    Raises `MissingFileError`, `LostFileError` where its disk does not answer, and `FormatError` where the file is not
    LAS or LAZ or is cut short.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file; expected a LAS or LAZ cloud")
    _check_header(path)
    try:
        _check_layers(path)
        # One thread: on a damaged file, those of the parallel reader wait for each other for ever.
        las = laspy.read(str(path), laz_backend=laspy.LazBackend.Lazrs)
    except FormatError:
        raise
    except BaseException as error:  # laspy and its decompressors raise many kinds, all of them about this file
        if not isinstance(error, Exception) and type(error).__name__ != _PANIC:
            raise
        if isinstance(error, OSError) and is_away(error) and not isinstance(error, PermissionError):
            raise lost(path, error) from None
        raise FormatError(f"{path}: expected a LAS or LAZ file, could not read it: {error}") from error
    names = set(las.point_format.dimension_names)
    points = np.asarray(las.xyz, float).reshape(-1, 3) - np.array([0.0, 0.0, _zero_altitude_m(path, las.header)])
    if {"red", "green", "blue"} <= names:
        colours = np.stack([np.asarray(las[name]) for name in ("red", "green", "blue")], axis=1)
        # Some programs write 8-bit colours into the 16-bit fields.
        rgb = (colours // 257 if colours.max(initial=0) > 255 else colours).astype(np.uint8)
    else:
        rgb = np.full((len(points), 3), 128, np.uint8)
    fruit_id = np.asarray(las[FRUIT_ID], np.int64) if FRUIT_ID in names else np.zeros(len(points), np.int64)
    return FruitCloud(points, rgb, fruit_id)


def _zero_altitude_m(path: Path, header: laspy.LasHeader) -> float:
    """Return what was added to z; nothing in files of other programs, nor in those of surveys of earlier versions."""
    found = [each.record_data for each in header.vlrs if (each.user_id, each.record_id) == _ALTITUDE_RECORD]
    if not found:
        return 0.0
    value = float(_ALTITUDE.unpack(found[0])[0]) if len(found[0]) == _ALTITUDE.size else math.nan
    if not math.isfinite(value):
        raise FormatError(f"{path}: expected an altitude in its record of Pomona, found something else: it is damaged")
    return value


def _check_header(path: Path) -> None:
    """Refuse counts of points and records that the file has no room for, which laspy would count to.

    Source: LAS Specification 1.4 R15 (ASPRS), tables 3 and 10; LAZ sets the highest bits of the point format.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(375)
        chunks = _chunks(file, size, int.from_bytes(head[96:100], "little"))
    least = 375 if head[25:26] >= b"\x04" else 227
    if len(head) < least or not head.startswith(b"LASF"):
        raise FormatError(f"{path}: expected a LAS or LAZ file, which begins with 'LASF' and a header")
    if head[24] != 1:
        raise FormatError(f"{path}: expected LAS 1.0 to 1.4, found version {head[24]}.{head[25]}")
    start = int.from_bytes(head[96:100], "little")
    vlrs, count = (int.from_bytes(head[at : at + 4], "little") for at in (100, 107))
    compressed, record_bytes = bool(head[104] & 0xC0), int.from_bytes(head[105:107], "little")
    evlrs = 0
    if least == 375:
        evlrs = int.from_bytes(head[243:247], "little")
        count = int.from_bytes(head[247:255], "little")
    room = max(size * _MOST_COMPRESSED, _ALWAYS_FINE_BYTES) if compressed else max(0, size - start)
    if compressed and chunks * _LEAST_CHUNK_BYTES > size:
        raise FormatError(f"{path}: expected a LAZ file, found a table of {chunks} chunks: it is damaged or cut short")
    if count * record_bytes > room or vlrs * _VLR_BYTES + evlrs * _EVLR_BYTES > size:
        raise FormatError(
            f"{path}: its header says {count} points of {record_bytes} bytes and {vlrs + evlrs} records before and "
            f"after them, which a file of {size} bytes cannot hold: it is damaged or cut short"
        )


def _check_layers(path: Path) -> None:
    """Refuse chunks of which the layers are longer than the file: lazrs makes room for them before it reads any.

    Source: LASzip's VLR and chunks of layers (LASzip 3, `laszip.hpp`, `laswritepoint.cpp`).
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        header = laspy.LasHeader.read_from(file)
        found = header.vlrs.get("LasZipVlr")
        record = found[0].record_data if found else b""
        if int.from_bytes(record[:2], "little") != _LAYERED:
            return
        items = np.frombuffer(record[34:], "<u2", 3 * int.from_bytes(record[32:34], "little")).reshape(-1, 3)
        layers = sum(_LAYERS.get(int(kind), int(item_bytes)) for kind, item_bytes, _ in items)
        file.seek(header.offset_to_point_data)
        table = lazrs.read_chunk_table(file, lazrs.LazVlr(record))
        at = header.offset_to_point_data + 8
        for _, chunk_bytes in table:
            file.seek(at + int(items[:, 1].sum()) + 4)
            in_layers = int(np.frombuffer(file.read(4 * layers), "<u4").sum(dtype=np.int64))
            if in_layers > size:
                raise FormatError(
                    f"{path}: expected a LAZ file, found a chunk of {in_layers} bytes in a file of {size}: it is "
                    "damaged or cut short"
                )
            at += chunk_bytes


def _chunks(file: BinaryIO, size: int, start: int) -> int:
    """How many chunks the table at the end of LAZ's points has; 0 where there is no table."""
    file.seek(start)
    at = int.from_bytes(file.read(8), "little", signed=True)
    if at == -1:  # of a file that was written without going back
        file.seek(max(0, size - 8))
        at = int.from_bytes(file.read(8), "little", signed=True)
    if not 0 < at <= size - 8:
        return 0
    file.seek(at)
    return int.from_bytes(file.read(8)[4:], "little")


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
    header.global_encoding.wkt = True  # as points of this format need it, with a CRS or without
    if frame is not None and frame.crs is not None:
        try:
            crs = CRS.from_user_input(frame.crs)
        except CRSError as error:
            raise InputError(f"{path}: the frame's CRS is not one that PROJ knows: {frame.crs}") from error
        header.vlrs.append(WktCoordinateSystemVlr(_well_known_text(crs)))
    return header


def _well_known_text(crs: CRS) -> str:
    """The text of a CRS in the first version; a later one where that has no words for it."""
    try:
        return crs.to_wkt("WKT1_GDAL")
    except CRSError:
        return crs.to_wkt()
