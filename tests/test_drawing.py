"""Drawing: what is drawn lies where it belongs in the photo, and nothing fails at the picture's edge."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.values import drawing
from pomona.values.detections import Mask
from pomona.values.drawing import PictureFromPhoto, Square

GREY = 90


def picture(width: int = 120, height: int = 80) -> np.ndarray:
    return np.full((height, width, 3), GREY, np.uint8)


def drawn(pixels: np.ndarray) -> np.ndarray:
    """The pixels that are not grey any more."""
    return (pixels != GREY).any(axis=2)


@pytest.mark.parametrize("scale", [0.5, 1.0, 3.0])
def test_edges_of_masks_lie_around_their_pixels(scale: float) -> None:
    pixels = picture()
    mask = Mask.from_pixels(np.ones((10, 12), bool), 24, 14)
    drawing.draw_mask(pixels, mask, PictureFromPhoto(20, 10, scale), drawing.FALSE, width=1)
    rows, columns = np.nonzero(pixels[:, :, 0] > 200)
    assert (columns.min(), columns.max()) == pytest.approx((4 * scale, 16 * scale - 1), abs=1)
    assert (rows.min(), rows.max()) == pytest.approx((4 * scale, 14 * scale - 1), abs=1)


def test_masks_are_tinted_where_asked_for() -> None:
    mask = Mask.from_pixels(np.ones((10, 12), bool), 24, 14)
    for tint, inside in ((0.0, (GREY, GREY, GREY)), (0.5, (172, 81, 81))):
        pixels = picture()
        drawing.draw_mask(pixels, mask, PictureFromPhoto(20, 10, 2.0), drawing.FALSE, width=1, tint=tint)
        assert pixels[18, 20].tolist() == list(inside)


def test_what_is_outside_the_picture_is_not_drawn() -> None:
    pixels = picture()
    mask = Mask.from_pixels(np.ones((10, 12), bool), 24, 14)
    drawing.draw_mask(pixels, mask, PictureFromPhoto(200, 10, 2.0), drawing.FALSE, width=2)
    drawing.write(pixels, "far away", (500.0, 20.0))
    assert not drawn(pixels).any()
    drawing.draw_mask(pixels, mask, PictureFromPhoto(30, 18, 4.0), drawing.FALSE, width=2)  # its lower right corner
    assert drawn(pixels)[:30, :30].any()
    assert not drawn(pixels)[40:, 40:].any()


def test_text_is_moved_into_the_picture() -> None:
    letters = []
    for place in ((40.0, 40.0), (-5.0, 20.0), (100.0, 20.0), (30.0, 85.0), (30.0, 3.0)):
        pixels = picture()
        drawing.write(pixels, "fruit", place)
        letters.append(int((pixels > GREY).sum()))
    assert len(set(letters)) == 1  # whole everywhere
    assert letters[0] > 100
    pixels = picture()
    drawing.write(pixels, "Reihe Süd", (4.0, 40.0))  # a letter that OpenCV lacks
    assert drawn(pixels).any()


def test_a_sphere_without_an_outline_is_a_cross_with_its_label() -> None:
    pixels = picture()
    unknown, center = np.full((32, 2), np.nan), np.array([60.0, 40.0])
    drawing.draw_sphere(pixels, unknown, center, drawing.DOUBLE, width=3)
    assert (pixels[40, 60] == drawing.DOUBLE).all()
    assert not drawn(pixels)[:28].any()
    drawing.label_sphere(pixels, "7", unknown, center)
    assert drawn(pixels)[24:36, 60:80].any()


def test_squares_partly_outside_the_photo() -> None:
    photo = picture(40, 30)
    part = drawing.cut(photo, Square(-10, 20, 20, 20))
    assert (part[:10, 10:] == GREY).all()
    assert (part[10:] == drawing.PAPER).all()
    assert (part[:, :10] == drawing.PAPER).all()
    assert (drawing.cut(photo, Square(-50, 0, 20, 20)) == drawing.PAPER).all()
    assert drawing.cut(photo, Square(0, 0, 30, 10)).shape == (10, 10, 3)


def test_the_key_is_as_wide_as_its_words() -> None:
    entries = ((drawing.RIGHT, "12 right"), (drawing.FALSE, "3 false"))
    assert drawing.key(600, entries).shape == (drawing.KEY_PX, 600, 3)
    strip = drawing.key(10, entries, "confidence 0.50 and more")
    assert strip.shape[1] > 300
    assert (strip[:, -2:] == drawing.PAPER).all()
