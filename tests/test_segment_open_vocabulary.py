"""Fruit found by words: tiny models saved in the test, whose weights are set by hand, find what is red."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from detector_models import red_tile
from pomona.errors import FormatError, InputError, MissingExtraError, MissingFileError
from pomona.stages.segment import Segmenter, load_segmenter, segment_photo
from pomona.stages.segment.open_vocabulary import DEFAULT_DETECTOR, DEFAULT_MASKS, Wish
from pomona.values.detections import Mask

pytest.importorskip("torch", reason="words need PyTorch (extra open-vocabulary)")
pytest.importorskip("transformers", reason="words need transformers (extra open-vocabulary)")

from words_models import fruit_at, write_models, write_other_models


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_models(tmp_path_factory.mktemp("weights"))


def filled(box: tuple[int, int, int, int]) -> Mask:
    x0, y0, x1, y1 = box
    return Mask.from_pixels(np.ones((y1 - y0, x1 - x0), bool), x0, y0)


@pytest.mark.parametrize(("width", "height"), [(192, 128), (128, 192), (48, 48), (96, 96), (330, 300)])
def test_words_find_fruits_in_the_tiles_pixels(models: Path, width: int, height: int) -> None:
    segmenter = load_segmenter(f"open:apple@{models}")
    assert isinstance(segmenter, Segmenter)
    assert (segmenter.traits.tile_px, segmenter.traits.min_overlap_px) == (48, 12)
    boxes = [fruit_at(1, 0, max(width, height)), fruit_at(2, 2, max(width, height))]
    (found,) = segmenter.segment([red_tile(width, height, boxes)])
    assert len(found) == 2
    order = np.argsort(found.boxes_px[:, 0])
    for box, k in zip(boxes, order, strict=True):
        np.testing.assert_allclose(found.boxes_px[k], box, atol=1)
        np.testing.assert_allclose(found.masks[k].box_px, box, atol=1)
        assert found.masks[k].iou(filled(box)) > 0.85
    assert ((found.scores > 0.9) & (found.scores <= 1)).all()


def test_other_words_find_something_else(models: Path) -> None:
    box = fruit_at(1, 1, 96)
    tile = red_tile(96, 96, [box])
    (pears,) = load_segmenter(f"open:pear@{models}").segment([tile])
    assert all(mask.iou(filled(box)) < 0.5 for mask in pears.masks)
    (both,) = load_segmenter(f"open:pear, apple@{models / 'detector'}+{models / 'masks'}").segment([tile])
    assert sum(mask.iou(filled(box)) > 0.85 for mask in both.masks) == 1


def test_grounding_dino_and_segment_anything_2(tmp_path: Path) -> None:
    segmenter = load_segmenter(f"open:ripe apple, apple@{write_other_models(tmp_path)}", score_floor=0.0)
    assert (segmenter.traits.tile_px, segmenter.traits.score_threshold) == (160, 0.3)
    noise = np.random.default_rng(0).integers(0, 256, (80, 120, 3)).astype(np.uint8)
    (found,) = segmenter.segment([noise])
    assert 0 < len(found) <= 10
    for box, mask in zip(found.boxes_px, found.masks, strict=True):
        assert min(*box[:2], *mask.box_px[:2]) >= 0
        assert max(box[2], mask.box_px[2]) <= 120
        assert max(box[3], mask.box_px[3]) <= 80
        assert filled(mask.box_px).intersection_px(filled(tuple(np.round(box).astype(int)))) > 0  # type: ignore[arg-type]


def test_nothing_red_is_nothing_found(models: Path) -> None:
    assert len(load_segmenter(f"open:apple@{models}").segment([red_tile(64, 40, [])])[0]) == 0


def test_words_on_a_tiled_photo(models: Path) -> None:
    segmenter = load_segmenter(f"open:apple@{models}")
    first, second = (12, 12, 20, 20), (72, 40, 80, 48)  # the tiles begin at 0, 36 and 72, and at 0 and 32
    assert len(segment_photo(red_tile(120, 80, [first, second]), segmenter)) == 2


def test_the_name_changes_with_words_and_weights(models: Path, tmp_path: Path) -> None:
    name = load_segmenter(f"open:apple@{models}").name
    assert name.startswith("open:apple@detector-")
    assert load_segmenter(f"open:pear@{models}").name != name
    assert load_segmenter(f"open:apple@{write_models(tmp_path)}").name != name


def test_wishes() -> None:
    assert Wish.parse("ripe apple") == Wish(("ripe apple",), DEFAULT_DETECTOR, DEFAULT_MASKS)
    assert Wish.parse("a, b@x/y") == Wish(("a", "b"), "x/y", DEFAULT_MASKS)
    assert Wish.parse("a@x/y+z/w") == Wish(("a",), "x/y", "z/w")
    assert Wish.parse("a@+z/w") == Wish(("a",), DEFAULT_DETECTOR, "z/w")
    for text in ("", " , ", "@x/y"):
        with pytest.raises(InputError, match="expected what to look for, such as 'open:ripe apple'"):
            Wish.parse(text)


def test_weights_that_are_not_there(models: Path, tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="expected a folder, or a name on the hub such as"):
        load_segmenter(f"open:apple@{tmp_path / 'nowhere'}")
    (tmp_path / "file").write_text("weights")
    with pytest.raises(FormatError, match="expected a folder with a detector saved by transformers, found a file"):
        load_segmenter(f"open:apple@{tmp_path / 'file'}")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FormatError, match=r"empty: expected a folder with a detector saved by transformers: "):
        load_segmenter(f"open:apple@{tmp_path / 'empty'}")


def test_weights_of_another_kind(models: Path) -> None:
    with pytest.raises(FormatError, match="masks: expected a folder with a detector saved by transformers"):
        load_segmenter(f"open:apple@{models / 'masks'}+{models / 'masks'}")
    with pytest.raises(FormatError, match="detector: expected a folder with a segmenter from boxes"):
        load_segmenter(f"open:apple@{models / 'detector'}+{models / 'detector'}")


def test_weights_that_are_damaged(models: Path, tmp_path: Path) -> None:
    from safetensors.numpy import load_file, save_file

    folder = write_models(tmp_path)
    weights = folder / "detector" / "model.safetensors"
    tensors = load_file(weights)
    lost = "box_head.dense0.weight"
    save_file({name: value for name, value in tensors.items() if name != lost}, weights, {"format": "pt"})
    with pytest.raises(FormatError, match=rf"all weights of Owlv2ForObjectDetection; 1 missing: {lost}"):
        load_segmenter(f"open:apple@{folder}")
    weights.write_bytes(weights.read_bytes()[:100])
    with pytest.raises(FormatError, match="detector: expected a folder with a detector saved by transformers: "):
        load_segmenter(f"open:apple@{folder}")
    (folder / "detector" / "config.json").write_text(json.dumps({"model_type": "owlv9"}))
    with pytest.raises(FormatError, match="owlv9"):
        load_segmenter(f"open:apple@{folder}")


def test_a_hub_that_cannot_be_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    import transformers

    def fails(source: str, **options: object) -> None:
        assert (source, options["local_files_only"]) == ("nobody/nothing", False)
        raise OSError("We couldn't connect to the hub\nand more")

    monkeypatch.setattr(transformers.AutoModelForZeroShotObjectDetection, "from_pretrained", fails)
    with pytest.raises(MissingFileError, match=r"nobody/nothing: .*couldn't connect to the hub\. Without a connection"):
        load_segmenter("open:apple@nobody/nothing")


def test_without_transformers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'pomona\[open-vocabulary\]'"):
        load_segmenter("open:apple")
