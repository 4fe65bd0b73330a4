"""Model files of eight bits say what the files of floats say that they were made of, and training goes on from them."""

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the train extra")
onnx = pytest.importorskip("onnx", reason="needs the train extra")

from pomona.basics.onnx_file import OnnxFile  # noqa: E402
from pomona.errors import FormatError  # noqa: E402
from pomona.learning.train import FitOptions  # noqa: E402
from pomona.learning.train.augment import AugmentOptions  # noqa: E402
from pomona.learning.train.center import CenterLearner  # noqa: E402
from pomona.learning.train.eight_bits import ENOUGH, in_eight_bits  # noqa: E402
from pomona.learning.train.export import export_onnx  # noqa: E402
from pomona.learning.train.fit import some_crops  # noqa: E402
from pomona.learning.train.network import FruitNet  # noqa: E402
from pomona.learning.train.rounding import rounded  # noqa: E402
from pomona.progress import Silent  # noqa: E402
from pomona.stages.segment.center_offset import CenterOffsetSegmenter  # noqa: E402
from pomona.stages.segment.load import SHIPPED_WEIGHTS, shipped_weights  # noqa: E402
from train_scenes import discs, samples_of_discs  # noqa: E402

PACKAGE = Path(__file__).parents[1] / "src" / "pomona"


@cache
def shipped() -> FruitNet:
    learner = CenterLearner.going_on_from(SHIPPED_WEIGHTS)
    network: FruitNet = learner.build(start=True, progress=Silent()).eval()
    return network


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A file of floats, and what is made of it."""
    folder = tmp_path_factory.mktemp("eight bits")
    floats, whole = folder / "floats.onnx", folder / "whole.onnx"
    export_onnx(shipped(), floats, fruit_px=(12.0, 120.0), typical_fruit_px=40.0, threshold=0.5)
    in_eight_bits(floats, whole, [discs(seed, size=160)[0] for seed in range(4)])
    return floats, whole


@pytest.mark.slow
def test_both_say_the_same_of_fruits(files: tuple[Path, Path]) -> None:
    floats, whole = (CenterOffsetSegmenter(path) for path in files)
    pixels, _ = discs(9, size=224)
    one, other = floats.maps(pixels), whole.maps(pixels)
    fruit = one.heatmap > 0.3
    assert fruit.sum() > 5
    assert np.abs(one.heatmap - other.heatmap).mean() < 0.005
    assert np.abs(one.heatmap - other.heatmap)[fruit].max() < 0.1
    assert np.abs(one.box - other.box)[:, fruit].mean() < 0.5  # of 40 px
    assert np.abs(one.foreground - other.foreground).mean() < 0.005
    assert np.abs(one.offset - other.offset)[:, one.foreground > 0.5].mean() < 1.0


@pytest.mark.slow
def test_fruits_wider_than_training_shows_are_as_wide_as_with_floats(files: tuple[Path, Path], tmp_path: Path) -> None:
    samples = samples_of_discs(tmp_path, larger=3)
    crops = some_crops(samples, CenterLearner(weights="none"), FitOptions(), ENOUGH)
    in_eight_bits(files[0], tmp_path / "whole.onnx", crops)
    floats, whole = (CenterOffsetSegmenter(path) for path in (files[0], tmp_path / "whole.onnx"))
    pixels = np.repeat(np.repeat(discs(9)[0], 4, 0), 4, 1)
    one, other = floats.maps(pixels), whole.maps(pixels)
    fruit = one.heatmap > 0.3
    widths_px = one.box[[0, 2]].sum(0)[fruit], other.box[[0, 2]].sum(0)[fruit]
    assert fruit.sum() > 50
    assert 120 < widths_px[0].mean() < 150
    assert 0.97 < widths_px[1].mean() / widths_px[0].mean() < 1.02


def test_each_fourth_crop_shows_wider_fruits_than_training(tmp_path: Path) -> None:
    plain = AugmentOptions(crop_px=96, fruit_px=(8.0, 16.0), stretch=0.0, mosaics=0.0, at_a_fruit=1.0, recolours=False)
    crops = some_crops(samples_of_discs(tmp_path), CenterLearner(weights="none"), FitOptions(augment=plain), 16)
    widest = []
    for crop in crops:
        red = (crop[:, :, 0] > 150).astype(np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(red)
        widest.append(stats[1:, cv2.CC_STAT_WIDTH].max(initial=0))
    median_px, wide = 16.0, np.array(widest)[3::4]  # fruits of a photo differ by a third from their median
    assert len(wide) == 4
    assert (wide > 1.1 * median_px).all()
    assert (wide < 2.2 * median_px).all()
    assert (np.delete(widest, np.s_[3::4]) < 1.4 * median_px).all()


@pytest.mark.slow
def test_it_is_a_third_as_large_and_its_metadata_is_the_same(files: tuple[Path, Path]) -> None:
    floats, whole = files
    assert 0.2 < whole.stat().st_size / floats.stat().st_size < 0.4
    assert OnnxFile(whole).metadata == OnnxFile(floats).metadata


@pytest.mark.slow
def test_no_two_weights_overflow_sixteen_bits(files: tuple[Path, Path]) -> None:
    assert_no_two_weights_overflow(files[1])


@pytest.mark.parametrize(
    "path",
    [
        SHIPPED_WEIGHTS, shipped_weights("citrus"), PACKAGE / "stages/second_look/weights/second_look.onnx",
        PACKAGE / "stages/measure/weights/circles.onnx",
    ],
    ids=lambda path: path.stem,
)  # fmt: skip
def test_no_two_weights_of_shipped_networks_overflow_sixteen_bits(path: Path) -> None:
    assert_no_two_weights_overflow(path)


def assert_no_two_weights_overflow(path: Path) -> None:
    """Processors without VNNI add the products of two bytes and two weights that follow each other, channels last."""
    graph = onnx.load(str(path)).graph
    found = {entry.name: onnx.numpy_helper.to_array(entry).astype(int) for entry in graph.initializer}
    made_by = {name: node for node in graph.node for name in node.output}
    used = [
        made_by[node.input[1]].input[0] for node in graph.node if node.op_type == "Conv" and node.input[1] in made_by
    ]
    weights = [found[name] for name in used if name in found]
    assert len(weights) > 10
    assert 64 < max(np.abs(each).max() for each in weights) <= 127
    for each in weights:
        if each.shape[1] > 1:  # others have a channel each, whose products are added in 32 bits
            in_order = np.abs(each.transpose(0, 2, 3, 1).reshape(len(each), -1))
            in_order = np.pad(in_order, ((0, 0), (0, in_order.shape[1] % 2)))
            assert (in_order[:, ::2] + in_order[:, 1::2]).max() <= 128


def test_rounding_together_is_nearer_than_one_by_one() -> None:
    rng = np.random.default_rng(0)
    mixing = rng.standard_normal((3, 40, 40)) / 6 + np.eye(40)  # inputs of a group go together
    inputs = np.maximum(rng.standard_normal((3, 900, 40)) @ mixing, 0)
    weights = rng.standard_normal((3, 5, 40))
    least = np.full((3, 5), 0.05)
    for in_pairs in (False, True):
        found = rounded(weights, inputs[:, :600], least, in_pairs=in_pairs)
        assert (found.scales >= least).all()
        if in_pairs:
            assert (np.abs(found.whole[:, :, ::2]) + np.abs(found.whole[:, :, 1::2])).max() <= 128
        one_by_one = np.clip(np.rint(weights / found.scales[:, :, None]), -127, 127) * found.scales[:, :, None]
        together = found.whole * found.scales[:, :, None]
        # On inputs that it has not seen.
        off_apart = np.einsum("gok,gnk->gon", weights - one_by_one, inputs[:, 600:])
        off_together = np.einsum("gok,gnk->gon", weights - together, inputs[:, 600:]) - found.shortfalls[:, :, None]
        assert 0.05 < off_together.std() / off_apart.std() < 0.85
        assert np.abs(off_together.mean(2)).max() < np.abs(off_apart.mean(2)).max() / 2


def test_inputs_that_are_always_zero_leave_weights_as_they_are_rounded() -> None:
    weights = np.array([[[1.0, -0.5, 0.25]]])
    found = rounded(weights, np.zeros((1, 50, 3)), np.full((1, 1), 1e-12), in_pairs=False)
    np.testing.assert_array_equal(found.whole, [[[127, -64, 32]]])
    np.testing.assert_array_equal(found.shortfalls, [[0.0]])


@pytest.mark.slow
def test_training_goes_on_from_what_a_file_of_eight_bits_stands_for(files: tuple[Path, Path]) -> None:
    learners = (CenterLearner.going_on_from(path) for path in files)
    floats, whole = (learner.build(start=True, progress=Silent()).eval() for learner in learners)
    image = torch.from_numpy(discs(9, size=96)[0]).permute(2, 0, 1)[None].float()
    with torch.no_grad():
        for one, other in zip(floats(image), whole(image), strict=True):
            assert 0 < float((one - other).abs().mean()) < 0.1 * float(one.abs().mean()) + 0.1


def test_what_is_of_eight_bits_already_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"fruit\.onnx: expected a network of floats, as `pomona train` exports it"):
        in_eight_bits(SHIPPED_WEIGHTS, tmp_path / "again.onnx", [discs(0, size=96)[0]])
    assert not (tmp_path / "again.onnx").exists()
