"""COCO files: what is written is read again; masks in every form; files of other tools, and wrong ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pycocotools import mask as coco_mask

from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.detections.coco import read_coco, write_coco
from pomona.formats.detections.coco_masks import ellipse_mask, mask_of
from pomona.formats.detections.read import read_detections
from pomona.formats.detections.rle import counts_of, decode_counts, encode, mask_from_counts
from pomona.progress import Silent
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.photos import Photo, Photos

WIDTH, HEIGHT = 60, 40
BOX = [10, 8, 12, 6]
SQUARE = [[10, 8, 22, 8, 22, 14, 10, 14]]


def photos_named(*names: str) -> Photos:
    return Photos(tuple(Photo(name=n, path=Path(n), width_px=WIDTH, height_px=HEIGHT) for n in names))


def coco(path: Path, *annotations: dict[str, Any], name: str = "a.jpg", **changes: Any) -> Path:
    """A file with one image and these annotations, which need to say only what is not usual."""
    entries = [
        {"id": k, "image_id": 1, "category_id": 1, "bbox": BOX, "segmentation": SQUARE} | annotation
        for k, annotation in enumerate(annotations, start=7)
    ]
    image = {"id": 1, "file_name": name, "width": WIDTH, "height": HEIGHT}
    content = {"images": [image], "categories": [{"id": 1, "name": "apple"}], "annotations": entries} | changes
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def random_mask(rng: np.random.Generator) -> Mask:
    pixels = np.zeros((HEIGHT, WIDTH), bool)
    x, y = rng.integers(0, WIDTH - 1), rng.integers(0, HEIGHT - 1)
    pixels[y : y + rng.integers(1, 25), x : x + rng.integers(1, 25)] = True
    return Mask.from_pixels(
        pixels & (rng.uniform(size=pixels.shape) < 0.8) | (pixels.cumsum() == 1).reshape(HEIGHT, -1)
    )


def full(mask: Mask) -> np.ndarray:
    pixels = np.zeros((HEIGHT, WIDTH), bool)
    pixels[mask.y_px : mask.y_px + mask.height_px, mask.x_px : mask.x_px + mask.width_px] = mask.pixels
    return pixels


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_runs_equal_those_of_pycocotools(seed: int) -> None:
    mask = random_mask(np.random.default_rng(seed))
    expected = coco_mask.encode(np.asfortranarray(full(mask).astype(np.uint8)))
    assert encode(mask, WIDTH, HEIGHT) == expected["counts"].decode()
    counts = decode_counts(expected["counts"].decode())
    assert counts.tolist() == counts_of(mask, WIDTH, HEIGHT).tolist()
    again = mask_from_counts(counts, WIDTH, HEIGHT)
    assert again is not None
    assert again == mask or (again.box_px == mask.box_px and again.packed == mask.packed)


@pytest.mark.parametrize(
    ("counts", "said"),
    [([5, -1, 2396], "negative"), ([5, 10], "sum to 60 × 40 = 2400 pixels, found 15"), ([], "found 0")],
)
def test_runs_that_do_not_fit_are_refused(counts: list[int], said: str) -> None:
    with pytest.raises(InputError, match=said):
        mask_from_counts(np.array(counts, np.int64), WIDTH, HEIGHT)


@pytest.mark.parametrize("text", ["a b", "é", "o", "ooooooooooooooo0"])
def test_compressed_runs_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        decode_counts(text)


def test_written_detections_are_read_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    photos = photos_named("east/1.jpg", "east/2.jpg", "west/1.jpg")
    masks = tuple(random_mask(rng) for _ in range(20))
    first = Detections("east/1.jpg", WIDTH, HEIGHT, masks, rng.uniform(0, 1, 20), np.arange(100, 120))
    written = SurveyDetections({"east/1.jpg": first, "west/1.jpg": Detections.empty("west/1.jpg", WIDTH, HEIGHT)})
    write_coco(tmp_path / "detections.json", photos, written)
    assert [p.name for p in tmp_path.iterdir()] == ["detections.json"]
    read = read_coco(tmp_path / "detections.json", photos)
    assert list(read) == ["east/1.jpg", "west/1.jpg"], "no fruit found is not the same as not looked at"
    assert [m.packed for m in read["east/1.jpg"].masks] == [m.packed for m in masks]
    assert [m.box_px for m in read["east/1.jpg"].masks] == [m.box_px for m in masks]
    np.testing.assert_array_equal(read["east/1.jpg"].scores, first.scores)
    np.testing.assert_array_equal(read["east/1.jpg"].ids, first.ids)
    np.testing.assert_array_equal(read["east/1.jpg"].boxes_px, first.boxes_px)
    given = read_detections(tmp_path / "detections.json", photos)
    assert [m.packed for m in given["east/1.jpg"].masks] == [m.packed for m in masks]


def test_written_files_are_read_by_pycocotools(tmp_path: Path) -> None:
    from pycocotools.coco import COCO

    mask = random_mask(np.random.default_rng(0))
    found = Detections("a.jpg", WIDTH, HEIGHT, (mask,), np.ones(1), np.array([5]))
    write_coco(tmp_path / "d.json", photos_named("a.jpg"), SurveyDetections({"a.jpg": found}))
    read = COCO(str(tmp_path / "d.json"))
    assert np.array_equal(read.annToMask(read.anns[5]).astype(bool), full(mask))
    assert read.anns[5]["area"] == mask.area_px


def test_photos_that_are_not_in_the_survey_are_not_written_or_read(tmp_path: Path) -> None:
    stranger = SurveyDetections({"x.jpg": Detections.empty("x.jpg", WIDTH, HEIGHT)})
    with pytest.raises(InputError, match=r"not in the survey: x\.jpg"):
        write_coco(tmp_path / "d.json", photos_named("a.jpg"), stranger)
    with pytest.raises(FormatError, match=r"'a\.jpg' is not a photo of this survey"):
        read_coco(coco(tmp_path / "d.json"), photos_named("b.jpg"))


def test_masks_in_every_form_are_the_same(tmp_path: Path) -> None:
    expected = np.zeros((HEIGHT, WIDTH), bool)
    expected[8:14, 10:22] = True
    mask = Mask.from_pixels(expected)
    forms: list[Any] = [
        SQUARE,
        [[10, 8, 16, 8, 16, 14, 10, 14], [16, 8, 22, 8, 22, 14, 16, 14]],
        {"size": [HEIGHT, WIDTH], "counts": counts_of(mask, WIDTH, HEIGHT).tolist()},
        {"size": [HEIGHT, WIDTH], "counts": encode(mask, WIDTH, HEIGHT)},
    ]
    path = coco(tmp_path / "d.json", *({"segmentation": form} for form in forms))
    progress = Silent()
    found = read_detections(path, photos_named("a.jpg"), progress=progress)["a.jpg"]
    assert [full(m).tolist() for m in found.masks] == [expected.tolist()] * 4
    assert found.ids.tolist() == [7, 8, 9, 10]
    assert found.scores.tolist() == [1, 1, 1, 1]
    assert [w.partition(": ")[2] for w in progress.warnings] == [
        "4 of 4 detections have no score: it is taken to be 1."
    ]


def test_round_polygons_have_the_area_of_the_disc() -> None:
    angles = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    points = np.stack([30 + 12 * np.cos(angles), 20 + 12 * np.sin(angles)], 1)
    mask = mask_of([points.ravel().tolist()], WIDTH, HEIGHT)
    assert mask is not None
    assert mask.area_px == pytest.approx(np.pi * 144, rel=0.03)
    np.testing.assert_allclose(mask.center_px, [30, 20], atol=0.3)


def test_a_box_alone_becomes_its_ellipse_with_a_warning(tmp_path: Path) -> None:
    path, progress = coco(tmp_path / "d.json", {"segmentation": []}), Silent()
    (mask,) = read_detections(path, photos_named("a.jpg"), progress=progress)["a.jpg"].masks
    assert mask.area_px == pytest.approx(np.pi / 4 * 12 * 6, rel=0.08)
    assert mask.box_px == (10, 8, 22, 14)
    assert "1 annotation without a mask: " in progress.warnings[0]
    assert ellipse_mask((10.6, 10.6, 0.3, 0.3), WIDTH, HEIGHT) is None


def test_what_is_no_fruit_is_left_out_with_a_warning(tmp_path: Path) -> None:
    crowd = {"iscrowd": 1, "segmentation": {"size": [HEIGHT, WIDTH], "counts": [0, HEIGHT * WIDTH]}}
    nothing = {"segmentation": {"size": [HEIGHT, WIDTH], "counts": [HEIGHT * WIDTH]}}
    progress = Silent()
    path = coco(tmp_path / "d.json", {}, crowd, nothing)
    found = read_detections(path, photos_named("a.jpg", "b.jpg"), progress=progress)
    assert found["a.jpg"].ids.tolist() == [7]
    assert list(found) == ["a.jpg"]
    for said in ("1 crowd (iscrowd) left out", "cover no pixel", "photos without detections: b.jpg"):
        assert sum(said in warning for warning in progress.warnings) == 1


@pytest.mark.parametrize(
    "name", ["east/IMG_1.jpg", "IMG_1.jpg", "/home/me/row/east/IMG_1.jpg", "C:\\row\\east\\IMG_1.jpg", "img_1.png"]
)
def test_photos_are_found_by_name_path_or_stem(tmp_path: Path, name: str) -> None:
    found = read_detections(coco(tmp_path / "d.json", {}, name=name), photos_named("east/IMG_1.jpg", "east/IMG_2.jpg"))
    assert list(found) == ["east/IMG_1.jpg"]
    assert found["east/IMG_1.jpg"].photo == "east/IMG_1.jpg"


def test_names_of_no_photo_are_refused_with_examples_of_both(tmp_path: Path) -> None:
    with pytest.raises(
        FormatError, match=r"none of its 1 images is among the 2 photos: expected names such as a\.jpg.*x9"
    ):
        read_detections(coco(tmp_path / "d.json", {}, name="x9.jpg"), photos_named("a.jpg", "b.jpg"))
    with pytest.raises(FormatError, match=r"fits several photos: east/1\.jpg, west/1\.jpg; give their names in full"):
        read_detections(coco(tmp_path / "d.json", {}, name="1.jpg"), photos_named("east/1.jpg", "west/1.jpg"))
    image = {"file_name": "a.jpg", "width": WIDTH, "height": HEIGHT}
    twice = coco(tmp_path / "d.json", images=[image | {"id": 1}, image | {"id": 2, "file_name": "x/a.jpg"}])
    with pytest.raises(FormatError, match=r"photo a\.jpg is given twice"):
        read_detections(twice, photos_named("a.jpg"))


def test_images_that_are_not_among_the_photos_are_warned_of(tmp_path: Path) -> None:
    images = [{"id": k, "file_name": f"{n}.jpg", "width": WIDTH, "height": HEIGHT} for k, n in enumerate("ax", 1)]
    progress = Silent()
    read_detections(coco(tmp_path / "d.json", images=images), photos_named("a.jpg"), progress=progress)
    assert any("images that are not among the photos: x.jpg" in warning for warning in progress.warnings)


def test_several_categories_need_a_choice(tmp_path: Path) -> None:
    categories = [{"id": 1, "name": "apple"}, {"id": 2, "name": "leaf"}]
    path = coco(tmp_path / "d.json", {}, {"category_id": 2}, categories=categories)
    with pytest.raises(FormatError, match="found apple, leaf"):
        read_detections(path, photos_named("a.jpg"))
    assert read_detections(path, photos_named("a.jpg"), classes=["apple"])["a.jpg"].ids.tolist() == [7]
    with pytest.raises(InputError, match=r"`classes`: expected some of those in .* \(apple, leaf\), found 'pear'"):
        read_detections(path, photos_named("a.jpg"), classes=["pear"])


@pytest.mark.parametrize(
    ("annotation", "said"),
    [
        ({"image_id": 9}, r"annotation 7: image_id: expected the id of one of the images, found 9"),
        ({"id": 1.5}, r"annotations\[0\]: id: expected a whole number"),
        ({"category_id": 4}, r"annotation 7: category_id: expected one of 1 \(apple\), found 4"),
        ({"score": 1.2}, "annotation 7: score: expected a number from 0 to 1"),
        ({"bbox": [1, 2, 3]}, "bbox: expected four finite numbers"),
        ({"bbox": [1, 2, 0, 3]}, "bbox: expected a positive width and height"),
        ({"bbox": [50, 2, 30, 3]}, r"bbox: expected a place inside the photo of 60 × 40"),
        ({"segmentation": [[1, 2, 3, 4]]}, "at least 3 points"),
        ({"segmentation": [[1, 2, 3, 4, 5, 90]]}, "inside the photo"),
        ({"segmentation": "text"}, "expected a list of polygons or an object"),
        ({"segmentation": {"size": [WIDTH, HEIGHT], "counts": [5]}}, r"expected size \[40, 60\]"),
        ({"segmentation": {"size": [HEIGHT, WIDTH], "counts": [5]}}, "expected runs that sum to"),
        ({"segmentation": {"size": [HEIGHT, WIDTH], "counts": 5}}, "expected counts as a text or a list"),
        ({"segmentation": {"counts": [5]}}, "expected the fields size and counts"),
        ({"segmentation": None, "bbox": None}, "expected a segmentation or at least a bbox, found neither"),
    ],
)
def test_wrong_annotations_are_named(tmp_path: Path, annotation: dict[str, Any], said: str) -> None:
    with pytest.raises(FormatError, match=said) as caught:
        read_detections(coco(tmp_path / "d.json", annotation), photos_named("a.jpg"))
    assert "d.json" in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"images": {}}, "an object with the lists"),
        ({"images": [5]}, r"images\[0\]: expected an object"),
        ({"images": [{"id": 1, "width": 60, "height": 40}]}, "file_name: expected a name"),
        ({"images": [{"id": 1, "file_name": "a.jpg", "width": 0, "height": 40}]}, "positive size"),
        ({"images": [{"id": 1, "file_name": "a.jpg", "width": 40, "height": 60}]}, "annotate the photo upright"),
        (
            {"images": [{"id": 1, "file_name": "a.jpg", "width": 30, "height": 20}]},
            "expected the size of a.jpg, 60 × 40",
        ),
        ({"images": [{"id": 1, "file_name": n, "width": 60, "height": 40} for n in "ab"]}, "image 1: expected unique"),
        ({"categories": 5}, "categories: expected a list"),
    ],
)
def test_wrong_files_are_refused(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    with pytest.raises(FormatError, match=said):
        read_detections(coco(tmp_path / "d.json", **changes), photos_named("a.jpg"))


def test_two_annotations_of_one_id_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="annotation 7: expected unique ids"):
        read_detections(coco(tmp_path / "d.json", {}, {"id": 7}), photos_named("a.jpg"))


def test_files_that_are_no_coco_are_refused(tmp_path: Path) -> None:
    photos = photos_named("a.jpg")
    with pytest.raises(MissingFileError, match=r"nowhere\.json: expected detections, but there is no such file"):
        read_detections(tmp_path / "nowhere.json", photos)
    for content, said in ((b"{", "no JSON"), (b"\xff{", "cannot be read"), (b"[" * 9999, "recursion")):
        (tmp_path / "x.json").write_bytes(content)
        with pytest.raises(FormatError, match=said):
            read_detections(tmp_path / "x.json", photos)
    (tmp_path / "x.json").write_text("[1]")
    with pytest.raises(InputError, match=r"expected detections of one of COCO; .*; found none of them"):
        read_detections(tmp_path / "x.json", photos)


def test_a_mask_of_nothing_is_left_out_whatever_its_box(tmp_path: Path) -> None:
    empty = coco_mask.encode(np.zeros((HEIGHT, WIDTH), np.uint8, order="F"))
    box = coco_mask.toBbox(empty).tolist()
    assert box == [0, 0, 0, 0]
    runs = {"size": [HEIGHT, WIDTH], "counts": empty["counts"].decode()}
    for bbox in (box, [5, 5, 0, 3], None):
        progress = Silent()
        path = coco(tmp_path / "d.json", {"bbox": bbox, "segmentation": runs}, {})
        found = read_detections(path, photos_named("a.jpg"), progress=progress)
        assert found["a.jpg"].ids.tolist() == [8]
        assert any("annotations that cover no pixel are left out: 7" in text for text in progress.warnings)
        assert read_coco(path)["a.jpg"].ids.tolist() == [8]


def test_a_box_of_zeros_beside_a_mask_is_none(tmp_path: Path) -> None:
    path = coco(tmp_path / "d.json", {"bbox": [0, 0, 0, 0]})
    found = read_detections(path, photos_named("a.jpg"))["a.jpg"]
    assert found.boxes_px is not None
    assert found.boxes_px.tolist() == [[10, 8, 22, 14]]
    with pytest.raises(FormatError, match="annotation 7: bbox: expected a positive width and height, found 0 and 0"):
        read_detections(coco(tmp_path / "d.json", {"bbox": [0, 0, 0, 0], "segmentation": None}), photos_named("a.jpg"))


def test_photos_are_listed_once_to_write_detections(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    listed = []
    by_name = Photos.by_name
    monkeypatch.setattr(Photos, "by_name", lambda photos: listed.append(1) or by_name(photos))
    names = [f"{k}.jpg" for k in range(30)]
    none = (), np.zeros(0), np.zeros(0, np.int64), np.zeros((0, 4))
    found = SurveyDetections({name: Detections(name, WIDTH, HEIGHT, *none) for name in names})
    write_coco(tmp_path / "d.json", photos_named(*names), found)
    assert len(listed) == 1
