"""Trainings of the networks of crops (`benchmarks/`): what crops ask for, and that files and checkpoints go on."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the train extra")

import crop_training  # noqa: E402
import train_circles  # noqa: E402
import train_second_look  # noqa: E402
from pomona.stages.measure.circle_network import CirclesNetwork  # noqa: E402
from pomona.stages.second_look import CentersNetwork  # noqa: E402
from synth_scenes import rough_row  # noqa: E402

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
FRUIT = (96.0, 96.0, 17.0, 0.8)  # x, y, radius, share seen

Fruit = tuple[float, float, float, float]


def patches(n: int, side_px: int, fruit: Fruit | None) -> torch.Tensor:
    """Patches (n, side, side, 4), dark, with the fruit's disc in the channel of likeness."""
    x, y = np.meshgrid(np.arange(side_px) + 0.5, np.arange(side_px) + 0.5)
    patch = np.full((side_px, side_px, 4), 60, np.uint8)
    if fruit is not None:
        patch[np.hypot(x - fruit[0], y - fruit[1]) < fruit[2], 3] = 180
    return torch.from_numpy(np.repeat(patch[None], n, 0))


def labels(n: int, fruit: Fruit) -> torch.Tensor:
    """The labels (n, 4) of patches that all show that fruit."""
    return torch.tensor([fruit] * n, dtype=torch.float32)


def seen_disc(crop: torch.Tensor) -> tuple[np.ndarray, float]:
    """The middle and radius of what is like fruit in a crop (4, side, side)."""
    like = crop[3].numpy()
    rows, columns = np.nonzero(like > (like.max() + like.min()) / 2)
    return np.array([columns.mean() + 0.5, rows.mean() + 0.5]), float(np.sqrt(len(rows) / np.pi))


@pytest.mark.parametrize("varied", [False, True])
def test_peaks_stay_on_fruits_however_crops_are_turned(varied: bool) -> None:
    how = train_second_look.Crops(radius_px=16, side_px=96)
    torch.manual_seed(3)
    crops, targets, weights = train_second_look.crops_of(
        patches(12, how.patch_px, FRUIT), labels(12, FRUIT)[:, None], how, varied
    )
    assert crops.shape == (12, 4, 96, 96)
    assert weights.min() == 1
    off = []
    for crop, target in zip(crops, targets[:, 0], strict=True):
        middle, _ = seen_disc(crop)
        row, column = np.unravel_index(int(target.argmax()), target.shape)
        off.append(np.hypot(*(middle - (np.array([column, row]) + 0.5) * train_second_look.STRIDE)))
        assert 0.8 < float(target.max()) <= 1
    assert max(off) < 1.6  # a cell is two pixels wide
    moved = np.ptp([seen_disc(crop)[0] for crop in crops], axis=0)
    assert (moved > 5).all() if varied else (moved < 1e-6).all()


def test_fruits_of_other_sizes_and_hardly_seen_ones_count_neither_way() -> None:
    how = train_second_look.Crops(radius_px=16, side_px=96)
    small, hidden = [96.0, 96.0, 7.0, 0.8], [96.0, 96.0, 16.0, 0.02]
    told = torch.tensor([[small], [hidden], [[np.nan] * 4]], dtype=torch.float32)
    _, targets, weights = train_second_look.crops_of(patches(3, how.patch_px, None), told, how, False)
    assert targets.max() < 1e-6
    assert weights[:2, 0, 24, 24].tolist() == [0, 0]
    assert 0.9 < float(weights[:2].mean()) < 1
    assert weights[2].min() == 1


def test_circles_follow_fruits_however_crops_are_turned() -> None:
    how = train_circles.HOW
    middle = how.patch_px / 2
    fruit = (middle + 2, middle - 3, 0.9 * how.radius_px, 0.9)
    torch.manual_seed(4)
    crops, wanted = train_circles.crops_of(patches(12, how.patch_px, fruit), labels(12, fruit), True)
    for crop, (right, down, log_radius) in zip(crops, wanted.numpy(), strict=True):
        found, found_radius = seen_disc(crop)
        assert np.hypot(*(found - how.side_px / 2 - how.radius_px * np.array([right, down]))) < 1
        assert found_radius == pytest.approx(how.radius_px * np.exp(log_radius), rel=0.06)
    assert np.ptp(wanted[:, 2].numpy()) > 0.05


@pytest.mark.parametrize(("n", "held_out"), [(3, 1), (7, 2), (40, 10)])
def test_of_all_folders_together_a_share_is_measured_on(n: int, held_out: int) -> None:
    pictures = [(np.full((k, 2, 2, 4), k, np.uint8), np.full((k, 4), k, np.float32)) for k in (0, 1, n - 1)]
    mixed = crop_training.Mixed.of([pictures[:2], pictures[2:]], 0.25)
    assert mixed.learnt == n - held_out
    of_folders = mixed.patches[:, 0, 0, 0].numpy()
    assert sorted(of_folders) == [1] + [n - 1] * (n - 1)
    np.testing.assert_array_equal(mixed.labels[:, 0].numpy(), of_folders)
    np.testing.assert_array_equal(mixed.parts, (of_folders == n - 1).astype(int))


@pytest.mark.parametrize("n", [0, 1])
def test_too_few_fruits_to_train_on_are_named(n: int) -> None:
    folders = [[(np.zeros((n, 2, 2, 4), np.uint8), np.zeros((n, 4), np.float32))], []]
    with pytest.raises(SystemExit, match=f"2 fruits or more to train on; found {n} in 2 folders"):
        crop_training.Mixed.of(folders, 0.25)


@pytest.fixture(scope="module")
def row(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return rough_row(tmp_path_factory.mktemp("rows") / "row", width_px=400, height_px=600)


def trained(name: str, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, str(BENCHMARKS / f"{name}.py"), *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_training_of_centres_goes_on_and_its_file_is_one_to_look_with(row: Path, tmp_path: Path) -> None:
    file = tmp_path / "new.onnx"
    small = ("--radius", "8", "--side", "48", "--file-side", "40", "--batch", "4", "--widths", "4", "6", "8", "8")
    assert "\n2 " in trained("train_second_look", str(file), str(row), "--steps", "2", *small)
    longer = trained("train_second_look", str(file), str(row), "--steps", "3", *small)
    assert "\n3 " in longer
    assert "\n2 " not in longer
    network = CentersNetwork(file)
    crops = np.random.default_rng(0).integers(0, 255, (5, 40, 40, 4), np.uint8)
    maps = network.centers(crops)
    assert maps.shape == (5, 20, 20)
    assert 0 < maps.min() < maps.max() < 0.5
    again = train_second_look.CentersNet((4, 6, 8, 8))
    as_seen = torch.from_numpy(crops).permute(0, 3, 1, 2).float()
    crop_training.fill_from_file(again, file, as_seen)
    np.testing.assert_allclose(torch.sigmoid(again.eval()(as_seen))[:, 0].detach().numpy(), maps, atol=1e-4)


@pytest.mark.slow
def test_a_training_of_circles_goes_on_and_its_file_is_one_to_measure_with(row: Path, tmp_path: Path) -> None:
    file = tmp_path / "new.onnx"
    assert "\n1 " in trained("train_circles", str(file), str(row), "--steps", "1", "--batch", "4")
    longer = trained("train_circles", str(file), str(row), "--steps", "2")
    assert "\n2 " in longer
    assert "\n1 " not in longer
    side_px = CirclesNetwork(file).side_px
    circles = CirclesNetwork(file).circles(np.full((3, side_px, side_px, 4), 90, np.uint8))
    assert circles.shape == (3, 6)
    assert np.abs(circles[:, :3]).max() < 1
