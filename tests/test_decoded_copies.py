"""Small copies of photos are kept: what is read is the same, belongs to who asked, and does not outlive its file."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pomona.errors import LostFileError
from pomona.stages.capture import load_photos, read_pixels
from pomona.stages.capture.decoded_copies import DecodedCopies
from pomona.values.photos import Photo


@pytest.fixture
def photo(tmp_path: Path) -> Photo:
    pixels = np.random.default_rng(0).integers(0, 255, (30, 40, 3), np.uint8).repeat(8, 0).repeat(8, 1)
    Image.fromarray(pixels).save(tmp_path / "a.jpg", quality=95)
    return next(iter(load_photos([tmp_path], min_photos=1)))


def test_what_is_read_again_is_the_same_and_is_decoded_once(photo: Photo, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, small, smaller = (read_pixels(photo, max_side_px=side) for side in (None, 80, 60))
    decoded = []
    monkeypatch.setattr("pomona.stages.capture.images._rgb", decoded.append)
    for side, before in ((None, whole), (80, small), (60, smaller)):
        np.testing.assert_array_equal(read_pixels(photo, max_side_px=side), before)
    assert not decoded


def test_pixels_belong_to_who_asked(photo: Photo) -> None:
    before = read_pixels(photo, max_side_px=80).copy()
    read_pixels(photo, max_side_px=80)[:] = 0
    np.testing.assert_array_equal(read_pixels(photo, max_side_px=80), before)


def test_a_file_that_was_changed_or_is_gone_is_told_of(photo: Photo) -> None:
    read_pixels(photo, max_side_px=80)
    Image.new("RGB", (320, 240), "red").save(photo.path)
    with pytest.raises(LostFileError, match="was changed"):
        read_pixels(photo, max_side_px=80)
    photo.path.unlink()
    with pytest.raises(LostFileError, match="is gone"):
        read_pixels(photo, max_side_px=80)


def test_no_more_is_kept_than_there_is_room_for() -> None:
    copies = DecodedCopies(largest_bytes=300, kept_bytes=1000)
    arrays = [np.full((10, 10, 3), k, np.uint8) for k in range(20)]
    for k, array in enumerate(arrays):
        copies.keep(k, array)
        kept = [j for j in range(20) if copies.get(j) is not None]
        assert len(kept) == min(k + 1, 3)
    assert all(copies.get(j) is arrays[j] for j in kept)
    assert copies.fits(arrays[0])
    assert not copies.fits(np.zeros((11, 10, 3), np.uint8))
    copies.keep(kept[0], arrays[kept[0]])  # once more: no further room
    assert all(copies.get(j) is not None for j in kept)
