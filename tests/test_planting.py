"""Fruits come to their trees: by trunks given, by the planting distance, and by where they gather."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.basics.row_line import row_line
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.pipeline.fuse import FUSE_BY_OBJECT
from pomona.pipeline.options import RunOptions
from pomona.pipeline.planting import planting_stage
from pomona.progress import Silent
from pomona.stages.fuse import Fused
from pomona.stages.measure.allometry import STORY_APPLES, weigh
from pomona.stages.planting import PlantingOptions, find_trunks, on_trees, read_trunks, trunk_table
from pomona.stages.planting.summary import trees_of
from pomona.stages.scale.gnss import in_local_metres
from pomona.stages.scale.report import PieceScale, Placed, ScaleReport
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.trees import Trees, Trunks


def row(
    trees: int, spacing_m: float, *, per_tree: int = 40, spread: float = 0.2, seed: int = 0, turned_deg: float = 30.0
) -> tuple[Fruits, np.ndarray]:
    """Fruits about trunks in a row that runs at an angle through (100, -50), and their true trees."""
    rng = np.random.default_rng(seed)
    true = np.repeat(np.arange(1, trees + 1), per_tree)
    along = (true - 1) * spacing_m + np.clip(rng.normal(0, spread * spacing_m, len(true)), -0.5, 0.5) * 1.0
    across = rng.normal(0, 0.25, len(true))
    a = np.deg2rad(turned_deg)
    x, y = 100 + along * np.cos(a) - across * np.sin(a), -50 + along * np.sin(a) + across * np.cos(a)
    n = len(true)
    centers = np.column_stack([x, y, rng.uniform(0.5, 3, n)])
    fruits = Fruits(np.arange(1, n + 1), centers, np.full(n, 0.075), np.full(n, 0.95), np.full(n, 4), np.full(n, 0.002))
    return fruits, true


def trunks_of(trees: int, spacing_m: float, turned_deg: float = 30.0) -> Trunks:
    a = np.deg2rad(turned_deg)
    along = np.arange(trees) * spacing_m
    return Trunks(np.arange(1, trees + 1), np.column_stack([100 + along * np.cos(a), -50 + along * np.sin(a)]))


@pytest.mark.parametrize("options", [PlantingOptions(spacing_m=1.2), PlantingOptions()], ids=["distance", "nothing"])
def test_trees_are_found_where_fruits_gather(options: PlantingOptions) -> None:
    fruits, true = row(7, 1.2)
    trunks = find_trunks(fruits, options)
    assert len(trunks) == 7
    assert trunks.spacing_m == pytest.approx(1.2, rel=0.02)
    off = np.linalg.norm(trunks.xy_in_world - trunks_of(7, 1.2).xy_in_world, axis=1)
    assert off.max() < 0.15
    assert (on_trees(fruits, trunks).tree_ids == true).mean() > 0.95


@pytest.mark.parametrize("options", [PlantingOptions(spacing_m=1.5), PlantingOptions()], ids=["distance", "nothing"])
def test_trees_of_a_bent_row_are_found(options: PlantingOptions) -> None:
    """A row of 60 m, 4 m aside in its middle: a straight line has a quarter of the fruits on no tree."""
    fruits, true = row(40, 1.5, per_tree=15, spread=0.15, turned_deg=0)
    along, across = fruits.centers_in_world[:, 0] - 129.25, fruits.centers_in_world[:, 1] + 50
    angle, radius_m = along / 112.5, 112.5
    x, y = (radius_m + across) * np.sin(angle), (radius_m + across) * np.cos(angle)
    bent = replace(fruits, centers_in_world=np.column_stack([x, y, fruits.centers_in_world[:, 2]]))
    trunks = find_trunks(bent, options)
    assert len(trunks) == 40
    steps = np.linalg.norm(np.diff(trunks.xy_in_world, axis=0), axis=1)
    assert steps == pytest.approx(np.full(39, 1.5), rel=0.02)
    tree_ids = on_trees(bent, trunks).tree_ids
    assert (tree_ids == 0).mean() < 0.01
    assert (tree_ids == true).mean() > 0.95


@pytest.mark.parametrize("seed", range(4))
def test_the_distance_is_that_at_which_fruits_gather_most(seed: int) -> None:
    """Distances one by one, each by all fruits, are the slow way to it."""
    rng = np.random.default_rng(seed)
    fruits, _ = row(int(rng.integers(4, 30)), rng.uniform(0.7, 3.0), seed=seed)
    along_m = row_line(fruits.centers_in_world).along_across(fruits.centers_in_world)[0]
    first_m, length_m = along_m.min(), np.ptp(along_m)
    tried_m = length_m / np.arange(length_m / min(8.0, length_m / 2.5), length_m / 0.5, 1 / 16)
    vectors = np.array([np.exp(2j * np.pi * (along_m - first_m) / spacing_m).mean() for spacing_m in tried_m])
    turns = 2j * np.pi * length_m / tried_m
    gathered = np.abs(vectors - (np.exp(turns) - 1) / turns)
    assert find_trunks(fruits).spacing_m == pytest.approx(tried_m[np.argmax(gathered)])


def test_trees_are_numbered_along_the_row_whatever_the_order_of_fruits() -> None:
    fruits, _ = row(5, 1.0, turned_deg=200)  # runs towards smaller x
    trunks = find_trunks(fruits, PlantingOptions(spacing_m=1.0))
    assert trunks.ids.tolist() == [1, 2, 3, 4, 5]
    assert (np.diff(trunks.xy_in_world[:, 0]) > 0).all()
    shuffled = fruits[np.random.default_rng(1).permutation(len(fruits))]
    assert np.allclose(find_trunks(shuffled, PlantingOptions(spacing_m=1.0)).xy_in_world, trunks.xy_in_world)


def test_fruits_that_hang_anywhere_are_on_no_tree() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        centers = np.column_stack([rng.uniform(0, 12, 300), rng.normal(0, 0.3, 300), rng.uniform(0.5, 3, 300)])
        fruits = Fruits(np.arange(1, 301), centers, np.full(300, 0.07), np.ones(300), np.full(300, 3))
        assert find_trunks(fruits).source == "none"
        assert not on_trees(fruits, find_trunks(fruits)).tree_ids.any()


@pytest.mark.parametrize("size", [1, 2, 3, 6])
def test_bunches_that_hang_anywhere_are_on_no_tree(size: int) -> None:
    rng, invented = np.random.default_rng(size), 0
    for _ in range(40):
        n = 600 // size
        bunches = np.column_stack([rng.uniform(0, 20, n), rng.uniform(-0.4, 0.4, n), rng.uniform(0.6, 2.4, n)])
        centers = np.repeat(bunches, size, axis=0) + rng.normal(0, 0.03, (n * size, 3))
        m = len(centers)
        hedge = Fruits(np.arange(1, m + 1), centers, np.full(m, 0.07), np.ones(m), np.full(m, 3))
        invented += find_trunks(hedge).source == "fruits"
    assert invented <= 3  # 0.8 by what is said of chance


@pytest.mark.parametrize("size", [1, 2, 3, 6])
def test_trees_are_found_where_bunches_gather(size: int) -> None:
    rng = np.random.default_rng(size)
    along = np.repeat(np.arange(15) * 1.1, 72 // size) + rng.normal(0, 0.2, 15 * (72 // size))
    n = len(along)
    bunches = np.column_stack([along, rng.uniform(-0.4, 0.4, n), rng.uniform(0.6, 2.4, n)])
    centers = np.repeat(bunches, size, axis=0) + rng.normal(0, 0.03, (n * size, 3))
    m = len(centers)
    for diameter_m in (0.07, np.nan):  # what is not measured is not told from bunches
        trunks = find_trunks(Fruits(np.arange(1, m + 1), centers, np.full(m, diameter_m), np.ones(m), np.full(m, 3)))
        assert (trunks.source, len(trunks.ids)) == ("fruits", 15)
        assert trunks.spacing_m == pytest.approx(1.1, abs=0.02)


def test_a_wrong_distance_is_said() -> None:
    fruits, _ = row(8, 1.2)
    progress = Silent()
    find_trunks(fruits, PlantingOptions(spacing_m=1.7), progress)
    assert len(progress.warnings) == 1
    assert "1.7 m apart" in progress.warnings[0]
    assert "every 1.2" in progress.warnings[0]
    progress = Silent()
    find_trunks(fruits, PlantingOptions(spacing_m=1.21), progress)
    assert progress.warnings == []


def test_fruits_near_the_middle_of_two_trunks_are_flagged() -> None:
    trunks = Trunks(np.array([4, 9]), np.array([[0.0, 0.0], [2.0, 0.0]]))
    centers = np.array([[0.1, 0.3, 1], [0.9, -0.3, 1], [1.1, 0, 1], [1.3, 0, 1], [2.9, 0, 1], [9.0, 0, 1]])
    fruits = Fruits(np.arange(1, 7), centers, np.full(6, 0.07), np.ones(6), np.full(6, 3))
    placed = on_trees(fruits, trunks)
    assert placed.tree_ids.tolist() == [4, 4, 9, 9, 9, 0]
    assert placed.other_tree_ids.tolist() == [0, 9, 4, 0, 0, 0]


def test_fruits_above_each_other_are_no_row() -> None:
    centers = np.array([[1.0, 2.0, 0.5], [1.0, 2.0, 1.5], [1.0, 2.0, 2.5]])
    fruits = Fruits(np.arange(1, 4), centers, np.full(3, 0.07), np.ones(3), np.full(3, 3))
    for options in (PlantingOptions(), PlantingOptions(spacing_m=1.0)):
        assert find_trunks(fruits, options).source == "none"


@pytest.mark.parametrize("spacing_m", [None, 1.2])
def test_parts_that_are_not_joined_have_no_trees_but_those_of_a_table(spacing_m: float | None, tmp_path: Path) -> None:
    fruits, _ = row(7, 1.2)
    pieces = tuple(PieceScale(side, 4, "fruit-diameter", 1.0) for side in ("east", "west"))
    frame = WorldFrame("fruit-diameter", approximate=True)
    stage = planting_stage(FUSE_BY_OBJECT)
    table = tmp_path / "trees.csv"
    table.write_text(
        "id,x,y\n" + "".join(f"{i},{x},{y}\n" for i, (x, y) in enumerate(trunks_of(7, 1.2).xy_in_world, 1))
    )

    def found(tied: int, options: PlantingOptions) -> tuple[Trunks, list[str]]:
        listening = Silent()
        placed = Placed(replace(Cameras.empty(), frame=frame), report=ScaleReport(pieces=pieces, tied_pieces=tied))
        measured = Fused(fruits, Observations.empty(), FruitCloud.empty())
        trunks = stage.compute(measured=measured, placed=placed, options=options, progress=listening)
        return trunks, listening.warnings

    assert len(found(2, PlantingOptions(spacing_m=spacing_m))[0]) == 7
    trunks, warnings = found(0, PlantingOptions(spacing_m=spacing_m))
    assert (len(trunks), trunks.source) == (0, "none")
    assert ["not joined" in said for said in warnings] == [True] * (spacing_m is not None)
    assert len(found(0, PlantingOptions(trees=table))[0]) == 7


def test_one_trunk_of_many_has_its_own_fruits_alone() -> None:
    """A table with a single trunk, given with a row of forty trees."""
    fruits, _ = row(40, 1.5, per_tree=15, turned_deg=0)
    one = Trunks(np.array([1]), np.array([[130.0, -50.0]]))
    away = np.abs(fruits.centers_in_world[:, 0] - 130)
    on = on_trees(fruits, one).tree_ids == 1
    assert on[away < 7.5].all()
    assert not on[away > 8].any()
    near = on_trees(fruits, one, PlantingOptions(spacing_m=1.5)).tree_ids == 1
    assert 0 < near.sum() <= 3 * 15


@pytest.mark.parametrize(("length_m", "spacing_m"), [(2.0, 4.0), (2.0, 2.5), (10.0, 50.0)])
def test_a_row_shorter_than_the_planting_distance_is_one_tree(length_m: float, spacing_m: float) -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        centers = np.column_stack([rng.normal(7, 0.2, 80), rng.uniform(0, length_m, 80), rng.uniform(1, 2, 80)])
        fruits = Fruits(np.arange(1, 81), centers, np.full(80, 0.07), np.ones(80), np.full(80, 3))
        trunks = find_trunks(fruits, PlantingOptions(spacing_m=spacing_m))
        assert trunks.ids.tolist() == [1]
        assert trunks.xy_in_world[0] == pytest.approx([7, length_m / 2], abs=0.2 * length_m)
        assert (on_trees(fruits, trunks).tree_ids == 1).all()


def test_one_tree_has_all_fruits() -> None:
    fruits, _ = row(1, 1.0)
    placed = on_trees(fruits, Trunks(np.array([3]), np.array([[100.0, -50.0]])))
    assert set(placed.tree_ids.tolist()) == {3}


def test_the_table_of_trees_adds_up() -> None:
    fruits, true = row(4, 1.2)
    trunks = trunks_of(4, 1.2)
    placed = weigh(on_trees(fruits, trunks), STORY_APPLES, WorldFrame("markers"))
    trees = trees_of(placed, trunks, STORY_APPLES)
    assert trees.ids.tolist() == [1, 2, 3, 4]
    assert trees.fruits.sum() == len(fruits)
    assert (trees.fruits_low <= trees.fruits).all()
    assert (trees.fruits <= trees.fruits_high).all()
    assert (trees.fruits_high - trees.fruits_low).max() < 0.3 * 40
    assert trees.weights_kg.sum() == pytest.approx(np.nansum(placed.weights_g) / 1000, rel=1e-9)
    assert (trees.weights_low_kg < trees.weights_kg).all()
    assert (trees.weights_kg < trees.weights_high_kg).all()
    assert trees.diameters_m == pytest.approx([0.075] * 4)
    assert np.abs(trees.fruits - np.bincount(true)[1:]).max() <= 3


def test_a_tree_without_fruits_has_none_and_weighs_nothing() -> None:
    fruits, _ = row(1, 1.0, turned_deg=0)
    trunks = Trunks(np.array([1, 2]), np.array([[100.0, -50.0], [104.0, -50.0]]))
    trees = trees_of(on_trees(fruits, trunks), trunks, STORY_APPLES)
    assert trees.fruits.tolist() == [40, 0]
    assert trees.weights_kg[1] == 0
    assert np.isnan(trees.diameters_m[1])


def test_no_tree_has_more_fruits_than_were_found_on_it_and_beside_it() -> None:
    fruits = Fruits(
        np.arange(1, 8), np.zeros((7, 3)), np.full(7, 0.07), np.full(7, 0.9), np.full(7, 3),
        tree_ids=np.array([1, 2, 2, 2, 2, 2, 3]), other_tree_ids=np.array([0, 0, 0, 0, 0, 3, 0]),
    )  # fmt: skip
    trees = trees_of(fruits, Trunks(np.array([1, 2, 3]), np.eye(3)[:, :2]), STORY_APPLES)
    assert trees.fruits.tolist() == [1, 5, 1]
    assert trees.fruits_low.tolist() == [0, 2, 0]
    assert trees.fruits_high.tolist() == [1, 5, 2]  # one of the second tree's may hang on the third


def test_nothing_is_known_of_unknown_trees() -> None:
    fruits, _ = row(3, 1.0)
    assert len(trees_of(fruits, Trunks.unknown(), STORY_APPLES)) == 0
    assert len(find_trunks(Fruits.empty())) == 0
    assert len(Trees.empty()) == 0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("id,x,y\n1,0,0\n1,1,0\n", "line 3, column id: tree 1 stands there twice"),
        ("id,x,y\n0,0,0\n", "numbers above 0, found 0"),
        ("id,x,y\n1,0,0\n2,0,0\n", "trees 1 and 2 stand at the same place"),
        ("id,x\n1,0\n", "y missing"),
        ("id,x (mm),y (mm)\n1,500,0\n", "x, y missing"),
        ("id,x,y\n", "at least one tree below the header"),
        ("id,x,y\n1,zero,0\n", "line 2, column x: expected a number, found 'zero'"),
        ('id,x,y\n1,"512,345",0\n', "line 2, column x: expected a number, found '512,345': decimal commas are"),
        ("id;x;y\n1;1,234;0.5\n", "column x: expected a number, found '1,234': decimal .* no cell has a decimal point"),
        ("id;x;y\n1;512.345,5;0\n", r"found '512\.345,5': write numbers without anything between thousands"),
        ("id;x;y\n1;0,5;4.612.345\n", r"found '4\.612\.345': write numbers without anything between thousands"),
        (
            "id,x,y\n1,2,0\n2,0,5,1\n",
            "line 3: expected 3 cells, as in the first line, found 4: a decimal comma needs cells parted by semicolons",
        ),
        ("id;x;y\n1;2;0;5\n", "line 2: expected 3 cells, as in the first line, found 4$"),
        ("id,x,y,X\n1,2,0,3\n", "line 1: the column x is there 2 times"),
    ],
)
def test_a_table_of_trunks_that_cannot_be_is_refused(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "trees.csv"
    path.write_text(text)
    with pytest.raises(FormatError, match=expected):
        read_trunks(path)


@pytest.mark.parametrize(
    "content",
    [
        "id;x;y\r\n1;0,5;2\r\n;;\r\n2;1,5;-2,25\r\n;;\r\n".encode("utf-8-sig"),
        b"sep=;\nID;X;Y\n1;0,5;2\n2;1,5;-2,25\n",
        "id\tx\ty\n1\t0.5\t2\n2\t1.5\t-2.25\n".encode("utf-16"),
        "id,x,y,who\n1,0.5,2,Jürg\n2,1.5,-2.25,\n".encode("cp1252"),
        b"ID,x (m),Y [m]\n1,0.5,2\n2,1.5,-2.25\n",
        "İD;X;Y\n1;0,5;2\n2;1,5;-2,25\n".encode(),
        "İD;X;Y\n1;0,5;2\n2;1,5;-2,25\n".encode("cp1254"),
        "ıd;x;y\n1;0,5;2\n2;1,5;-2,25\n".encode(),
        b"id,x_m,y_m,fruits,diameter_m\n1,0.5,2,63,0.074\n2,1.5,-2.25,48,0.075\n",
        b"id,x_m,x,y,\n1,9,0.5,2,\n2,9,1.5,-2.25,,,leans\n",
    ],
    ids=["emptied rows", "sep", "UTF-16", "Windows", "units", "Turkish", "as Windows", "small i", "a survey", "notes"],
)
def test_tables_of_spreadsheets_are_read(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "trees.csv").write_bytes(content)
    trunks = read_trunks(tmp_path / "trees.csv")
    assert trunks.ids.tolist() == [1, 2]
    assert trunks.xy_in_world.tolist() == [[0.5, 2], [1.5, -2.25]]


def test_trunks_in_metres_are_looked_through_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[int] = []

    def at_one_place(trunks: Trunks, real: Any = trunk_table._at_one_place) -> Any:
        looked.append(len(trunks.ids))
        return real(trunks)

    monkeypatch.setattr(trunk_table, "_at_one_place", at_one_place)
    fruits, _ = row(2, 1.0)
    x, y, _ = fruits.centers_in_world[0]
    path = tmp_path / "trees.csv"
    path.write_text(f"id,x,y\n1,{x},{y}\n2,{x + 1},{y}\n")
    assert find_trunks(fruits, PlantingOptions(trees=path)).ids.tolist() == [1, 2]
    assert looked == [2]
    path.write_text(f"id,x,y\n1,{x},{y}\n2,{x},{y}\n")
    with pytest.raises(FormatError, match="trees 1 and 2 stand at the same place"):
        find_trunks(fruits, PlantingOptions(trees=path))


def test_trunks_of_another_frame_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "trees.csv"
    path.write_text("id,x,y\n1,0,0\n2,1,0\n")
    fruits, _ = row(2, 1.0)  # about (100, -50)
    with pytest.raises(FormatError, match=r"in the survey's frame, near its fruits; found the nearest 11[0-9] m"):
        find_trunks(fruits, PlantingOptions(trees=path))


def test_trunks_may_be_in_the_coordinate_system_of_the_markers(tmp_path: Path) -> None:
    posts = np.array([[301234.0, 4612345.0, 212.0], [301244.0, 4612345.0, 212.0], [301239.0, 4612347.0, 214.0]])
    local, there = in_local_metres(posts, "EPSG:25831", "here")
    fruits = Fruits(np.arange(1, 4), local, np.full(3, 0.08), np.ones(3), np.full(3, 5))
    path = tmp_path / "trees.csv"
    path.write_text("id;x;y\n7;301234,0;4612345,0\n8;301244,0;4612345,0\n")
    options = PlantingOptions(trees=path, trees_crs="EPSG:25831")
    trunks = find_trunks(fruits, options, crs=there.crs)
    assert trunks.ids.tolist() == [7, 8]
    np.testing.assert_allclose(trunks.xy_in_world, local[:2, :2], atol=1e-4)
    points = tmp_path / "gcp_list.txt"
    points.write_text("EPSG:25831\n301234 4612345 212 100 100 a.jpg post\n")
    by_gcp = find_trunks(fruits, PlantingOptions(trees=path, trees_gcp=points), crs=there.crs)
    assert by_gcp.xy_in_world.tolist() == trunks.xy_in_world.tolist()
    path.write_text("id,x,y\n" + "".join(f"{k},{x},{y}\n" for k, (x, y, _) in enumerate(local.tolist(), start=7)))
    assert find_trunks(fruits, options, crs=there.crs).xy_in_world.tolist() == local[:, :2].tolist()  # in metres, too
    path.write_text("id,x,y\n7,401234,4612345\n8,401244,4612345\n")
    with pytest.raises(FormatError, match="expected trunks in the survey's frame or in EPSG:25831, near its fruits"):
        find_trunks(fruits, options, crs=there.crs)


@pytest.mark.parametrize("by", ["crs", "gcp"])
def test_trunks_may_be_in_degrees_where_the_markers_are(tmp_path: Path, by: str) -> None:
    """Taken for metres they stand at one place, which a fruit happens to be near."""
    posts = np.array([[0.6 + 1.2e-5 * k, 41.6, 212.0] for k in range(8)])
    local, there = in_local_metres(posts, "EPSG:4326", "here")
    fruits = Fruits(np.arange(1, 10), np.vstack([local, [0.6, 41.6, 0.0]]), np.full(9, 0.08), np.ones(9), np.full(9, 5))
    path, points = tmp_path / "trees.csv", tmp_path / "gcp_list.txt"
    path.write_text("id,x,y\n" + "".join(f"{k},{x:.9f},{y:.9f}\n" for k, (x, y, _) in enumerate(posts, start=1)))
    points.write_text("EPSG:4326\n0.6 41.6 212 100 100 a.jpg post\n")
    given = {"trees_crs": "EPSG:4326"} if by == "crs" else {"trees_gcp": points}
    trunks = find_trunks(fruits, PlantingOptions(trees=path, **given), crs=there.crs)
    np.testing.assert_allclose(trunks.xy_in_world, local[:, :2], atol=1e-3)
    assert trunks.spacing_m == pytest.approx(1.0, abs=0.01)
    markers = tmp_path / "markers.csv"
    markers.write_text("id,x,y,z\n" + "".join(f"{k},{x:.9f},{y:.9f},212\n" for k, (x, y, _) in enumerate(posts)))
    of_run = {"markers": markers, "markers_crs": "EPSG:4326"} if by == "crs" else {"gcp": points}
    RunOptions(trees=path, **of_run).check_files()  # type: ignore[arg-type]
    for options in (PlantingOptions(trees=path), PlantingOptions(trees=path, trees_crs="EPSG:32650")):
        with pytest.raises(FormatError, match="trees 1 and 2 stand at the same place: expected metres, not degrees"):
            find_trunks(fruits, options, crs=there.crs)


def test_a_missing_table_and_a_distance_that_cannot_be_are_named(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="`trees`"):
        read_trunks(tmp_path / "trees.csv")
    with pytest.raises(InputError, match=r"`tree_spacing`: expected metres between 0.2 and 50, found 120"):
        PlantingOptions(spacing_m=120)
