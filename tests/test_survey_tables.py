"""fruits.csv, observations.csv, fruits.geojson and PLY: what is written is what is read."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from pomona.errors import FormatError, MissingFileError
from pomona.formats.geojson import write_geojson
from pomona.formats.ply import write_ply
from pomona.formats.tables import (
    FRUIT_COLUMNS,
    read_fruits,
    read_observations,
    write_fruits,
    write_observations,
)
from pomona.values.cameras import WorldFrame
from pomona.values.fruits import FruitCloud, Fruits, Observations

FRUITS = Fruits(
    ids=[4, 9],
    centers_in_world=[[1.23456, -2, 0.5], [0, 0, 0]],
    diameters_m=[0.0751, np.nan],
    scores=[0.912, np.nan],
    views=[12, 1],
    diameter_sds_m=[0.002, np.nan],
    visibilities=[0.5, np.nan],
    weights_g=[190.04, np.nan],
    tree_ids=[2, 0],
    sides=("both", "east"),
    reasons=("", "seen once, no size"),
    rough_diameters_m=[np.nan, 0.0712],
    rough_diameter_sds_m=[np.nan, 0.0061],
)


def test_fruits_come_back(tmp_path: Path) -> None:
    write_fruits(tmp_path / "fruits.csv", FRUITS)
    back = read_fruits(tmp_path / "fruits.csv")
    np.testing.assert_allclose(back.centers_in_world, FRUITS.centers_in_world, atol=5.1e-5)
    for name in ("ids", "views", "tree_ids", "diameters_m", "diameter_sds_m", "visibilities", "scores"):
        np.testing.assert_array_equal(getattr(back, name), getattr(FRUITS, name))
    np.testing.assert_array_equal(back.rough_diameters_m, FRUITS.rough_diameters_m)
    np.testing.assert_array_equal(back.rough_diameter_sds_m, FRUITS.rough_diameter_sds_m)
    np.testing.assert_allclose(back.weights_g, [190.0, np.nan])
    assert back.sides == FRUITS.sides
    assert back.reasons == FRUITS.reasons


def test_what_was_not_measured_is_an_empty_cell(tmp_path: Path) -> None:
    write_fruits(tmp_path / "fruits.csv", FRUITS)
    with (tmp_path / "fruits.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == FRUIT_COLUMNS
    empty = {name for name, cell in rows[1].items() if cell == ""}
    assert empty == {
        "diameter_m",
        "diameter_sd_m",
        "height_m",
        "visibility",
        "weight_g",
        "weight_sd_g",
        "score",
        "tree_id",
        "other_tree_id",
        "stands_for",
    }
    assert rows[1]["reason"] == "seen once, no size"
    assert rows[1]["x_m"] == "0.0"


def test_no_fruits_are_a_valid_table(tmp_path: Path) -> None:
    write_fruits(tmp_path / "f.csv", Fruits.empty())
    write_observations(tmp_path / "o.csv", Observations.empty())
    assert (tmp_path / "f.csv").read_text().startswith("id,x_m,y_m,z_m,diameter_m,diameter_sd_m,visibility")
    assert len(read_fruits(tmp_path / "f.csv")) == 0
    assert len(read_observations(tmp_path / "o.csv")) == 0


def test_observations_come_back(tmp_path: Path) -> None:
    observations = Observations([4, 4, 9], ("east/a, b.jpg", 'c"d.jpg', "e"), [1, 2, 3], [[1.5, 2], [3, 4], [5, 6.25]])
    write_observations(tmp_path / "o.csv", observations)
    back = read_observations(tmp_path / "o.csv")
    assert back.photo == observations.photo
    np.testing.assert_array_equal(back.xy_px, observations.xy_px)
    np.testing.assert_array_equal(back.detection_id, [1, 2, 3])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("id,x_m\n1,2\n", "expected columns id, x_m, y_m, z_m in the first line, found id, x_m"),
        ("", "found nothing"),
        ("id,x_m,y_m,z_m\n1,2,3,4\n2,2,three,4\n", "line 3, column y_m: expected a number, found 'three'"),
        ("id,x_m,y_m,z_m\n1.5,2,3,4\n", "line 2, column id: expected a whole number, found '1.5'"),
    ],
)
def test_tables_that_are_none(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "f.csv").write_text(text)
    with pytest.raises(FormatError, match=message):
        read_fruits(tmp_path / "f.csv")


def test_a_table_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="no such file"):
        read_fruits(tmp_path / "f.csv")


def test_geojson_without_a_place_on_earth_says_so(tmp_path: Path) -> None:
    write_geojson(tmp_path / "f.geojson", FRUITS, WorldFrame("markers", approximate=False))
    content = json.loads((tmp_path / "f.geojson").read_text())
    assert content["type"] == "FeatureCollection"
    assert CRS(content["crs"]["properties"]["name"]).is_engineering
    assert "metres" in content["note"]
    first, second = content["features"]
    assert first["geometry"] == {"type": "Point", "coordinates": [1.2346, -2.0, 0.5]}
    assert first["properties"]["diameter_m"] == 0.0751
    assert second["properties"]["diameter_m"] is None
    write_geojson(tmp_path / "f.geojson", FRUITS, WorldFrame())
    content = json.loads((tmp_path / "f.geojson").read_text())
    assert "no unit" in content["note"]
    crs = CRS(content["crs"]["properties"]["name"])
    assert (crs.is_engineering, crs.axis_info[0].unit_name) == (True, "unknown")


def test_geojson_with_a_place_on_earth(tmp_path: Path) -> None:
    crs = "+proj=tmerc +lat_0=41.5 +lon_0=0.9 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs +type=crs"
    frame = WorldFrame("gnss", False, True, crs, (41.5, 0.9, 200.0))
    fruits = Fruits([1], [[100.0, 50.0, 1.5]], [0.07], [1], [2])
    write_geojson(tmp_path / "f.geojson", fruits, frame)
    content = json.loads((tmp_path / "f.geojson").read_text())
    longitude, latitude, altitude = content["features"][0]["geometry"]["coordinates"]
    # One degree: 111.07 km of latitude at 41.5°, and 83.5 km of longitude.
    assert longitude == pytest.approx(0.9 + 100 / 83_500, abs=2e-6)
    assert latitude == pytest.approx(41.5 + 50 / 111_070, abs=2e-6)
    assert altitude == 201.5
    assert "note" not in content


def test_geojson_of_no_fruits(tmp_path: Path) -> None:
    write_geojson(tmp_path / "f.geojson", Fruits.empty(), WorldFrame())
    assert json.loads((tmp_path / "f.geojson").read_text())["features"] == []


def test_ply_holds_the_cloud(tmp_path: Path) -> None:
    write_ply(tmp_path / "c.ply", FruitCloud([[1, 2, 3.5], [4, 5, 6]], [[1, 2, 3], [4, 5, 255]], [0, 7]))
    head, _, body = (tmp_path / "c.ply").read_bytes().partition(b"end_header\n")
    assert b"element vertex 2\n" in head
    kinds = [("xyz", "<f8", 3), ("rgb", "u1", 3), ("fruit_id", "<i4")]
    points = np.frombuffer(body, kinds)
    assert points["xyz"].tolist() == [[1, 2, 3.5], [4, 5, 6]]
    assert points["rgb"].tolist() == [[1, 2, 3], [4, 5, 255]]
    assert points["fruit_id"].tolist() == [0, 7]
