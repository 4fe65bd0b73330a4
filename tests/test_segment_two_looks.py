"""A tile seen at two sizes: what a perfect network says of each comes together where the fruits are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from pomona.errors import FormatError
from pomona.stages.capture import load_photos
from pomona.stages.segment import SegmentOptions, load_segmenter, segment_photos
from pomona.stages.segment.center_offset import CenterOffsetSegmenter, ModelMetadata
from pomona.stages.segment.decode import DecodeOptions, Maps, decode
from pomona.stages.segment.two_looks import padded, seen_at_two_sizes, seen_with_mirror_image
from pomona.values.detections import Mask
from segment_scenes import disc, write_disc_model
from test_segment_onnx import METADATA, red_image

STRIDE = 4
DISCS = [(40.0, 44.0), (120.0, 50.0), (203.0, 140.0), (68.0, 130.0)]


def perfect_look(tile: np.ndarray) -> Maps:
    """What a perfect network says of red discs, whatever their size."""
    h, w = tile.shape[0] // STRIDE, tile.shape[1] // STRIDE
    red = (tile[:, :, 0] > 150).astype(np.uint8)
    count, _, stats, _ = cv2.connectedComponentsWithStats(red)
    rows, columns = np.mgrid[:h, :w]
    x, y = (columns + 0.5) * STRIDE, (rows + 0.5) * STRIDE
    heat, best = np.zeros((h, w)), np.full((h, w), np.inf)
    box, offset, circle = np.ones((4, h, w)), np.zeros((2, h, w)), np.zeros((5, h, w))
    for k in range(1, count):
        x0, y0, wide, high, _ = stats[k]
        cx, cy, radius = x0 + wide / 2, y0 + high / 2, (wide + high) / 4
        far = np.hypot(x - cx, y - cy) / radius
        near = far < best
        best[near] = far[near]
        heat = np.maximum(heat, 0.9 * np.exp(-2 * far**2))
        box[:, near] = np.array([x - x0, y - y0, x0 + wide - x, y0 + high - y])[:, near]
        offset[:, near] = np.array([cx - x, cy - y])[:, near]
        full = np.full((h, w), radius)
        circle[:, near] = np.array([cx - x, cy - y, full, 0.1 * full, 0.2 * full])[:, near]
    foreground = cv2.resize(red.astype(np.float32), (w, h), interpolation=cv2.INTER_AREA)
    as_floats = (np.asarray(maps, np.float32) for maps in (heat, box, foreground, offset))
    return Maps(*as_floats, STRIDE, np.asarray(circle, np.float32))


@pytest.mark.parametrize("larger", [1.25, 1.5, 2.0])
def test_discs_stay_where_they_are(larger: float) -> None:
    image = red_image(250, 190, DISCS)  # no multiples of 32
    maps = seen_at_two_sizes(perfect_look, image, larger, 32)
    assert maps.heatmap.shape == (192 // STRIDE, 256 // STRIDE)
    found = decode(maps, 250, 190, DecodeOptions(score_threshold=0.4))
    assert len(found) == len(DISCS)
    assert found.circles_px is not None
    for box, circle, mask in zip(found.boxes_px, found.circles_px, found.masks, strict=True):
        at = DISCS[int(np.argmin([np.hypot(*(mask.center_px - centre)) for centre in DISCS]))]
        assert mask.iou(Mask.from_pixels(disc(250, 190, *at, 20))) > 0.9
        assert box == pytest.approx([at[0] - 20, at[1] - 20, at[0] + 20, at[1] + 20], abs=1.5)
        assert circle == pytest.approx([*at, 20, 2, 4], abs=1.5)


class LessSure:
    """Says 0.9 everywhere when it looks first, and 0.5 later; remembers the tiles that it has `seen`."""

    def __init__(self) -> None:
        self.seen: list[np.ndarray] = []

    def __call__(self, tile: np.ndarray) -> Maps:
        self.seen.append(tile)
        maps = perfect_look(tile)
        says = np.full_like(maps.heatmap, 0.9 if len(self.seen) == 1 else 0.5)
        return replace(maps, heatmap=says, foreground=says, circle=None)


def test_the_other_size_sees_the_tile_mirrored_and_odds_are_averaged() -> None:
    image = red_image(96, 64, [(30.0, 30.0)])
    look = LessSure()
    maps = seen_at_two_sizes(look, image, 1.5, 32)
    assert (look.seen[0] == image[:, ::-1]).all()
    assert look.seen[1].shape == (64, 64, 3)
    assert (look.seen[1][43:] == 114).all()
    assert maps.circle is None
    assert maps.heatmap == pytest.approx(np.full((16, 24), 0.75))  # odds of 9 and 1: 3


def test_of_an_enlarged_tile_the_smaller_look_alone_says_where_fruits_are() -> None:
    image = red_image(96, 64, [(30.0, 30.0)])
    look = LessSure()
    maps = seen_at_two_sizes(look, image, 1.5, 32, enlarged=True)
    assert len(look.seen) == 2
    assert maps.heatmap == pytest.approx(np.full((16, 24), 0.5), abs=1e-3)
    assert maps.foreground == pytest.approx(np.full((16, 24), 0.75), abs=1e-3)  # both say whose the pixels are


def test_padding_is_grey_and_at_the_right_and_below() -> None:
    tile = np.full((33, 64, 3), 7, np.uint8)
    whole = padded(tile, 32)
    assert whole.shape == (64, 64, 3)
    assert (whole[:33] == 7).all()
    assert (whole[33:] == 114).all()


def test_a_mirror_image_changes_nothing_for_a_perfect_network() -> None:
    image = red_image(250, 190, DISCS)
    once, twice = perfect_look(padded(image, 32)), seen_with_mirror_image(perfect_look, image, 32)
    assert twice.heatmap == pytest.approx(once.heatmap, abs=1e-3)
    seen = once.heatmap > 0.2
    assert twice.box[:, seen] == pytest.approx(once.box[:, seen], abs=1e-3)
    assert twice.offset[:, seen] == pytest.approx(once.offset[:, seen], abs=1e-3)
    assert twice.circle is not None
    assert once.circle is not None
    assert twice.circle[:, seen] == pytest.approx(once.circle[:, seen], abs=1e-3)


def test_a_model_file_says_how_much_larger_photos_are_read() -> None:
    read = ModelMetadata.parse(Path("m.onnx"), METADATA | {"pomona.larger": "1.5"})
    assert read.larger == 1.5
    assert read.traits.typical_fruit_px == 40
    assert read.closer().typical_fruit_px == 60
    assert read.closer().fruit_px == (18, 180)
    assert read.closer().min_overlap_px >= 120
    assert ModelMetadata.parse(Path("m.onnx"), METADATA).larger == 1
    for wrong in ("0.5", "nan", "large", "9"):
        with pytest.raises(FormatError, match=r"pomona\.larger"):
            ModelMetadata.parse(Path("m.onnx"), METADATA | {"pomona.larger": wrong})


@pytest.mark.parametrize(("scale", "read_px"), [(0.5, 150), (0.78, 234), (0.85, 255), (1.3, 390), (1.4, 280)])
def test_photos_are_read_larger_where_that_is_not_mostly_blur(
    scale: float, read_px: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("onnx", reason="the model of this test is made with onnx (extra train)")
    model = write_disc_model(tmp_path / "discs.onnx", metadata=METADATA | {"pomona.larger": "1.5"})
    side = 200
    Image.fromarray(red_image(side, side, [(100.0, 100.0)])).save(tmp_path / "a.png")
    photos = load_photos([tmp_path / "a.png"], min_photos=1)
    widths: list[int] = []
    of_file = CenterOffsetSegmenter._look

    def look(self: CenterOffsetSegmenter, tile: np.ndarray) -> Maps:
        widths.append(tile.shape[1])
        return of_file(self, tile)

    monkeypatch.setattr(CenterOffsetSegmenter, "_look", look)
    found = segment_photos(photos, load_segmenter(model), options=SegmentOptions(scale=scale))
    assert found["a.png"].width_px == side
    usual = round(side * scale)
    expected = [read_px, usual] if read_px > usual else [usual, usual]
    assert widths == [32 * -(-width // 32) for width in expected]
