"""`positions.csv`: where photos were taken, by a receiver better than the camera's own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pomona.basics.arrays import BoolArray
from pomona.errors import FormatError, InputError, few
from pomona.formats.small_table import SmallTable, read_small_table
from pomona.progress import Progress
from pomona.values.photo_names import pair_names
from pomona.values.photos import Gnss, Photos

_LATITUDES, _LONGITUDES = 90.0, 180.0


def read_positions(path: Path) -> dict[str, Gnss]:
    """Read a table with the columns `photo,latitude,longitude`, and `altitude` and `sd` (metres) if it has them.

    Degrees are WGS 84. Raises `MissingFileError`, and `FormatError` naming line and column for what cannot be.
    """
    optional = ("altitude", "sd")
    table = read_small_table(path, ("photo", "latitude", "longitude"), "`positions`", "photo", optional=optional)
    latitudes, longitudes = table.numbers("latitude"), table.numbers("longitude")
    altitudes, sds = table.numbers_if_given("altitude"), table.numbers_if_given("sd")
    _check(table, "latitude", np.abs(latitudes) > _LATITUDES, "degrees from -90 to 90")
    _check(table, "longitude", np.abs(longitudes) > _LONGITUDES, "degrees from -180 to 180")
    _check(table, "sd", sds <= 0, "metres above 0")
    result: dict[str, Gnss] = {}
    values = zip(table.cells["photo"], latitudes.tolist(), longitudes.tolist(), altitudes, sds, strict=True)
    for line, (photo, latitude, longitude, altitude, sd) in zip(table.lines, values, strict=True):
        if photo in result:
            raise FormatError(f"{path}, line {line}: photo {photo} stands there twice")
        result[photo] = Gnss(latitude, longitude, _known(altitude), _known(sd))
    return result


def with_positions(photos: Photos, path: Path, progress: Progress, *, are_all: bool = True) -> Photos:
    """Return the photos at the places that a table has, in place of those of EXIF; others have none.

    Raises what `read_positions` raises, and `InputError` where a name may mean several photos, or no photo is in the
    table, though these `are_all`.
    """
    positions = read_positions(path)
    pairs = pair_names(list(positions), photos.names)
    if not pairs and are_all:
        raise InputError(f"{path}: expected places of some of the {len(photos)} photos, found {few(list(positions))}")
    places = {photo: positions[name] for name, photo in pairs.items()}
    without = [photo.name for photo in photos if photo.name not in places]
    if without:
        progress.warn(f"{len(without)} of {len(photos)} photos have no place in {path.name}: {few(without)}")
    items = tuple(replace(photo, gnss=places.get(photo.name)) for photo in photos)
    return Photos(items, photos.skipped, from_video=photos.from_video)


def _check(table: SmallTable, column: str, wrong: BoolArray, expected: str) -> None:
    if wrong.any():
        k = int(np.flatnonzero(wrong)[0])
        found = table.cells[column][k]
        raise FormatError(f"{table.path}, line {table.lines[k]}: `{column}`: expected {expected}, found {found}")


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
