"""The Fuji-SfM benchmark on miniatures whose files were written by other means than Pomona's own."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.io import loadmat

from datasets_scenes import GREEN, RED, RedSegmenter, painted, write_fuji_spheres
from fuji_miniature import write_boxes, write_miniature, write_tiles
from pomona.datasets.fuji_files import find_fuji_files
from pomona.datasets.fuji_row import read_fuji_row, read_true_trees
from pomona.datasets.fuji_sfm import benchmark_fuji_sfm, tiles_of
from pomona.datasets.row_scores import TreeCounts
from pomona.datasets.values import BenchmarkOptions, BenchmarkResult, ComparedTable
from pomona.errors import FormatError, InputError, MissingFileError, PomonaError
from pomona.formats.xyz import read_xyz, write_xyz
from pomona.progress import Silent

METHODS = ("object", "paper", "paper, text", "paper, published code")


@pytest.fixture(scope="module")
def spheres(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("spheres")
    write_fuji_spheres(root)
    return root


@pytest.fixture
def copy(spheres: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(spheres, tmp_path / "copy"))


def run(root: Path, out: Path, **options: object) -> BenchmarkResult:
    return benchmark_fuji_sfm(root, out, BenchmarkOptions(**options), Silent())  # type: ignore[arg-type]


def value(table: ComparedTable, name: str, column: str) -> float:
    return next(figure.ours[column] for figure in table.figures if figure.name == name)


@pytest.mark.slow
def test_given_cameras_masks_and_clouds_make_table_3_and_figure_8(spheres: Path, tmp_path: Path) -> None:
    result = run(spheres, tmp_path / "out")
    assert set(result.missing) == {"Table 2"}
    titles = [table.title.split(",")[0] for table in result.tables]
    assert titles == ["Table 3"] * 4 + ["Figure 8"]
    for table in result.tables[:4]:
        assert table.columns == METHODS
        for method in METHODS:
            assert value(table, "T", method) in (6, 24)
            assert value(table, "DR", method) >= 0.9
            assert 0.85 < value(table, "F1", method) <= 1
    printed = {figure.name: figure.printed for figure in result.tables[2].figures}
    assert printed["F1"] == 0.881
    assert "test trees (4; 24 apples)" in result.tables[2].title
    assert value(result.tables[4], "RMSE, %", "object") < 20
    assert (tmp_path / "out" / "fruits-paper-published-code.csv").is_file()
    assert any("west side: 7 masks" in line for line in result.found)


def test_bundler_and_mat_files_mean_the_same_photos(spheres: Path) -> None:
    row = read_fuji_row(find_fuji_files(spheres), Silent())
    assert row.cameras is not None
    assert row.detections is not None
    assert row.cloud is not None
    assert row.cameras.photos[0] == "west/IMG_0000"
    assert len(row.cameras) == len(row.detections) == 14
    # Every cloud point of a fruit projects into a mask of its side's photo, where it is in the picture.
    for i, photo in enumerate(row.cameras.photos):
        xy, _ = row.cameras.project(i, row.cameras.points_in_world)
        seen = row.cameras.track_photo_idx == i
        np.testing.assert_allclose(xy[row.cameras.track_point_idx[seen]], row.cameras.track_xy_px[seen], atol=1e-3)
        inside = [
            mask.contains(row.cameras.project(i, row.cloud.points_in_world)[0]) for mask in row.detections[photo].masks
        ]
        assert np.any(inside, axis=0).sum() > 100


def test_without_clouds_only_the_object_method_is_left_and_without_boxes_a_total(copy: Path, tmp_path: Path) -> None:
    shutil.rmtree(copy / "data" / "pt_clouds")
    shutil.rmtree(copy / "3-3D_data")
    result = run(copy, tmp_path / "out")
    (total,) = result.tables
    assert total.columns == ("object",)
    assert 27 <= value(total, "fruits found in all", "object") <= 33
    assert "no boxes" in result.missing["Table 3"]


class Steps(Silent):
    """Remembers what was begun."""

    def __init__(self) -> None:
        super().__init__()
        self.begun: list[str] = []

    def start(self, label: str, total: int | None = None) -> None:
        self.begun.append(label)


@pytest.mark.slow
@pytest.mark.parametrize("halved", [False, True])
def test_with_photos_of_the_masks_size_fruits_are_looked_at_again(halved: bool, copy: Path, tmp_path: Path) -> None:
    shutil.rmtree(copy / "data" / "pt_clouds")
    for path in (copy / "data" / "masks").rglob("*.mat"):
        label = loadmat(path)["mask"]
        pixels = np.where(label[:, :, None] > 0, RED, GREEN).astype(np.uint8)
        folder = copy / "2-SfM-set" / f"raw_images_{path.parent.name.split('_')[0]}_side"
        folder.mkdir(parents=True, exist_ok=True)
        Image.fromarray(pixels[::2, ::2] if halved else pixels).save(folder / f"{path.stem}.jpg")
    steps = Steps()
    result = benchmark_fuji_sfm(copy, tmp_path / "out", BenchmarkOptions(), steps)
    assert ("looking again" in steps.begun) != halved
    assert [warning for warning in steps.warnings if "another size than the photos" in warning] == [
        "The fruits are not looked at again: the masks have another size than the photos."
    ] * halved
    in_test_trees = next(table for table in result.tables if "test trees" in table.title and "centre" in table.title)
    assert 0.85 < value(in_test_trees, "F1", "object") <= 1


def test_masks_without_cameras_say_why_there_is_no_table_3(copy: Path, tmp_path: Path) -> None:
    shutil.rmtree(copy / "data" / "camaras")
    result = run(copy, tmp_path / "out")
    assert result.tables == ()
    assert "no cameras" in result.missing["Table 3"]


def test_one_side_alone_is_enough(copy: Path, tmp_path: Path) -> None:
    shutil.rmtree(copy / "data" / "pt_clouds")
    for path in copy.rglob("east_side*"):
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
    result = run(copy, tmp_path / "out")
    assert value(result.tables[0], "T", "object") == 6


@pytest.mark.parametrize("kind", ["json", "csv"])
def test_tiles_make_table_2_from_json_and_from_csv(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pomona.datasets.pictures.load_segmenter", lambda model: RedSegmenter())
    discs = [(40.0, 50.0, 20.0), (150.0, 90.0, 30.0), (100.0, 160.0, 16.0)]
    for name in ("training", "validation"):
        pixels, ids = painted(200, 200, discs)
        empty, nothing = painted(200, 200, [])
        folder = tmp_path / "1-Mask-set" / f"{name}_images_and_annotations"
        write_tiles(folder, name, [("_MG_1_01", pixels, ids), ("_MG_1_02", empty, nothing)])
        for unwanted in folder.glob("*.csv" if kind == "json" else "*.json"):
            unwanted.unlink()
    labelled = tiles_of(find_fuji_files(tmp_path), "validation")
    assert sorted(len(photo.fruits) for photo in labelled) == [0, 3]
    result = run(tmp_path, tmp_path / "out")
    (table,) = result.tables
    assert value(table, "AP (IoU > 0.5)", "Pomona") == pytest.approx(1.0)
    assert value(table, "R at 0.5", "Pomona") == 1.0
    assert value(table, "R at 0.95", "Pomona") == pytest.approx(1 / 3)
    assert {f.name: f.printed for f in table.figures}["AP (IoU > 0.5)"] == 0.8599
    assert set(result.missing) == {"Table 3", "Figure 8"}


def test_trees_by_column_by_position_and_training_by_name(tmp_path: Path) -> None:
    low = np.c_[np.linspace(0, 9.9, 110), np.zeros((110, 2))]
    boxes = np.c_[low, low + 0.08]
    write_boxes(tmp_path / "boxes.txt", boxes)
    known = read_true_trees(find_fuji_files(tmp_path), 11)
    counts = np.bincount(known.truth.tree_ids)[1:]
    assert counts.tolist() == [10] * 11
    assert known.training in ({1, 2, 3}, {9, 10, 11})
    assert "cutting the row into 11" in known.source
    (tmp_path / "boxes.txt").unlink()
    write_boxes(tmp_path / "boxes_training.txt", boxes[:30])
    write_boxes(tmp_path / "boxes_test.txt", boxes[30:])
    known = read_true_trees(find_fuji_files(tmp_path), 11)
    assert len(known.training) == 3
    assert sum(np.isin(known.truth.tree_ids, sorted(known.training))) == 30
    table = "x_min,y_min,z_min,x_max,y_max,z_max,tree\n" + "".join(
        ",".join(map(str, box)) + f",{1 + k // 55}\n" for k, box in enumerate(boxes)
    )
    for path in tmp_path.glob("*.txt"):
        path.unlink()
    (tmp_path / "boxes.csv").write_text(table)
    assert read_true_trees(find_fuji_files(tmp_path), 11).trees == (1, 2)


def test_r2_and_rmse_of_counts() -> None:
    counts = TreeCounts((1, 2, 3), np.array([90, 110, 130]), np.array([100, 110, 120]))
    assert counts.r2 == pytest.approx(1.0)
    assert counts.rmse_percent == pytest.approx(100 * np.sqrt(200 / 3) / 110)
    assert np.isnan(TreeCounts((1, 2), np.array([1, 2]), np.array([1, 2])).r2)


def test_text_clouds_come_back_with_and_without_ids(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("// X Y Z R G B\n1.5, 2, 3, 255, 0, 7\n-1;0;0.25;1;2;3\n")
    cloud = read_xyz(tmp_path / "a.txt")
    assert cloud.points_in_world.tolist() == [[1.5, 2, 3], [-1, 0, 0.25]]
    assert cloud.rgb.tolist() == [[255, 0, 7], [1, 2, 3]]
    write_xyz(tmp_path / "b.txt", cloud)
    assert read_xyz(tmp_path / "b.txt").points_in_world.tolist() == cloud.points_in_world.tolist()
    (tmp_path / "c.txt").write_text("0 0 0 1 2 3 7\n")
    assert read_xyz(tmp_path / "c.txt").fruit_id.tolist() == [7]


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("data/pt_clouds/east_side_pc.txt", "x y z\n1 2 3\n", "x y z\n"),
        ("data/pt_clouds/east_side_pc.txt", "0 0 0 1 2 300\n" * 3, "whole numbers from 0 to 255"),
        ("data/camaras/east_side_cameras.out", "# Bundle file v0.3\n7 3\n1 0 0\n", "line 2"),
        (
            "data/camaras/east_side_cameras.out",
            "# Bundle file v0.3\n1 0\n1 0 0\n1 0 0\n0 1 0\n0 0 1\n0 0 0\n",
            "7 masks",
        ),
        ("3-3D_data/apple_boxes_01.txt", "apple 1 at the left\n", "apple 1 at the left"),
        ("3-3D_data/apple_boxes_01.txt", "1 1 1 0.5 0.5 0.5\n1 1 1 2 2 2.5\n", "highest corner"),
        ("data/masks/east_side_masks/IMG_0003.mat", "no MATLAB file", "IMG_0003.mat"),
    ],
)
def test_broken_files_are_named_with_what_was_expected(
    copy: Path, tmp_path: Path, name: str, text: str, says: str
) -> None:
    (copy / name).write_text(text)
    with pytest.raises(PomonaError, match=says) as error:
        run(copy, tmp_path / "out")
    assert isinstance(error.value, FormatError | InputError)
    assert Path(name).name in str(error.value)


def test_photos_and_masks_of_other_order_are_refused(copy: Path, tmp_path: Path) -> None:
    folder = copy / "2-SfM-set" / "raw_images_east_side"
    folder.mkdir(parents=True)
    names = [f"IMG_{i:04d}" for i in range(7)]
    for name in names:
        Image.new("RGB", (320, 240)).save(folder / f"{name}.jpg")
    files = find_fuji_files(copy)
    assert read_fuji_row(files, Silent()).detections is not None
    for name in ("b_0000", *(f"a_{i:04d}" for i in range(1, 7))):
        (folder / f"IMG_{name[2:]}.jpg").rename(folder / f"{name}.jpg")
    with pytest.raises(InputError, match=r"IMG_0000\.mat: expected the masks of a_0001"):
        read_fuji_row(find_fuji_files(copy), Silent())


def test_folders_without_the_dataset_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="nowhere"):
        run(tmp_path / "nowhere", tmp_path / "out")
    with pytest.raises(InputError, match="found none of them"):
        run(tmp_path, tmp_path / "out")
    with pytest.raises(InputError, match="`trees`: expected at least 1"):
        BenchmarkOptions(trees=0)


@pytest.mark.slow
def test_a_rendered_row_in_the_published_formats_makes_all_tables(shared_data: Path, tmp_path: Path) -> None:
    root = tmp_path / "fuji"
    write_miniature(root, shared_data / "orchard-dev")
    result = run(root, tmp_path / "out")
    assert not result.missing
    table_2, *rest = result.tables
    assert 0.5 < value(table_2, "AP (IoU > 0.5)", "Pomona") <= 1
    inside = next(table for table in rest if "test trees" in table.title and "centre" in table.title)
    assert value(inside, "F1", "object") > 0.8
    for method in METHODS[1:]:
        assert 0.5 < value(inside, "F1", method) <= 1


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_photos_alone_are_laid_over_the_boxes(shared_data: Path, tmp_path: Path) -> None:
    root = tmp_path / "fuji"
    write_miniature(root, shared_data / "orchard-dev")
    shutil.rmtree(root / "data")
    shutil.rmtree(root / "1-Mask-set")
    result = run(root, tmp_path / "out")
    assert any("laid over the boxes" in note for note in result.tables[0].notes)
    assert value(result.tables[-2], "F1", "object") > 0.3
