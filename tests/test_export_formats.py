"""What is written for other programs: read back by our readers, and by those programs' own formulas and standards."""

from __future__ import annotations

import json
import sqlite3
import struct
import sys
from contextlib import closing
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from unittest.mock import MagicMock
from xml.etree import ElementTree

import numpy as np
import pytest
from pyproj.exceptions import ProjError

from camera_scenes import enu_axes, geocentric, make_scene
from pomona.errors import InputError, MissingExtraError
from pomona.formats.cameras.colmap import write_colmap
from pomona.formats.cameras.lenses import Lens, fit_lens
from pomona.formats.cameras.metashape_export import write_metashape
from pomona.formats.cameras.nerfstudio_export import write_nerfstudio
from pomona.formats.cameras.onto_photos import as_stored
from pomona.formats.cameras.read import read_cameras
from pomona.formats.geojson import write_geojson
from pomona.formats.geoparquet import write_geoparquet
from pomona.formats.gpkg import write_gpkg
from pomona.formats.kml import write_kml
from pomona.formats.tables import FRUIT_COLUMNS, fruit_rows
from pomona.progress import Silent
from pomona.values.cameras import Cameras, WorldFrame, local_crs
from pomona.values.crop import RowSegments
from pomona.values.fruits import FruitCloud, Fruits
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos
from pomona.values.trees import Trees

METRES = WorldFrame("markers", approximate=False, up_is_known=True)
LLEIDA = (41.6215, 0.5954, 187.3)
ON_EARTH = WorldFrame("gnss", approximate=False, up_is_known=True, crs=local_crs(*LLEIDA[:2]), origin=LLEIDA)
LENSES = (
    Intrinsics("OPENCV", 1600, 1200, np.array([1400, 1410, 790, 610, -0.1, 0.05, 0.001, -0.002])),
    Intrinsics("SIMPLE_RADIAL", 1600, 1200, np.array([1500, 800, 600, 0.03])),
    # What a fisheye becomes: a ratio of two polynomials.
    Intrinsics("FULL_OPENCV", 1600, 1200, np.array([1500, 1500, 800, 600, 0.3, 0.02, 0, 0, 0.001, 0.45, 0.05, 0.001])),
)


def _cameras(frame: WorldFrame) -> Cameras:
    scene = make_scene(21, cameras=6)
    poses = [np.column_stack([r, -r @ c]) for r, c in zip(scene.rotations, scene.centers, strict=True)]
    names = tuple(f"{'east' if i < 3 else 'west'}/IMG_{i:04}.JPG" for i in range(6))
    rgb = scene.rgb.astype(np.uint8)
    cameras = Cameras(names, LENSES, np.array([0, 1, 2, 0, 1, 2]), np.array(poses), scene.points, rgb,
                      np.full(len(scene.points), 0.5), frame=frame)  # fmt: skip
    cameras = replace(cameras, intrinsics=(*LENSES, LENSES[0].turned(1)), intrinsics_idx=np.array([3, 1, 2, 0, 1, 2]))
    rolled = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    return replace(cameras, cam_from_world=np.concatenate([rolled @ poses[:1], poses[1:]]))


def _photos(folder: Path, cameras: Cameras) -> Photos:
    """The first photo was taken with the camera held upright: stored as wide as all, and turned by its EXIF."""
    return Photos(
        tuple(
            Photo(name, folder / name, *((1200, 1600) if i == 0 else (1600, 1200)), orientation=6 if i == 0 else 1)
            for i, name in enumerate(cameras.photos)
        )
    )


def _same(read: Cameras, cameras: Cameras, points: np.ndarray) -> None:
    assert read.photos == cameras.photos
    for i in range(len(cameras)):
        expected = cameras.project(i, cameras.points_in_world)[0]
        lens = cameras.intrinsics_of(i)
        inside = ((expected > 0) & (expected < [lens.width_px, lens.height_px])).all(1)
        assert inside.any()
        np.testing.assert_allclose(read.project(i, points)[0][inside], expected[inside], atol=0.01)


@pytest.mark.parametrize("frame", [METRES, ON_EARTH])
def test_nerfstudio_comes_back(tmp_path: Path, frame: WorldFrame) -> None:
    cameras = _cameras(frame)
    photos = _photos(tmp_path / "photos", cameras)
    write_nerfstudio(tmp_path / "out", cameras, photos)
    read = read_cameras(tmp_path / "out", photos).cameras
    assert read.frame == frame
    np.testing.assert_allclose(read.points_in_world, cameras.points_in_world)
    np.testing.assert_array_equal(read.points_rgb, cameras.points_rgb)
    _same(read, cameras, cameras.points_in_world)


def test_nerfstudio_by_its_own_formula(tmp_path: Path) -> None:
    cameras = _cameras(METRES)
    photo = tmp_path / "photos" / cameras.photos[3]
    photo.parent.mkdir(parents=True)
    photo.touch()
    write_nerfstudio(tmp_path / "out", cameras, _photos(tmp_path / "photos", cameras))
    content = json.loads((tmp_path / "out" / "transforms.json").read_text())
    frame = content["frames"][3]
    assert frame["file_path"] == f"../photos/{cameras.photos[3]}"
    assert content["frames"][0]["file_path"] == f"images/{cameras.photos[0]}"  # there is no such file
    matrix = np.array(frame["transform_matrix"])
    inside = (cameras.points_in_world - matrix[:3, 3]) @ matrix[:3, :3]
    x, y = inside[:, 0] / -inside[:, 2], -inside[:, 1] / -inside[:, 2]  # OpenGL: y up, looking along -z
    r2 = x**2 + y**2
    d = 1 + sum(frame[f"k{n}"] * r2**n for n in (1, 2, 3, 4))
    u = x * d + 2 * frame["p1"] * x * y + frame["p2"] * (r2 + 2 * x**2)
    v = y * d + 2 * frame["p2"] * x * y + frame["p1"] * (r2 + 2 * y**2)
    px = np.stack([frame["fl_x"] * u + frame["cx"], frame["fl_y"] * v + frame["cy"]], 1)
    np.testing.assert_allclose(px, cameras.project(3, cameras.points_in_world)[0], atol=1e-6)


@pytest.mark.parametrize(("focal_px", "taken"), [(1500, True), (1200, False)])
def test_splatfacto_takes_lenses_that_three_coefficients_are_near_to(
    tmp_path: Path, focal_px: float, taken: bool
) -> None:
    fisheye = Lens(width_px=1600, height_px=1200, fx=focal_px, fy=focal_px, cx=800, cy=600, curve="equidistant")
    lens = fit_lens(fisheye, "a fisheye").intrinsics
    cameras = replace(_cameras(METRES), intrinsics=(lens,), intrinsics_idx=np.zeros(6, int))
    photos = Photos(tuple(Photo(name, tmp_path / name, 1600, 1200) for name in cameras.photos))
    progress = Silent()
    write_nerfstudio(tmp_path / "out", cameras, photos, progress)
    content = json.loads((tmp_path / "out" / "transforms.json").read_text())
    assert (content["k4"] == 0) == taken  # where it is not, nerfstudio's `_undistort_image` ends with an assertion
    assert ["splatfacto does not take" in said for said in progress.warnings] == [True] * (not taken)
    grid = np.stack(np.meshgrid(np.linspace(0, 1600, 41), np.linspace(0, 1200, 31)), -1).reshape(-1, 2)
    off_px = read_cameras(tmp_path / "out", photos).cameras.intrinsics[0].px_from_cam(lens.cam_from_px(grid)) - grid
    assert np.sqrt((off_px**2).sum(1).mean()) < 0.1


def test_metashape_comes_back(tmp_path: Path) -> None:
    cameras = _cameras(METRES)
    photos = _photos(tmp_path, cameras)
    write_metashape(tmp_path / "cameras.xml", cameras, photos)
    read = read_cameras(tmp_path / "cameras.xml", photos)
    assert (read.cameras.frame.scale_source, read.cameras.frame.approximate) == ("given", False)
    _same(read.cameras, cameras, cameras.points_in_world)


def test_metashape_comes_back_to_its_place_on_earth(tmp_path: Path) -> None:
    cameras = _cameras(ON_EARTH)
    photos = _photos(tmp_path, cameras)
    write_metashape(tmp_path / "cameras.xml", cameras, photos)
    read = read_cameras(tmp_path / "cameras.xml", photos).cameras
    assert read.frame.origin is not None
    on_earth = geocentric(*LLEIDA) + cameras.points_in_world @ enu_axes(*LLEIDA[:2])
    points = (on_earth - geocentric(*read.frame.origin)) @ enu_axes(*read.frame.origin[:2]).T
    _same(read, cameras, points)


def test_metashape_by_its_own_formula(tmp_path: Path) -> None:
    cameras = _cameras(METRES)
    write_metashape(tmp_path / "cameras.xml", cameras, _photos(tmp_path, cameras))
    chunk = ElementTree.parse(tmp_path / "cameras.xml").getroot()[0]
    camera = chunk.findall("cameras/camera")[3]
    assert camera.get("label") == "IMG_0003"
    values = {child.tag: child.text or "" for child in chunk.findall("sensors/sensor/calibration")[0]}
    k = {name: float(text) for name, text in values.items() if name != "resolution"}
    matrix = np.array((camera.findtext("transform") or "").split(), float).reshape(4, 4)
    x, y, z = ((cameras.points_in_world - matrix[:3, 3]) @ matrix[:3, :3]).T
    x, y = x / z, y / z
    r2 = x**2 + y**2
    d = 1 + k["k1"] * r2 + k["k2"] * r2**2 + k["k3"] * r2**3 + k["k4"] * r2**4
    u = x * d + k["p1"] * (r2 + 2 * x**2) + 2 * k["p2"] * x * y
    v = y * d + k["p2"] * (r2 + 2 * y**2) + 2 * k["p1"] * x * y
    px = np.stack([800 + k["cx"] + u * k["f"] + u * k["b1"], 600 + k["cy"] + v * k["f"]], 1)
    np.testing.assert_allclose(px, cameras.project(3, cameras.points_in_world)[0], atol=1e-6)


def test_metashape_labels_of_photos_of_one_name(tmp_path: Path) -> None:
    cameras = replace(
        _cameras(METRES), photos=tuple(f"{side}/IMG_{i}.JPG" for side in ("east", "west") for i in range(3))
    )
    photos = _photos(tmp_path, cameras)
    write_metashape(tmp_path / "cameras.xml", cameras, photos)
    labels = [c.get("label") for c in ElementTree.parse(tmp_path / "cameras.xml").getroot().iter("camera")]
    assert labels == [f"{side}/IMG_{i}" for side in ("east", "west") for i in range(3)]
    _same(read_cameras(tmp_path / "cameras.xml", photos).cameras, cameras, cameras.points_in_world)


def test_colmap_comes_back(tmp_path: Path) -> None:
    cameras = _cameras(METRES)
    photos = _photos(tmp_path / "photos", cameras)
    write_colmap(tmp_path / "upright", cameras, photos)
    _same(read_cameras(tmp_path / "upright", photos).cameras, cameras, cameras.points_in_world)
    write_colmap(tmp_path / "stored", as_stored(cameras, photos), photos, upright=False)
    assert "1200 1600" not in (tmp_path / "stored" / "cameras.txt").read_text()
    read = read_cameras(tmp_path / "stored", photos).cameras
    assert read.frame == METRES
    _same(read, cameras, cameras.points_in_world)


def _fruits() -> Fruits:
    centers = np.array([[1.0, 2.0, 3.0], [-4.0, 5.5, 1.25], [np.nan] * 3])
    return Fruits(
        ids=np.array([1, 2, 7]),
        centers_in_world=centers,
        diameters_m=np.array([0.07, np.nan, np.nan]),
        scores=np.array([0.9, 0.8, 0.1]),
        views=np.array([4, 3, 1]),
        reasons=("", "hidden", "nowhere"),
        sides=("east", "both", ""),
    )


@pytest.mark.parametrize("frame", [METRES, ON_EARTH])
def test_geopackage(tmp_path: Path, frame: WorldFrame) -> None:
    write_gpkg(tmp_path / "fruits.gpkg", _fruits(), frame)
    write_gpkg(tmp_path / "fruits.gpkg", _fruits(), frame)  # replaces
    write_geojson(tmp_path / "fruits.geojson", _fruits(), frame)
    features = json.loads((tmp_path / "fruits.geojson").read_text())["features"]
    database = sqlite3.connect(tmp_path / "fruits.gpkg")
    assert database.execute("PRAGMA application_id").fetchone() == (0x47504B47,)
    assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    srs_id = 4326 if frame.crs else -1
    assert database.execute("SELECT table_name, srs_id FROM gpkg_contents").fetchall() == [
        ("layer_styles", None),
        ("fruits", srs_id),
    ]
    assert {-1, 0, 4326} == {row[0] for row in database.execute("SELECT srs_id FROM gpkg_spatial_ref_sys")}
    rows = database.execute(f"SELECT geom, {', '.join(FRUIT_COLUMNS)} FROM fruits ORDER BY fid").fetchall()
    for (blob, *values), feature, row in zip(rows, features, fruit_rows(_fruits()), strict=True):
        assert values == list(row.values())
        if feature["geometry"] is None:
            assert blob is None
            continue
        assert struct.unpack("<2sBBiBI", blob[:13]) == (b"GP", 0, 1, srs_id, 1, 1001)
        np.testing.assert_allclose(struct.unpack("<3d", blob[13:]), feature["geometry"]["coordinates"], atol=1e-9)
    database.close()


def _trees_and_segments() -> tuple[Trees, RowSegments]:
    known, nothing = np.array([30.0, 40.5]), np.full(2, np.nan)
    trees = Trees(np.array([1, 2]), np.array([[0.0, 0], [1.5, 0]]), np.array([28, 37]), np.array([26, 36]),
                  np.array([30, 38]), nothing, nothing, nothing, nothing, known, known - 2, known + 5)  # fmt: skip
    ends = np.array([[1.0, 0], [1.5, 0]])
    segments = RowSegments(ends - [[1, 0], [0.5, 0]], ends, np.array([40, 25]), known, known - 1, known + 1, nothing)
    return trees, segments


@pytest.mark.parametrize("frame", [METRES, ON_EARTH])
def test_geopackage_with_trees_and_row_in_another_reader(tmp_path: Path, frame: WorldFrame) -> None:
    geopandas = pytest.importorskip("geopandas", reason="GeoPandas is not installed")
    pyogrio = pytest.importorskip("pyogrio", reason="GDAL's reader is not installed")
    trees, segments = _trees_and_segments()
    path = tmp_path / "fruits.gpkg"
    write_gpkg(path, _fruits(), frame, trees, segments)
    layers = dict(pyogrio.list_layers(path).tolist())
    assert layers == {"layer_styles": None, "fruits": "Point Z", "trees": "Point", "segments": "LineString"}
    read = geopandas.read_file(path, layer="trees")
    assert read["id"].tolist() == [1, 2]
    assert read["fruits"].tolist() == [28, 37]
    assert read["all_high"].tolist() == [35.0, 45.5]
    assert read["weight_kg"].isna().all()
    lines = geopandas.read_file(path, layer="segments")
    assert lines["all_fruits"].tolist() == [30.0, 40.5]
    assert (read.crs is not None and read.crs.to_epsg() == 4326) == (frame.crs is not None)
    in_metres = lines.to_crs(frame.crs) if frame.crs else lines
    assert in_metres.length.tolist() == pytest.approx([1.0, 0.5], abs=1e-3)
    styles = pyogrio.read_dataframe(path, layer="layer_styles")
    assert styles["f_table_name"].tolist() == ["fruits", "trees", "segments"]
    assert styles["useAsDefault"].astype(bool).all()
    # QGIS draws no feature whose cell is empty: fruits without a diameter have a number and a class of their own.
    of_fruits = ElementTree.fromstring(styles["styleQML"][0]).find("renderer-v2")
    assert of_fruits is not None
    assert of_fruits.get("attr") == 'coalesce("diameter_m", -999999)'
    classes = [(float(r.get("lower", "")), float(r.get("upper", ""))) for r in of_fruits.findall("ranges/range")]
    assert classes == [(0.07, 0.07)] * 5 + [(-999999, -999999)]
    assert len(of_fruits.findall("symbols/symbol")) == 6
    for style, column in zip(styles["styleQML"][1:], ("fruits", "all_fruits"), strict=True):
        renderer = ElementTree.fromstring(style).find("renderer-v2")
        assert renderer is not None
        assert renderer.get("attr") == column
        ranges = [(float(r.get("lower", "")), float(r.get("upper", ""))) for r in renderer.findall("ranges/range")]
        assert len(ranges) == len(renderer.findall("symbols/symbol")) == 5
        assert all(one[1] == other[0] for one, other in pairwise(ranges))
    first, last = ranges[0][0], ranges[-1][1]
    assert (first, last) == (30.0, 40.5)


def test_every_fruit_with_a_place_is_in_a_class_of_the_style(tmp_path: Path) -> None:
    """By QGIS's own rule (`QgsGraduatedSymbolRenderer`): the first range that holds the value; of none, nothing."""
    rng = np.random.default_rng(0)
    diameters = np.where(rng.random(60) < 0.3, np.nan, rng.normal(0.07, 0.01, 60).round(4))
    centers = rng.normal(0, 2, (60, 3))
    fruits = Fruits(np.arange(1, 61), centers, diameters, np.ones(60), np.full(60, 3))
    drawn = {}
    for name, some in (("some", fruits), ("none", replace(fruits, diameters_m=np.full(60, np.nan)))):
        write_gpkg(tmp_path / f"{name}.gpkg", some, METRES)
        with closing(sqlite3.connect(tmp_path / f"{name}.gpkg")) as database:
            (style,) = database.execute("SELECT styleQML FROM layer_styles").fetchone()
            renderer = ElementTree.fromstring(style).find("renderer-v2")
            assert renderer is not None
            values = [value for (value,) in database.execute(f"SELECT {renderer.get('attr')} FROM fruits ORDER BY fid")]
        ranges = renderer.findall("ranges/range")
        drawn[name] = [
            next(
                (r.get("label") for r in ranges if float(r.get("lower", "")) <= value <= float(r.get("upper", ""))),
                None,
            )
            for value in values
            if value is not None
        ]
    assert [label == "not known" for label in drawn["some"]] == np.isnan(diameters).tolist()
    assert None not in drawn["some"]
    assert drawn["none"] == ["not known"] * 60


@pytest.mark.parametrize("kind", ["geojson", "kml", "parquet"])
def test_trees_and_row_are_in_every_map(tmp_path: Path, kind: str) -> None:
    """GDAL reads GeoJSON and KML, pyarrow and GeoPandas' reader GeoParquet; all places and statistics are alike."""
    geopandas = pytest.importorskip("geopandas", reason="GeoPandas is not installed")
    trees, segments = _trees_and_segments()
    fruits = replace(_fruits(), visibilities=np.array([1.0, 0.758, 0.3]))
    path = tmp_path / f"row.{kind}"
    if kind == "geojson":
        write_geojson(path, fruits, ON_EARTH, trees, segments)
        ids = [feature.get("id") for feature in json.loads(path.read_text())["features"]]
        assert ids == [1, 2, 7, None, None, None, None]
    elif kind == "kml":
        write_kml(path, fruits, ON_EARTH, trees, segments)
    else:
        pytest.importorskip("pyarrow", reason="the extra 'geoparquet' is not installed")
        write_geoparquet(path, fruits, ON_EARTH, trees, segments)
    if kind == "kml":
        layers = {name: geopandas.read_file(path, layer=name) for name in ("fruits", "trees", "segments")}
    else:
        read = geopandas.read_parquet(path) if kind == "parquet" else geopandas.read_file(path)
        assert read["layer"].tolist() == ["fruits"] * 3 + ["trees"] * 2 + ["segments"] * 2
        layers = {str(name): rows for name, rows in read.groupby("layer")}
    of_trees, of_row = layers["trees"], layers["segments"]
    assert of_trees.crs.to_epsg() == of_row.crs.to_epsg() == 4326
    assert of_trees.geometry.geom_type.tolist() == ["Point"] * 2
    assert of_row.geometry.geom_type.tolist() == ["LineString"] * 2
    shares = layers["fruits"]["visible_share" if kind == "kml" else "visibility"].astype(float)
    np.testing.assert_allclose(shares, fruits.visibilities, atol=1e-3)
    assert of_trees["fruits"].astype(float).tolist() == [28, 37]
    assert of_row["all_fruits"].astype(float).tolist() == [30.0, 40.5]
    assert of_row.to_crs(ON_EARTH.crs).length.tolist() == pytest.approx([1.0, 0.5], abs=1e-3)


@pytest.mark.parametrize(("frame", "unit"), [(METRES, "metre"), (WorldFrame(), "unknown")])
def test_gdal_takes_no_metres_of_a_survey_without_a_place_for_degrees(
    tmp_path: Path, frame: WorldFrame, unit: str
) -> None:
    geopandas = pytest.importorskip("geopandas", reason="GeoPandas is not installed")
    trees, segments = _trees_and_segments()
    write_geojson(tmp_path / "row.geojson", _fruits(), frame, trees, segments)
    read = geopandas.read_file(tmp_path / "row.geojson")
    assert read.crs.is_engineering
    assert not read.crs.is_geographic
    assert {axis.unit_name for axis in read.crs.axis_info} == {unit}
    points = read[(read["layer"] == "fruits") & ~read.geometry.is_empty & read.geometry.notna()].geometry
    known = _fruits().centers_in_world[np.isfinite(_fruits().centers_in_world).all(1)]
    np.testing.assert_allclose(points.get_coordinates(include_z=True), known, atol=1e-4)
    assert read[read["layer"] == "segments"].length.tolist() == pytest.approx([1.0, 0.5])
    with pytest.raises(ProjError):
        read.to_crs("EPSG:4326")


@pytest.mark.parametrize("frame", [METRES, ON_EARTH])
def test_geoparquet_by_its_specification(tmp_path: Path, frame: WorldFrame) -> None:
    """Read with pyarrow and the bytes of well-known binary, not with the GeoPandas that wrote it."""
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra 'geoparquet' is not installed")
    write_geoparquet(tmp_path / "fruits.parquet", _fruits(), frame)
    write_geojson(tmp_path / "fruits.geojson", _fruits(), frame)
    features = json.loads((tmp_path / "fruits.geojson").read_text())["features"]
    table = parquet.read_table(tmp_path / "fruits.parquet")
    column = json.loads(table.schema.metadata[b"geo"])["columns"]["geometry"]
    assert column["encoding"] == "WKB"
    assert column["crs"] is None or column["crs"]["id"]["code"] == 4326
    assert (column["crs"] is None) == (frame.crs is None)
    for point, feature in zip(table["geometry"].to_pylist(), features, strict=True):
        if feature["geometry"] is not None:
            places = struct.unpack("<3d", point[5:29])
            np.testing.assert_allclose(places, feature["geometry"]["coordinates"], atol=1e-9)
    assert table["id"].to_pylist() == _fruits().ids.tolist()
    assert table["diameter_m"].null_count + int(np.isnan(table["diameter_m"].to_numpy()).sum()) >= 1


def test_kml(tmp_path: Path) -> None:
    write_kml(tmp_path / "fruits.kml", _fruits(), ON_EARTH)
    namespace = {"k": "http://www.opengis.net/kml/2.2"}
    marks = ElementTree.parse(tmp_path / "fruits.kml").getroot().findall(".//k:Placemark", namespace)
    assert [mark.findtext("k:name", "", namespace) for mark in marks] == ["1", "2", "7"]
    longitude, latitude, altitude = map(float, marks[0].findtext(".//k:coordinates", "", namespace).split(","))
    assert (longitude, latitude) == pytest.approx((LLEIDA[1] + 1.2e-5, LLEIDA[0] + 1.8e-5), abs=2e-6)
    assert altitude == pytest.approx(LLEIDA[2] + 3)
    assert marks[2].find("k:Point", namespace) is None
    data = {d.get("name"): d.findtext("k:value", "", namespace) for d in marks[1].findall(".//k:Data", namespace)}
    assert data["reason"] == "hidden"
    assert "diameter_m" not in data


def test_kml_needs_a_place_on_earth(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="KML needs a place on Earth"):
        write_kml(tmp_path / "fruits.kml", _fruits(), METRES)


def test_rerun(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    from pomona.formats.rerun import write_rerun

    fruits = replace(_fruits(), centers_in_world=np.zeros((3, 3)))
    write_rerun(tmp_path / "survey.rrd", _cameras(METRES), fruits, FruitCloud.empty())
    content = (tmp_path / "survey.rrd").read_bytes()
    assert content[:3] == b"RRF"
    assert len(content) > 2000


def test_fruits_that_are_not_measured_are_as_large_in_rerun_as_they_are_likely_to_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pomona.formats.rerun import write_rerun

    rerun = MagicMock()
    monkeypatch.setitem(sys.modules, "rerun", rerun)
    cherries = Fruits(
        np.arange(1, 6), np.zeros((5, 3)), np.array([0.020, 0.024, 0.025, np.nan, np.nan]), np.ones(5), np.full(5, 3),
        rough_diameters_m=np.array([np.nan, np.nan, np.nan, 0.022, np.nan]),
    )  # fmt: skip
    write_rerun(tmp_path / "survey.rrd", _cameras(METRES), cherries, FruitCloud.empty())
    _, balls = rerun.Points3D.call_args_list
    np.testing.assert_allclose(balls.kwargs["radii"], [0.010, 0.012, 0.0125, 0.011, 0.012])


def test_rerun_missing_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pomona.formats.rerun import write_rerun

    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"pomona\[rerun\]"):
        write_rerun(tmp_path / "survey.rrd", _cameras(METRES), _fruits(), FruitCloud.empty())
