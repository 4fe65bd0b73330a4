"""Mask R-CNN of torchvision from checkpoints made here: read, run, and refused where they are something else."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pomona.errors import FormatError, InputError, MissingExtraError, MissingFileError
from pomona.stages.segment import load_segmenter
from pomona.stages.segment.mask_rcnn import _paste, architecture_of, build_mask_rcnn, segment_tile
from pomona.values.detections import Mask
from segment_scenes import disc

torch = pytest.importorskip("torch", reason="needs the extra train")


@pytest.fixture(scope="module")
def state() -> dict[str, Any]:
    """The tensors of an untrained Mask R-CNN of two classes."""
    torch.manual_seed(0)
    return dict(build_mask_rcnn("maskrcnn-mobilenet", 2).state_dict())


def saved(path: Path, checkpoint: object) -> Path:
    torch.save(checkpoint, path)
    return path


def test_a_checkpoint_gives_masks_in_the_tile(state: dict[str, Any], tmp_path: Path) -> None:
    content = {"model": state, "arch": "maskrcnn-mobilenet", "score_threshold": 0.25, "typical_fruit_px": 48.0}
    segmenter = load_segmenter(saved(tmp_path / "net.pth", content), score_floor=0.0)
    assert segmenter.name.startswith("maskrcnn-mobilenet:net-")
    assert (segmenter.traits.score_threshold, segmenter.traits.typical_fruit_px) == (0.25, 48.0)
    assert segmenter.traits.tile_px == 1024
    tile = np.random.default_rng(0).integers(0, 255, (96, 128, 3), np.uint8)
    (found,) = segmenter.segment([tile])
    assert len(found) > 0, "an untrained network with a floor of 0 says a lot"
    for mask, box in zip(found.masks, found.boxes_px, strict=True):
        assert min(*mask.box_px[:2], *box[:2]) >= 0
        assert max(mask.box_px[2], box[2]) <= 128
        assert max(mask.box_px[3], box[3]) <= 96
    assert len(load_segmenter(tmp_path / "net.pth", score_floor=1.0).segment([tile])[0]) == 0


@pytest.mark.parametrize(("fruit_labels", "expected"), [((53, 55), [0.8, 0.7]), ((53,), [0.6, 0.7]), ((55,), [0.8])])
def test_a_fruit_that_is_taken_for_two_kinds_is_one_detection(
    fruit_labels: tuple[int, ...], expected: list[float]
) -> None:
    """Networks suppress what overlaps within a kind alone: an apple was counted again as an orange."""
    found = {
        "boxes": torch.tensor([[10.0, 10, 30, 30], [10, 11, 30, 30], [29, 10, 49, 30], [10, 10, 30, 30]]),
        "scores": torch.tensor([0.6, 0.8, 0.7, 0.9]),
        "labels": torch.tensor([53, 55, 53, 1]),
        "masks": torch.ones((4, 1, 28, 28)),
    }

    class Stub(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.weight = torch.nn.Parameter(torch.zeros(1))
            self.transform = lambda images: (SimpleNamespace(tensors=images[0][None], image_sizes=[(64, 64)]), None)
            self.backbone, self.rpn = (lambda _: {}), (lambda *_: ([], {}))
            self.roi_heads = lambda *_: ([found], {})

    seen = segment_tile(Stub(), np.zeros((64, 64, 3), np.uint8), fruit_labels)
    assert seen.scores.tolist() == pytest.approx(expected)


def test_a_bare_state_dict_of_parallel_training_tells_its_architecture(state: dict[str, Any], tmp_path: Path) -> None:
    bare = {f"module.{key}": value for key, value in state.items()}
    segmenter = load_segmenter(saved(tmp_path / "bare.pt", bare))
    assert segmenter.name.startswith("maskrcnn-mobilenet:bare-")
    assert segmenter.traits.score_threshold == 0.5


def test_checkpoints_of_something_else_are_refused(state: dict[str, Any], tmp_path: Path) -> None:
    def refusal(content: object) -> str:
        with pytest.raises(FormatError, match=r"x\.pt: expected") as caught:
            load_segmenter(saved(tmp_path / "x.pt", content))
        return str(caught.value)

    boxes_only = {key: value for key, value in state.items() if "mask_predictor" not in key}
    assert "no mask head" in refusal(boxes_only)
    assert "no box head" in refusal({"conv.weight": torch.zeros(3)})
    assert "found an object of list" in refusal([1, 2, 3])
    assert "architecture is 'maskrcnn-vit'" in refusal({"model": state, "arch": "maskrcnn-vit"})
    fewer = {key: value for key, value in state.items() if not key.startswith("rpn.head.cls_logits")}
    assert "missing (rpn.head.cls_logits" in refusal(fewer)
    assert "of another shape" in refusal(state | {"rpn.head.cls_logits.bias": torch.zeros(7)})


def test_files_that_are_no_checkpoint_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"nowhere\.pt: no such file"):
        load_segmenter(tmp_path / "nowhere.pt")
    (tmp_path / "text.pth").write_text("not a checkpoint")
    with pytest.raises(FormatError, match="PyTorch cannot load it"):
        load_segmenter(tmp_path / "text.pth")


def test_architectures_are_told_by_their_blocks() -> None:
    def keys(blocks: tuple[int, ...], *more: str) -> dict[str, int]:
        names = [f"backbone.body.layer{k}.{n}.conv1.weight" for k, count in enumerate(blocks, 1) for n in range(count)]
        return dict.fromkeys([*names, *more], 0)

    deep = "backbone.body.layer1.0.conv3.weight"
    assert architecture_of(Path("a"), keys((3, 4, 6, 3), deep)) == "maskrcnn-r50"
    assert architecture_of(Path("a"), keys((3, 4, 23, 3), deep)) == "maskrcnn-r101"
    assert architecture_of(Path("a"), keys((2, 2, 2, 2))) == "maskrcnn-r18"
    with pytest.raises(FormatError, match=r"ResNet of \(1, 1, 1, 1\) blocks"):
        architecture_of(Path("a"), keys((1, 1, 1, 1)))
    with pytest.raises(FormatError, match="none of these"):
        architecture_of(Path("a"), {"body.weight": 0})
    with pytest.raises(InputError, match="expected one of maskrcnn-r101"):
        build_mask_rcnn("maskrcnn-r9000", 2)


def test_without_torch_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(__import__("sys").modules, "torch", None)
    with pytest.raises(MissingExtraError, match=r"pomona\[train\]"):
        load_segmenter(tmp_path / "net.pt")


@pytest.mark.parametrize("box", [(10.0, 12.0, 58.0, 60.0), (-14.0, 5.3, 30.2, 49.5), (70.1, 40.0, 130.0, 99.9)])
def test_pasted_masks_lie_in_their_boxes(box: tuple[float, float, float, float]) -> None:
    probability = disc(28, 28, 14, 14, 14).astype(np.float32)
    mask = _paste(probability, np.array(box), 100, 80)
    assert mask is not None
    rows, columns = np.arange(80) + 0.5, np.arange(100) + 0.5
    across = (columns - (box[0] + box[2]) / 2) / ((box[2] - box[0]) / 2)
    down = (rows - (box[1] + box[3]) / 2) / ((box[3] - box[1]) / 2)
    assert mask.iou(Mask.from_pixels(across**2 + (down**2)[:, None] <= 1)) > 0.93


def test_boxes_without_area_give_no_mask() -> None:
    ones = np.ones((28, 28), np.float32)
    assert _paste(ones, np.array([10.0, 10.0, 10.0, 30.0]), 100, 80) is None
    assert _paste(ones, np.array([120.0, 10.0, 140.0, 30.0]), 100, 80) is None
    assert _paste(0 * ones, np.array([10.0, 10.0, 30.0, 30.0]), 100, 80) is None
