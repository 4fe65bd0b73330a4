"""Places of photos in a table, in place of those in EXIF."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.errors import FormatError, InputError, MissingFileError
from pomona.progress import Silent
from pomona.stages.capture.positions import read_positions, with_positions
from pomona.values.photos import Gnss, Photo, Photos

EXIF = Gnss(41.0, 0.8, 100.0)
PHOTOS = Photos(tuple(Photo(f"east/IMG_{k:04}.JPG", Path(f"IMG_{k:04}.JPG"), 400, 300, gnss=EXIF) for k in range(3)))


def table(folder: Path, *rows: str, columns: str = "photo,latitude,longitude,altitude,sd") -> Path:
    path = folder / "positions.csv"
    path.write_text("\n".join([columns, *rows]) + "\n")
    return path


def test_a_table_goes_before_exif_and_photos_without_a_place_are_named(tmp_path: Path) -> None:
    path = table(tmp_path, "IMG_0000.jpg,41.6203,0.8701,212.40,0.015", "img_0002,41.6204,0.8702,,")
    progress = Silent()

    photos = with_positions(PHOTOS, path, progress)

    assert [photo.gnss for photo in photos] == [
        Gnss(41.6203, 0.8701, 212.40, 0.015), None, Gnss(41.6204, 0.8702, None, None)
    ]  # fmt: skip
    assert progress.warnings == ["1 of 3 photos have no place in positions.csv: east/IMG_0001.JPG"]


@pytest.mark.parametrize(
    "columns",
    [
        "Photo,Latitude (deg),Longitude (deg),Altitude (m),SD (m)",
        "photo,latitude_deg,longitude_deg,altitude_m,sd_m",
        "photo,latitude [°],longitude [°],altitude,sd",
    ],
)
def test_columns_may_have_their_unit_behind_the_name(tmp_path: Path, columns: str) -> None:
    path = table(tmp_path, "IMG_0000.jpg,41.6203,0.8701,212.40,0.015", columns=columns)
    assert read_positions(path) == {"IMG_0000.jpg": Gnss(41.6203, 0.8701, 212.40, 0.015)}


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("IMG_0000.JPG,4161.2,0.87,212,0.02", "line 2: `latitude`: expected degrees from -90 to 90, found 4161.2"),
        ("IMG_0000.JPG,41.6,301234.5,212,0.02", "line 2: `longitude`: expected degrees from -180 to 180"),
        ("IMG_0000.JPG,41.6,0.87,212,0", "line 2: `sd`: expected metres above 0, found 0"),
        ("IMG_0000.JPG,north,0.87,212,0.02", "line 2"),
    ],
)
def test_what_cannot_be_is_refused_with_its_line(tmp_path: Path, row: str, said: str) -> None:
    with pytest.raises(FormatError, match=said):
        read_positions(table(tmp_path, row))


def test_tables_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"line 3: photo IMG_0000.JPG stands there twice"):
        read_positions(table(tmp_path, "IMG_0000.JPG,41,0,1,1", "IMG_0000.JPG,41,0,1,1"))
    with pytest.raises(InputError, match=r"expected places of some of the 3 photos, found other.jpg"):
        with_positions(PHOTOS, table(tmp_path, "other.jpg,41,0,1,1"), Silent())
    with pytest.raises(MissingFileError):
        read_positions(tmp_path / "none.csv")
