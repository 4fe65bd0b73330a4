"""The ONNX segmenter: a model made by hand finds discs; files that are no such model are refused with reasons."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pomona.basics import onnx_file
from pomona.basics.onnx_file import OnnxFile, chosen_providers
from pomona.errors import FormatError, InputError, MissingFileError, OutOfMemoryError
from pomona.progress import Silent
from pomona.stages.segment import Segmenter, load_segmenter, segment_photo
from pomona.stages.segment.center_offset import ModelMetadata
from pomona.stages.segment.decode import DecodeOptions, decode
from pomona.stages.segment.load import SHIPPED_WEIGHTS, shipped_weights
from pomona.stages.segment.photo_detections import SegmentOptions, iter_detections, segment_photos
from pomona.values.detections import Mask
from pomona.values.photos import Photos
from segment_scenes import DISC_PX, disc, painted_maps, write_disc_model

METADATA = {
    "pomona.kind": "center-offset",
    "pomona.stride": "4",
    "pomona.fruit_px": "12,120",
    "pomona.typical_fruit_px": "40",
}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("onnx", reason="the model of these tests is made with onnx (extra train)")
    return write_disc_model(tmp_path_factory.mktemp("model") / "discs.onnx")


def red_image(width: int, height: int, centres: list[tuple[float, float]]) -> np.ndarray:
    pixels = np.full((height, width, 3), (40, 90, 40), np.uint8)
    for x, y in centres:
        pixels[disc(width, height, x, y, DISC_PX)] = (220, 30, 30)
    return pixels


def test_finds_discs_where_they_are(model: Path) -> None:
    centres = [(40.0, 44.0), (120.0, 50.0), (200.0, 140.0), (68.0, 130.0)]
    segmenter = load_segmenter(model)
    assert isinstance(segmenter, Segmenter)
    assert segmenter.name.startswith("onnx:discs-")
    # 250 × 190 is no multiple of 32: what the network sees beyond the tile's edge is padding, and must not count.
    (found,) = segmenter.segment([red_image(250, 190, centres)])
    assert len(found) == 4
    for mask in found.masks:
        k = np.argmin([np.hypot(*(mask.center_px - centre)) for centre in centres])
        assert mask.iou(Mask.from_pixels(disc(250, 190, *centres[k], DISC_PX))) > 0.85
    assert ((found.scores > 0.4) & (found.scores <= 1)).all()


def test_a_disc_on_the_seam_of_tiles_is_one(model: Path) -> None:
    centres = [(100.0, 60.0), (160.0, 60.0), (230.0, 64.0)]
    pixels = red_image(300, 128, centres)
    segmenter = load_segmenter(model)
    from pomona.stages.segment import SegmentOptions

    options = SegmentOptions(tile_px=128, min_overlap_px=24)
    found = segment_photo(pixels, segmenter, options=options)
    assert len(found) == 3
    truth = [Mask.from_pixels(disc(300, 128, *centre, DISC_PX)) for centre in centres]
    assert min(max(mask.iou(t) for mask in found.masks) for t in truth) > 0.8


def test_score_floor_is_the_least_score_given(model: Path) -> None:
    image = red_image(160, 128, [(60.0, 60.0)])
    assert len(load_segmenter(model, score_floor=0.999).segment([image])[0]) == 0
    assert len(load_segmenter(model, score_floor=0.3).segment([image])[0]) == 1


def test_the_name_changes_with_the_content(model: Path, tmp_path: Path) -> None:
    other = write_disc_model(tmp_path / "discs.onnx", metadata=METADATA | {"pomona.typical_fruit_px": "41"})
    assert load_segmenter(model).name != load_segmenter(other).name


def test_metadata_becomes_traits() -> None:
    read = ModelMetadata.parse(Path("m.onnx"), METADATA | {"pomona.score_threshold": "0.3"})
    assert read.stride == 4
    assert read.traits.fruit_px == (12, 120)
    assert read.traits.typical_fruit_px == 40
    assert read.traits.score_threshold == 0.3
    assert read.traits.min_overlap_px >= 80


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"pomona.kind": "yolo"}, "another kind"),
        ({"pomona.kind": ""}, "another kind"),
        ({"pomona.stride": "5"}, "divisor of 32"),
        ({"pomona.stride": "four"}, "positive number, found 'four'"),
        ({"pomona.fruit_px": "12"}, "2 positive numbers"),
        ({"pomona.fruit_px": "50,120"}, "range around"),
        ({"pomona.typical_fruit_px": "nan"}, "positive number"),
        ({"pomona.score_threshold": "1.5"}, "expected 0 to 1"),
    ],
)
def test_senseless_metadata_is_refused(changes: dict[str, str], said: str) -> None:
    with pytest.raises(FormatError, match=said):
        ModelMetadata.parse(Path("m.onnx"), METADATA | changes)


def test_missing_metadata_is_named() -> None:
    entries = {key: value for key, value in METADATA.items() if key != "pomona.fruit_px"}
    with pytest.raises(FormatError, match=r"m\.onnx: metadata pomona\.fruit_px is missing"):
        ModelMetadata.parse(Path("m.onnx"), entries)


def test_models_of_another_contract_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    with pytest.raises(FormatError, match="heatmap missing among"):
        load_segmenter(write_disc_model(tmp_path / "a.onnx", rename={"heatmap": "boxes"}))
    with pytest.raises(FormatError, match=r"pomona\.kind"):
        load_segmenter(write_disc_model(tmp_path / "b.onnx", metadata={}))
    wrong_stride = write_disc_model(tmp_path / "c.onnx", metadata=METADATA | {"pomona.stride": "8"})
    with pytest.raises(FormatError, match="output 'heatmap': expected shape"):
        load_segmenter(wrong_stride).segment([red_image(64, 64, [])])


def test_files_that_are_no_model_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"nowhere\.onnx: no such file"):
        load_segmenter(tmp_path / "nowhere.onnx")
    (tmp_path / "text.onnx").write_text("not a model")
    with pytest.raises(FormatError, match=r"text\.onnx: expected an ONNX model"):
        load_segmenter(tmp_path / "text.onnx")


@pytest.mark.parametrize("name", ["yolo", "model.tflite", "weights", ""])
def test_names_that_nothing_answers_to_are_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"expected a file ending in \.onnx, \.pt or \.pth"):
        load_segmenter(name)


def test_missing_shipped_weights_are_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("pomona.stages.segment.load.SHIPPED_WEIGHTS", tmp_path / "fruit.onnx")
    with pytest.raises(MissingFileError, match="reinstall the package"):
        load_segmenter()


# Centres in pixels of the oranges that a person sees plainly in three frames of `orange-tree-video`, and of what may be
# found or not: balls, green oranges, and parts of oranges.
ORANGES = {
    "f0021": [(341, 275), (225, 324), (258, 372), (240, 399), (72, 393), (76, 440), (100, 454), (223, 482), (172, 513)],
    "f0060": [(177, 46), (71, 210), (302, 165), (160, 351), (145, 380), (193, 461), (113, 480)],
    "f0099": [(179, 66), (223, 134), (155, 171), (111, 240), (158, 279), (155, 305), (188, 322), (238, 384)],
}
DOUBTFUL = {
    "f0021": [(217, 514), (345, 310), (411, 170), (101, 201), (419, 80), (174, 78), (328, 345), (433, 167), (424, 205)],
    "f0060": [(147, 487), (233, 281), (326, 240), (137, 236), (80, 371), (219, 317), (239, 245), (346, 92)],
    "f0099": [(181, 395), (163, 205), (90, 153), (172, 456), (197, 215)],
}


@pytest.mark.slow
def test_weights_for_citrus_find_plain_oranges(shared_data: Path) -> None:
    from pomona.stages.capture import load_photos

    frames = [shared_data / "orange-tree-video" / "frames" / f"{name}.jpg" for name in ORANGES]
    options = SegmentOptions(score_threshold=0.3, kept_share=1)
    photos = load_photos(frames, min_photos=3)
    found = segment_photos(photos, load_segmenter(shipped_weights("citrus")), options=options)
    right = false = 0
    for name, true in ORANGES.items():
        boxes = found[f"{name}.jpg"].boxes_px
        assert boxes is not None
        centres = (boxes[:, :2] + boxes[:, 2:]) / 2
        apart_px = np.linalg.norm(centres[:, None] - np.array(true + DOUBTFUL[name], float), axis=2)
        right += int((apart_px[:, : len(true)].min(0) < 13).sum())
        false += int((apart_px.min(1) > 18).sum())
    assert 17 <= right <= 24  # the usual weights find 8
    assert false <= 9


@pytest.mark.slow
def test_shipped_weights_find_red_apples(shared_data: Path) -> None:
    from pomona.stages.capture import load_photos

    if not SHIPPED_WEIGHTS.is_file():
        pytest.skip("no weights are shipped yet")
    folder = shared_data / "apple-tree-video" / "frames"
    photos = load_photos(sorted(folder.iterdir())[:2])
    found = segment_photos(photos, load_segmenter())
    assert all(3 <= len(of_photo) <= 400 for of_photo in found.values())


def test_touching_discs_come_apart_by_where_their_pixels_point() -> None:
    discs = [(60.0, 60.0, 20.0), (98.0, 62.0, 20.0), (80.0, 96.0, 18.0)]
    found = decode(painted_maps(160, 128, discs), 160, 128, DecodeOptions())
    assert len(found) == 3
    visible = [Mask.from_pixels(disc(160, 128, *d)) for d in discs]
    assert min(max(mask.iou(t) for mask in found.masks) for t in visible) > 0.85
    covered = sum(mask.pixels.sum() for mask in found.masks)
    union = np.logical_or.reduce([disc(160, 128, *d) for d in discs]).sum()
    assert abs(covered - union) < 0.08 * union, "no pixel belongs to two"


@settings(max_examples=20, deadline=None)
@given(x=st.floats(0, 150), y=st.floats(0, 110), radius=st.floats(8, 40))
def test_decoded_masks_and_boxes_stay_in_the_tile(x: float, y: float, radius: float) -> None:
    found = decode(painted_maps(160, 128, [(x, y, radius)]), 150, 110, DecodeOptions())
    for mask, box in zip(found.masks, found.boxes_px, strict=True):
        assert min(*mask.box_px[:2], *box[:2]) >= 0
        assert mask.box_px[2] <= 150 >= box[2]
        assert mask.box_px[3] <= 110 >= box[3]


def test_nothing_on_the_maps_is_nothing_found() -> None:
    assert len(decode(painted_maps(64, 64, []), 64, 64, DecodeOptions())) == 0


@pytest.mark.parametrize(
    ("available", "chosen"),
    [
        (["TensorrtExecutionProvider", "CUDAExecutionProvider", "CPUExecutionProvider"], ["CUDA", "CPU"]),
        (["AzureExecutionProvider", "CPUExecutionProvider"], ["CPU"]),
    ],
    ids=["made for GPUs", "plain"],
)
def test_networks_run_on_cuda_where_there_is_one(available: list[str], chosen: list[str]) -> None:
    assert chosen_providers(available) == [f"{name}ExecutionProvider" for name in chosen]


def test_too_little_memory_is_no_fault_of_the_model(model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Session:
        def run(self, *given: object) -> None:
            raise RuntimeError("BFCArena::AllocateRawInternal Failed to allocate memory for requested buffer of size 9")

    network = OnnxFile(model)
    monkeypatch.setattr(network, "_session", Session())
    with pytest.raises(
        OutOfMemoryError, match="there is not enough memory here to run this model on an image of shape"
    ):
        network.run(np.zeros((1, 3, 64, 64), np.float32), [node.name for node in network.outputs])


@pytest.mark.parametrize("how", ["raises", "is left out"])
def test_a_gpu_that_cannot_be_used_is_said_and_the_cpu_does_the_same(
    model: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    import onnxruntime

    on_cpu = OnnxFile(model)
    real = onnxruntime.InferenceSession

    def without_cuda(path: str, *, providers: list[str], **named: object) -> object:
        if "CUDAExecutionProvider" in providers and how == "raises":
            raise RuntimeError("CUDA failure 100: no CUDA-capable device is detected\nand more")
        return real(path, providers=providers[-1:], **named)

    monkeypatch.setattr(onnxruntime, "InferenceSession", without_cuda)
    monkeypatch.setattr(
        onnxruntime, "get_available_providers", lambda: ["CUDAExecutionProvider", "CPUExecutionProvider"]
    )
    segmenter, progress = load_segmenter(model), Silent()
    pixels = red_image(64, 64, [(30.0, 30.0)])
    image = pixels.transpose(2, 0, 1)[None].astype(np.float32)
    names = [node.name for node in on_cpu.outputs]
    for found, wanted in zip(OnnxFile(model).run(image, names), on_cpu.run(image, names), strict=True):
        np.testing.assert_array_equal(found, wanted)
    assert on_cpu.note is None
    assert list(iter_detections(Photos(()), segmenter, progress=progress)) == []
    (said,) = progress.warnings
    assert "could not use one" in said
    assert "CPU" in said
    assert "\n" not in said
    assert ("no CUDA-capable device" in said) == (how == "raises")


def test_a_library_that_cuda_lacks_is_named_and_nothing_is_printed(
    model: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """As the package `onnxruntime-gpu` says it where CUDA is not installed."""
    import onnxruntime

    real, lacks = onnxruntime.InferenceSession, "Failed to load libcublasLt.so.13: cannot open shared object file"
    monkeypatch.setattr(
        onnxruntime, "get_available_providers", lambda: ["CUDAExecutionProvider", "CPUExecutionProvider"]
    )
    monkeypatch.setattr(onnxruntime, "preload_dlls", lambda: print(f"{lacks}\nPlease follow a page.\n"))
    monkeypatch.setattr(
        onnxruntime, "InferenceSession", lambda path, providers, **named: real(path, providers=providers[-1:], **named)
    )
    onnx_file._libraries_missing.cache_clear()
    note = OnnxFile(model).note
    onnx_file._libraries_missing.cache_clear()
    assert note is not None
    assert f"({lacks})" in note
    assert "onnxruntime-gpu[cuda,cudnn]" in note
    assert capfd.readouterr() == ("", "")
