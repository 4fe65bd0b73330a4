"""No result is older than what it was made from: which stages each option, each file and each room of code redoes."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, BinaryIO

import pytest

import pomona
from package_rooms import PACKAGE, rooms
from pipeline_fakes import Fakes, make_photos
from pomona.browser.view import read_survey
from pomona.errors import MissingFileError
from pomona.pipeline import STAGES, RunOptions, code, go_on, run, segment_only
from pomona.pipeline.code import engine_versions
from pomona.pipeline.select import SelectOptions
from pomona.pipeline.stage import Stage
from pomona.pipeline.stages import stages_of
from pomona.progress import Recorder, Silent
from pomona.stages.capture import KeyFrameOptions
from pomona.stages.dense.options import DenseOptions
from pomona.stages.filter.options import FilterOptions
from pomona.stages.filter.svm import shipped
from pomona.stages.fuse.object.options import ObjectOptions
from pomona.stages.fuse.paper.options import PaperOptions
from pomona.stages.measure import MeasureOptions
from pomona.stages.planting import PlantingOptions
from pomona.stages.report import ContactSheetOptions, ReportOptions
from pomona.stages.scale.options import ScaleOptions
from pomona.stages.scale.report import Placed
from pomona.stages.scene import DenseSceneOptions
from pomona.stages.second_look import SecondLookOptions
from pomona.stages.segment.photo_detections import SegmentOptions
from pomona.stages.sfm.options import SfmOptions
from pomona.stages.sfm.pieces import Reconstruction
from pomona.stages.yields import YieldOptions
from pomona.survey import SurveyFolder
from pomona.survey.unfinished import unfinished, unfinished_in_words


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    return make_photos(tmp_path / "photos")


def redone(photos: Path, out: Path, options: RunOptions) -> list[str]:
    """The stages that a run does itself, in the order of the default method."""
    return sorted((stage.name for stage in run([photos], out, options).stages if not stage.kept), key=STAGES.index)


def write_markers(folder: Path) -> dict[str, Any]:
    path = folder / "markers.csv"
    path.write_text("id,x,y,z\n0,0,0,1\n1,1,0,1\n2,0,0,2\n")
    return {"markers": path}


def write_positions(folder: Path) -> dict[str, Any]:
    path = folder / "positions.csv"
    rows = [f"IMG_000{k}.jpg,41.62,{0.87 + 1e-5 * k},212.5,0.02" for k in range(4)]
    path.write_text("\n".join(["photo,latitude,longitude,altitude,sd", *rows]) + "\n")
    return {"positions": path}


def write_gcp(folder: Path) -> dict[str, Any]:
    path = folder / "gcp_list.txt"
    path.write_text("EPSG:32631\n430000 4580000 80 40 30 IMG_0000.jpg A\n430001 4580000 81 50 30 IMG_0001.jpg B\n")
    return {"gcp": path}


def copied_weights(folder: Path) -> dict[str, Any]:
    """A model file of another content."""
    path = folder / "mine.onnx"
    path.write_bytes(b"another network")
    return {"model": str(path)}


def copied_machine(folder: Path) -> dict[str, Any]:
    path = folder / "mine.json"
    values = json.loads(shipped("object").read_text())
    path.write_text(json.dumps(values | {"trained_on": "other fruits"}))
    return {"filter_model": path}


def weighed_pairs(folder: Path) -> dict[str, Any]:
    path = folder / "pairs.csv"
    path.write_text("diameter_mm,weight_g\n" + "".join(f"{d},{d**3 / 1900:.0f}\n" for d in range(60, 80, 2)))
    return {"weights": path}


def write_trunks(folder: Path) -> dict[str, Any]:
    path = folder / "trunks.csv"
    path.write_text("id,x,y\n7,0,0\n8,1.5,0\n")
    return {"trees": path}


def counted_trees(folder: Path) -> dict[str, Any]:
    path = folder / "counts.csv"
    path.write_text("tree,count\n1,50\n")
    return {"hand_counts": path}


def given_detections(folder: Path, label: str = "apple") -> dict[str, Any]:
    path = folder / "given.json"
    category = {"id": 1, "name": label}
    images = [{"id": k + 1, "file_name": f"IMG_{k:04}.jpg", "width": 96, "height": 72} for k in range(4)]
    box = [20, 28, 16, 16]
    square = [20, 28, 36, 28, 36, 44, 20, 44]
    annotations = [
        {"id": k + 1, "image_id": k + 1, "category_id": 1, "bbox": box, "segmentation": [square], "area": 256}
        for k in range(4)
    ]
    path.write_text(json.dumps({"images": images, "annotations": annotations, "categories": [category]}))
    return {"detections": path}


def given_cameras(folder: Path) -> dict[str, Any]:
    """The cameras of the survey itself, in another folder, said to be in metres."""
    shutil.copytree(folder / "out" / "cameras", folder / "cameras")
    (folder / "cameras" / "frame.json").write_text('{"scale_source": "given"}')
    return {"cameras": folder / "cameras"}


PAPER = {"method": "paper"}
SELECTED = ["select", "scale", "fuse", "second_look", "filter", "scene", "report"]
GIVEN = [name for name in STAGES if name != "sfm"]
# Each option: what a run before it had (None: the defaults), what is changed, and the stages that see it. The stand-ins
# of the stages give the same whatever they get, so that what comes after them is kept.
Change = dict[str, Any] | Callable[[Path], dict[str, Any]]
TABLE: dict[str, tuple[Change, Change, list[str]]] = {
    "sides": ({}, {"sides": "IMG_000[012]*,IMG_0003*"}, [name for name in STAGES if name != "select"]),
    "method": ({}, PAPER, [n for n in STAGES if n not in ("segment", "sfm", "second_look")]),
    "variant": (PAPER, {**PAPER, "variant": "text"}, ["fuse"]),
    "model": ({}, copied_weights, ["segment"]),
    "score_threshold": ({}, {"score_threshold": 0.6}, SELECTED),
    "detections": ({}, given_detections, GIVEN),
    "classes": (
        {},
        lambda folder: given_detections(folder) | {"classes": ("apple",)},
        [n for n in STAGES if n != "sfm"],
    ),
    "cameras": ({}, given_cameras, [name for name in STAGES if name not in ("segment", "select")]),
    "markers": ({}, write_markers, ["scale"]),
    "markers_crs": (write_markers, lambda folder: write_markers(folder) | {"markers_crs": "EPSG:32631"}, ["scale"]),
    "gcp": ({}, write_gcp, ["scale"]),
    "scale_bar": ({}, {"scale_bar": (0, 1, 0.85)}, ["scale"]),
    "marker_dictionary": ({}, {"marker_dictionary": "DICT_5X5_50"}, ["scale"]),
    "use_gnss": ({}, {"use_gnss": False}, ["scale"]),
    "positions": (
        {},
        write_positions,
        ["segment", "sfm", "scale", "second_look", "filter", "measure", "dense", "scene", "report"],
    ),
    "fruit": ({}, {"fruit": "plum"}, ["scale", "fuse", "second_look", "measure", "scene", "results", "report"]),
    "weights": ({}, weighed_pairs, ["measure", "results"]),
    "trees": ({}, write_trunks, ["planting", "results", "report"]),
    "tree_spacing": ({}, {"tree_spacing": 1.2}, ["planting", "results"]),
    "packing": ({}, {"packing": "60,70,80"}, ["report"]),
    "hand_counts": ({}, counted_trees, ["results"]),
    "fruit_diameter_m": ({}, {"fruit_diameter_m": 0.06}, ["scale", "fuse", "second_look", "scene"]),
    "engine": (PAPER, {**PAPER, "engine": "opencv"}, ["dense"]),
    "second_look": ({}, {"second_look": False}, ["second_look"]),
    "scene": ({}, {"scene": False}, ["scene", "results", "report"]),
    "dense_scene": ({}, {"dense_scene": DenseSceneOptions(min_pixels=3)}, ["scene"]),
    "looking": ({}, {"looking": SecondLookOptions(peaks=4)}, ["second_look"]),
    "filter_false_positives": ({}, {"filter_false_positives": False}, ["filter"]),
    "filter_model": ({}, copied_machine, ["filter"]),
    "key_frames": ({}, {"key_frames": KeyFrameOptions(move=0.1)}, []),  # of photos there are none
    "segment": ({}, {"segment": SegmentOptions(sample_photos=5)}, ["segment"]),
    "select": ({}, {"select": SelectOptions(trusted_share=0.9)}, SELECTED),
    "sfm": ({}, {"sfm": SfmOptions(window=7)}, ["sfm"]),
    "scale": ({}, {"scale": ScaleOptions(refine=False)}, ["scale"]),
    "object": ({}, {"object": ObjectOptions(rounds=2)}, ["scale", "fuse", "second_look"]),
    "paper": (PAPER, {**PAPER, "paper": PaperOptions(min_points=20)}, ["fuse"]),
    "dense": (PAPER, {**PAPER, "dense": DenseOptions(neighbours=5)}, ["dense"]),
    "filter": ({}, {"filter": FilterOptions(threshold=0.4)}, ["filter"]),
    "planting": ({}, {"planting": PlantingOptions(between=0.2)}, ["planting", "results"]),
    "yields": ({}, {"yields": YieldOptions(draws=200)}, ["results"]),
    "measure": ({}, {"measure": MeasureOptions(rays_per_photo=12)}, ["measure"]),
    "report": ({}, {"report": ReportOptions(contact_sheet=ContactSheetOptions(columns=2))}, ["report"]),
}


def test_the_table_has_every_option() -> None:
    assert set(TABLE) == {field.name for field in fields(RunOptions)}


@pytest.mark.parametrize("option", sorted(TABLE))
def test_a_changed_option_redoes_the_stages_that_see_it(
    fakes: Fakes, photos: Path, tmp_path: Path, option: str
) -> None:
    before, change, expected = TABLE[option]
    out = tmp_path / "out"
    run([photos], out, RunOptions(**(before(tmp_path) if callable(before) else before)))
    changed = RunOptions(**(change(tmp_path) if callable(change) else change))
    assert redone(photos, out, changed) == expected
    assert redone(photos, out, changed) == []


def test_a_moved_file_is_the_same_file(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    markers = write_markers(tmp_path)["markers"]
    run([photos], tmp_path / "out", RunOptions(markers=markers))
    markers = markers.rename(tmp_path / "elsewhere.csv")
    assert redone(photos, tmp_path / "out", RunOptions(markers=markers)) == []
    markers.write_text("id,x,y,z\n0,0,0,1\n1,1,0,1\n2,0,0,3\n")
    assert redone(photos, tmp_path / "out", RunOptions(markers=markers)) == ["scale"]


def test_tables_that_are_gone_change_nothing(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    writers = (write_markers, write_positions, weighed_pairs, write_trunks, counted_trees, copied_machine)
    given = {name: path for write in writers for name, path in write(tmp_path).items()}
    run([photos], tmp_path / "out", RunOptions(**given))
    for path in given.values():
        path.unlink()
    again = go_on(tmp_path / "out", changed={"packing": "60,70"})
    assert [stage.name for stage in again.stages if not stage.kept] == ["report"]
    assert sum("is no longer there: the survey's own copy" in warning for warning in again.warnings) == len(given)
    options = SurveyFolder.open(tmp_path / "out").get("options")
    assert options["markers"] == given["markers"].as_posix()  # as it was said
    with pytest.raises(MissingFileError, match=r"`markers`: .*mistyped\.csv does not exist"):
        run([photos], tmp_path / "out", RunOptions(markers=tmp_path / "mistyped.csv"))
    with pytest.raises(MissingFileError, match=r"`markers`: .*markers\.csv does not exist"):
        run([photos], tmp_path / "out", RunOptions(**given), overwrite=True)
    given["markers"].write_text("id,x,y,z\n0,0,0,1\n1,1,0,1\n2,0,0,3\n")
    assert [s.name for s in go_on(tmp_path / "out").stages if not s.kept][:1] == ["scale"]


def test_masks_alone_leave_the_other_options_of_a_survey(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    given, markers = given_detections(tmp_path), write_markers(tmp_path)["markers"]
    run([photos], tmp_path / "out", RunOptions(**given, markers=markers, method="paper", score_threshold=0.4))
    segment_only([photos], tmp_path / "out", changed={"sides": "none"})
    options = RunOptions.from_json(SurveyFolder.open(tmp_path / "out").get("options"))
    expected = RunOptions(markers=markers, method="paper", score_threshold=0.4, sides="none")
    assert options == expected  # but for the masks that were given
    assert fakes.calls["tiles"] > 0
    assert go_on(tmp_path / "out").fruits == 1
    assert redone(photos, tmp_path / "out", expected) == []
    segment_only([photos], tmp_path / "out", changed={"score_threshold": 0.6}, overwrite=True)
    assert RunOptions.from_json(SurveyFolder.open(tmp_path / "out").get("options")) == RunOptions(score_threshold=0.6)


def test_names_of_classes_beside_the_masks_redo_them(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    labels, names = tmp_path / "set" / "labels", tmp_path / "set" / "data.yaml"
    labels.mkdir(parents=True)
    for photo in photos.iterdir():
        (labels / f"{photo.stem}.txt").write_text("0 .3 .5 .1 .1\n0 .6 .5 .1 .1\n1 .8 .8 .1 .1\n")
    names.write_text("names: [leaf, apple]\n")
    options = RunOptions(detections=labels, classes=("apple",), sides="none")
    assert run([photos], tmp_path / "out", options, until="select").detections == 4
    assert run([photos], tmp_path / "out", options, until="select").stages[0].kept
    names.write_text("names: [apple, leaf]\n")
    mended = run([photos], tmp_path / "out", options, until="select")
    assert (mended.detections, mended.stages[0].kept) == (8, False)


def test_masks_need_no_cameras(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    gone = tmp_path / "cameras"
    assert run([photos], tmp_path / "out", RunOptions(cameras=gone), until="select").detections > 0
    again = segment_only([photos], tmp_path / "out", changed={"score_threshold": 0.4})
    assert again.detections > 0
    assert RunOptions.from_json(SurveyFolder.open(tmp_path / "out").get("options")).cameras == gone
    with pytest.raises(MissingFileError, match=r"`cameras`: .* does not exist"):
        go_on(tmp_path / "out")


OLDER = ("cloud.laz", "contact_sheet.jpg", "fruits.csv", "fruits.geojson")


@pytest.mark.parametrize("stage", ["fuse", "measure"])
def test_a_changed_run_that_was_stopped_is_told_of(
    fakes: Fakes, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    out = tmp_path / "out"
    run([photos], out)
    assert unfinished(SurveyFolder.open(out)) is None
    monkeypatch.setattr(fakes, "_place", lambda *given, **more: placed_anew(fakes, *given, **more))
    fakes.install(monkeypatch)
    fakes.raising[stage] = (fakes.calls[stage] + 1, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        run([photos], out, RunOptions(scale_bar=(0, 1, 0.85)))
    survey, warned = SurveyFolder.open(out), Recorder(Silent())
    found = unfinished(survey)
    assert found is not None
    assert (found.stage, set(OLDER) - set(found.older)) == (stage, set())
    assert "cameras" not in found.older
    opened = pomona.open(out, progress=warned)
    assert len(opened.fruits) == 1  # as the run before left them
    (said,) = warned.warnings
    assert f"was not finished: it got to stage '{stage}'" in said
    assert f"`pomona report {out}`" in said
    assert said in read_survey(out).warnings
    kept = {s.name for s in go_on(out).stages if s.kept}
    assert {"segment", "select", "sfm", "scale"} <= kept
    assert stage not in kept
    assert unfinished(SurveyFolder.open(out)) is None
    assert not unfinished_in_words(SurveyFolder.open(out))


def placed_anew(fakes: Fakes, reconstruction: Reconstruction, *given: Any, **more: Any) -> Placed:
    """Cameras in a frame twice as large."""
    placed = Fakes._place(fakes, reconstruction, *given, **more)
    return replace(
        placed, cameras=replace(placed.cameras, cam_from_world=placed.cameras.cam_from_world * [1.0, 1.0, 1.0, 2.0])
    )


def test_stages_one_by_one_leave_later_results_older(
    fakes: Fakes, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    go_on_until = {"changed": {"fruit_diameter_m": 0.06}, "until": "scale"}
    run([photos], out, until="scale")
    assert unfinished(SurveyFolder.open(out)) is None  # later stages have not been run yet
    run([photos], out)
    monkeypatch.setattr(fakes, "_place", lambda *given, **more: placed_anew(fakes, *given, **more))
    fakes.install(monkeypatch)
    go_on(out, **go_on_until)
    found = unfinished(SurveyFolder.open(out))
    assert found is not None
    assert found.stage == "fuse"
    assert "fruits.csv" in found.older
    records = json.loads((out / "survey.json").read_text())
    records["stages"]["fuse"]["made_from"] = {"results": "none", "fuse": "itself"}  # a hostile one ends, too
    (out / "survey.json").write_text(json.dumps(records))
    assert unfinished(SurveyFolder.open(out)) is not None


def test_a_photo_is_digested_once(fakes: Fakes, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    digested: list[str] = []
    real = hashlib.file_digest

    def noting(file: BinaryIO, algorithm: str) -> Any:
        digested.append(Path(file.name).name)
        return real(file, algorithm)  # type: ignore[arg-type]

    monkeypatch.setattr("hashlib.file_digest", noting)
    run([photos], tmp_path / "out")
    names = [name for name in digested if name.endswith(".jpg") and name.startswith("IMG_")]
    assert sorted(names) == [f"IMG_{k:04}.jpg" for k in range(4)]


def test_another_class_of_given_detections(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    given = given_detections(tmp_path)
    run([photos], tmp_path / "out", RunOptions(**given))
    assert redone(photos, tmp_path / "out", RunOptions(**given, classes=("apple",))) == ["segment"]


# The four faults of one cause: a dependency that was said by hand, in one of three places.


def test_another_method_ties_the_sides_anew(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "out", RunOptions(method="paper"))
    go_on(tmp_path / "out", until="filter", changed={"method": "object"})
    assert fakes.calls["scale"] == 2
    assert fakes.calls["sfm"] == 1


def test_another_threshold_segments_nothing_again_and_answers_the_new_question(
    fakes: Fakes, photos: Path, tmp_path: Path
) -> None:
    assert run([photos], tmp_path / "out").detections == 4
    tiles = fakes.calls["tiles"]
    detections = (tmp_path / "out" / "detections.json").read_bytes()
    summary = run([photos], tmp_path / "out", RunOptions(score_threshold=0.95))
    assert (summary.detections, summary.fruits) == (0, 0)
    assert fakes.calls["tiles"] == tiles
    assert (tmp_path / "out" / "detections.json").read_bytes() == detections
    assert "No fruit was found" in " ".join(summary.warnings)
    back = run([photos], tmp_path / "out")
    assert (back.detections, back.fruits) == (4, 1)
    assert fakes.calls["tiles"] == tiles


def test_a_threshold_below_what_the_file_keeps_segments_again(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "out")
    tiles = fakes.calls["tiles"]
    summary = run([photos], tmp_path / "out", RunOptions(score_threshold=0.01))
    assert fakes.calls["tiles"] > tiles
    # The network is asked for what it would else not tell of.
    assert summary.detections == 8


def test_other_engines_redo_what_they_made(
    fakes: Fakes, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run([photos], tmp_path / "out")
    monkeypatch.setattr(
        "pomona.pipeline.runner.engine_versions",
        lambda module: engine_versions(module) | ({"pycolmap": "9.9"} if module.endswith(".sfm") else {}),
    )
    assert redone(photos, tmp_path / "out", RunOptions()) == ["sfm"]
    record = SurveyFolder.open(tmp_path / "out").record_of("sfm")
    assert record is not None
    assert record.engines["pycolmap"] == "9.9"


def test_the_manifest_says_which_engines_ran(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "out")
    records = SurveyFolder.open(tmp_path / "out").records
    assert {"onnxruntime", "cv2", "numpy"} <= records["segment"].engines.keys()
    assert {"pycolmap", "cv2", "numpy"} <= records["sfm"].engines.keys()
    assert "not installed" not in [version for record in records.values() for version in record.engines.values()]


# Which stages run code of which rooms, read off the imports by a person. Rooms that are not here are reached by none.
ALL = frozenset(STAGES)
SPACE = frozenset({"scale", "fuse", "second_look", "filter", "measure", "dense"})
HANDED = frozenset({"results", "report"})  # where fruits were corrected, these run what measures them anew, too
ROOMS: dict[str, frozenset[str]] = {
    "adjustment": frozenset({"sfm", "scale", "report"}),
    "basics/arrays": ALL,
    "values/cameras": ALL - {"segment", "select"},
    "stages/capture": frozenset({"segment", "sfm", "scale", "second_look", "filter", "measure", "dense", "scene"})
    | HANDED,
    "corrections": HANDED,
    "values/crop": HANDED,
    "basics/data_frames": ALL,
    "stages/dense": frozenset({"dense", "scene"}),
    "values/detections": ALL - {"sfm", "planting"},
    "values/drawing": frozenset({"report"}),
    "errors": ALL,
    "evaluate": frozenset({"report"}),
    "stages/filter": frozenset({"filter"}),
    "formats": frozenset(
        {"segment", "sfm", "scale", "fuse", "second_look", "filter", "measure", "planting", "dense", "scene"}
    )
    | HANDED,
    "fruit/crops": frozenset({"second_look", "measure"}) | HANDED,
    "fruit/geometry": frozenset({"scale", "fuse", "second_look", "filter", "measure"}) | HANDED,
    "fruit/traits": SPACE | {"scene"} | HANDED,
    "values/fruits": SPACE | {"planting", "scene"} | HANDED,
    "stages/fuse": SPACE | {"planting"} | HANDED,
    "basics/geometry": ALL - {"segment", "select"},
    "values/intrinsics": ALL - {"segment", "select"},
    "values/intervals": HANDED,
    "basics/gpu": frozenset({"segment", "sfm", "scale", "second_look", "measure", "dense", "scene"}) | HANDED,
    "values/label_image": frozenset({"fuse", "second_look", "filter", "measure", "dense", "scene"}) | HANDED,
    "stages/measure": frozenset({"measure"}) | HANDED,
    "basics/option_values": ALL,
    "basics/onnx_file": frozenset({"segment", "second_look", "measure"}) | HANDED,
    "values/photo_names": frozenset({"segment", "sfm", "scale", "report"}),
    "values/photos": frozenset({"segment", "sfm", "scale", "second_look", "filter", "dense", "measure", "scene"})
    | HANDED,
    "stages/planting": frozenset({"planting"}) | HANDED,
    "progress": ALL,
    "stages/report": frozenset({"report"}),
    "basics/row_line": frozenset({"planting"}) | HANDED,
    "stages/scale": frozenset({"scale", "report"}),
    "stages/scene": frozenset({"scene"}),
    "stages/second_look": frozenset({"second_look"}),
    "stages/segment": frozenset({"segment"}),
    "stages/sfm": frozenset({"sfm", "scale", "report"}),
    "basics/threads": frozenset({"segment", "second_look", "sfm", "scale", "filter", "measure", "dense", "scene"})
    | HANDED,
    "values/trees": frozenset({"planting"}) | HANDED,
    "survey": ALL - {"select", "planting"},
    "stages/yields": frozenset({"results"}),
}
# Rooms whose modules have different users. The pipeline's are those of the stages; each redoes its own, what they share
# redoes all.
FILES = {f"pipeline/{name}.py": frozenset({name}) for name in STAGES} | {
    "fruit/geometry/cloud_points.py": frozenset({"results"}),
    "fruit/geometry/discs.py": frozenset({"scale", "report"}),
    "fruit/geometry/mask_outlines.py": frozenset({"scale", "fuse", "second_look", "filter", "measure"}) | HANDED,
    "fruit/geometry/mask_rays.py": frozenset({"scale", "fuse", "second_look", "filter", "measure"}) | HANDED,
    "fruit/geometry/sphere_outlines.py": HANDED,
    "fruit/geometry/spheres.py": frozenset({"scale", "fuse", "second_look", "filter", "measure"}) | HANDED,
    "fruit/traits/colours.py": frozenset({"second_look", "filter", "measure"}) | HANDED,
    "fruit/traits/kinds.py": frozenset({"measure"}) | HANDED,
    "fruit/traits/packing.py": frozenset({"report"}),
    "fruit/traits/ranges.py": frozenset({"scale", "fuse", "second_look", "filter", "dense", "scene"}),
    "fruit/traits/size.py": SPACE | {"scene"} | HANDED,
    "pipeline/correct.py": HANDED,
    "pipeline/planting.py": frozenset({"planting"}) | HANDED,
    "pipeline/fused_store.py": frozenset({"fuse", "second_look", "filter", "measure", "dense"}),
    "pipeline/stage.py": ALL,
    "pipeline/runner.py": frozenset[str](),
    "stages/report/static/viewer.js": frozenset({"report"}),
    "stages/filter/weights/object_svm.json": frozenset({"filter"}),
    "stages/second_look/weights/second_look.onnx": frozenset({"second_look"}),
    "stages/measure/weights/circles.onnx": frozenset({"measure"}) | HANDED,
    "stages/segment/weights/fruit.onnx": frozenset({"segment"}),
    "demo/markers.csv": frozenset[str](),
}


def stage_modules() -> dict[str, set[str]]:
    """The modules of the functions of each stage, and of inputs that are not stored, for all methods."""

    def modules_of(stage: Stage[Any]) -> set[str]:
        unstored = [source for source in stage.stages if source.store is None]
        return {stage.compute.__module__}.union(*(modules_of(source) for source in unstored))

    modules: dict[str, set[str]] = {}
    for method in ("object", "paper"):
        for corrected in (False, True):
            for stage in stages_of(method, corrected=corrected).in_order:
                modules.setdefault(stage.name, set()).update(modules_of(stage))
    return modules


class Copy:
    """A copy of the package, of which a file can be changed to see which stages it redoes."""

    def __init__(self, folder: Path) -> None:
        self.package = folder / "pomona"
        shutil.copytree(PACKAGE, self.package, ignore=shutil.ignore_patterns("__pycache__", "*.jpg"))
        self._modules = stage_modules()
        self._before = self._digests()

    def redone_by(self, *paths: Path) -> frozenset[str]:
        contents = [path.read_bytes() for path in paths]
        for path, content in zip(paths, contents, strict=True):
            path.write_bytes(content + b"\n")
        code._file_digest.cache_clear()
        code.code_digest.cache_clear()
        after = self._digests()
        for path, content in zip(paths, contents, strict=True):
            path.write_bytes(content)
        code._file_digest.cache_clear()
        return frozenset(name for name, digests in after.items() if digests != self._before[name])

    def _digests(self) -> dict[str, list[str]]:
        return {
            name: [code.code_digest(module, self.package) for module in sorted(modules)]
            for name, modules in self._modules.items()
        }


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Copy:
    return Copy(tmp_path_factory.mktemp("copy"))


@pytest.mark.parametrize("room", sorted(rooms() - {"pipeline"} | {"__init__", "__main__", "py"}))
def test_a_byte_in_a_room_redoes_the_stages_that_run_it(package: Copy, room: str) -> None:
    path = package.package / room
    files = (
        sorted(path.rglob("*.py")) if path.is_dir() else [f for f in path.parent.glob(f"{path.name}.*") if f.is_file()]
    )
    assert package.redone_by(*files) == ROOMS.get(room, frozenset())


@pytest.mark.parametrize("name", sorted(FILES))
def test_a_byte_in_a_file_redoes_the_stages_that_use_it(package: Copy, name: str) -> None:
    assert package.redone_by(package.package / name) == FILES[name]
