"""From labelled photos to samples: label images, large photos in parts, splits by photo, classes, bad sets."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the train extra")

from PIL import Image

import pomona
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.detections.label_sets import LabelSet, read_label_set
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto
from pomona.formats.detections.shapes import ellipse_mask
from pomona.learning.train.augment import AugmentOptions, draw_crop
from pomona.learning.train.gather import gather
from pomona.learning.train.label_images import paint, samples_of
from pomona.learning.train.samples import IGNORED, Sample, boxes_of, group_of, split, write_split
from pomona.progress import Silent
from pomona.stages.capture.images import size_of
from pomona.values.detections import Mask
from view_scenes import write_view_survey


def write_photo(path: Path, width: int, height: int, discs: Sequence[tuple[float, float, float]] = ()) -> None:
    """Red discs (x, y, r) on green noise."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(len(discs))
    pixels = rng.integers(40, 110, (height, width, 3)).astype(np.uint8)
    pixels[:, :, 0] //= 2
    for x, y, r in discs:
        cv2.circle(pixels, (round(x), round(y)), round(r), (200, 30, 30), -1)
    cv2.imwrite(str(path), pixels[:, :, ::-1])


def disc(x: float, y: float, r: float, size: tuple[int, int], *, boxed: bool = False) -> LabelledFruit:
    mask = ellipse_mask((x, y), (r, r), 0, *size)
    assert mask is not None
    return LabelledFruit((x - r, y - r, x + r, y + r), None if boxed else mask)


def coco_of(folder: Path, names: list[str], boxes: dict[str, list[list[float]]], label: str = "apple") -> None:
    """A set of photos of 64 × 64 with boxes."""
    for name in names:
        write_photo(folder / name, 64, 64, [(x + w / 2, y + h / 2, w / 2) for x, y, w, h in boxes.get(name, [])])
    images = [{"id": k, "file_name": name, "width": 64, "height": 64} for k, name in enumerate(names)]
    numbered = [(names.index(name), box) for name, several in boxes.items() for box in several]
    annotations = [{"id": k, "image_id": i, "category_id": 1, "bbox": b} for k, (i, b) in enumerate(numbered)]
    content = {"images": images, "categories": [{"id": 1, "name": label}], "annotations": annotations}
    (folder / "labels.json").write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("stem", "group"),
    [
        ("DSC_1047_17kv1r21k_10", "DSC_1047_17kv1r21k"),
        ("IMG_0001", "IMG_0001"),
        ("DSC_1047", "DSC_1047"),
        ("20200101_123456", "20200101_123456"),
        ("PXL_20230101_123456789", "PXL_20230101_123456789"),
        ("frame_12", "frame_12"),
        ("IMG_0001_3", "IMG_0001"),
        ("_MG_8067_01", "_MG_8067"),
        ("row1_001", "row1_001"),
        ("row1_01", "row1_01"),
        ("20240512_001", "20240512_001"),
        ("IMG_0001_0", "IMG_0001"),
        ("DSC_1047_3", "DSC_1047"),
        ("IMG_0001_0_1024", "IMG_0001"),
        ("orchard_512_0", "orchard"),
        ("tree_0_0_512_512", "tree"),
        ("IMG_0001_512_0_1024_512", "IMG_0001"),
        ("IMG_0001_r0_c1", "IMG_0001"),
        ("IMG_0001_r02c11", "IMG_0001"),
        ("IMG_0001_row2_col3", "IMG_0001"),
        ("IMG_0001-x512-y0", "IMG_0001"),
        ("IMG_0001_y0_x512", "IMG_0001"),
        ("IMG_0001_tile_7", "IMG_0001"),
        ("IMG_0001_patch12", "IMG_0001"),
        ("IMG_0001_jpg.rf.0a1b2c3d4e5f60718293a4b5c6d7e8f9", "IMG_0001"),
        ("IMG_0001_3_jpg.rf.0a1b2c3d4e5f60718293a4b5c6d7e8f9", "IMG_0001"),
        ("east_000", "east_000"),
        ("crop", "crop"),
        ("7", "7"),
    ],
)
def test_which_photo_a_tile_was_cut_from(stem: str, group: str) -> None:
    assert group_of(stem) == group


def test_splits_leave_no_side_empty_and_no_photo_on_both() -> None:
    def sample(stem: str) -> Sample:
        return Sample(Path(f"{stem}.jpg"), Path(), np.zeros((0, 4)), group_of(stem), "x")

    for count in (2, 3, 12):
        for held_out in (0.01, 0.15, 0.99):
            samples = [sample(f"IMG_{k:04d}_r{r}_c{c}") for k in range(count) for r in range(2) for c in range(2)]
            training, validation = split(samples, held_out)
            assert training
            assert validation
            assert len(training) + len(validation) == 4 * count
            assert not {s.group for s in training} & {s.group for s in validation}


def test_labels_of_masks_boxes_crowds_and_what_is_hardly_seen(tmp_path: Path) -> None:
    size = (120, 100)
    shapes = [(30, 30, 16), (40, 34, 8), (90, 30, 12)]
    write_photo(tmp_path / "a.png", *size, [(x, y, r) for x, y, r in shapes])
    mask, small, boxed = (disc(x, y, r, size, boxed=k == 2) for k, (x, y, r) in enumerate(shapes))
    speck = disc(10, 90, 2, size)
    crowd = LabelledFruit((50, 70, 80, 95), None, ignored=True)
    photo = LabelledPhoto(tmp_path / "a.png", "a.png", *size, (mask, small, speck, crowd, boxed))
    (sample,) = samples_of(photo, tmp_path / "cache", source="s", fruit_px=24)
    assert sample.image == tmp_path / "a.png"
    assert sample.weak
    assert sample.boxes_px.tolist() == [[14, 14, 46, 46], [32, 26, 48, 42], [78, 18, 102, 42]]
    labels = sample.label_image()
    assert labels[30, 20] == 1
    assert labels[34, 40] == 2, "the smaller one is nearer"
    assert labels[30, 90] == 3
    assert labels[90, 10] == IGNORED
    assert (labels[70:95, 50:80] == IGNORED).all()
    assert labels[60, 10] == 0
    assert (labels == 3).sum() == pytest.approx(np.pi * 144, rel=0.1)


def test_pixels_to_be_ignored_are_doubtful_where_they_are_and_not_between(tmp_path: Path) -> None:
    size = (120, 100)
    write_photo(tmp_path / "images" / "a.png", *size)
    ids = np.zeros(size[::-1], np.uint16)
    ids[40:60, 50:70] = 3
    ids[5:15, 5:15] = ids[80:95, 100:115] = 65534
    (tmp_path / "masks").mkdir()
    cv2.imwrite(str(tmp_path / "masks" / "a.png"), ids)
    (photo,) = read_label_set(LabelSet("masks", tmp_path), size_of)
    (sample,) = samples_of(photo, tmp_path / "cache", source="s")
    assert sample.boxes_px.tolist() == [[50, 40, 70, 60]]
    assert sample.ignored_px is not None
    assert sample.ignored_px.tolist() == [[5, 5, 15, 15], [100, 80, 115, 95]]
    assert (sample.label_image() == IGNORED).sum() == 10 * 10 + 15 * 15


def test_a_box_drawn_beside_a_mask_is_learnt_as_drawn(tmp_path: Path) -> None:
    size = (64, 64)
    write_photo(tmp_path / "a.png", *size, [(32, 32, 16)])
    half = disc(32, 32, 16, size).mask
    assert half is not None
    seen = Mask.from_pixels(half.pixels[:, :16], *half.box_px[:2])  # leaves hide the right half of the fruit

    def drawn(*box: float) -> LabelledFruit:
        return LabelledFruit(box, seen).as_drawn()

    whole, rounded = drawn(16, 16, 48, 48), drawn(15.4, 16, 32.6, 48)
    cutting, elsewhere = drawn(20, 16, 48, 48), drawn(0, 0, 64, 64)
    assert whole.box_px == (16, 16, 48, 48)
    assert not whole.exact
    for fruit in (rounded, cutting, elsewhere):
        assert fruit.box_px == pytest.approx((16, 16, 32, 48), abs=1)
        assert fruit.exact
    photo = LabelledPhoto(tmp_path / "a.png", "a.png", *size, (whole,))
    (sample,) = samples_of(photo, tmp_path / "cache", source="s")
    assert sample.weak
    plain = AugmentOptions(crop_px=64, fruit_px=None, mosaics=0, recolours=False, stretch=0)
    crop = draw_crop([sample], np.random.default_rng(0), plain)
    assert crop.boxes_px == pytest.approx(np.array([[16, 16, 48, 48]]), abs=1)
    assert (crop.labels == 1).sum() == seen.area_px
    ignored = replace(whole, ignored=True)
    labels = paint(replace(photo, fruits=(ignored,)), [])
    assert (labels == IGNORED).sum() == seen.area_px


@pytest.mark.parametrize("radius", [30, 160])
def test_a_large_photo_is_cut_once_and_fruits_stay_where_they_are(tmp_path: Path, radius: int) -> None:
    size = (2200, 1500)
    centers = [(x, y) for x in (250, 733, 1100, 1900) for y in (300, 750, 1200)]
    write_photo(tmp_path / "a.jpg", *size, [(x, y, radius) for x, y in centers])
    fruits = tuple(disc(x, y, radius, size) for x, y in centers)
    photo = LabelledPhoto(tmp_path / "a.jpg", "sub/a.jpg", *size, fruits)
    samples = samples_of(photo, tmp_path / "cache", source="s", fruit_px=2.0 * radius)
    scale = min(1, 110 / (2 * radius))
    assert len(samples) == (6 if scale == 1 else 1)
    assert {s.group for s in samples} == {"a"}
    assert {s.name for s in samples} == {"sub/a.jpg"}
    fruit_pixels = 0
    for sample in samples:
        pixels, labels = sample.pixels(), sample.label_image()
        assert pixels.shape[:2] == labels.shape
        assert max(labels.shape) <= 1100
        red = pixels[:, :, 0] > 150
        assert (red == (labels != 0)).mean() > 0.995
        assert set(np.unique(labels)) - {IGNORED, 0} == set(range(1, len(sample.boxes_px) + 1))
        np.testing.assert_allclose(boxes_of(labels, len(sample.boxes_px)), sample.boxes_px, atol=1.5)
        fruit_pixels += int((labels != 0).sum())
    assert fruit_pixels == pytest.approx(12 * np.pi * radius**2 * scale**2, rel=0.03)
    before = {s.labels: s.labels.stat().st_mtime_ns for s in samples}
    again = samples_of(photo, tmp_path / "cache", source="s", fruit_px=2.0 * radius)
    assert {s.labels: s.labels.stat().st_mtime_ns for s in again} == before
    np.testing.assert_array_equal(again[0].boxes_px, samples[0].boxes_px)
    crop = draw_crop(samples, np.random.default_rng(0), AugmentOptions(crop_px=96))
    assert crop.pixels.shape == (96, 96, 3)


def test_boxes_of_a_large_photo_become_the_same_weak_masks(tmp_path: Path) -> None:
    size = (2000, 1400)
    centers = [(300, 300), (1500, 900)]
    write_photo(tmp_path / "a.jpg", *size, [(x, y, 40) for x, y in centers])
    photo = LabelledPhoto(
        tmp_path / "a.jpg", "a.jpg", *size, tuple(disc(x, y, 40, size, boxed=True) for x, y in centers)
    )
    samples = samples_of(photo, tmp_path / "cache", source="s", fruit_px=80)
    areas = [int((s.label_image() == 1).sum()) for s in samples if len(s.boxes_px)]
    assert areas == pytest.approx([np.pi * 1600] * 2, rel=0.1)


def test_changed_labels_make_another_label_image(tmp_path: Path) -> None:
    write_photo(tmp_path / "a.png", 64, 64)
    photos = [
        LabelledPhoto(tmp_path / "a.png", "a.png", 64, 64, (disc(x, 30, 10, (64, 64)),)) for x in (20, 40)
    ]  # fmt: skip
    one, other = (samples_of(p, tmp_path / "cache", source="s")[0] for p in photos)
    assert one.label_image()[30, 20] == 1
    assert other.label_image()[30, 20] == 0


def test_a_photo_that_the_camera_stored_turned_is_kept_upright(tmp_path: Path) -> None:
    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[5:15, 40:56] = (255, 0, 0)
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(pixels).save(tmp_path / "a.jpg", exif=exif, quality=98)
    assert size_of(tmp_path / "a.jpg") == (40, 60)
    fruit = disc(30, 48, 6, (40, 60))  # stored (48, 10) is at x = 40 - 10, y = 48
    photo = LabelledPhoto(tmp_path / "a.jpg", "a.jpg", 40, 60, (fruit,))
    (sample,) = samples_of(photo, tmp_path / "cache", source="s")
    red, labels = sample.pixels(), sample.label_image()
    assert red.shape == (60, 40, 3)
    assert (red[labels == 1, 0] > 150).mean() > 0.9


def test_grey_of_twelve_bits_is_learnt_as_bright_as_it_is_segmented(tmp_path: Path) -> None:
    grey = np.tile(np.linspace(0, 255, 64).astype(np.uint8), (48, 1))
    cv2.imwrite(str(tmp_path / "a.png"), grey.astype(np.uint16) * 16)  # 0 to 4095 of 65535
    photo = LabelledPhoto(tmp_path / "a.png", "a.png", 64, 48, (disc(30, 20, 8, (64, 48)),))
    (sample,) = samples_of(photo, tmp_path / "cache", source="s")
    assert np.abs(sample.pixels()[:, :, 0].astype(int) - grey).max() <= 4


def test_sets_of_several_kinds_together_and_classes(tmp_path: Path) -> None:
    data = tmp_path / "data"
    names = [f"IMG_{k:04d}.png" for k in range(8)]
    coco_of(data / "boxes", names, {name: [[10, 10, 30, 30]] for name in names})
    for k in range(3):
        write_photo(data / "yolo" / "images" / f"{k}.png", 64, 64, [(32, 32, 12)])
        (data / "yolo" / "labels").mkdir(exist_ok=True)
        (data / "yolo" / "labels" / f"{k}.txt").write_text("1 0.5 0.5 0.4 0.4\n0 0.2 0.2 0.2 0.2\n")
    (data / "yolo" / "data.yaml").write_text("names: [Apple, leaf]\n")
    ids = np.zeros((64, 64), np.uint16)
    ids[20:40, 20:40] = 9
    write_photo(data / "row" / "images" / "east_0.jpg", 64, 64)
    (data / "row" / "truth" / "masks").mkdir(parents=True)
    cv2.imwrite(str(data / "row" / "truth" / "masks" / "east_0.png"), ids)
    training, validation = gather([data], tmp_path / "cache", 0.3)
    everything = training + validation
    assert len(everything) == 12
    assert {s.source for s in validation} <= {"data/boxes", "data/yolo"}
    assert [s.source for s in training if not s.weak] == ["rendered"]
    assert sum(len(s.boxes_px) for s in everything) == 8 + 6 + 1
    write_split(tmp_path / "split.json", training, validation)
    assert "rendered/row/east_0.jpg" in json.loads((tmp_path / "split.json").read_text())["training"]

    apples = gather([data], tmp_path / "cache", 0.3, classes=["apple"])
    assert sum(len(s.boxes_px) for side in apples for s in side) == 8 + 3 + 1
    with pytest.raises(InputError, match=r"`classes`: expected some of .*Apple, leaf\), found 'pear'"):
        gather([data], tmp_path / "cache", 0.3, classes=["pear"])
    with pytest.raises(InputError, match=r"boxes: expected fruits of the classes leaf, found only apple"):
        gather([data], tmp_path / "cache", 0.3, classes=["leaf"])


def test_a_survey_is_no_labels_and_its_exported_ones_beside_its_photos_are(tmp_path: Path) -> None:
    survey, photos = write_view_survey(tmp_path / "row"), tmp_path / "row" / "photos"
    with pytest.raises(InputError, match=r"is a survey.*`pomona export .* --to coco --out PHOTOS/labels\.json`"):
        gather([survey], tmp_path / "cache", 0.3)
    pomona.open(survey).export("coco", photos / "labels.json")
    training, validation = gather([photos], tmp_path / "cache", 0.3)
    assert sum(len(sample.boxes_px) for sample in training + validation) > 24


def test_photos_of_a_rendered_row_stay_together(tmp_path: Path) -> None:
    for row in ("a", "b", "c"):
        for name in ("east_000", "east_001"):
            write_photo(tmp_path / row / "images" / f"{name}.jpg", 64, 64)
            (tmp_path / row / "truth" / "masks").mkdir(parents=True, exist_ok=True)
            ids = np.zeros((64, 64), np.uint16)
            ids[20:40, 20:40] = 9
            cv2.imwrite(str(tmp_path / row / "truth" / "masks" / f"{name}.png"), ids)
    training, validation = gather([tmp_path], tmp_path / "cache", 0.3)
    assert len(training) + len(validation) == 6
    assert not {s.group for s in training} & {s.group for s in validation}
    with pytest.raises(InputError, match="expected some of each"):
        gather([tmp_path / "a"], tmp_path / "cache", 0.3)


def via_of(folder: Path, names: list[str]) -> None:
    content = {}
    for name in names:
        write_photo(folder / name, 64, 64, [(30, 30, 12)])
        circle = {"name": "circle", "cx": 30, "cy": 30, "r": 12}
        content[f"{name}1"] = {"filename": name, "size": 1, "regions": [{"shape_attributes": circle}]}
    (folder / "via_region_data.json").write_text(json.dumps(content))


def test_folders_that_say_what_their_photos_are_for(tmp_path: Path) -> None:
    """The layout of the Fuji-SfM set: tiles with VIA labels, in folders for training and validation."""
    masks = tmp_path / "Fuji-SfM" / "1-Mask-set"
    via_of(masks / "train", ["_MG_8067_01.png", "_MG_8067_02.png", "_MG_8068_01.png"])
    via_of(masks / "val", ["_MG_8069_01.png"])
    via_of(masks / "test", ["_MG_8070_01.png"])
    write_photo(tmp_path / "Fuji-SfM" / "2-SfM-set" / "east" / "_MG_1.jpg", 64, 64)
    progress = Silent()
    training, validation = gather([tmp_path / "Fuji-SfM"], tmp_path / "cache", 0.15, progress=progress)
    assert [s.name for s in training] == ["_MG_8067_01.png", "_MG_8067_02.png", "_MG_8068_01.png"]
    assert [s.name for s in validation] == ["_MG_8069_01.png"]
    assert progress.warnings == [f"{tmp_path / 'Fuji-SfM'}: 1 samples kept there for tests are not used"]

    via_of(masks / "val", ["_MG_8067_03.png", "_MG_8069_01.png"])
    progress = Silent()
    training, validation = gather([tmp_path / "Fuji-SfM"], tmp_path / "cache", 0.15, progress=progress)
    assert (len(training), len(validation)) == (3, 2)
    assert any("1 of 2 samples to measure on are of photos of which other parts" in w for w in progress.warnings)
    training, validation = gather([tmp_path / "Fuji-SfM"], tmp_path / "cache", 0.15, split_by="photos")
    assert len(training) + len(validation) == 5
    assert not {s.group for s in training} & {s.group for s in validation}


def test_further_parts_of_photos_follow_those_that_have_a_side(tmp_path: Path) -> None:
    """Train and validation folders beside tiles without a side, in the same folder and in another one."""
    via_of(tmp_path / "set" / "train", ["IMG_0001_0_0.png", "IMG_0003_0_0.png"])
    via_of(tmp_path / "set" / "valid", ["IMG_0002_0_0.png", "IMG_0003_0_512.png"])
    names = [f"IMG_{k:04d}_512_0.png" for k in range(1, 9)]
    via_of(tmp_path / "set" / "more", names)
    via_of(tmp_path / "other", [f"IMG_{k:04d}_512_512.png" for k in range(1, 9)])
    progress = Silent()
    training, validation = gather([tmp_path / "other", tmp_path / "set"], tmp_path / "cache", 0.15, progress=progress)
    assert len(training) + len(validation) == 4 + 2 * 8
    followers = [s for s in training + validation if not s.part]
    of = {s.name: side for side, samples in (("t", training), ("v", validation)) for s in samples if s in followers}
    for offset in ("512_0", "512_512"):
        assert of[f"IMG_0001_{offset}.png"] == "t"
        assert of[f"IMG_0002_{offset}.png"] == "v"
        assert of[f"IMG_0003_{offset}.png"] == "v"  # on both sides already: held out in doubt
    both = {s.group for s in training} & {s.group for s in validation}
    assert both == {"IMG_0003"}  # as the folders say
    assert any("4 samples that no folder says a side of" in warning for warning in progress.warnings)


def test_sides_are_said_by_the_names_of_what_is_given(tmp_path: Path) -> None:
    for part, k in (("train", 1), ("valid", 7), ("test", 9)):
        via_of(tmp_path / "set" / part, [f"IMG_{n:04d}.png" for n in range(k, k + 4)])
    folders = [tmp_path / "set" / part for part in ("train", "valid", "test")]
    for given in (folders, [folder / "via_region_data.json" for folder in folders]):
        progress = Silent()
        training, validation = gather(given, tmp_path / "cache", 0.15, progress=progress)
        assert [s.name for s in training] == [f"IMG_{n:04d}.png" for n in range(1, 5)]
        assert [s.name for s in validation] == [f"IMG_{n:04d}.png" for n in range(7, 11)]
        assert any("4 samples kept there for tests are not used" in warning for warning in progress.warnings)
    training, validation = gather(folders, tmp_path / "cache", 0.15, split_by="photos")
    assert len(training) + len(validation) == 12
    training, validation = gather(folders[2:], tmp_path / "cache", 0.3)
    assert len(training) + len(validation) == 4


def test_a_set_with_one_side_alone_is_split(tmp_path: Path) -> None:
    via_of(tmp_path / "set" / "train", [f"IMG_{k:04d}.png" for k in range(6)])
    training, validation = gather([tmp_path / "set"], tmp_path / "cache", 0.2)
    assert len(training) + len(validation) == 6


def test_sets_that_cannot_be_used(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    coco_of(folder, ["a_0.png", "a_1.png"], {"a_0.png": [[1, 1, 20, 20]]})
    with pytest.raises(InputError, match="`split_by`: expected folders or photos, found 'dice'"):
        gather([folder], tmp_path / "cache", 0.5, split_by="dice")
    (folder / "a_1.png").write_bytes((folder / "a_1.png").read_bytes()[:200])
    with pytest.raises(FormatError, match=r"a_1\.png: expected a photo: "):
        gather([folder], tmp_path / "cache", 0.5)
    (folder / "a_1.png").unlink()
    with pytest.raises(MissingFileError, match=r"labels\.json: image 1: photo 'a_1\.png' is not there"):
        gather([folder], tmp_path / "cache", 0.5)
    coco_of(folder, ["only.png"], {"only.png": [[1, 1, 20, 20]]})
    with pytest.raises(InputError, match="expected some of each"):
        gather([folder], tmp_path / "cache", 0.5)


def test_photos_that_two_files_label_are_refused(tmp_path: Path) -> None:
    via_of(tmp_path / "set", [f"IMG_{k:04d}.png" for k in range(4)])
    (tmp_path / "set" / "copy.json").write_text((tmp_path / "set" / "via_region_data.json").read_text())
    with pytest.raises(InputError, match=r"IMG_0000\.png: expected labels of one file.*copy\.json and in .*via_region"):
        gather([tmp_path / "set"], tmp_path / "cache", 0.3)
    training, validation = gather([tmp_path / "set" / "copy.json"], tmp_path / "cache", 0.3)
    assert len(training) + len(validation) == 4


def test_photos_without_labels_are_warned_of(tmp_path: Path) -> None:
    names = [f"IMG_{k:04d}.png" for k in range(6)]
    coco_of(tmp_path / "set", names, {names[0]: [[1, 1, 20, 20]]})
    progress = Silent()
    gather([tmp_path / "set"], tmp_path / "cache", 0.3, progress=progress)
    assert any(r"5 of 6 photos have no label" in warning for warning in progress.warnings)


def test_weak_masks_are_close_to_true_ones_on_a_rendered_photo(shared_data: Path) -> None:
    from pomona.formats.detections.png_masks import read_png_masks
    from pomona.learning.train.weak_masks import label_image_from_boxes

    photo = read_png_masks(shared_data / "orchard-dev", size_of)[0]
    fruits = [f for f in photo.fruits if f.mask is not None and f.mask.area_px >= 400]
    boxes = np.array([f.box_px for f in fruits])
    pixels = Sample(photo.path, Path(), boxes, "", "").pixels()
    labels = label_image_from_boxes(pixels, boxes)
    iou = []
    for k, fruit in enumerate(fruits, start=1):
        truth = paint(photo, [fruit]) == 1
        iou.append(((labels == k) & truth).sum() / ((labels == k) | truth).sum())
    assert 0.65 < np.mean(iou) < 0.95


@pytest.mark.parametrize(
    ("orientation", "size", "place"),
    [(3, (60, 40), (12, 30)), (6, (40, 60), (30, 48)), (8, (40, 60), (10, 12))],  # where stored (48, 10) is, upright
)
@pytest.mark.parametrize("name", ["a.tif", "a.TIFF", "a.png"])
def test_a_tiff_that_is_stored_turned_is_kept_upright(
    tmp_path: Path, name: str, orientation: int, size: tuple[int, int], place: tuple[int, int]
) -> None:
    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[5:15, 40:56] = (255, 0, 0)
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(pixels).save(tmp_path / name, "TIFF", exif=exif)
    assert size_of(tmp_path / name) == size
    photo = LabelledPhoto(tmp_path / name, name, *size, (disc(*place, 6, size),))
    (sample,) = samples_of(photo, tmp_path / "cache", source="s")
    assert sample.image.parent == tmp_path / "cache"
    red, labels = sample.pixels(), sample.label_image()
    assert red.shape[:2] == labels.shape == size[::-1]
    assert (red[labels == 1, 0] > 150).mean() > 0.9


def test_photos_of_a_row_with_padded_numbers_are_not_tiles_of_one() -> None:
    groups = [group_of(f"row1_{k:03}") for k in range(1, 100)]
    assert groups == [f"row1_{k:03}" for k in range(1, 100)]
