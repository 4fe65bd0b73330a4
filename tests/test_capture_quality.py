"""Photos that are blurred or badly lit, as the checks of the app, of watching and the report's have them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pomona.stages.capture.quality import look_at, problems_of, quality_of, shares_of_usual, sharpness
from pomona.values.photos import Photo, Photos


@pytest.fixture
def photos(tmp_path: Path) -> Photos:
    """Two sides, the second softer, of seven photos of one texture: one blurred, one dark, one too bright."""
    rng = np.random.default_rng(3)
    scene = cv2.GaussianBlur(rng.uniform(0, 255, (240, 360, 3)), (0, 0), 1.2)
    made = []
    for k in range(14):
        pixels = cv2.GaussianBlur(scene, (0, 0), 1.5) if k >= 7 else scene
        pixels = {2: cv2.GaussianBlur(scene, (0, 0), 4), 3: scene / 40, 10: scene + 230}.get(k, pixels)
        path = tmp_path / f"p{k:02}.png"
        cv2.imwrite(str(path), np.clip(pixels, 0, 255).astype(np.uint8))
        made.append(Photo(path.name, path, 360, 240, side="east" if k < 7 else "west"))
    return Photos(tuple(made))


def test_bad_photos_are_named_and_others_are_not(photos: Photos) -> None:
    found = problems_of(look_at(photos, overlaps=False))
    assert found.blurred == ("p02.png",)
    assert found.dark == ("p03.png",)
    assert found.bright == ("p10.png",)
    assert found.gap == ()


def test_a_photo_alone_is_seen_as_among_others(photos: Photos) -> None:
    for among, photo in zip(look_at(photos, overlaps=False), photos, strict=True):
        alone = quality_of(photo)
        assert (among.photo, among.side) == (photo.name, photo.side)
        assert (among.sharpness, among.dark, among.bright) == (alone.sharpness, alone.dark, alone.bright)
        assert np.isnan(among.overlap)


def test_sharpness_does_not_depend_on_contrast() -> None:
    grey = np.random.default_rng(1).integers(60, 190, (80, 80)).astype(np.uint8)
    assert sharpness((grey // 2).astype(np.uint8)) == pytest.approx(sharpness(grey), rel=0.05)
    assert sharpness(np.full((20, 20), 7, np.uint8)) == 0


def test_what_is_usual_takes_three() -> None:
    assert np.isnan(shares_of_usual([1.0, 9.0], 5)).all()
    assert shares_of_usual([1.0, 2.0, 4.0], 5).tolist() == [0.5, 1.0, 2.0]
    assert shares_of_usual([1.0, 1.0, 1.0, 9.0, 9.0, 9.0], 1)[1:5].tolist() == [1.0, 1.0, 1.0, 1.0]
