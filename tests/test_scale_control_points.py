"""Markers surveyed in a coordinate system, and ground control points: the world frame has its place on Earth."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod, Transformer

from pomona.errors import FormatError, InputError, MissingFileError
from pomona.pipeline import RunOptions
from pomona.progress import Silent
from pomona.stages.scale import ScaleOptions, place_in_world
from pomona.stages.scale.control_points import read_control_points, surveyed_markers
from pomona.stages.scale.gnss import in_local_metres
from pomona.stages.sfm import Reconstruction
from pomona.values.cameras import Cameras, local_crs
from scale_scenes import PLACES, as_piece, marker_table, photographed, photos_of, show_markers, sighted

EAST, WEST = photographed("east", seed=1), photographed("west", seed=2)
BOTH = Reconstruction((as_piece(EAST, "east", 3), as_piece(WEST, "west", 4)))
LATITUDE, LONGITUDE, ALTITUDE = 41.6203, 0.8701, 212.4
"""Where the row's (0, 0, 0) is: an orchard near Lleida."""


def on_earth(places: Mapping[int, Sequence[float]], crs: str) -> dict[int, tuple[float, float, float]]:
    """The row's places in a coordinate system, easting or longitude first."""
    to_crs = Transformer.from_crs(local_crs(LATITUDE, LONGITUDE), crs, always_xy=True)
    return {i: (*to_crs.transform(x, y), z + ALTITUDE) for i, (x, y, z) in places.items()}


def gcp_lines(crs: str = "EPSG:25831", *, named: bool = True) -> list[str]:
    """A `gcp_list.txt` of all places that photos show."""
    there, lines = on_earth(PLACES, crs), [crs]
    for seen in sighted([EAST, WEST], PLACES):
        x, y, z = there[seen.marker_id]
        column, row = seen.center_px
        name = f" point_{seen.marker_id}" if named else ""
        lines.append(f"{x:.9f} {y:.9f} {z:.4f} {column:.3f} {row:.3f} {seen.photo.split('/')[1]}{name}")
    return lines


def off_m(found: Cameras, *truth: Cameras) -> float:
    """RMS distance of cameras from where they truly are on Earth."""
    frame = found.frame
    assert frame.crs is not None
    assert frame.origin is not None
    to_degrees = Transformer.from_crs(frame.crs, "EPSG:4326", always_xy=True)
    truly = Transformer.from_crs(local_crs(LATITUDE, LONGITUDE), "EPSG:4326", always_xy=True)
    true = {name: c for world in truth for name, c in zip(world.photos, world.centers_in_world, strict=True)}
    squares = []
    for name, (x, y, z) in zip(found.photos, found.centers_in_world, strict=True):
        tx, ty, tz = true[name]
        _, _, away_m = Geod(ellps="WGS84").inv(*to_degrees.transform(x, y), *truly.transform(tx, ty))
        squares.append(away_m**2 + (z + frame.origin[2] - tz - ALTITUDE) ** 2)
    return float(np.sqrt(np.mean(squares)))


@pytest.mark.parametrize("crs", ["EPSG:25831", "EPSG:4326", "EPSG:3857"])
def test_markers_surveyed_in_a_coordinate_system(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, crs: str) -> None:
    show_markers(monkeypatch, sighted([EAST, WEST], PLACES))
    table = marker_table(tmp_path / "markers.csv", on_earth(PLACES, crs))
    options, progress = ScaleOptions(markers=table, markers_crs=crs), Silent()

    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=options, progress=progress)

    assert progress.warnings == []
    frame = placed.cameras.frame
    assert frame.scale_source == "markers"
    assert frame.origin is not None
    assert frame.origin[:2] == (pytest.approx(LATITUDE, abs=1e-4), pytest.approx(LONGITUDE, abs=1e-4))
    assert 0 < off_m(placed.cameras, EAST, WEST) < 0.002
    # Metres of the ground, not of the map: Web Mercator's are a third longer here.
    assert np.ptp(placed.cameras.centers_in_world[:, 0]) == pytest.approx(np.ptp(EAST.centers_in_world[:, 0]), abs=0.2)


@pytest.mark.parametrize("crs", ["EPSG:25831", "EPSG:4326"])
@pytest.mark.parametrize("named", [True, False])
def test_ground_control_points_place_the_row_without_any_plate(tmp_path: Path, named: bool, crs: str) -> None:
    # Both sides call their photos the same: full names tell them apart.
    lines = gcp_lines(crs, named=named)
    full = [f"{seen.photo}" for seen in sighted([EAST, WEST], PLACES)]
    lines = [lines[0], *(" ".join([*line.split()[:5], name, *line.split()[6:]]) for line, name in
                         zip(lines[1:], full, strict=True))]  # fmt: skip
    path = tmp_path / "gcp_list.txt"
    path.write_text("\n".join(lines) + "\n")
    progress = Silent()

    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=ScaleOptions(gcp=path), progress=progress)

    assert progress.warnings == []
    assert placed.report.tied_pieces == 2
    assert placed.report.source == placed.cameras.frame.scale_source == "control-points"
    assert 0 < off_m(placed.cameras, EAST, WEST) < 0.002


@pytest.mark.parametrize("west_sees_points", [False, True])
def test_a_scale_bar_serves_the_side_that_no_control_point_places(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, west_sees_points: bool
) -> None:
    # Points are numbered from 0, as plates are: those of the bar, 0 and 1, are others.
    lines = gcp_lines()
    seen = sighted([EAST, WEST], PLACES)
    mixed_up = {3: 0, 0: 1, 1: 2, 2: 3}  # west, so that its points fit nowhere, and two of them have the bar's ids
    there = on_earth(PLACES, "EPSG:25831")
    kept = []
    for line, sighting in zip(lines[1:], seen, strict=True):
        words, i = line.split(), sighting.marker_id
        if sighting.photo.startswith("west"):
            if not west_sees_points or i not in mixed_up:
                continue
            i = mixed_up[i]
            words[:3] = [f"{value:.9f}" for value in there[i]]
        kept.append(" ".join([*words[:5], sighting.photo, f"point_{i}"]))
    path = tmp_path / "gcp_list.txt"
    in_order = sorted(kept, key=lambda line: line.split()[-1])
    path.write_text("\n".join([lines[0], *in_order]) + "\n")
    show_markers(monkeypatch, sighted([WEST], {0: (0.5, -0.4, 1.0), 1: (1.5, -0.4, 1.0)}))
    options, progress = ScaleOptions(gcp=path, scale_bar=(0, 1, 1.0)), Silent()

    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=options, progress=progress)

    assert [piece.source for piece in placed.report.pieces] == ["control-points", "scale-bar"]
    assert 0 < off_m(placed.cameras.of_photos(EAST.photos), EAST) < 0.006
    west = placed.cameras.of_photos(WEST.photos).centers_in_world
    truly = WEST.centers_in_world
    np.testing.assert_allclose(
        np.linalg.norm(west - west[0], axis=1), np.linalg.norm(truly - truly[0], axis=1), rtol=5e-3, atol=1e-3
    )
    assert placed.report.unseen_markers == ()
    (said,) = [warning for warning in progress.warnings if "nothing says where on Earth" in warning]
    assert f"({WEST.photos[0]} to {WEST.photos[-1]})" in said
    assert EAST.photos[0] not in said
    of_bar = [marker for marker in placed.report.markers if marker.side == "west" and marker.used]
    assert [(marker.marker_id, np.isnan(marker.left_out_mm)) for marker in of_bar] == [(0, True), (1, True)]
    assert 0 < placed.report.left_out_rms_mm < 5


def test_a_point_measured_wrongly_is_told_by_its_name(tmp_path: Path) -> None:
    seen = zip(gcp_lines()[1:], sighted([EAST, WEST], PLACES), strict=True)
    moved = [line.split() for line, sighting in seen if sighting.photo.startswith("east")]
    moved = [[f"{float(x) + 0.4:.3f}", *rest] if rest[-1] == "point_3" else [x, *rest] for x, *rest in moved]
    path = tmp_path / "gcp_list.txt"
    path.write_text("\n".join(["EPSG:25831", *(" ".join(words) for words in moved)]) + "\n")
    progress = Silent()

    place_in_world(
        Reconstruction((as_piece(EAST, "east", 3),)), photos_of(EAST), options=ScaleOptions(gcp=path), progress=progress
    )

    assert any(re.search(r"point point_3 was left out: seen 0\.(3[5-9]|4[0-5])", text) for text in progress.warnings)


@pytest.mark.parametrize(("crs", "digits"), [("EPSG:25831", 2), ("EPSG:4326", 7)])
def test_points_without_a_name_are_told_apart_by_their_places(tmp_path: Path, crs: str, digits: int) -> None:
    there = on_earth({i: (0.5 * i, 0.4 * (-1) ** i, 1.0) for i in range(8)}, crs)
    path = tmp_path / "gcp_list.txt"
    lines = [f"{x:.{digits}f} {y:.{digits}f} {z:.2f} 9 9 {n}.jpg" for x, y, z in there.values() for n in ("a", "b")]
    path.write_text("\n".join([crs, *lines]) + "\n")
    found = read_control_points(path)
    assert len(found.markers) == len(set(found.names.values())) == 8
    away_m = np.linalg.norm(np.diff(found.markers.points_in_world, axis=0), axis=1)
    np.testing.assert_allclose(away_m, np.hypot(0.5, 0.8), atol=0.03)


def test_a_point_with_two_places_is_refused_in_degrees_too(tmp_path: Path) -> None:
    path = tmp_path / "gcp_list.txt"
    for off, refused in ((0.0, False), (1e-9, False), (1e-6, True)):  # nothing, 0.1 mm and 0.1 m
        path.write_text(f"EPSG:4326\n0.87 41.62 200 9 9 a.jpg A\n{0.87 + off:.9f} 41.62 200 9 9 b.jpg A\n")
        if refused:
            with pytest.raises(FormatError, match="line 3: point A has another place"):
                read_control_points(path)
        else:
            assert len(read_control_points(path).markers) == 1


def test_points_that_fit_nowhere_are_told_by_their_names(tmp_path: Path) -> None:
    swapped = {"point_0": "point_1", "point_1": "point_2", "point_2": "point_3", "point_3": "point_0"}
    there, lines = on_earth(PLACES, "EPSG:25831"), ["EPSG:25831"]
    for seen in sighted([EAST], PLACES):
        if (name := swapped.get(f"point_{seen.marker_id}")) is not None:
            x, y, z = there[int(name[-1])]
            lines.append(f"{x:.3f} {y:.3f} {z:.3f} {seen.center_px[0]:.2f} {seen.center_px[1]:.2f} {seen.photo} {name}")
    path, progress = tmp_path / "gcp_list.txt", Silent()
    path.write_text("\n".join(lines) + "\n")
    one = Reconstruction((as_piece(EAST, "east", 3),))
    place_in_world(one, photos_of(EAST), options=ScaleOptions(gcp=path), progress=progress)
    (said,) = [text for text in progress.warnings if "has no place from the control points" in text]
    assert re.search(r"points: point point_\d, point point_\d, .* are seen where the table does not have them", said)


@pytest.mark.parametrize(
    "header",
    [
        "WGS84 UTM 31N",
        "wgs84 utm 31n",
        "epsg:32631",
        "+proj=utm +zone=31 +ellps=WGS84 +datum=WGS84 +units=m +no_defs",
        "'+proj=utm +zone=31 +datum=WGS84 +units=m +no_defs=True'",
    ],
)
def test_control_points_have_every_first_line_of_opendronemap(tmp_path: Path, header: str) -> None:
    path = tmp_path / "gcp_list.txt"
    lines = [line for line in gcp_lines("EPSG:32631") if line.startswith("EPSG") or "000.jpg" in line]
    path.write_text("\r\n".join([header, *lines[1:]]) + "\r\n")
    found = read_control_points(path, photos_of(EAST))
    assert found.frame is not None
    assert found.frame.origin[:2] == (pytest.approx(LATITUDE, abs=1e-4), pytest.approx(LONGITUDE, abs=1e-4))


def test_control_points_of_the_southern_half_of_the_earth(tmp_path: Path) -> None:
    path = tmp_path / "gcp_list.txt"
    path.write_text("WGS84 UTM 18S\n500000 5900000 30 100 100 000.jpg A\n500001 5900000 30 200 100 000.jpg B\n")
    found = read_control_points(path, photos_of(EAST))
    assert found.frame is not None
    assert found.frame.origin[:2] == (pytest.approx(-37.05, abs=0.02), pytest.approx(-75.0, abs=1e-3))


def test_places_on_both_sides_of_the_date_line_are_neighbours() -> None:
    """On Taveuni, the 180th meridian goes through gardens."""
    degrees = np.array([[179.99997, -16.8, 30], [-179.99998, -16.8, 31], [-179.99999, -16.80001, 30]])
    points, frame = in_local_metres(degrees, "EPSG:4326", "a table")
    assert frame.origin[:2] == (pytest.approx(-16.8, abs=1e-6), pytest.approx(-179.99999, abs=1e-6))
    east_m = 0.00001 * 111_320 * np.cos(np.radians(16.8))
    np.testing.assert_allclose(points[:, 0], [-4 * east_m, east_m, 0], atol=0.02)
    assert np.ptp(points[:, 1]) == pytest.approx(1.107, abs=0.02)


def test_wrong_control_points_say_where_and_what(tmp_path: Path) -> None:
    photos, path = photos_of(EAST), tmp_path / "gcp_list.txt"
    good = [line for line in gcp_lines() if line.startswith("EPSG") or "000.jpg" in line]

    def refused(lines: Sequence[str], error: type[Exception], said: str) -> None:
        path.write_text("\n".join(lines) + "\n")
        with pytest.raises(error, match=said):
            read_control_points(path, photos)

    refused(good[:1], FormatError, "expected a line with the CRS")
    refused(["EPSG:99999", *good[1:]], InputError, "gcp_list.txt: expected a coordinate system, such as EPSG:32631")
    refused(["WGS84 UTM 61N", *good[1:]], InputError, "expected a coordinate system, .* found WGS84 UTM 61N")
    refused([*good, "1 2 3"], FormatError, rf"line {len(good) + 1}: expected x y z column row photo")
    refused([*good, "1 2 here 4 5 000.jpg A"], FormatError, "expected five numbers")
    refused([*good, "1 2 nan 4 5 000.jpg A"], FormatError, "expected finite numbers")
    refused([good[0], good[1], good[1].replace("000.jpg", "001.jpg").replace(good[1].split()[2], "900")],
            FormatError, "line 3: point point_0 has another place")  # fmt: skip
    words = good[1].split()
    refused(
        [good[0], ",".join(words)], FormatError, r"line 2: expected x y z .* with spaces between them, found 1 word$"
    )
    refused([good[0], " ".join([*words[:3], "9000", *words[4:]])], FormatError, "pixel 9000 .* is not in east/000.jpg")
    refused([good[0], good[1].replace("000.jpg", "other.jpg")], InputError, "expected points in some of the 8 photos")
    with pytest.raises(MissingFileError, match="does not exist"):
        read_control_points(tmp_path / "none.txt")


def test_degrees_without_a_system_are_asked_about(tmp_path: Path) -> None:
    table = marker_table(tmp_path / "markers.csv", on_earth(PLACES, "EPSG:4326"))
    with pytest.raises(FormatError, match=r"all 6 markers stand within .*: expected metres, .* `markers_crs`"):
        surveyed_markers(table, None)
    with pytest.raises(InputError, match="`markers_crs`: expected a coordinate system, such as EPSG:32631"):
        RunOptions(markers=table, markers_crs="EPSG:none").check_files()


def test_options_that_contradict_each_other(tmp_path: Path) -> None:
    table, path = marker_table(tmp_path / "markers.csv"), tmp_path / "gcp_list.txt"
    path.write_text("\n".join(gcp_lines()))
    with pytest.raises(InputError, match="`gcp` and `markers`: give one of them"):
        RunOptions(markers=table, gcp=path)
    with pytest.raises(InputError, match="`markers_crs` EPSG:25831 is of `markers`, which is not given"):
        RunOptions(markers_crs="EPSG:25831")


@pytest.mark.parametrize(
    ("crs", "x", "y"),
    [("EPSG:25831", -0.5, -0.75), ("EPSG:25831", 4612345.0, 301234.0), ("EPSG:2193", 301234.0, 4612345.0)],
    ids=["metres of a row", "exchanged", "another country"],
)
def test_places_where_a_coordinate_system_is_not_used_are_refused(crs: str, x: float, y: float) -> None:
    with pytest.raises(InputError, match=f"here: expected places where {crs} is used .*, found latitude .* exchanged"):
        in_local_metres(np.array([[x, y, 0.0], [x + 1, y, 0.0]]), crs, "here")


@pytest.mark.parametrize(
    ("crs", "x", "y"),
    [("EPSG:25832", 900000.0, 5500000.0), ("EPSG:4326", -179.9, -16.0), ("EPSG:3832", 3306000.0, -1800000.0)],
    ids=["beyond a zone's edge", "degrees", "over the date line"],
)
def test_places_about_where_a_coordinate_system_is_used_are_taken(crs: str, x: float, y: float) -> None:
    local, _ = in_local_metres(np.array([[x, y, 0.0], [x, y, 2.0]]), crs, "here")
    assert np.ptp(local, axis=0) == pytest.approx([0, 0, 2], abs=1e-6)
