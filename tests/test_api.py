"""`pomona.run` and `pomona.open`: a survey as values, the same as the commands."""

from __future__ import annotations

import csv
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest

import pomona
from pipeline_fakes import Fakes, make_photos
from pomona.errors import InputError, MissingExtraError, MissingFileError, SurveyError
from pomona.formats.coordinate_systems import places_on_earth
from pomona.stages.fuse.object.options import ObjectOptions
from pomona.survey import SurveyFolder
from pomona.values.cameras import WorldFrame, local_crs
from pomona.values.fruits import Fruits
from serving import running


@pytest.fixture
def survey(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> pomona.Survey:
    Fakes().install(monkeypatch)
    return pomona.run(make_photos(tmp_path / "photos"), tmp_path / "out")


def test_a_run_gives_values(survey: pomona.Survey) -> None:
    assert len(survey.fruits) == 1
    np.testing.assert_allclose(survey.fruits.centers_in_world, [[0, 0, 2]])
    assert len(survey.observations) == survey.detections.total == 4
    assert len(survey.cameras) == len(survey.photos) == 4
    assert survey.photos.names == tuple(f"IMG_{k:04}.jpg" for k in range(4))
    assert all(photo.path.is_file() for photo in survey.photos)
    assert survey.frame.scale_source == "fruit-diameter"
    assert survey.score_threshold == 0.5
    assert survey.least_score == pytest.approx(0.25)
    assert len(survey.cloud) > 0
    assert repr(survey) == f"Survey({str(survey.folder)!r})"


def test_what_was_written_is_opened_and_gone_on_with(survey: pomona.Survey, tmp_path: Path) -> None:
    opened = pomona.open(str(survey.folder))
    np.testing.assert_array_equal(opened.fruits.ids, survey.fruits.ids)
    before = SurveyFolder.open(survey.folder).records["sfm"]
    again = pomona.run(str(tmp_path / "photos"), survey.folder, object=ObjectOptions(rounds=2))
    records = SurveyFolder.open(again.folder).records
    assert records["sfm"] == before
    assert SurveyFolder.open(again.folder).get("options")["object"]["rounds"] == 2


def test_options_of_stages_are_kept_for_later_stages(survey: pomona.Survey, tmp_path: Path) -> None:
    from pomona.pipeline import RunOptions
    from pomona.stages.capture import KeyFrameOptions
    from pomona.stages.report import ContactSheetOptions, ReportOptions

    options = RunOptions(
        object=ObjectOptions(rounds=2, baselines=(0.1, 0.4)),
        scale_bar=(0, 1, 0.85),
        key_frames=KeyFrameOptions(move=0.1),
        report=ReportOptions(contact_sheet=ContactSheetOptions(columns=2)),
    )
    assert RunOptions.from_json(options.to_json()) == options


def test_unknown_and_wrong_options_are_named(survey: pomona.Survey, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="`fruit_size` is not an option: expected some of cameras, classes"):
        pomona.run(tmp_path / "photos", tmp_path / "out", fruit_size=3)
    with pytest.raises(InputError, match="`method`: expected one of object, paper, found 'magic'"):
        pomona.run(tmp_path / "photos", tmp_path / "out", method="magic")
    with pytest.raises(MissingFileError, match="is not a survey"):
        pomona.open(tmp_path)


def test_options_have_the_names_of_the_command(survey: pomona.Survey, tmp_path: Path) -> None:
    again = pomona.run(tmp_path / "photos", survey.folder, fruit_diameter=0.08, gnss=False, filter=False)
    kept = SurveyFolder.open(again.folder).get("options")
    assert (kept["fruit_diameter_m"], kept["use_gnss"], kept["filter_false_positives"]) == (0.08, False, False)
    assert kept["filter"] is None


def test_evaluate_and_export(survey: pomona.Survey, tmp_path: Path) -> None:
    truth = tmp_path / "truth.csv"
    truth.write_text("id,x,y,z,diameter\n1,0,0,2.001,0.07\n2,1,0,2,0.07\n")
    scores = survey.evaluate(truth)
    assert (scores.recall, scores.precision) == (0.5, 1.0)
    assert scores.f1 == pytest.approx(2 / 3)
    path = survey.export("csv", tmp_path / "fruits.csv")
    with path.open(newline="") as file:
        assert [row["id"] for row in csv.DictReader(file)] == ["1"]
    with pytest.raises(SurveyError, match="exists already"):
        survey.export("csv", path)
    with pytest.raises(InputError, match="expected one of"):
        survey.export("shapefile")


def test_the_page_is_served(survey: pomona.Survey) -> None:
    with running(survey.viewer()) as server:
        with urllib.request.urlopen(server.url) as answer:
            assert b"<html" in answer.read().lower()
        assert not server.changed
    for port, said in ((70000, "`port`: expected 0 to 65535, found 70000"), ("80", "`port`: expected a whole number")):
        with pytest.raises(InputError, match=said):
            survey.viewer(port=port)


def test_tables(survey: pomona.Survey) -> None:
    pytest.importorskip("pandas")
    fruits = survey.fruits.to_pandas()
    with (survey.folder / "fruits.csv").open(newline="") as file:
        assert list(fruits.columns) == next(csv.reader(file))
    assert fruits.loc[0, ["x_m", "y_m", "z_m"]].tolist() == [0, 0, 2]
    assert survey.observations.to_pandas().fruit_id.tolist() == [1] * 4
    detections = survey.detections.to_pandas()
    assert detections.photo.tolist() == list(survey.photos.names)
    assert (detections.x1_px > detections.x0_px).all()
    assert survey.cameras.to_pandas().photo.tolist() == list(survey.cameras.photos)
    assert survey.photos.to_pandas().width_px.tolist() == [96] * 4


def test_no_tree_is_no_number_in_tables(survey: pomona.Survey) -> None:
    pandas = pytest.importorskip("pandas")
    fruits = Fruits([1, 2], np.zeros((2, 3)), [0.07, 0.07], [1.0, 1.0], [3, 3], tree_ids=[0, 5])  # type: ignore[arg-type]
    table = fruits.to_pandas()
    assert table.tree_id[0] is pandas.NA
    assert (table.tree_id[1], str(table.tree_id.dtype), table.other_tree_id.isna().all()) == (5, "Int64", True)
    assert table.groupby("tree_id").size().to_dict() == {5: 1}
    assert table.id.dtype == np.int64


def test_no_tree_is_no_number_in_tables_with_places(survey: pomona.Survey, tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas")
    pytest.importorskip("pyogrio")
    table = survey.fruits.to_geopandas(WorldFrame("markers", False, True, "EPSG:32631"))
    assert table.tree_id.isna().all()
    table.to_file(tmp_path / "fruits.gpkg")
    assert geopandas.read_file(tmp_path / "fruits.gpkg").tree_id.isna().all()


def test_values_are_one_line(survey: pomona.Survey) -> None:
    assert repr(survey.fruits) == "Fruits(1 fruit)"
    assert repr(survey.observations) == "Observations(4 observations)"
    assert repr(survey.detections) == "SurveyDetections(4 photos, 4 detections)"
    assert repr(survey.detections["IMG_0000.jpg"]) == "Detections('IMG_0000.jpg', 1 detection)"
    assert repr(survey.photos) == "Photos(4 photos)"
    assert repr(survey.cameras).startswith("Cameras(4 photos, ")
    assert repr(survey.cloud).startswith("FruitCloud(")
    assert repr(survey.trees) == "Trees(0 trees)"
    assert repr(survey.segments).startswith("RowSegments(")
    assert "packed" not in repr(survey.detections["IMG_0000.jpg"].masks[0])


def test_one_fruit_and_loops(survey: pomona.Survey) -> None:
    one = survey.fruits[0]
    assert (len(one), one.ids.tolist()) == (1, [1])
    assert [fruit.ids.tolist() for fruit in survey.fruits] == [[1]]
    assert [len(seen) for seen in survey.observations] == [1] * 4
    assert survey.observations[-1].photo == ("IMG_0003.jpg",)
    assert len(survey.fruits[:0]) == 0
    with pytest.raises(IndexError):
        survey.fruits[1]


def test_cameras_by_the_names_of_photos(survey: pomona.Survey) -> None:
    cameras, points = survey.cameras, survey.fruits.centers_in_world
    name = cameras.photos[2]
    np.testing.assert_array_equal(cameras.project(name, points)[0], cameras.project(2, points)[0])
    assert cameras.intrinsics_of(name) is cameras.intrinsics_of(2)
    np.testing.assert_array_equal(cameras.rays_in_world(name, [[1, 2]]), cameras.rays_in_world(2, [[1, 2]]))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"no photo 'x\.jpg' has a camera: expected an index, or one of IMG_0000\.jpg"):
        cameras.project("x.jpg", points)


def test_a_table_with_places(survey: pomona.Survey) -> None:
    pytest.importorskip("geopandas")
    fruits = survey.fruits.to_geopandas()
    assert fruits.crs is None
    assert (fruits.geometry.x[0], fruits.geometry.z[0]) == (0, 2)


def test_a_table_on_earth_has_the_altitudes_of_exported_files(survey: pomona.Survey) -> None:
    pytest.importorskip("geopandas")
    frame = WorldFrame("gnss", False, True, local_crs(41.6, 0.6), (41.6, 0.6, 231.5))
    fruits = survey.fruits.to_geopandas(frame)
    assert (fruits.geometry.z[0], fruits.z_m[0]) == (233.5, 2)
    degrees = fruits.to_crs("EPSG:4326").geometry[0]
    exported = places_on_earth(survey.fruits.centers_in_world, frame)[0]
    np.testing.assert_allclose((degrees.x, degrees.y, degrees.z), exported, rtol=0, atol=1e-8)


@pytest.mark.parametrize(("package", "call"), [("pandas", "to_pandas"), ("geopandas", "to_geopandas")])
def test_without_pandas_the_extra_is_named(
    survey: pomona.Survey, monkeypatch: pytest.MonkeyPatch, package: str, call: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtraError, match=rf"pomona\[{package}\]"):
        getattr(survey.fruits, call)()


def test_what_the_package_offers() -> None:
    assert set(dir(pomona)) >= {"run", "open", "Survey", "RunOptions", "sample_folder"}
    assert (pomona.sample_folder() / "markers.csv").is_file()
    with pytest.raises(AttributeError, match="no attribute 'walk'"):
        _ = pomona.walk  # type: ignore[attr-defined]
