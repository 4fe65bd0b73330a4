from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pomona.errors import FormatError, InputError, MissingFileError
from pomona.evaluate.fruits import Truth, evaluate_fruits, read_truth
from pomona.stages.scale.gnss import in_local_metres
from pomona.values.cameras import WorldFrame
from pomona.values.fruits import Fruits


def test_a_rows_truth_is_read_with_what_can_be_seen(tmp_path: Path) -> None:
    folder = tmp_path / "truth"
    folder.mkdir()
    (folder / "fruits.csv").write_text("id,tree,x,y,z,diameter\n3,1,0.5,0,1,0.08\n7,2,1,0,1,0.07\n")
    (folder / "visible_pixels.json").write_text(json.dumps({"a": {"3": 130, "7": 400}, "b": {"3": 121}}))
    for path in (tmp_path, folder, folder / "fruits.csv"):
        truth = read_truth(path)
        assert truth.ids.tolist() == [3, 7]
        assert truth.tree_ids.tolist() == [1, 2]
        visible = truth.visible()
        assert visible is not None
        assert visible.tolist() == [True, False]


@pytest.mark.parametrize(
    "text",
    [
        '"id","x","y","z","diameter"\n3,0.5,0,1,0.08\n7,1,0,1,0.07\n',
        "id;x;y;z;diameter\n3;0,5;0;1;0,08\n7;1;0;1;0,07\n",
        "ID\tX\tY\tZ\tDIAMETER\tTREE\n3\t0.5\t0\t1\t0.08\t\n7\t1\t0\t1\t0.07\t\n",
        "sep=;\nid;x;y;z;diameter\n3;0,5;0;1;0,08\n7;1;0;1;0,07\n",
        "# measured by hand\n\nid,x (m),y (m),z (m),diameter (m)\n3,0.5,0,1,0.08\n7,1,0,1,0.07\n",
        "id,x_m,y_m,z_m,diameter_m,score,tree_id\n3,0.5,0,1,0.08,0.9,\n7,1,0,1,0.07,1.0,\n",
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_tables_of_spreadsheets_are_read(tmp_path: Path, text: str, encoding: str) -> None:
    (tmp_path / "fruits.csv").write_text(text, encoding=encoding)
    truth = read_truth(tmp_path)
    assert truth.ids.tolist() == [3, 7]
    assert truth.centers_in_world.tolist() == [[0.5, 0, 1], [1, 0, 1]]
    assert truth.diameters_m.tolist() == [0.08, 0.07]
    assert truth.tree_ids.tolist() == [0, 0]


def test_without_visible_pixels_only_all_fruits_are_scored(tmp_path: Path) -> None:
    (tmp_path / "fruits.csv").write_text("id,x,y,z,diameter\n1,0,0,1,0.08\n")
    truth = read_truth(tmp_path)
    assert truth.visible() is None
    assert evaluate_fruits(Fruits.empty(), truth).visible is None


def test_boxes_are_read_as_columns_lines_and_corners(tmp_path: Path) -> None:
    boxes = np.array([[0, 0, 1, 0.08, 0.07, 1.09], [2, 0, 1, 2.08, 0.08, 1.08]])
    steps = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    corners = np.array([box[:3] + steps * (box[3:] - box[:3]) for box in boxes])
    columns = "id,x_min,y_min,z_min,x_max,y_max,z_max\n" + "".join(
        f"{i}," + ",".join(map(str, box)) + "\n" for i, box in zip((4, 9), boxes, strict=True)
    )
    texts = {
        "columns.csv": columns,
        "six.txt": "# low, high\n" + "\n".join(" ".join(map(str, box)) for box in boxes),
        "corners.txt": "\n".join(" ".join(map(str, box.ravel())) for box in corners),
        "three.txt": "\n".join("\t".join(map(str, point)) for point in corners.reshape(-1, 3)),
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
        truth = read_truth(tmp_path / name)
        assert truth.boxes_in_world == pytest.approx(boxes)
        assert truth.diameters_m == pytest.approx([0.08, 0.08])
    assert read_truth(tmp_path / "columns.csv").ids.tolist() == [4, 9]


POSTS = np.array([[301234.0, 4612345.0, 212.0], [301244.0, 4612345.0, 212.5], [301239.0, 4612347.0, 214.0]])


def test_truth_in_a_coordinate_system_comes_into_the_surveys_frame() -> None:
    local, on_earth = in_local_metres(POSTS, "EPSG:25831", "here")
    frame = WorldFrame("gnss", crs=on_earth.crs, origin=on_earth.origin)
    truth = Truth(
        np.arange(3), POSTS, np.full(3, 0.08), seen_photo=("a",), seen_id=np.array([1]), seen_px=np.array([9])
    )
    brought = truth.brought_from("EPSG:25831", frame)
    np.testing.assert_allclose(brought.centers_in_world, local, atol=1e-6)
    assert brought.diameters_m.tolist() == truth.diameters_m.tolist()
    assert brought.seen_photo == ("a",)
    half = np.array([0.04, 0.03, 0.05])
    boxes = np.hstack([POSTS - half, POSTS + half])
    boxed = Truth.from_boxes(boxes).brought_from("EPSG:25831", frame)
    assert boxed.boxes_in_world is not None
    np.testing.assert_allclose(boxed.centers_in_world, local, atol=1e-6)
    sides = boxed.boxes_in_world[:, 3:] - boxed.boxes_in_world[:, :3]
    np.testing.assert_allclose(sides, [[0.08, 0.06, 0.10]] * 3, rtol=1e-3)  # metres of the ground, not of the map
    np.testing.assert_allclose(boxed.diameters_m, 0.08, rtol=1e-3)


def test_truth_in_a_coordinate_system_needs_a_survey_on_earth() -> None:
    truth = Truth(np.arange(3), POSTS, np.full(3, 0.08))
    with pytest.raises(InputError, match="`truth_crs` EPSG:25831: the survey's frame has no place on Earth"):
        truth.brought_from("EPSG:25831", WorldFrame("markers"))
    _, on_earth = in_local_metres(POSTS, "EPSG:25831", "here")
    frame = WorldFrame("gnss", crs=on_earth.crs, origin=on_earth.origin)
    with pytest.raises(InputError, match="`truth_crs`: expected a coordinate system, such as EPSG:32631"):
        truth.brought_from("EPSG:none", frame)
    exchanged = Truth(np.arange(3), POSTS[:, [1, 0, 2]], np.full(3, 0.08))
    with pytest.raises(InputError, match=r"`truth_crs`: expected places where EPSG:25831 is used .* exchanged"):
        exchanged.brought_from("EPSG:25831", frame)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("id,x,y,z,diameter\n1,0,0,east,0.08\n", "line 2"),
        ("id,x,y,z,diameter\n1,0,0,1,0\n", "line 2, column diameter: expected metres above 0, found 0"),
        ("id,x,y,z,diameter\n1,0,0,1,0.08\n1,0,0,2,0.08\n", "line 3, column id: fruit 1 stands there twice"),
        ("id,x,y,z,diameter\n1,0,5,0,75,1,2,0,08\n", "line 2: expected 5 cells, .* a decimal comma needs cells parted"),
        ("id,x,y,z,diameter_mm\n1,0,0,1,80\n", "expected the columns id,x,y,z,diameter, .* found 'id,x,y,z,diam"),
        (
            "x_min,y_min,z_min,x_max,y_max,z_max\n\n0,0,0,1,1,0\n",
            "line 3: expected the lowest, then the highest corner",
        ),
        ("fruit,where\n1,there\n", "expected the columns id,x,y,z,diameter"),
        ("1 2 3 4\n", "6, 24 or 3 numbers"),
        ("0 0 0 1 1 0\n", "box 1: expected the lowest, then the highest corner, found 0 0 0 1 1 0"),
        ("0 0 0\n1 1 1\n", "eight corners"),
        ("", "empty"),
    ],
)
def test_what_is_no_truth_is_named(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "truth.csv").write_text(text)
    with pytest.raises(FormatError, match=says):
        read_truth(tmp_path / "truth.csv")


def test_labels_of_photos_are_no_truth_in_space(tmp_path: Path) -> None:
    (tmp_path / "labels.json").write_text('{"images": [], "annotations": []}')
    with pytest.raises(FormatError, match=r"labels of photos are compared .* `pomona evaluate --detections`"):
        read_truth(tmp_path / "labels.json")


def test_broken_visible_pixels_are_named(tmp_path: Path) -> None:
    (tmp_path / "fruits.csv").write_text("id,x,y,z,diameter\n1,0,0,1,0.08\n")
    (tmp_path / "visible_pixels.json").write_text('{"a": 3}')
    with pytest.raises(FormatError, match=r"visible_pixels\.json"):
        read_truth(tmp_path)


def test_missing_truth_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"fruits\.csv"):
        read_truth(tmp_path)
    with pytest.raises(MissingFileError, match=r"nope does not exist; expected a table of true fruits \(id, x, y, z, "):
        read_truth(tmp_path / "nope")


def test_orchard_dev(shared_data: Path) -> None:
    truth = read_truth(shared_data / "orchard-dev")
    visible = truth.visible()
    assert visible is not None
    assert (len(truth), len(np.unique(truth.tree_ids))) == (153, 3)
    assert 100 < visible.sum() < 153
    shifted = truth.centers_in_world + np.array([0.003, 0, 0])
    fruits = Fruits(truth.ids, shifted, truth.diameters_m + 0.002, np.ones(153), np.full(153, 2))
    scores = evaluate_fruits(fruits, truth)
    assert scores.all.f1 == 1
    assert scores.all.center_rmse_m == pytest.approx(0.003)
    assert scores.all.diameter_bias_m == pytest.approx(0.002)
    assert scores.visible is not None
    assert scores.visible.hidden == 153 - visible.sum()
