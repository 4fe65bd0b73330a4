"""Detections in the files of other programs: a made scene in every format is read as it is, and wrong files are not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import detection_scenes as scenes
from detection_scenes import FRUITS, SCENE, WRITERS, scene_photos, whole, written
from pomona.errors import FormatError, InputError, MissingFileError, PomonaError
from pomona.formats.detections.coco_file import parse_coco
from pomona.formats.detections.photo_source import GivenPhotos
from pomona.formats.detections.read import read_detections
from pomona.progress import Silent
from pomona.values.detections import SurveyDetections
from pomona.values.photos import Photo, Photos
from work import counted

UNLISTED = "COCO results by name"  # they have no place for a photo without fruit


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_masks_that_were_written(tmp_path: Path, name: str) -> None:
    write, exact, scored = WRITERS[name]
    progress = Silent()
    found = read_detections(write(tmp_path), scene_photos(), progress=progress)
    assert list(found) == [photo for photo in SCENE if SCENE[photo] or name != UNLISTED]
    assert found.total == len(FRUITS)
    for photo, fruits in SCENE.items():
        if not fruits:
            continue
        for fruit in fruits:
            overlaps = [iou(whole(mask), fruit.pixels) for mask in found[photo].masks]
            best = int(np.argmax(overlaps))
            assert overlaps[best] >= (1 if exact else 0.97), (photo, fruit, overlaps)
            assert found[photo].scores[best] == pytest.approx(fruit.score if scored else 1, abs=1e-6)
            # As much is read too much as too little: no outline is moved or grown.
            mask = whole(found[photo].masks[best])
            assert mask.sum() == pytest.approx(fruit.pixels.sum(), rel=0 if exact else 0.015)
    said = " ".join(progress.warnings)
    assert ("have no score: it is taken to be 1" in said) == (not scored)
    ids = np.concatenate([of_photo.ids for of_photo in found.values()])
    assert len(np.unique(ids)) == len(ids)


def iou(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


def changed(folder: Path, name: str, old: str, new: str) -> Path:
    """A format's files with a piece of the first that has it changed."""
    path = WRITERS[name][0](folder)
    for file in [path] if path.is_file() else sorted(p for p in path.rglob("*.*") if p.is_file()):
        text = file.read_text()
        if old in text:
            file.write_text(text.replace(old, new, 1))
            return path
    raise AssertionError(f"{old} is in no file of {name}")


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("COCO, polygons", '"width": 400', '"width": 800', "image 10 'east/IMG_1.JPG': expected the size of IMG_1.JPG"),
        ("COCO, polygons", '"score": 0.9', '"score": NaN', "annotation 50: score: .* found nan"),
        ("COCO, polygons", '"segmentation": [[', '"segmentation": [[5000, ', "annotation 50: .*expected polygons"),
        ("COCO, polygons", '"segmentation": [[', '"segmentation": [[5000, 9, ', "annotation 50: .*inside the photo"),
        ("COCO, polygons", '"segmentation": [[', '"segmentation": [[1e400, 9, ', "annotation 50: .*expected poly"),
        ("COCO, runs", '"counts": [', '"counts": [7, ', "annotation 50: .*expected runs that sum to 400 × 300"),
        ("COCO, runs", '"counts": [', f'"counts": [{10**30}, ', "annotation 50: .*expected counts"),
        ("COCO results by name", '"IMG_1"', "77", "result 0: image_id: expected a photo's name, found 77"),
        ("SAHI", '"category_id": 0', '"category_id": null', "category_id: expected a whole number"),
        ("VIA 2", '"all_points_x": [', '"all_points_x": [5, ', "region 0: expected as many all_points_x"),
        ("VIA 2", '"score": "0.9"', '"score": "nan"', "region 0: score: expected a number from 0 to 1, found 'nan'"),
        ("VIA 3", '"vid": "1"', '"vid": "9"', "metadata '0_x': vid: expected one of the views, found '9'"),
        ("VIA 3", '"fid_list": ["1"]', '"fid_list": ["1", "2"]', r"view '1': fid_list: expected the id of one file"),
        ("VIA 3", '"xy": [9', '"xy": [5', "metadata '1_x': xy: expected the number and coordinates of a shape"),
        ("VIA 3", '"fname": "east/IMG_1.JPG"', '"fname": ""', "file '1': fname: expected a photo's name"),
        ("VIA, a table", '""cx"": 200.0', '""cx"": 900', "line 3: expected a place inside the photo of 400 × 300"),
        ("YOLO", " 0.9\n", " 9\n", "east/IMG_1.txt: line 1: score: .* found '9'"),
        ("YOLO", " 0.9\n", "\n", "IMG_1.txt: line 2: expected a confidence at the end of all lines or of none"),
        ("YOLO", "names: [apple]", "names: [", r"data\.yaml: expected YAML"),
        ("YOLO", "0 0.", "7 0.", "line 1: expected the number of a class from 0 to 0, found 7"),
        ("CVAT", 'width="400"', 'width="300"', "image 'east/IMG_1.JPG': expected the size .* found 300 × 300"),
        ("CVAT", 'points="', 'points="5,nan;', r"shape 0 \(polygon\): points: expected pairs x,y"),
        ("CVAT", 'rle="', 'rle="3, ', r"shape 2 \(mask\): rle: expected runs that sum to .* pixels, found"),
        ("CVAT", 'rle="', 'rle="x, ', "rle: expected whole numbers with commas between"),
        ("CVAT", 'left="', 'left="3', "expected a place inside the photo"),
        ("CVAT", '<polygon label="apple"', '<points label="apple"', "no XML: mismatched tag: line 6"),
        ("CVAT", "<image", "<track/><image", "found tracks: export it as 'CVAT for images 1.1'"),
        ("CVAT", "<annotations>", "<!DOCTYPE a [<!ENTITY a 'b'>]><annotations>", "XML that defines entities"),
        ("CVAT", '<tag label="sunny" source="manual">', '<cuboid label="x">', "no XML"),
        ("CVAT", '<tag label="sunny" source="manual"></tag>', "<cuboid/>", r"\(cuboid\): expected a shape with"),
        ("CVAT", '<tag label="sunny" source="manual"></tag>', '<box xtl="1" ytl="1" xbr="9" ybr="9" rotation="5"/>',
         r"shape 3 \(box\): rotation: expected a box without rotation: draw a turned one as a polygon"),
        ("supervision, Pascal VOC", "<width>400", "<width>40", "IMG_1.xml: size: expected the size of IMG_1.JPG"),
        ("supervision, Pascal VOC", "<x2>", "<x99999>", "no XML"),
        ("supervision, Pascal VOC", "<x3>", "<x3>1e9", "object 0: .*inside the photo|object 0: x3: expected"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path: Path, name: str, old: str, new: str, said: str) -> None:
    path = changed(tmp_path / "given", name, old, new)
    with pytest.raises(FormatError, match=said) as caught:
        read_detections(path, scene_photos())
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("name", ["images of 8 bits", "images with a palette", "TIFF, big-endian", "MATLAB"])
def test_label_images_of_another_size_are_refused(tmp_path: Path, name: str) -> None:
    path = WRITERS[name][0](tmp_path)
    small = Photos(tuple(replace(photo, width_px=200, height_px=150) for photo in scene_photos()))
    with pytest.raises(FormatError, match=r"IMG_1.*expected the size of IMG_1\.JPG, 200 × 150, found 400 × 300"):
        read_detections(path, small)


def test_images_that_say_fruit_but_not_which_are_refused(tmp_path: Path) -> None:
    path = scenes.label_images(tmp_path, "8 bits")
    cv2.imwrite(str(tmp_path / "east" / "IMG_1.png"), (scenes.label_image("east/IMG_1.JPG") > 0).astype(np.uint8) * 255)
    with pytest.raises(
        FormatError, match=r"IMG_1\.png: .*black and white alone, .* give each fruit its own number \(1, 2, …\)"
    ):
        read_detections(path, scene_photos())


def test_boxes_become_ellipses_and_it_is_said(tmp_path: Path) -> None:
    written(tmp_path / "IMG_1.txt", "0 0.5 0.5 0.2 0.1 0.8\n")
    progress = Silent()
    found = read_detections(tmp_path, scene_photos(), progress=progress)
    (mask,) = found["east/IMG_1.JPG"].masks
    assert mask.area_px == pytest.approx(np.pi / 4 * 80 * 30, rel=0.02)
    assert found["east/IMG_1.JPG"].scores.tolist() == [0.8]
    assert found["west/IMG_3.JPG"].scores.tolist() == []
    assert any("1 annotation without a mask: " in warning for warning in progress.warnings)
    said = "photos without a file are taken as photos without fruit, as YOLO writes none for them: "
    assert any(warning.partition(said)[2].count("IMG_") == 2 for warning in progress.warnings)


def test_the_classes_that_are_fruit_are_chosen(tmp_path: Path) -> None:
    path = changed(tmp_path, "CVAT", 'ellipse label="apple"', 'ellipse label="leaf"')
    with pytest.raises(FormatError, match=r"expected detections of one class, found apple, leaf: .*`classes`"):
        read_detections(path, scene_photos())
    assert read_detections(path, scene_photos(), classes=["Apple"]).total == len(FRUITS) - 1
    assert read_detections(path, scene_photos(), classes=["leaf", "apple"]).total == len(FRUITS)
    with pytest.raises(InputError, match=r"`classes`: expected some of those in .* \(apple, leaf\), found 'pear'"):
        read_detections(path, scene_photos(), classes=["pear"])


def test_parts_of_one_group_are_one_fruit_in_cvat(tmp_path: Path) -> None:
    halves = [
        f'<polygon label="apple" group_id="4" points="{x},10;{x + 8},10;{x + 8},30;{x},30"></polygon>' for x in (10, 20)
    ]
    image = f'<image id="0" name="IMG_1.JPG" width="400" height="300">{"".join(halves)}</image>'
    path = written(tmp_path / "a.xml", f"<annotations>{image}</annotations>")
    (mask,) = read_detections(path, scene_photos())["east/IMG_1.JPG"].masks
    assert (mask.box_px, mask.area_px) == ((10, 10, 28, 30), 320)


def test_the_photos_of_a_result_are_known_by_numbers_or_the_only_one(tmp_path: Path) -> None:
    photos = Photos(tuple(Photo(name=f"{k:06}.jpg", path=Path("x"), width_px=400, height_px=300) for k in (7, 12)))
    entry = {"category_id": 1, "score": 0.5, "segmentation": [[10, 10, 30, 10, 30, 30]]}
    path, progress = written(tmp_path / "r.json", [entry | {"image_id": 12}]), Silent()
    assert list(read_detections(path, photos, progress=progress)) == ["000012.jpg"]
    assert any("the numbers are taken to be the names of photos" in warning for warning in progress.warnings)
    written(path, [entry])
    with pytest.raises(
        FormatError, match=r"result 0: image_id: expected the photo, found none: give the list the photo"
    ):
        read_detections(path, photos)
    only = Photos(photos.items[:1])
    assert read_detections(path, only).total == 1
    written(path, [entry | {"file_name": "other.jpg"}])
    with pytest.raises(
        FormatError, match=r"none of its 1 images is among the 2 photos: .* such as 000007.jpg.*other.jpg"
    ):
        read_detections(path, photos)
    written(path, [entry | {"category_id": [1], "image_id": 12}])
    with pytest.raises(FormatError, match="annotation 1: category_id: expected a whole number"):
        read_detections(path, photos)


def test_crowds_are_left_out_but_for_supervisions_fruits_in_parts(tmp_path: Path) -> None:
    path = scenes.supervision_coco(tmp_path)
    content = json.loads(path.read_text())
    content["categories"][0]["supercategory"] = "plant"
    progress = Silent()
    assert read_detections(written(path, content), scene_photos(), progress=progress).total == len(FRUITS) - 1
    assert any("1 crowd (iscrowd) left out" in warning for warning in progress.warnings)


def test_what_was_drawn_with_cvats_brush_is_a_fruit_to_learn_from(tmp_path: Path) -> None:
    path = scenes.cvat_coco(tmp_path)
    marks = [annotation.crowd for annotation in parse_coco(path).annotations]
    assert marks == [False] * len(FRUITS)
    path.write_text(path.read_text().replace('"url": ""}]', '"url": "https://cocodataset.org"}]', 1))
    assert [annotation.crowd for annotation in parse_coco(path).annotations] == [False] * 2 + [True] * (len(FRUITS) - 2)


def test_a_folder_must_hold_one_format_and_something(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="no such file or folder"):
        read_detections(tmp_path / "none", scene_photos())
    with pytest.raises(InputError, match=r"expected detections of one of COCO; .*MATLAB masks; found none of them"):
        read_detections(tmp_path, scene_photos())
    scenes.cvat(tmp_path)
    (tmp_path / "notes.md").write_bytes("# drawn in May by Zoë".encode("latin-1"))
    written(tmp_path / "page.html", "<html><p>not closed")
    assert read_detections(tmp_path, scene_photos()).total == len(FRUITS)
    scenes.via2(tmp_path)
    with pytest.raises(InputError, match=r"of one format, found CVAT \(annotations.xml\), VIA \(project.json\): name"):
        read_detections(tmp_path, scene_photos())


def test_files_of_both_sides_are_read_together_and_photos_once(tmp_path: Path) -> None:
    for side in ("east", "west"):
        scenes.coco_file(lambda f: scenes.rle_of(f.pixels))(tmp_path / side)
    with pytest.raises(
        FormatError, match=r"west/masks\.json: image 10: photo east/IMG_1\.JPG is given twice: .*east/masks"
    ):
        read_detections(tmp_path, scene_photos())
    for side in ("east", "west"):
        path = tmp_path / side / "masks.json"
        content = json.loads(path.read_text())
        content["images"] = [image for image in content["images"] if image["file_name"].startswith(side)]
        known = {image["id"] for image in content["images"]}
        content["annotations"] = [entry for entry in content["annotations"] if entry["image_id"] in known]
        written(path, content)
    assert read_detections(tmp_path, scene_photos()).total == len(FRUITS)


def test_the_photos_own_files_are_no_label_images(tmp_path: Path) -> None:
    photos = Photos(tuple(replace(p, path=(tmp_path / p.name).with_suffix(".png")) for p in scene_photos()))
    for photo in photos:
        photo.path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(photo.path), np.zeros((4, 4, 3), np.uint8))
    scenes.via_csv(tmp_path)
    assert read_detections(tmp_path, photos).total == len(FRUITS)


PIECES = (
    b'"',
    b"{}",
    b"[]",
    b"null",
    b"-1",
    b"1e999",
    b"9" * 25,
    b"9" * 400,
    b"NaN",
    b"0",
    b",",
    b"\n",
    b"\xff",
    b"\x00",
    b"<",
    b";",
)


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Some bytes changed, cut out, doubled, put in, or all that follow lost."""
    at = int(rng.integers(0, len(data)))
    end = min(len(data), at + int(rng.integers(1, 12)))
    kind = rng.integers(0, 6)
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:at] + data[end:]
    if kind == 2:
        return data[:end] + data[at:]
    if kind == 3:
        return data[:at] + rng.integers(0, 256, end - at).astype(np.uint8).tobytes() + data[end:]
    if kind == 4:  # another digit: most such files can still be read
        digits = [k for k in range(at, min(at + 200, len(data))) if data[k : k + 1].isdigit()]
        if digits:
            return data[: digits[0]] + b"%d" % rng.integers(0, 10) + data[digits[0] + 1 :]
    return data[:at] + PIECES[rng.integers(len(PIECES))] + data[end if rng.random() < 0.5 else at :]


@pytest.mark.parametrize("name", WRITERS)
def test_damaged_files_are_read_or_refused_in_words(tmp_path: Path, name: str) -> None:
    path = WRITERS[name][0](tmp_path / "given")
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*.*") if p.is_file())
    rng = np.random.default_rng(sorted(WRITERS).index(name))
    refused = 0
    for case in range(24):
        file = files[case % len(files)]
        data = file.read_bytes()
        file.write_bytes(mutated(data, rng) if data else b"0 0.1")
        with counted() as work:
            found = read_or_refused(path)
        refused += isinstance(found, str)
        if isinstance(found, str):
            assert str(path) in found
        else:
            check_sound(found)
        assert 100 < work.calls < 100_000  # a damaged number is no reason to count to it
        assert 0 < work.peak_mb < 50
        file.write_bytes(data)
    assert refused >= 3


def read_or_refused(path: Path) -> SurveyDetections | str:
    """What is read, or why it is not; other errors than the package's own are let through."""
    try:
        return read_detections(path, scene_photos())
    except PomonaError as error:
        return str(error)


def check_sound(found: SurveyDetections) -> None:
    """That masks lie inside their photos is checked by the values themselves."""
    for of_photo in found.values():
        assert ((of_photo.scores >= 0) & (of_photo.scores <= 1)).all()
        assert of_photo.boxes_px is not None
        assert np.isfinite(of_photo.boxes_px).all()
        assert all(0 < mask.area_px <= scenes.WIDTH * scenes.HEIGHT for mask in of_photo.masks)


def test_many_results_of_numbered_photos_take_no_search_each() -> None:
    numbered = GivenPhotos(
        Photos(tuple(Photo(name=f"{k:06}.jpg", path=Path("x"), width_px=4, height_px=3) for k in range(400)))
    )
    with counted() as work:
        found = [numbered.numbered(k) for k in range(401)]
    assert [photo.name if photo else None for photo in found] == [*(f"{k:06}.jpg" for k in range(400)), None]
    assert work.calls < 401 * 40


def test_two_photos_of_one_number_are_none() -> None:
    photos = [Photo(name=f"{name}.jpg", path=Path("x"), width_px=4, height_px=3) for name in ("7", "east/07", "IMG_8")]
    numbered = GivenPhotos(Photos(tuple(photos)))
    assert [numbered.numbered(k) for k in (7, 8)] == [None, None]


def test_yolo_and_voc_with_suffixes_in_capitals_are_read(tmp_path: Path) -> None:
    written(tmp_path / "yolo" / "IMG_1.TXT", "0 0.5 0.5 0.2 0.1 0.8\n")
    assert read_detections(tmp_path / "yolo", scene_photos())["east/IMG_1.JPG"].scores.tolist() == [0.8]
    box = "<bndbox><xmin>31</xmin><ymin>11</ymin><xmax>50</xmax><ymax>20</ymax></bndbox>"
    written(
        tmp_path / "voc" / "IMG_1.XML",
        f"<annotation><filename>IMG_1.JPG</filename><object><name>apple</name>{box}</object></annotation>",
    )
    assert read_detections(tmp_path / "voc", scene_photos()).total == 1


def test_scores_of_x_anylabeling_are_read(tmp_path: Path) -> None:
    def shape(x: float, score: object, **more: object) -> dict[str, object]:
        points = [[x, 10], [x + 30, 10], [x + 30, 40], [x, 40]]
        return {"label": "apple", "points": points, "shape_type": "polygon", "score": score} | more

    shapes = [shape(10, 0.75), shape(60, 1), shape(110, None), shape(160, None, group_id=3)]
    shapes += [shape(200, 0.5, group_id=3), shape(300, 0.25, shape_type="rectangle")]
    content = {"version": "2.4.4", "imagePath": "IMG_1.JPG", "imageWidth": 400, "imageHeight": 300, "shapes": shapes}
    progress = Silent()
    found = read_detections(written(tmp_path / "IMG_1.json", content), scene_photos(), progress=progress)
    assert found["east/IMG_1.JPG"].scores.tolist() == [0.75, 1, 1, 0.5, 0.25]
    assert any("1 of 5 detections have no score" in warning for warning in progress.warnings)
    for wrong in (1.5, "0.9", True):
        written(tmp_path / "IMG_1.json", content | {"shapes": [shape(10, wrong)]})
        with pytest.raises(FormatError, match=r"IMG_1\.json: shape 0: score: expected a number from 0 to 1"):
            read_detections(tmp_path / "IMG_1.json", scene_photos())


@pytest.mark.parametrize("name", ["mkdocs.yml", "conda.yaml"])
@pytest.mark.parametrize("text", ["", "emoji: !!python/name:material.emoji\n", "names: 3\n", "day: 2024-99-99\n"])
def test_yaml_above_the_detections_of_yolo_is_not_theirs(tmp_path: Path, name: str, text: str) -> None:
    written(tmp_path / "found" / "IMG_1.txt", "0 0.5 0.5 0.2 0.1 0.8\n")
    (tmp_path / name).write_text(text)
    assert read_detections(tmp_path / "found", scene_photos()).total == 1
    written(tmp_path / "data.yaml", "names: [pear, apple]\n")
    assert read_detections(tmp_path / "found", scene_photos(), classes=["pear"]).total == 1
    written(tmp_path / "data.yaml", "names: [pear\n")
    with pytest.raises(FormatError, match=r"data\.yaml: expected YAML"):
        read_detections(tmp_path / "found", scene_photos())


def test_detections_in_utf16_are_refused_in_words(tmp_path: Path) -> None:
    path = scenes.coco_file(lambda f: scenes.rle_of(f.pixels))(tmp_path)
    path.write_text(path.read_text(), encoding="utf-16")
    for given in (path, tmp_path):
        with pytest.raises(
            FormatError, match=r"masks\.json: .*cannot be read: its text is in UTF-16, as PowerShell's >"
        ):
            read_detections(given, scene_photos())


def test_cvat_in_utf16_is_read(tmp_path: Path) -> None:
    path = scenes.cvat(tmp_path)
    path.write_text(path.read_text(), encoding="utf-16")
    assert read_detections(tmp_path, scene_photos()).total == len(FRUITS)


def test_a_file_of_yolo_with_a_byte_order_mark_alone_is_a_photo_without_fruit(tmp_path: Path) -> None:
    written(tmp_path / "IMG_1.txt", "0 0.5 0.5 0.2 0.1 0.8\n")
    (tmp_path / "IMG_3.txt").write_bytes(b"\xef\xbb\xbf")
    progress = Silent()
    found = read_detections(tmp_path, scene_photos(), progress=progress)
    assert len(found["west/IMG_3.JPG"].masks) == 0
    said = "photos without a file are taken as photos without fruit, as YOLO writes none for them: "
    assert any(text.partition(said)[2].count("IMG_") == 1 for text in progress.warnings)


def outline(fruit: scenes.Ellipse) -> str:
    return "0 " + " ".join(f"{x / scenes.WIDTH:g} {y / scenes.HEIGHT:g}" for x, y in fruit.outline())


def test_boxes_of_yolo_with_a_confidence_and_a_track(tmp_path: Path) -> None:
    """As Ultralytics' `save_txt` writes what `track` found; the box is 80 × 60 around the photo's middle."""
    written(tmp_path / "IMG_1.txt", "0 .5 .5 .2 .2 .9 1\n")
    progress = Silent()
    found = read_detections(tmp_path, scene_photos(), progress=progress)["east/IMG_1.JPG"]
    assert found.scores.tolist() == [0.9]
    assert found.boxes_px is not None
    assert found.boxes_px.tolist() == [pytest.approx([160, 120, 240, 180])]
    assert any("1 annotation without a mask: " in warning for warning in progress.warnings)
    written(tmp_path / "IMG_1.txt", "0 .5 .5 .2 .2 .9 4\n0 .2 .2 .1 .1 .8 1\n")
    written(tmp_path / "IMG_3.txt", "0 .5 .5 .2 .2 .7 4\n")
    both = read_detections(tmp_path, scene_photos())
    assert both["east/IMG_1.JPG"].scores.tolist() == [0.9, 0.8]
    assert both["west/IMG_3.JPG"].scores.tolist() == [0.7]


def test_outlines_of_yolo_with_a_confidence_and_a_track(tmp_path: Path) -> None:
    """A track's number 1 could be a place, but not beside one of 2 in another photo's file."""
    first, second = SCENE["east/IMG_1.JPG"][:2]
    written(tmp_path / "IMG_1.txt", f"{outline(first)} 0.9 1\n")
    written(tmp_path / "IMG_3.txt", f"{outline(second)} 0.75 2\n")
    found = read_detections(tmp_path, scene_photos())
    for name, fruit, score in (("east/IMG_1.JPG", first, 0.9), ("west/IMG_3.JPG", second, 0.75)):
        assert found[name].scores.tolist() == [score]
        assert iou(whole(found[name].masks[0]), fruit.pixels) > 0.97


@pytest.mark.parametrize(
    "text",
    [
        "0 .5 .5 .2 .2 .9 1.0\n",  # a place, written as such
        "0 .5 .5 .2 .2 .9 1\n1 .1 .1 .4 .1 .4 1\n",  # no two fruits have one number
        "0 .5 .5 .2 .2 .9 1\n0 .1 .1 .4 .1 .4 .4\n",
        "0 .5 .5 .2 .2 .9 .3 .5 1\n",  # no box has nine numbers
    ],
)
def test_outlines_of_yolo_that_end_at_the_edge_are_no_tracks(tmp_path: Path, text: str) -> None:
    written(tmp_path / "IMG_1.txt", text)
    progress = Silent()
    found = read_detections(tmp_path, scene_photos(), classes=["0", "1"] if "\n1 " in text else None, progress=progress)
    assert found["east/IMG_1.JPG"].scores.tolist() == [1.0] * text.count("\n")
    assert not any("without a mask" in warning for warning in progress.warnings)


def test_a_whole_number_out_of_place_is_no_track(tmp_path: Path) -> None:
    for text, said in (("0 .5 .5 .2 .2 95\n", "score: .* found '95'"), ("0 40 30 10 10 60 70\n", "shares")):
        written(tmp_path / "IMG_1.txt", text)
        with pytest.raises(FormatError, match=rf"IMG_1\.txt: line 1: .*{said}"):
            read_detections(tmp_path, scene_photos())
