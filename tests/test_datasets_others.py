"""PFuji-Size, FruitNeRF, MinneApple and WGISD on miniatures in their published layouts."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rich.console import Console
from typer.testing import CliRunner

from conftest import REPOSITORY
from datasets_scenes import RedSegmenter, painted, write_fruitnerf, write_fuji_spheres
from fuse_scenes import sphere_points
from pomona.cli.app import app
from pomona.datasets.fruitnerf import benchmark_fruitnerf
from pomona.datasets.minneapple import benchmark_minneapple
from pomona.datasets.pfuji_size import benchmark_pfuji_size
from pomona.datasets.registry import DATASETS, Dataset
from pomona.datasets.tables import result_tables
from pomona.datasets.values import BenchmarkOptions, BenchmarkResult, ComparedTable, Figure
from pomona.datasets.wgisd import benchmark_wgisd
from pomona.errors import PomonaError
from pomona.progress import Silent

DISCS = [(60.0, 50.0, 20.0), (160.0, 90.0, 30.0), (100.0, 160.0, 16.0)]


def value(table: ComparedTable, name: str, column: str = "Pomona") -> float:
    return next(figure.ours[column] for figure in table.figures if figure.name == name)


@pytest.fixture
def red(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pomona.datasets.pictures.load_segmenter", lambda model: RedSegmenter())


@pytest.fixture
def apples(tmp_path: Path) -> Path:
    root = tmp_path / "PFuji-Size_dataset"
    folder = root / "3-apple_point_clouds"
    folder.mkdir(parents=True)
    lines = []
    for k, diameter in enumerate((0.068, 0.076, 0.084)):
        points = sphere_points(np.array([3.0, 1.0, 2.0]), diameter, 1500)
        points = points[points[:, 1] < 1.01]
        columns = [points, np.full((len(points), 3), 120)]
        if k == 2:  # the eighth column says which points are sure; strays are not
            points = np.concatenate(
                [points, np.random.default_rng(0).uniform([2.8, 0.9, 1.9], [3.2, 1.1, 2.1], (300, 3))]
            )
            sure = np.r_[np.full(len(points) - 300, 3), np.zeros(300)]
            columns = [points, np.full((len(points), 3), 120), np.zeros((len(points), 1)), sure[:, None], sure[:, None]]
        name = f"{2018 + 2 * (k == 2)}_01_{k + 1:03d}.txt"
        np.savetxt(folder / name, np.concatenate(columns, axis=1), fmt="%.5f")
        lines.append(f"{name},{1000 * diameter:.1f}")
    (root / "4-apples_GT_diameter.txt").write_text("\n".join(lines) + "\n")
    return root


def test_pfuji_size_measures_spheres_by_year(apples: Path) -> None:
    result = benchmark_pfuji_size(apples, Silent())
    (table,) = result.tables
    assert value(table, "all apples: measured") == 3
    assert 0 <= value(table, "all apples: MAE, mm") < 2
    assert 0.8 < value(table, "all apples: R²") <= 1
    assert value(table, "apples of 2020: apples") == 1
    assert table.source == ""


@pytest.mark.parametrize(
    ("line", "says"),
    [("2018_01_001.txt;70", "none"), ("2018_01_001.txt,wide", "line 1"), ("2018_01_001.txt,0.07", "in mm"),
     ("2018_01_009.txt,70", "nowhere below")],
)  # fmt: skip
def test_pfuji_size_names_the_wrong_line(apples: Path, line: str, says: str) -> None:
    (apples / "4-apples_GT_diameter.txt").write_text(line + "\n")
    with pytest.raises(PomonaError, match=says):
        benchmark_pfuji_size(apples, Silent())


@pytest.mark.parametrize("y_up", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_fruitnerf_scores_a_rendered_tree_whatever_its_units_and_axes(tmp_path: Path, y_up: bool) -> None:
    count = write_fruitnerf(tmp_path, y_up=y_up)
    result = benchmark_fruitnerf(tmp_path, tmp_path / "out", model=None, fruit_diameter_m=0.075, progress=Silent())
    (table,) = result.tables
    assert value(table, "fruits", "true") == count == 14
    assert 0.85 < value(table, "F1") <= 1
    assert ("with y up" in table.notes[0]) == y_up


def test_fruitnerf_refuses_fruits_of_another_tree_and_broken_files(tmp_path: Path) -> None:
    write_fruitnerf(tmp_path, y_up=False)
    folder = next(path for path in tmp_path.iterdir() if path.is_dir())
    fruits = folder / "fruits.obj"
    fruits.write_text("o a\nv 0 0 90\nv 0.1 0.1 90.1\nv 1 east 2\n")
    with pytest.raises(PomonaError, match="line 4"):
        _fruitnerf(tmp_path)
    fruits.write_text("o a\nv 8 8 2\nv 8.7 8.7 2.7\n")
    with pytest.raises(PomonaError, match="do not lie where the masks are"):
        _fruitnerf(tmp_path)
    (folder / "semantics" / "003.png").unlink()
    with pytest.raises(PomonaError, match=r"frames\[3\].semantic_path"):
        _fruitnerf(tmp_path)
    (folder / "transforms.json").write_text('{"frames": []}')
    with pytest.raises(PomonaError, match="with frames"):
        _fruitnerf(tmp_path)


def _fruitnerf(root: Path) -> BenchmarkResult:
    return benchmark_fruitnerf(root, root / "out", model=None, fruit_diameter_m=0.075, progress=Silent())


def test_minneapple_is_scored_by_boxes_and_masks(tmp_path: Path, red: None) -> None:
    folder = tmp_path / "detection" / "train"
    for name in ("images", "masks"):
        (folder / name).mkdir(parents=True)
    for k in range(2):
        pixels, ids = painted(220, 200, DISCS[k:])
        Image.fromarray(pixels).save(folder / "images" / f"2015_{k}.png")
        Image.fromarray(ids.astype(np.uint8)).save(folder / "masks" / f"2015_{k}.png")
    result = benchmark_minneapple(tmp_path, model=None, progress=Silent())
    (table,) = result.tables
    assert value(table, "AP50", "by boxes") == pytest.approx(1)
    assert value(table, "AP50", "by masks") == pytest.approx(1)
    assert "5 apples on 2 photos" in table.notes[0]
    assert "test photos" in table.notes[1]
    assert {figure.name: figure.printed for figure in table.figures}["AP50"] == 0.763
    with pytest.raises(PomonaError, match="images and masks"):
        benchmark_minneapple(folder / "images", model=None, progress=Silent())


def write_wgisd(root: Path) -> None:
    (root / "data").mkdir()
    for k in range(3):
        pixels, ids = painted(220, 200, DISCS[k:])
        Image.fromarray(pixels).save(root / "data" / f"CDY_{k}.jpg", quality=95)
        lines, masks = [], []
        for i in np.unique(ids[ids > 0]):
            rows, columns = np.nonzero(ids == i)
            x0, x1, y0, y1 = columns.min(), columns.max() + 1, rows.min(), rows.max() + 1
            lines.append(f"0 {(x0 + x1) / 440:.6f} {(y0 + y1) / 400:.6f} {(x1 - x0) / 220:.6f} {(y1 - y0) / 200:.6f}")
            masks.append(ids == i)
        (root / "data" / f"CDY_{k}.txt").write_text("\n".join(lines) + "\n")
        np.savez_compressed(root / "data" / f"CDY_{k}.npz", np.stack(masks, axis=2))
    (root / "test.txt").write_text("CDY_0\nCDY_1\n")
    (root / "test_masked.txt").write_text("CDY_1\nCDY_2\n")
    (root / "classes.txt").write_text("grape\n")


def test_wgisd_is_scored_on_its_lists(tmp_path: Path, red: None) -> None:
    write_wgisd(tmp_path)
    result = benchmark_wgisd(tmp_path, model=None, progress=Silent())
    by_masks, by_boxes = result.tables
    assert value(by_masks, "best F1 (IoU > 0.5)") == 1
    assert by_masks.figures[2].printed == 0.91
    assert "3 clusters on the 2 photos" in by_masks.notes[0]
    assert value(by_boxes, "AP50") == pytest.approx(1)
    assert by_boxes.figures[2].printed is None


def test_wgisd_names_what_does_not_fit(tmp_path: Path, red: None) -> None:
    write_wgisd(tmp_path)
    np.savez_compressed(tmp_path / "data" / "CDY_1.npz", np.zeros((200, 220, 1), bool))
    with pytest.raises(PomonaError, match=r"CDY_1.npz.*2 boxes"):
        benchmark_wgisd(tmp_path, model=None, progress=Silent())
    (tmp_path / "data" / "CDY_1.npz").write_bytes(b"PK broken")
    with pytest.raises(PomonaError, match="NumPy"):
        benchmark_wgisd(tmp_path, model=None, progress=Silent())
    (tmp_path / "test_masked.txt").write_text("CDY_0\nSYH_9\n")
    with pytest.raises(PomonaError, match="line 2: photo 'SYH_9'"):
        benchmark_wgisd(tmp_path, model=None, progress=Silent())
    with pytest.raises(PomonaError, match="folder data"):
        benchmark_wgisd(tmp_path / "data", model=None, progress=Silent())


def test_the_command_prints_tables_and_json_and_keeps_them(tmp_path: Path) -> None:
    write_fuji_spheres(tmp_path / "fuji", sides=("west",))
    shutil.rmtree(tmp_path / "fuji" / "data" / "pt_clouds")
    arguments = ["benchmark", "fuji-sfm", "--root", str(tmp_path / "fuji"), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, [*arguments, "--json"], env={"COLUMNS": "200"})
    assert result.exit_code == 0
    content = json.loads(result.stdout)
    assert content["missing"].keys() == {"Table 2"}
    assert json.loads((tmp_path / "out" / "benchmark.json").read_text()) == content
    missing = CliRunner().invoke(app, ["benchmark", "wgisd", "--root", str(tmp_path), "--out", str(tmp_path / "o")])
    assert missing.exit_code == 1
    assert "folder data" in missing.stderr


def test_tables_show_printed_figures_and_what_is_missing() -> None:
    table = ComparedTable(
        "A", (Figure("F1", {"ours": 0.5, "other": float("nan")}, 0.881),), "someone 2020", ("a note",)
    )
    console = Console(width=120, record=True, file=open("/dev/null", "w", encoding="utf-8"))  # noqa: SIM115
    console.print(result_tables(BenchmarkResult("set", ("a file",), (table,), {"B": "no file"})))
    text = console.export_text()
    for expected in ("a file", "0.500", "0.881", "–", "someone 2020", "a note", "B could not be made: no file"):
        assert expected in text
    assert table.to_json()["figures"][0]["ours"]["other"] is None


@pytest.mark.parametrize("dataset", DATASETS, ids=lambda each: each.name)
def test_every_dataset_has_a_command_and_is_documented(dataset: Dataset) -> None:
    assert dataset.title.split(":")[0].split(",")[0] in (REPOSITORY / "docs" / "lab" / "public-datasets.md").read_text(
        encoding="utf-8"
    )
    shown = CliRunner().invoke(app, ["benchmark", dataset.name, "--help"], env={"COLUMNS": "200"})
    assert shown.exit_code == 0
    assert dataset.title in " ".join(shown.stdout.split())
    for option in ("model", "trees", "fruit_diameter_m"):
        flag = f"--{option.removesuffix('_m').replace('_', '-')} "
        assert (flag in shown.stdout) == (option in dataset.options)


def test_a_dataset_that_is_not_there_is_named(tmp_path: Path) -> None:
    for dataset in DATASETS:
        with pytest.raises(PomonaError, match="nowhere"):
            dataset.run(tmp_path / "nowhere", tmp_path / "out", BenchmarkOptions(), Silent())
