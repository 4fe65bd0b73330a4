"""Training of Mask R-CNN: what it is told of a crop and starts from, a loss that falls, a stop without a trace."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.error import URLError

import numpy as np
import pytest
from typer.testing import CliRunner

torch = pytest.importorskip("torch", reason="needs the train extra")
torchvision = pytest.importorskip("torchvision", reason="needs the train extra")

from pomona.cli.app import app  # noqa: E402
from pomona.errors import FormatError, InputError  # noqa: E402
from pomona.learning.train import FitOptions, options_for, train  # noqa: E402
from pomona.learning.train.augment import AugmentOptions  # noqa: E402
from pomona.learning.train.crop import TrainingCrop  # noqa: E402
from pomona.learning.train.fit import Batches, fit  # noqa: E402
from pomona.learning.train.learner import ModelSettings  # noqa: E402
from pomona.learning.train.mask_rcnn import MaskRcnnLearner, target_of  # noqa: E402
from pomona.learning.train.samples import IGNORED, Sample  # noqa: E402
from pomona.learning.train.training_state import TrainingState  # noqa: E402
from pomona.progress import Silent  # noqa: E402
from pomona.stages.segment import load_segmenter  # noqa: E402
from pomona.stages.segment import mask_rcnn as detectors  # noqa: E402
from train_scenes import coco_folder, discs, samples_of_discs  # noqa: E402

SMALL = FitOptions(
    steps=4,
    batch=1,
    optimiser="sgd",
    learning_rate=0.02,
    weight_decay=1e-4,
    warm_up=2,
    average=0.0,
    check_every=2,
    checked_photos=1,
    workers=0,
    threads=1,
    augment=AugmentOptions(crop_px=64, fruit_px=(20, 30), mosaics=0.0, copy_paste=0.3, recolours=False),
)


@pytest.fixture
def samples(tmp_path: Path) -> list[Sample]:
    return samples_of_discs(tmp_path, 5)


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """An untrained network proposes a thousand fruits and finds hundreds, and most of its weights and of its work are
    in the heads of boxes and masks: that takes seconds."""
    build = detectors.build_mask_rcnn

    def small(arch: str, classes: int) -> Any:
        faster_rcnn, mask_rcnn = (getattr(torchvision.models.detection, name) for name in ("faster_rcnn", "mask_rcnn"))
        network = build(arch, classes)
        network.rpn._post_nms_top_n = {"training": 50, "testing": 50}
        network.roi_heads.detections_per_img = 8
        network.roi_heads.box_head = faster_rcnn.TwoMLPHead(256 * 7 * 7, 64)
        network.roi_heads.box_predictor = faster_rcnn.FastRCNNPredictor(64, classes)
        network.roi_heads.mask_head = mask_rcnn.MaskRCNNHeads(256, (64,), 1)
        network.roi_heads.mask_predictor = mask_rcnn.MaskRCNNPredictor(64, 64, classes)
        return network

    monkeypatch.setattr(detectors, "build_mask_rcnn", small)
    monkeypatch.setattr("pomona.learning.train.mask_rcnn.build_mask_rcnn", small)


def learner(arch: str = "maskrcnn-r18", weights: str | None = "none") -> MaskRcnnLearner:
    return MaskRcnnLearner(arch, weights=weights, proposals=16)


def test_a_crop_s_target_has_boxes_masks_and_doubts() -> None:
    labels = np.zeros((64, 64), np.int16)
    labels[10:30, 10:30], labels[40:50, 40:50], labels[10:30, 28:30] = 1, 3, IGNORED
    boxes = np.array([[10.0, 10, 30, 30], [np.nan] * 4, [40, 40, 50, 50]])
    crop = TrainingCrop(np.zeros((64, 64, 3), np.uint8), labels, boxes, np.array([[0.0, 0, 8, 8], [5, 5, 5.5, 9]]))
    target = target_of(crop)
    assert target["labels"].tolist() == [1, 1, -1], "and nothing of the box that is half a pixel wide"
    assert target["boxes"].tolist() == [[10, 10, 30, 30], [40, 40, 50, 50], [0, 0, 8, 8]]
    first = target["masks"][0]
    assert (first == 1).sum() == 20 * 18
    assert (first == 0.5).sum() == 20 * 2
    assert (target["masks"][1] == 1).sum() == 100
    nothing = target_of(TrainingCrop(crop.pixels, np.zeros_like(labels), np.zeros((0, 4))))
    assert nothing["boxes"].shape == (0, 4)
    assert nothing["masks"].shape == (0, 64, 64)


@pytest.mark.usefixtures("few")
def test_doubtful_fruits_are_neither_wanted_nor_punished() -> None:
    pixels = discs(0)[0]
    one = learner()
    network = one.build(start=True, progress=Silent()).train()
    network.roi_heads.fg_bg_sampler.positive_fraction = 1.0
    sampled = []
    select = network.roi_heads.select_training_samples

    def spy(proposals: Any, targets: Any) -> Any:
        result = select(proposals, targets)
        sampled.extend(zip(result[0], result[2], strict=True))
        return result

    network.roi_heads.select_training_samples = spy
    nobody = TrainingCrop(
        pixels[:96, :96], np.zeros((96, 96), np.int16), np.zeros((0, 4)), np.array([[20.0, 20, 80, 80]])
    )
    total, each = one.loss(network, one.batch_of([nobody]))
    assert np.isfinite(float(total))
    assert set(each) == set(one.losses)
    ((places, kinds),) = sampled
    assert kinds.max() <= 0
    overlap = torchvision.ops.box_iou(places, torch.tensor([[20.0, 20, 80, 80]]))[:, 0]
    assert (overlap < 0.5).all()


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_the_loss_of_a_batch_seen_again_and_again_falls(samples: list[Sample], tmp_path: Path) -> None:
    one = learner()
    run = TrainingState(one, tmp_path, SMALL, photos="", progress=Silent())
    batch = Batches(samples, one, steps=1, batch=1, seed=4, augment=SMALL.augment)[0]

    def loss() -> float:
        torch.manual_seed(0)  # of the proposals that are sampled
        return float(one.loss(run.average.train(), batch)[0])

    before = loss()
    for _ in range(8):
        run.learn(batch)
    assert run.step == 8
    assert 0 < loss() < 0.7 * before


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_a_stop_leaves_no_trace(samples: list[Sample], tmp_path: Path) -> None:
    one, halves = learner("maskrcnn-mobilenet"), (samples[:4], samples[4:])
    network = fit(one, *halves, tmp_path / "once", options=SMALL)

    class Stops(Silent):
        def advance(self, units: int = 1) -> None:
            self.done = getattr(self, "done", 0) + units
            if self.done == 3:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit(one, *halves, tmp_path / "twice", options=SMALL, progress=Stops())
    assert torch.load(tmp_path / "twice" / "last.pt", weights_only=True)["step"] == 2
    again = fit(one, *halves, tmp_path / "twice", options=SMALL)
    log = (tmp_path / "once" / "log.csv").read_text()
    assert (tmp_path / "twice" / "log.csv").read_text() == log
    for mine, theirs in zip(again.state_dict().values(), network.state_dict().values(), strict=True):
        assert torch.equal(mine, theirs)
    assert log.startswith("step,objectness,proposal,classifier,box,mask,ap50,f1")

    one.export(again, tmp_path / "net.pt", ModelSettings(threshold=0.4, fruit_px=25))
    segmenter = load_segmenter(tmp_path / "net.pt", score_floor=0.05)
    assert segmenter.name.startswith("maskrcnn-mobilenet:net-")
    assert (segmenter.traits.score_threshold, segmenter.traits.typical_fruit_px) == (0.4, 25)
    (theirs,) = segmenter.segment([samples[4].pixels()])
    mine = one.segment(again, samples[4].pixels())
    np.testing.assert_allclose(theirs.boxes_px, mine.boxes_px, atol=1e-2)
    np.testing.assert_allclose(theirs.scores, mine.scores, atol=1e-4)


def test_a_file_of_weights_fills_what_it_fits(tmp_path: Path) -> None:
    torch.manual_seed(1)
    published = detectors.build_mask_rcnn("maskrcnn-r18", 91).state_dict()
    old = {key.replace("rpn.head.conv.0.0.", "rpn.head.conv."): value for key, value in published.items()}
    old = {key.replace(".0.weight", ".weight") if "fpn.inner" in key else key: value for key, value in old.items()}
    old = {key.replace("mask_head.2.0.", "mask_head.mask_fcn3."): value for key, value in old.items()}
    assert len(old.keys() - published.keys()) >= 4
    torch.save(old, tmp_path / "coco.pth")
    told = Silent()
    state = learner(weights=str(tmp_path / "coco.pth")).build(start=True, progress=told).state_dict()
    assert told.warnings == []
    for key in ("rpn.head.conv.0.0.weight", "backbone.fpn.inner_blocks.1.0.weight", "roi_heads.mask_head.2.0.bias"):
        assert torch.equal(state[key], published[key])
    boxes, masks = "roi_heads.box_predictor.bbox_pred.bias", "roi_heads.mask_predictor.mask_fcn_logits.bias"
    assert torch.equal(state[masks], published[masks][[0, 53]]), "background and COCO's apple"
    assert torch.equal(state[boxes][4:], published[boxes][4 * 53 : 4 * 54])

    body = torchvision.models.resnet18().state_dict()
    torch.save(body, tmp_path / "classifier.pth")
    state = learner(weights=str(tmp_path / "classifier.pth")).build(start=True, progress=told).state_dict()
    assert torch.equal(state["backbone.body.layer4.1.conv2.weight"], body["layer4.1.conv2.weight"])
    assert "start anew (backbone.fpn, roi_heads." in told.warnings[0]

    for weights, said in (
        (body, "found those of maskrcnn-r18: give `arch` maskrcnn-r18"),
        ({"a": torch.ones(1)}, "are a"),
    ):
        torch.save(weights, tmp_path / "other.pth")
        with pytest.raises(FormatError, match=said):
            learner("maskrcnn-r34", str(tmp_path / "other.pth")).build(start=True, progress=told)
    (tmp_path / "other.pth").write_bytes(b"broken")
    with pytest.raises(FormatError, match=r"other\.pth: expected weights of a Mask R-CNN"):
        learner(weights=str(tmp_path / "other.pth")).build(start=True, progress=told)


def test_published_weights_are_asked_for_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def offline(url: str, *_: object, **__: object) -> None:
        asked.append(url.rsplit("/", 1)[1])
        raise URLError("no route to host")

    monkeypatch.setattr("torchvision.models._api.load_state_dict_from_url", offline)
    for arch, weights in (("maskrcnn-r18", None), ("maskrcnn-mobilenet", None), ("maskrcnn-mobilenet", "imagenet")):
        with pytest.raises(InputError, match=r"could not be downloaded .*no route.*give it as `weights`, or put it in"):
            learner(arch, weights).build(start=True, progress=Silent())
    assert [name.split("-")[0] for name in asked] == [
        "resnet18",
        "fasterrcnn_mobilenet_v3_large_fpn",
        "mobilenet_v3_large",
    ]
    assert learner("maskrcnn-r50", None).weights == "coco"
    learner("maskrcnn-r18", None).build(start=False, progress=Silent())  # from a checkpoint: nothing is downloaded
    assert len(asked) == 3
    with pytest.raises(InputError, match="publishes COCO weights for maskrcnn-r50 and maskrcnn-mobilenet, not for"):
        learner("maskrcnn-r101", "coco")


def test_from_nothing_batch_normalisation_learns() -> None:
    network = learner("maskrcnn-mobilenet").build(start=True, progress=Silent())
    kinds = {type(module).__name__ for module in network.backbone.body.modules()}
    assert "BatchNorm2d" in kinds
    assert "FrozenBatchNorm2d" not in kinds


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_a_network_from_nothing_comes_to_find_discs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detectors, "_DETECTIONS_PER_TILE", 20)
    folder = coco_folder(tmp_path / "discs", 24)
    options = options_for("maskrcnn-r18")
    augment = AugmentOptions(crop_px=160, fruit_px=(24, 36), mosaics=0.0, copy_paste=0.3)
    small = replace(options.fit, steps=60, batch=2, learning_rate=0.01, warm_up=5, average=0.9, augment=augment)
    small = replace(small, check_every=30, checked_photos=2)
    scores = train([folder], tmp_path / "net.pt", options=replace(options, weights="none", fit=small))
    assert scores.ap50 > 0.6
    (found,) = load_segmenter(tmp_path / "net.pt").segment([discs(99)[0]])
    assert len(found) > 0
    rows = (tmp_path / "net.training" / "log.csv").read_text().splitlines()
    assert len(rows) == 3
    assert (tmp_path / "net.training" / "curves.svg").is_file()


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_the_command_trains_and_says_how_well(tmp_path: Path) -> None:
    folder = coco_folder(tmp_path / "discs", 24)
    out = tmp_path / "net.pt"
    command = ["train", str(folder), "--out", str(out), "--arch", "maskrcnn-mobilenet", "--weights", "none"]
    done = CliRunner().invoke(app, [*command, "--epochs", "1", "--batch", "10", "--crop", "64", "--workers", "0"])
    assert done.exit_code == 0, done.stderr
    # An epoch from nothing hardly teaches it where a disc is.
    assert re.search(
        r": on \d+ fruits of photos held out, (AP50 0\.\d+, F1 |nothing that was found is right)", done.stdout
    )
    assert ("AP50" in done.stdout) != ("train for longer" in done.stderr)
    assert torch.load(out, weights_only=True)["arch"] == "maskrcnn-mobilenet"
    other = CliRunner().invoke(app, [*command[:4], "--arch", "maskrcnn-r18", "--weights", "none"])
    assert isinstance(other.exception, InputError) or other.exit_code != 0
    assert "begun with arch maskrcnn-mobilenet, now maskrcnn-r18" in other.stderr + str(other.exception)
