"""Detectors of other tools: exported files with known fruits give them in the tile's pixels; wrong ones are refused."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from detector_models import Box, red_tile, write_detr, write_yolo
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.stages.segment import Segmenter, SegmenterTraits, TileDetections, load_segmenter
from pomona.stages.segment.fruit_classes import fruit_columns
from pomona.stages.segment.load import files_of
from pomona.stages.segment.placement import TilePlacement
from pomona.values.detections import Mask

needs_onnx = pytest.mark.skipif(
    __import__("importlib.util").util.find_spec("onnx") is None, reason="models are made with onnx (extra train)"
)
FRUITS: list[Box] = [(64, 40, 112, 96), (200, 120, 232, 152)]
"""In a tile of 320 × 240, at the edges of the masks' cells, so that they are known to the pixel."""


def in_input(box: Box, placement: TilePlacement) -> Box:
    x0, y0, x1, y1 = np.array(box) * (placement.scale * 2) + placement.shift_px * 2
    return float(x0), float(y0), float(x1), float(y1)


def assert_found(found: TileDetections, boxes: Sequence[Box], tolerance_px: float = 1.0) -> None:
    assert len(found) == len(boxes)
    for box, got, mask in zip(boxes, found.boxes_px, found.masks, strict=True):
        np.testing.assert_allclose(got, box, atol=tolerance_px)
        np.testing.assert_allclose(mask.box_px, box, atol=tolerance_px)
        x0, y0, x1, y1 = (int(edge) for edge in box)
        assert mask.iou(Mask.from_pixels(np.ones((y1 - y0, x1 - x0), bool), x0, y0)) > 0.9


@needs_onnx
@pytest.mark.parametrize("end_to_end", [False, True])
@pytest.mark.parametrize("free_size", [False, True])
def test_yolo_finds_fruits_in_a_letterboxed_tile(tmp_path: Path, end_to_end: bool, free_size: bool) -> None:
    placement = TilePlacement.letterboxed((320, 240), (160, 128))
    assert placement.shift_px == (0, 4)
    first, second = (in_input(box, placement) for box in FRUITS)
    duplicate = in_input((66, 42, 114, 98), placement)
    rows = [(second, 0, 0.6), (first, 0, 0.9), (first, 0, 0.05)] + ([] if end_to_end else [(duplicate, 0, 0.8)])
    segmenter = load_segmenter(write_yolo(tmp_path / "best.onnx", rows, end_to_end=end_to_end, free_size=free_size))
    assert isinstance(segmenter, Segmenter)
    assert segmenter.name.startswith("yolo-seg:best-")
    assert (segmenter.traits.tile_px, segmenter.traits.min_overlap_px) == (128, 32)
    (found,) = segmenter.segment([red_tile(320, 240, FRUITS)])
    assert_found(found, FRUITS)
    np.testing.assert_allclose(found.scores, [0.9, 0.6], atol=1e-6)


@needs_onnx
@pytest.mark.parametrize(("width", "height"), [(128, 256), (80, 64), (301, 197), (160, 128)])
def test_yolo_on_tiles_of_any_shape(tmp_path: Path, width: int, height: int) -> None:
    box = (width // 4, height // 8, 3 * width // 4, height // 2)
    placement = TilePlacement.letterboxed((width, height), (160, 128))
    model = write_yolo(tmp_path / "best.onnx", [(in_input(box, placement), 0, 0.9)])
    (found,) = load_segmenter(model).segment([red_tile(width, height, [box])])
    assert_found(found, [box])


@needs_onnx
@pytest.mark.parametrize("known", [False, True])
def test_yolo_sees_small_photos_at_the_scale_of_the_fruits_it_knows(tmp_path: Path, known: bool) -> None:
    box, input_px = (20, 16, 48, 40), (320, 320)
    placement = TilePlacement((80, 64), input_px, (1.0, 1.0), (120, 128))  # not enlarged
    assert TilePlacement.letterboxed((80, 64), input_px, enlarged=False) == placement
    seen = placement if known else TilePlacement.letterboxed((80, 64), input_px)
    model = write_yolo(
        tmp_path / "best.onnx",
        [(in_input(box, seen), 0, 0.9)],
        input_px=input_px,
        metadata={"pomona.typical_fruit_px": "28"} if known else {},
    )
    (found,) = load_segmenter(model).segment([red_tile(80, 64, [box])])
    assert_found(found, [box])
    larger = TilePlacement.letterboxed((640, 512), input_px, enlarged=False)
    assert larger == TilePlacement.letterboxed((640, 512), input_px)


@needs_onnx
def test_a_yolo_mask_is_what_is_red_in_its_box(tmp_path: Path) -> None:
    placement = TilePlacement.letterboxed((320, 240), (160, 128))
    wide = (40, 24, 144, 120)
    model = write_yolo(tmp_path / "best.onnx", [(in_input(wide, placement), 0, 0.9)], half=True)
    (found,) = load_segmenter(model).segment([red_tile(320, 240, FRUITS)])
    np.testing.assert_allclose(found.boxes_px, [wide], atol=1)
    np.testing.assert_allclose(found.masks[0].box_px, FRUITS[0], atol=1)
    (nothing,) = load_segmenter(model).segment([red_tile(320, 240, [])])
    assert len(nothing) == 0, "a detection without a mask is none"


@needs_onnx
def test_only_fruit_classes_count(tmp_path: Path) -> None:
    placement = TilePlacement.letterboxed((320, 240), (160, 128))
    first, second = (in_input(box, placement) for box in FRUITS)
    rows = [(first, 1, 0.9), (second, 2, 0.8)]
    names = "{0: 'leaf', 1: 'ripe_apples', 2: 'person'}"
    tile = red_tile(320, 240, FRUITS)
    model = write_yolo(tmp_path / "many.onnx", rows, names=names, classes=3)
    assert_found(load_segmenter(model).segment([tile])[0], FRUITS[:1])
    assert_found(load_segmenter(f"{model}:person").segment([tile])[0], FRUITS[1:])
    assert_found(load_segmenter(f"{model}:2, ripe_apples").segment([tile])[0], FRUITS)
    assert load_segmenter(f"{model}:person").name != load_segmenter(model).name
    with pytest.raises(InputError, match=r"no class 'pear'; its classes are 0 leaf, 1 ripe_apples, 2 person"):
        load_segmenter(f"{model}:pear")
    with pytest.raises(InputError, match="expected the classes that are fruit behind the colon"):
        load_segmenter(f"{model}:")


@pytest.mark.parametrize(
    ("names", "fruits"),
    [
        (["apple", "leaf"], [0]),
        (["Apple", "apple tree", "PEARS", "pineapple"], [0, 2]),
        (["UnripeApple", "orange-flower", "cherries"], [0, 2]),
        (["tomatoes", "banana", "fruit"], [0, 2]),
    ],
)
def test_names_that_say_fruit(names: list[str], fruits: list[int]) -> None:
    assert fruit_columns(Path("m.onnx"), len(names), dict(enumerate(names))) == fruits


def test_classes_that_say_nothing() -> None:
    assert fruit_columns(Path("m.onnx"), 1, {0: "mela"}) == [0]
    assert fruit_columns(Path("m.onnx"), 80, {}) == [47, 49]
    with pytest.raises(FormatError, match=r"none of its classes is a fruit \(classes: 0 car, 1 dog\).*:CLASS,CLASS"):
        fruit_columns(Path("m.onnx"), 2, {0: "car", 1: "dog"})
    with pytest.raises(FormatError, match=r"not known which of its 3 classes.*0 to 2, without names"):
        fruit_columns(Path("m.onnx"), 3, {})


@needs_onnx
@pytest.mark.parametrize("masks_name", ["masks", "4245"])
def test_detr_finds_fruits_in_a_stretched_tile(tmp_path: Path, masks_name: str) -> None:
    fruits: list[Box] = [(60, 45, 120, 90), (200, 120, 280, 180)]  # at the edges of cells of 20 × 15 pixels
    shares = [(x0 / 320, y0 / 240, x1 / 320, y1 / 240) for x0, y0, x1, y1 in fruits]
    rows = [(shares[1], 0, 1.0), (shares[0], 0, 2.0), (shares[0], 0, 1.5), ((0, 0, 1, 1), 0, -4.0)]
    segmenter = load_segmenter(write_detr(tmp_path / "rf.onnx", rows, masks_name=masks_name))
    assert isinstance(segmenter, Segmenter)
    assert segmenter.name.startswith("rf-detr-seg:rf-")
    assert segmenter.traits.tile_px == 64
    (found,) = segmenter.segment([red_tile(320, 240, fruits)])
    assert_found(found, fruits)
    np.testing.assert_allclose(found.scores, 1 / (1 + np.exp([-2.0, -1.0])), atol=1e-6)


@needs_onnx
def test_detr_metadata_says_which_class_is_fruit(tmp_path: Path) -> None:
    rows = [((0.25, 0.25, 0.5, 0.5), 1, 2.0), ((0.5, 0.5, 0.75, 0.75), 0, 2.0)]
    boxes: list[Box] = [(16, 16, 32, 32), (32, 32, 48, 48)]
    names = {"rfdetr_inference": '{"class_id_to_name": {"0": "leaf", "1": "apple"}}'}
    model = write_detr(tmp_path / "rf.onnx", rows, columns=3, metadata=names)
    assert_found(load_segmenter(model).segment([red_tile(64, 64, boxes)])[0], boxes[:1])
    unnamed = write_detr(tmp_path / "unnamed.onnx", rows, columns=3)
    with pytest.raises(FormatError, match="not known which of its 2 classes are fruit"):
        load_segmenter(unnamed)
    assert_found(load_segmenter(f"{unnamed}:0").segment([red_tile(64, 64, boxes)])[0], boxes[1:])


@needs_onnx
def test_metadata_that_anybody_may_add_becomes_traits(tmp_path: Path) -> None:
    metadata = {"pomona.typical_fruit_px": "33", "pomona.score_threshold": "0.35"}
    model = write_detr(tmp_path / "rf.onnx", [((0, 0, 1, 1), 0, 0.0)], metadata=metadata)
    traits = load_segmenter(model).traits
    assert (traits.typical_fruit_px, traits.score_threshold) == (33, 0.35)
    plain = write_detr(tmp_path / "plain.onnx", [((0, 0, 1, 1), 0, 0.0)])
    assert load_segmenter(plain).traits.typical_fruit_px is None
    assert len(load_segmenter(plain, score_floor=0.6).segment([red_tile(64, 64, [(0, 0, 64, 64)])])[0]) == 0
    assert len(load_segmenter(plain, score_floor=0.4).segment([red_tile(64, 64, [(0, 0, 64, 64)])])[0]) == 1


@needs_onnx
def test_unknown_outputs_are_refused(tmp_path: Path) -> None:
    model = write_detr(tmp_path / "x.onnx", [((0.0, 0.0, 1.0, 1.0), 0, 2.0)])
    said = (
        r"no layout that Pomona knows\. Found: pred .*Known: Pomona's own.*YOLO-seg.*RF-DETR-seg.*"
        r"docs/reference/detectors\.md"
    )
    with pytest.raises(FormatError, match=said):
        load_segmenter(_renamed(model, "dets", "pred"))


def _renamed(path: Path, old: str, new: str) -> Path:
    import onnx

    model = onnx.load(path)
    for node in model.graph.node:
        node.output[:] = [new if name == old else name for name in node.output]
    for output in model.graph.output:
        output.name = new if output.name == old else output.name
    onnx.save(model, path)
    return path


@needs_onnx
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"names": "{0: 'apple', 1: 'pear', 2: 'leaf'}"}, r"m = 32 and 3 classes; found output0 .*\(1, 37, 12\)"),
        ({"names": "{0: apple"}, "metadata names: expected a dict of the classes' names"),
        ({"names": "{'a': 'apple'}"}, "metadata names: expected a dict"),
        ({"names": None, "end_to_end": True}, "metadata names is missing"),
    ],
)
def test_yolo_files_that_contradict_themselves(tmp_path: Path, options: dict[str, object], said: str) -> None:
    with pytest.raises(FormatError, match=said):
        load_segmenter(write_yolo(tmp_path / "best.onnx", [((0, 0, 9, 9), 0, 0.9)], **options))  # type: ignore[arg-type]


@needs_onnx
@pytest.mark.parametrize(
    ("metadata", "said"),
    [
        ("{", "expected JSON"),
        ("[]", "expected a JSON object, found list"),
        ('{"class_id_to_name": {"a": "b"}}', "class_id_to_name: expected an object"),
        ('{"stds": [1, 0, 1]}', "stds: expected 3 numbers"),
        ('{"means": "grey"}', "means: expected 3 numbers, found grey"),
    ],
)
def test_detr_metadata_without_sense(tmp_path: Path, metadata: str, said: str) -> None:
    rows = [((0.0, 0.0, 1.0, 1.0), 0, 2.0)]
    with pytest.raises(FormatError, match=said):
        load_segmenter(write_detr(tmp_path / "rf.onnx", rows, metadata={"rfdetr_inference": metadata}))


@needs_onnx
def test_a_truncated_export_is_refused(tmp_path: Path) -> None:
    model = write_yolo(tmp_path / "best.onnx", [((0, 0, 9, 9), 0, 0.9)])
    model.write_bytes(model.read_bytes()[:-400])
    with pytest.raises(FormatError, match=r"best\.onnx: expected an ONNX model, but ONNX Runtime cannot load it"):
        load_segmenter(model)
    with pytest.raises(MissingFileError, match=r"nowhere\.onnx: no such file"):
        load_segmenter(f"{tmp_path / 'nowhere.onnx'}:apple")


@given(
    tile=st.tuples(st.integers(1, 2000), st.integers(1, 2000)),
    network=st.tuples(st.integers(32, 1280), st.integers(32, 1280)),
    letterboxed=st.booleans(),
)
def test_placed_tiles_fit_and_come_back(tile: tuple[int, int], network: tuple[int, int], letterboxed: bool) -> None:
    placement = (TilePlacement.letterboxed if letterboxed else TilePlacement.stretched)(tile, network)
    x0, y0, x1, y1 = in_input((0, 0, *tile), placement)
    assert 0 <= x0 < x1 <= network[0] + 1e-6
    assert 0 <= y0 < y1 <= network[1] + 1e-6
    if letterboxed:
        assert abs(x0 - (network[0] - x1)) <= 1 + 1e-6
        assert abs(y0 - (network[1] - y1)) <= 1 + 1e-6
        assert min(network[0] - (x1 - x0), network[1] - (y1 - y0)) < 1
    np.testing.assert_allclose(placement.boxes_in_tile(np.array([[x0, y0, x1, y1]])), [[0, 0, *tile]], atol=1e-6)


class Plugin:
    """A segmenter as another package would bring it."""

    def __init__(self, argument: str = "nothing") -> None:
        if argument == "broken":
            raise RuntimeError("no such weights")
        self.name = f"plugin:{argument}"
        self.traits = SegmenterTraits()

    def segment(self, tiles: Sequence[np.ndarray]) -> list[TileDetections]:
        return [TileDetections.empty() for _ in tiles]


def no_segmenter() -> str:
    return "weights"


number = 3


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    values = {"mine": "Plugin", "text": "no_segmenter", "number": "number", "gone": "vanished"}
    entries = [EntryPoint(key, f"{__name__}:{value}", "pomona.segmenters") for key, value in values.items()]
    entries.append(EntryPoint("lost", "no_such_package.detector:make", "pomona.segmenters"))
    monkeypatch.setattr("pomona.stages.segment.load.entry_points", lambda group: entries)


@pytest.mark.usefixtures("installed")
def test_entry_points_with_and_without_argument() -> None:
    assert load_segmenter("mine").name == "plugin:nothing"
    assert load_segmenter("mine:a:b.onnx2").name == "plugin:a:b.onnx2"


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("model", "said"),
    [
        ("lost", r"'lost' \(entry point no_such_package\.detector:make\) cannot be imported: ModuleNotFoundError"),
        ("gone", "cannot be imported: AttributeError"),
        ("number", "expected a function or class, found an object of type int"),
        (
            "text",
            r"expected a pomona\.stages\.segment\.Segmenter \(name, traits, segment\), found an object of type str",
        ),
        ("mine:broken", "could not be made with the argument 'broken': RuntimeError: no such weights"),
        ("text:1", "could not be made with the argument '1': TypeError"),
        ("other:1", "one of the installed segmenters: gone, lost, mine, number, text"),
    ],
)
def test_entry_points_that_do_not_work(model: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        load_segmenter(model)


def test_files_that_a_model_depends_on(tmp_path: Path) -> None:
    (tmp_path / "m.onnx").write_bytes(b"")
    folder = tmp_path / "weights"
    folder.mkdir()
    (folder / "config.json").write_text("{}")
    assert files_of(None)[0].name == "fruit.onnx"
    assert files_of(f"{tmp_path / 'm.onnx'}:apple") == (tmp_path / "m.onnx",)
    assert files_of("mine:argument") == ()
    assert files_of("open:apple") == ()
    assert files_of(f"open:apple@{folder}") == (folder / "config.json",)


def test_the_detector_of_the_documentation(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    text = (Path(__file__).parent.parent / "docs" / "reference" / "detectors.md").read_text()
    (code,) = [block for block in text.split("```python\n")[1:] if "class RedThings" in block]
    (tmp_path / "red_things.py").write_text(code.split("```")[0])
    monkeypatch.syspath_prepend(tmp_path)
    entry = EntryPoint("red-things", "red_things:RedThings", "pomona.segmenters")
    monkeypatch.setattr("pomona.stages.segment.load.entry_points", lambda group: [entry])
    (found,) = load_segmenter("red-things").segment([red_tile(320, 240, FRUITS)])
    assert_found(found, FRUITS, tolerance_px=0)
    assert len(load_segmenter("red-things:2000").segment([red_tile(320, 240, FRUITS)])[0]) == 1
    assert len(load_segmenter("red-things").segment([red_tile(32, 24, [])])[0]) == 0
    with pytest.raises(InputError, match="could not be made with the argument 'many'"):
        load_segmenter("red-things:many")
