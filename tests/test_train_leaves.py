"""Leaves before fruits, and shade: what hides fruit hides it in the labels too."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.errors import InputError
from pomona.learning.train.augment import AugmentOptions
from pomona.learning.train.occlusion import behind_leaves
from pomona.learning.train.recolour import as_phones_show, recolour

SIZE = 160


def two_fruits() -> tuple[np.ndarray, np.ndarray]:
    """Red fruits, 40 pixels wide, before green."""
    yy, xx = np.mgrid[:SIZE, :SIZE]
    labels = np.zeros((SIZE, SIZE), np.int16)
    for k, x in enumerate((45, 115)):
        labels[(xx - x) ** 2 + (yy - 80) ** 2 < 20**2] = k + 1
    pixels = np.full((SIZE, SIZE, 3), (30, 120, 40), np.uint8)
    pixels[labels > 0] = (200, 30, 30)
    return pixels, labels


def test_leaves_hide_fruit_in_pixels_and_labels_alike() -> None:
    pixels, labels = two_fruits()
    hidden = []
    for seed in range(20):
        seen, left = behind_leaves(pixels, labels, 40.0, np.random.default_rng(seed))
        assert set(np.unique(left)) <= {0, 1, 2}
        assert not ((left > 0) & (labels == 0)).any()
        np.testing.assert_array_equal(seen[left > 0], pixels[left > 0])
        covered = (labels > 0) & (left == 0)
        # A leaf shows foliage, lighter or darker; now and then a piece of fruit where no place without was found.
        is_green = seen[covered][:, 1].astype(int) > seen[covered][:, 0]
        assert covered.sum() == 0 or is_green.mean() > 0.7
        hidden.append(covered.sum() / (labels > 0).sum())
    assert 0.1 < np.mean(hidden) < 0.7
    assert min(hidden) < 0.1
    pixels_again, labels_again = two_fruits()
    np.testing.assert_array_equal(pixels, pixels_again)
    np.testing.assert_array_equal(labels, labels_again)


def test_leaves_are_reproducible_and_need_a_fruit() -> None:
    pixels, labels = two_fruits()
    one, other = (behind_leaves(pixels, labels, 40.0, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one[0], other[0])
    np.testing.assert_array_equal(one[1], other[1])
    bare, none = behind_leaves(pixels, np.zeros_like(labels), 40.0, np.random.default_rng(3))
    np.testing.assert_array_equal(bare, pixels)
    assert not none.any()


def test_leaves_at_the_edge_stay_in_the_crop() -> None:
    labels = np.zeros((SIZE, SIZE), np.int16)
    labels[:6, :6] = 1
    labels[-6:, -6:] = 2
    for seed in range(10):
        seen, left = behind_leaves(np.full((SIZE, SIZE, 3), 90, np.uint8), labels, 90.0, np.random.default_rng(seed))
        assert seen.shape == (SIZE, SIZE, 3)
        assert left.shape == labels.shape


def test_shade_darkens_a_part_and_brightens_nothing() -> None:
    grey = np.full((SIZE, SIZE, 3), 128, np.uint8)
    spreads = [np.ptp(recolour(grey, np.random.default_rng(seed), shaded=0.4).mean(2)) for seed in range(60)]
    uneven = sum(spread > 100 for spread in spreads)
    assert 0 < uneven < 40
    assert min(spreads) < 40
    # Asked for none, nothing changes from what it was.
    plain = [recolour(grey, np.random.default_rng(seed)) for seed in range(3)]
    assert all(np.ptp(pixels.mean(2)) < 110 for pixels in plain)


def test_a_phone_evens_the_light_and_keeps_fruits_where_they_are() -> None:
    rows, columns = np.mgrid[:SIZE, :SIZE]
    disc = (rows - SIZE / 2) ** 2 + (columns - SIZE / 3) ** 2 < (SIZE / 10) ** 2
    scene = np.full((SIZE, SIZE, 3), (30, 60, 25), np.uint8)
    scene[:, SIZE // 2 :] = (120, 200, 100)  # the half in the sun
    scene[disc] = (220, 110, 30)
    for seed in range(20):
        seen = as_phones_show(scene, np.random.default_rng(seed))
        assert seen.shape == scene.shape
        assert seen.dtype == np.uint8
        red = seen[:, :, 0].astype(float) - seen[:, :, 1]
        found = red > np.median(red[disc]) / 2
        assert (found & disc).sum() > 0.7 * (found | disc).sum()  # edges are soft by two pixels of 16
        light = seen.mean(2)
        ratio = light[:, 3 * SIZE // 4 :].mean() / light[:, : SIZE // 8].mean()
        assert 1.2 < ratio < 3.9  # 3.65 in the scene
        assert np.array_equal(seen, as_phones_show(scene, np.random.default_rng(seed)))


def test_a_share_is_asked_for() -> None:
    with pytest.raises(InputError, match="`phones`: expected a share"):
        AugmentOptions(phones=-0.1)
    with pytest.raises(InputError, match="`leafy`: expected a share"):
        AugmentOptions(leafy=1.5)
