"""Clouds as LAS and LAZ: what is written is read back, by us and by laspy alone."""

from __future__ import annotations

import errno
import math
import sqlite3
import struct
from contextlib import closing
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS, Transformer

from pomona.errors import FormatError, InputError, LostFileError, MissingFileError
from pomona.formats.gpkg import write_gpkg
from pomona.formats.las import read_las, write_las
from pomona.values.cameras import WorldFrame, local_crs
from pomona.values.fruits import FruitCloud, Fruits


@pytest.fixture
def cloud() -> FruitCloud:
    rng = np.random.default_rng(0)
    return FruitCloud(rng.normal(0, 5, (200, 3)), rng.integers(0, 256, (200, 3)), rng.integers(0, 400, 200))


@pytest.mark.parametrize("name", ["cloud.laz", "cloud.las"])
def test_places_colours_and_fruits_come_back(tmp_path: Path, cloud: FruitCloud, name: str) -> None:
    write_las(tmp_path / name, cloud)
    back = read_las(tmp_path / name)
    np.testing.assert_allclose(back.points_in_world, cloud.points_in_world, atol=0.000051)
    np.testing.assert_array_equal(back.rgb, cloud.rgb)
    np.testing.assert_array_equal(back.fruit_id, cloud.fruit_id)
    assert [p.name for p in tmp_path.iterdir()] == [name]


def crs_of(path: Path) -> CRS | None:
    """The CRS that another program finds in the file."""
    with laspy.open(path) as reader:
        return reader.header.parse_crs()


def test_other_programs_find_the_extra_dimension(tmp_path: Path, cloud: FruitCloud) -> None:
    write_las(tmp_path / "cloud.laz", cloud)
    las = laspy.read(tmp_path / "cloud.laz")
    assert "fruit_id" in las.point_format.extra_dimension_names
    assert int(las.red.max()) > 60_000
    assert las.header.creation_date is None  # so that tomorrow's file is the same
    assert crs_of(tmp_path / "cloud.laz") is None


@pytest.mark.parametrize("crs", ["EPSG:25831", "+proj=tmerc +lat_0=41.6 +lon_0=0.6 +datum=WGS84 +units=m +type=crs"])
def test_the_crs_of_the_frame_is_kept(tmp_path: Path, cloud: FruitCloud, crs: str) -> None:
    write_las(tmp_path / "cloud.laz", cloud, frame=WorldFrame("gnss", False, True, crs, (41.6, 0.6, 100.0)))
    found = crs_of(tmp_path / "cloud.laz")
    assert found is not None
    assert found.is_projected
    assert found == CRS.from_user_input(crs)


def test_the_header_is_what_las_1_4_asks_for(tmp_path: Path, cloud: FruitCloud) -> None:
    """Readers of LAS know no WKT of the second version, and take no point whose return is the zeroth."""
    frame = WorldFrame("gnss", False, True, local_crs(41.6, 0.6), (41.6, 0.6, 100.0))
    for name, given in (("local.las", None), ("on_earth.laz", frame)):
        write_las(tmp_path / name, cloud, frame=given)
        las = laspy.read(tmp_path / name)
        assert las.header.global_encoding.wkt  # which points of formats 6 and later need
        for returns in (las.return_number, las.number_of_returns):
            assert np.unique(np.asarray(returns)).tolist() == [1]
        assert list(las.header.number_of_points_by_return[:2]) == [200, 0]
    (record,) = las.header.vlrs.get("WktCoordinateSystemVlr")
    assert record.string.startswith('PROJCS["')
    for word in ("PROJCRS", "BASEGEOGCRS", "CONVERSION", "LENGTHUNIT"):
        assert word not in record.string
    assert '"central_meridian",0.6]' in record.string


@pytest.mark.parametrize("name", ["cloud.laz", "cloud.las"])
def test_on_earth_z_is_the_altitude_as_in_the_geopackage(tmp_path: Path, name: str) -> None:
    centers = np.array([[1.0, 2.0, 1.5], [-3.0, 0.5, -0.25]])
    cloud = FruitCloud(centers, np.full((2, 3), 90), np.array([1, 2]))
    fruits = Fruits(np.array([1, 2]), centers, np.full(2, 0.07), np.ones(2), np.array([3, 3]))
    frame = WorldFrame("gnss", False, True, local_crs(41.6, 0.6), (41.6, 0.6, 212.4))
    write_las(tmp_path / name, cloud, frame=frame, with_altitudes=True)
    las = laspy.read(tmp_path / name)
    np.testing.assert_allclose(las.z, [213.9, 212.15], atol=0.00006)
    write_gpkg(tmp_path / "fruits.gpkg", fruits, frame)
    with closing(sqlite3.connect(tmp_path / "fruits.gpkg")) as database:
        on_map = [struct.unpack("<3d", blob[-24:]) for (blob,) in database.execute("SELECT geom FROM fruits")]
    degrees = Transformer.from_crs(crs_of(tmp_path / name), "EPSG:4326", always_xy=True).transform(las.x, las.y)
    np.testing.assert_allclose(np.column_stack([*degrees, las.z]), on_map, atol=0.00006)
    np.testing.assert_allclose(read_las(tmp_path / name).points_in_world, centers, atol=0.000051)  # the survey's own


@pytest.mark.parametrize("frame", [None, WorldFrame("markers", False, True), WorldFrame("given", False, True,
                                   "EPSG:25831")])  # fmt: skip
def test_without_an_origin_on_earth_z_is_the_survey_s(tmp_path: Path, cloud: FruitCloud, frame: WorldFrame) -> None:
    write_las(tmp_path / "cloud.laz", cloud, frame=frame, with_altitudes=True)
    np.testing.assert_allclose(laspy.read(tmp_path / "cloud.laz").z, cloud.points_in_world[:, 2], atol=0.000051)


def test_a_survey_s_own_cloud_lies_on_its_fruits(tmp_path: Path, cloud: FruitCloud) -> None:
    frame = WorldFrame("gnss", False, True, local_crs(41.6, 0.6), (41.6, 0.6, 212.4))
    write_las(tmp_path / "cloud.laz", cloud, frame=frame)
    np.testing.assert_allclose(laspy.read(tmp_path / "cloud.laz").z, cloud.points_in_world[:, 2], atol=0.000051)


@pytest.mark.parametrize("record", [b"", struct.pack("<d", math.nan), struct.pack("<d", math.inf) + b"\0"])
def test_a_damaged_altitude_is_said(tmp_path: Path, cloud: FruitCloud, record: bytes) -> None:
    write_las(tmp_path / "cloud.las", cloud)
    las = laspy.read(tmp_path / "cloud.las")
    las.header.vlrs.append(laspy.VLR("pomona", 1, "", record))
    las.write(tmp_path / "cloud.las")
    with pytest.raises(FormatError, match=r"cloud.las: expected an altitude in its record of Pomona"):
        read_las(tmp_path / "cloud.las")


def test_a_crs_that_the_first_version_of_wkt_has_no_words_for_is_kept(tmp_path: Path, cloud: FruitCloud) -> None:
    write_las(tmp_path / "cloud.las", cloud, frame=WorldFrame("given", False, True, "EPSG:4979"))
    assert crs_of(tmp_path / "cloud.las") == CRS.from_epsg(4979)


def test_an_empty_cloud_is_a_valid_file(tmp_path: Path) -> None:
    write_las(tmp_path / "cloud.laz", FruitCloud(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0)))
    assert len(read_las(tmp_path / "cloud.laz")) == 0


def test_a_disk_that_does_not_answer_says_nothing_of_the_file(
    tmp_path: Path, cloud: FruitCloud, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*given: object, **options: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    write_las(tmp_path / "cloud.laz", cloud)
    monkeypatch.setattr(laspy, "read", broken)
    with pytest.raises(LostFileError, match=r"cloud.laz cannot be reached .*: when its disk answers again, the same"):
        read_las(tmp_path / "cloud.laz")


def test_bad_input_is_named(tmp_path: Path, cloud: FruitCloud) -> None:
    with pytest.raises(MissingFileError, match="no such file"):
        read_las(tmp_path / "none.laz")
    (tmp_path / "text.laz").write_text("not a cloud")
    with pytest.raises(FormatError, match=r"text\.laz"):
        read_las(tmp_path / "text.laz")
    write_las(tmp_path / "whole.laz", cloud)
    (tmp_path / "cut.laz").write_bytes((tmp_path / "whole.laz").read_bytes()[:900])
    with pytest.raises(FormatError, match=r"cut\.laz"):
        read_las(tmp_path / "cut.laz")
    broken = FruitCloud(np.full((1, 3), np.nan), np.zeros((1, 3), np.uint8), np.zeros(1))
    with pytest.raises(InputError, match="finite"):
        write_las(tmp_path / "nan.laz", broken)
    with pytest.raises(InputError, match="CRS"):
        write_las(tmp_path / "crs.laz", cloud, frame=WorldFrame(crs="nowhere"))
