"""Labels of other programs: small files written by hand, as those programs write them, and what is wrong with some."""

import base64
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.detections.coco_labels import read_coco_labels
from pomona.formats.detections.label_sets import find_label_sets, part_of, read_label_set
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto, classes_of
from pomona.formats.detections.labelme import read_labelme
from pomona.formats.detections.photo_source import PhotoFinder
from pomona.formats.detections.png_masks import read_png_masks
from pomona.formats.detections.via import read_via_json
from pomona.formats.detections.via_csv import read_via_csv
from pomona.formats.detections.voc import read_voc
from pomona.formats.detections.yolo import read_yolo
from pomona.formats.xml_file import load_xml

WIDTH, HEIGHT = 80, 60


def size_of(path: Path) -> tuple[int, int]:
    assert path.is_file()
    return WIDTH, HEIGHT


def photos_of(label_file: Path) -> PhotoFinder:
    return PhotoFinder(label_file, size_of)


def photo(path: Path) -> Path:
    """A file that stands for a photo of 80 × 60: readers of labels do not open it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"not looked into")
    return path


def pixels_of(fruit: LabelledFruit) -> np.ndarray:
    whole = np.zeros((HEIGHT, WIDTH), bool)
    assert fruit.mask is not None
    x0, y0, x1, y1 = fruit.mask.box_px
    whole[y0:y1, x0:x1] = fruit.mask.pixels
    return whole


def area(fruit: LabelledFruit) -> int:
    return int(pixels_of(fruit).sum())


VIA_PROJECT = """{
 "_via_settings": {"ui": {}, "core": {"buffer_size": 18}, "project": {"name": "block 7"}},
 "_via_img_metadata": {
  "IMG_1.jpg4711": {
   "filename": "IMG_1.jpg", "size": 4711, "file_attributes": {},
   "regions": [
    {"shape_attributes": {"name": "polygon", "all_points_x": [10, 30, 30], "all_points_y": [10, 10, 30]},
     "region_attributes": {"name": "apple"}},
    {"shape_attributes": {"name": "circle", "cx": 50, "cy": 20, "r": 8.5}, "region_attributes": {"name": "apple"}},
    {"shape_attributes": {"name": "ellipse", "cx": 40, "cy": 45, "rx": 12, "ry": 5, "theta": 1.5707963},
     "region_attributes": {"name": "leaf"}},
    {"shape_attributes": {"name": "rect", "x": 60, "y": 40, "width": 12, "height": 10}, "region_attributes": {}},
    {"shape_attributes": {"name": "polyline", "all_points_x": [2, 12, 12, 2], "all_points_y": [40, 40, 48, 52]},
     "region_attributes": {"name": "apple"}}]},
  "IMG_2.jpg12": {"filename": "IMG_2.jpg", "size": 12, "regions": [], "file_attributes": {}}
 },
 "_via_attributes": {"region": {"name": {"type": "text"}}, "file": {}},
 "_via_data_format_version": "2.0.10",
 "_via_image_id_list": ["IMG_1.jpg4711", "IMG_2.jpg12"]
}"""


def check_via(photos: list[LabelledPhoto]) -> None:
    polygon, circle, ellipse, rect, line = photos[0].fruits
    assert 180 <= area(polygon) <= 220  # half of 20 × 20
    assert pixels_of(polygon)[12, 25]
    assert not pixels_of(polygon)[28, 12]
    assert area(circle) == pytest.approx(np.pi * 8.5**2, rel=0.06)
    assert circle.box_px == (41, 11, 59, 29) or circle.box_px == (42, 12, 58, 28)
    turned = pixels_of(ellipse)
    assert turned.any(1).sum() == pytest.approx(24, abs=1)
    assert turned.any(0).sum() == pytest.approx(10, abs=1)
    assert rect.mask is None
    assert rect.box_px == (60, 40, 72, 50)
    assert 80 <= area(line) <= 120
    assert [f.category for f in photos[0].fruits] == ["apple", "apple", "leaf", None, "apple"]
    assert photos[1].fruits == ()
    assert classes_of(photos) == ("apple", "leaf")


def test_a_via_project(tmp_path: Path) -> None:
    photo(tmp_path / "IMG_1.jpg"), photo(tmp_path / "IMG_2.jpg")
    (tmp_path / "block7.json").write_text(VIA_PROJECT)
    (one,) = find_label_sets(tmp_path)
    assert one.kind == "via"
    check_via(read_label_set(one, size_of))


def test_bare_via_annotations_with_regions_as_version_1_wrote_them(tmp_path: Path) -> None:
    content = json.loads(VIA_PROJECT)["_via_img_metadata"]
    for entry in content.values():
        entry["regions"] = {str(k): region for k, region in enumerate(entry["regions"])}
    photo(tmp_path / "images" / "IMG_1.jpg"), photo(tmp_path / "images" / "IMG_2.jpg")
    (tmp_path / "via_region_data.json").write_text(json.dumps(content))
    (one,) = find_label_sets(tmp_path)
    photos = read_label_set(one, size_of)
    check_via(photos)
    assert photos[0].path == tmp_path / "images" / "IMG_1.jpg"


VIA_TABLE = r'''filename,file_size,file_attributes,region_count,region_id,region_shape_attributes,region_attributes
IMG_1.jpg,4711,"{}",5,0,"{""name"":""polygon"",""all_points_x"":[10,30,30],""all_points_y"":[10,10,30]}","{""name"":""apple""}"
IMG_1.jpg,4711,"{}",5,1,"{""name"":""circle"",""cx"":50,""cy"":20,""r"":8.5}","{""name"":""apple""}"
IMG_1.jpg,4711,"{}",5,2,"{""name"":""ellipse"",""cx"":40,""cy"":45,""rx"":12,""ry"":5,""theta"":1.5707963}","{""name"":""leaf""}"
IMG_1.jpg,4711,"{}",5,3,"{""name"":""rect"",""x"":60,""y"":40,""width"":12,""height"":10}","{}"
IMG_1.jpg,4711,"{}",5,4,"{""name"":""polyline"",""all_points_x"":[2,12,12,2],""all_points_y"":[40,40,48,52]}","{""name"":""apple""}"
IMG_2.jpg,12,"{}",0,0,"{}","{}"
'''  # fmt: skip


def test_a_via_table(tmp_path: Path) -> None:
    photo(tmp_path / "IMG_1.jpg"), photo(tmp_path / "IMG_2.jpg")
    (tmp_path / "via_export_csv.csv").write_text(VIA_TABLE)
    (one,) = find_label_sets(tmp_path)
    assert one.kind == "via-csv"
    check_via(read_label_set(one, size_of))


def test_a_project_and_its_table_side_by_side_are_one_set(tmp_path: Path) -> None:
    photo(tmp_path / "IMG_1.jpg"), photo(tmp_path / "IMG_2.jpg")
    (tmp_path / "via.csv").write_text(VIA_TABLE)
    (tmp_path / "via.json").write_text(VIA_PROJECT)
    assert [one.kind for one in find_label_sets(tmp_path)] == ["via"]
    (tmp_path / "via.csv").write_text(VIA_TABLE.replace("IMG_2", "IMG_3"))
    with pytest.raises(InputError, match=r"labels of one format, found via-csv .*, via "):
        find_label_sets(tmp_path)


def broken_via(shape: str) -> str:
    return f'{{"a.jpg9": {{"filename": "a.jpg", "size": 9, "regions": [{{"shape_attributes": {shape}}}]}}}}'


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ('{"name": "point", "cx": 3, "cy": 3}', "region 0: expected a shape with an extent.*'point'"),
        ('{"name": "circle", "cx": 90, "cy": 3, "r": 5}', "region 0: expected a place inside the photo of 80 × 60"),
        ('{"name": "circle", "cx": 9, "cy": 3, "r": "5"}', "region 0: r: expected a finite number"),
        ('{"name": "circle", "cx": 9, "cy": 3, "r": 0}', "positive radii"),
        ('{"name": "polygon", "all_points_x": [1, 2, 3], "all_points_y": [1, 2]}', "as many all_points_x"),
        ('{"name": "polygon", "all_points_x": [1, 2], "all_points_y": [1, 2]}', "at least 3 points"),
        ('{"name": "polygon", "all_points_x": [1, 99, 3], "all_points_y": [1, 2, 9]}', "inside the photo.*x 1 to 99"),
        ('{"name": "rect", "x": 1, "y": 1, "width": 0, "height": 4}', "positive width and height"),
        ('{"name": "rect", "x": 1, "y": 1, "width": 4}', "height: expected a finite number, found None"),
        ('"round"', "expected an object with shape_attributes"),
    ],
)
def test_shapes_of_via_that_cannot_be(tmp_path: Path, shape: str, message: str) -> None:
    photo(tmp_path / "a.jpg")
    (tmp_path / "via.json").write_text(broken_via(shape))
    with pytest.raises(FormatError, match=rf"via\.json: photo 'a\.jpg'.*{message}"):
        read_via_json(tmp_path / "via.json", photos_of)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("filename,region_attributes\na.jpg,{}\n", "line 1: .*region_shape_attributes are missing"),
        ("filename,region_shape_attributes,region_attributes\n", ".*a header and no line"),
        ("filename,region_shape_attributes,region_attributes\na.jpg,{}\n", "line 2: expected 3 cells, found 2"),
        ("filename,region_shape_attributes,region_attributes\na.jpg,{x,{}\n", "line 2: region_shape_.*JSON object"),
        ("filename,region_shape_attributes,region_attributes\n,{},{}\n", "line 2: filename"),
    ],
)
def test_tables_of_via_that_cannot_be(tmp_path: Path, table: str, message: str) -> None:
    photo(tmp_path / "a.jpg")
    (tmp_path / "via.csv").write_text(table)
    with pytest.raises(FormatError, match=rf"via\.csv: {message}"):
        read_via_csv(tmp_path / "via.csv", photos_of)


def test_yolo_boxes_and_outlines_with_the_folders_of_ultralytics(tmp_path: Path) -> None:
    for name in ("train/a", "train/bare", "val/b"):
        photo(tmp_path / "images" / f"{name}.jpg")
    for name, text in {
        "train/a": "0 0.5 0.5 0.25 0.2\n1 0.1 0.1 0.3 0.1 0.3 0.4\n\n",
        "val/b": "0 0.0 0.0 0.5 0.0 0.5 0.5 0.0 0.5\n",
    }.items():
        file = tmp_path / "labels" / f"{name}.txt"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    (tmp_path / "data.yaml").write_text(
        "path: .\ntrain: images/train\nval: images/val\nnames:\n  0: apple\n  1: pear\n"
    )
    (one,) = find_label_sets(tmp_path)
    assert one.kind == "yolo"
    photos = {p.name: p for p in read_label_set(one, size_of)}
    assert sorted(photos) == ["images/train/a.jpg", "images/train/bare.jpg", "images/val/b.jpg"]
    box, outline = photos["images/train/a.jpg"].fruits
    assert box.mask is None
    assert box.box_px == pytest.approx((30, 24, 50, 36))
    assert outline.category == "pear"
    assert area(outline) == pytest.approx(16 * 18 / 2, rel=0.12)
    assert photos["images/train/bare.jpg"].fruits == ()
    (rectangle,) = photos["images/val/b.jpg"].fruits
    assert rectangle.mask is None, "a rectangle drawn as an outline is a box"
    assert rectangle.box_px == (0, 0, 40, 30)


def test_yolo_beside_the_photos_and_without_names(tmp_path: Path) -> None:
    photo(tmp_path / "a.jpg"), photo(tmp_path / "b.png")
    (tmp_path / "a.txt").write_text("3 0.5 0.5 1 1")
    (tmp_path / "b.txt").write_text("")
    (one,) = find_label_sets(tmp_path)
    photos = read_label_set(one, size_of)
    assert [[f.category for f in p.fruits] for p in photos] == [["3"], []]
    (tmp_path / "classes.txt").write_text("a\nb\nc\nd\n")
    assert read_yolo(tmp_path, size_of)[0].fruits[0].category == "d"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("0 0.5 0.5 0.1", "found 3 numbers"),
        ("0 0.5 0.5 0.1 0.1 0.9", "found 5 numbers"),
        ("0 0.5 0.5 0.1 x", "expected numbers"),
        ("apple 0.5 0.5 0.1 0.1", "number of a class first, found 'apple'"),
        ("2 0.5 0.5 0.1 0.1", "class from 0 to 1, found 2"),
        ("0 40 30 10 10", "shares of the photo's sides"),
        ("0 0.99 0.5 0.2 0.1", "inside the photo of 80 × 60"),
        ("0 0.5 0.5 0 0.1", "positive width"),
        ("0 nan 0.5 0.1 0.1", "shares"),
    ],
)
def test_lines_of_yolo_that_cannot_be(tmp_path: Path, line: str, message: str) -> None:
    photo(tmp_path / "images" / "a.jpg")
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "a.txt").write_text(f"0 0.5 0.5 0.1 0.1\n{line}\n")
    (tmp_path / "data.yaml").write_text("names: [apple, 'leaf']\n")
    with pytest.raises(FormatError, match=rf"a\.txt: line 2: .*{message}"):
        read_yolo(tmp_path, size_of)


def test_yolo_without_its_photo_or_with_two_or_with_broken_names(tmp_path: Path) -> None:
    (tmp_path / "labels").mkdir()
    (tmp_path / "images").mkdir()
    (tmp_path / "labels" / "a.txt").write_text("0 0.5 0.5 0.1 0.1\n")
    with pytest.raises(MissingFileError, match=r"a\.txt: expected a photo of the same name"):
        read_yolo(tmp_path, size_of)
    photo(tmp_path / "images" / "a.jpg"), photo(tmp_path / "images" / "a.png")
    with pytest.raises(FormatError, match=r"expected one photo of this name, found a\.jpg and a\.png"):
        read_yolo(tmp_path, size_of)
    (tmp_path / "images" / "a.png").unlink()
    (tmp_path / "data.yaml").write_text("names: 3\n")
    with pytest.raises(FormatError, match=r"data\.yaml: names: expected a list"):
        read_yolo(tmp_path, size_of)
    (tmp_path / "data.yaml").write_text("names: [3\n")
    with pytest.raises(FormatError, match=r"data\.yaml: expected YAML"):
        read_yolo(tmp_path, size_of)


def labelme(shapes: str, path: str = "a.jpg") -> str:
    return (
        '{"version": "5.4.1", "flags": {}, "shapes": ['
        + shapes
        + f'], "imagePath": "{path}", "imageData": null, "imageHeight": {HEIGHT}, "imageWidth": {WIDTH}}}'
    )


def test_labelme_with_every_shape_and_a_fruit_in_two_parts(tmp_path: Path) -> None:
    photo(tmp_path / "photos" / "a.jpg")
    png = base64.b64encode(cv2.imencode(".png", np.eye(12, dtype=np.uint8) * 255)[1].tobytes()).decode()
    shapes = ",".join(
        [
            '{"label": "apple", "points": [[10, 10], [30.5, 10], [30.5, 30]], "group_id": null}',
            '{"label": "apple", "points": [[50, 30], [40, 20]], "group_id": null, "shape_type": "rectangle"}',
            '{"label": "apple", "points": [[70, 10], [70, 16]], "group_id": null, "shape_type": "circle"}',
            '{"label": "apple", "points": [[1, 40], [9, 40], [5, 50]], "group_id": 4, "shape_type": "polygon"}',
            '{"label": "apple", "points": [[12, 40], [20, 40], [16, 50]], "group_id": 4, "shape_type": "polygon"}',
            f'{{"label": "pear", "points": [[60, 40], [71, 51]], "shape_type": "mask", "mask": "{png}"}}',
        ]
    )
    (tmp_path / "json").mkdir()
    (tmp_path / "json" / "a.json").write_text(labelme(shapes, r"..\\photos\\a.jpg"))
    (one,) = find_label_sets(tmp_path)
    assert one.kind == "labelme"
    (found,) = read_label_set(one, size_of)
    polygon, rectangle, circle, parts, mask = found.fruits
    assert area(polygon) == pytest.approx(205, rel=0.1)
    assert rectangle.mask is None
    assert rectangle.box_px == (40, 20, 50, 30)
    assert area(circle) == pytest.approx(np.pi * 36, rel=0.05)
    assert parts.box_px == pytest.approx((1, 40, 20, 50), abs=1)
    assert pixels_of(parts)[42, 5]
    assert pixels_of(parts)[42, 16]
    assert not pixels_of(parts)[42, 10]
    assert mask.category == "pear"
    np.testing.assert_array_equal(pixels_of(mask)[40:52, 60:72], np.eye(12, dtype=bool))


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ('{"label": "a", "points": [[1, 2]], "shape_type": "point"}', "shape 0: shape_type.*'point'"),
        ('{"label": "a", "points": [[1, 2], [3]], "shape_type": "polygon"}', "shape 0: points: expected pairs"),
        ('{"label": "a", "points": [[1, 2], [3, 400], [4, 5]], "shape_type": "polygon"}', "inside the photo"),
        ('{"label": "a", "points": [[1, 2], [3, 4]], "shape_type": "mask", "mask": "!!"}', "PNG in base64"),
        ('{"label": "a", "points": [[1, 2], [3, 4], [1, 1]], "shape_type": "rectangle"}', "2 or 4 corners"),
        ('{"label": "a", "shape_type": "polygon"}', "label, points and shape_type"),
    ],
)
def test_shapes_of_labelme_that_cannot_be(tmp_path: Path, shape: str, message: str) -> None:
    photo(tmp_path / "a.jpg")
    (tmp_path / "a.json").write_text(labelme(shape))
    with pytest.raises(FormatError, match=rf"a\.json: .*{message}"):
        read_labelme([tmp_path / "a.json"], photos_of)


def test_labelme_files_that_do_not_fit_their_photos(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(labelme("", "gone.jpg"))
    with pytest.raises(MissingFileError, match=r"a\.json: imagePath: photo 'gone\.jpg' is not there"):
        read_labelme([tmp_path / "a.json"], photos_of)
    photo(tmp_path / "a.jpg")
    assert len(read_labelme([tmp_path / "a.json"], photos_of)) == 1  # renamed with its labels
    (tmp_path / "b.json").write_text(labelme("", "a.jpg"))
    with pytest.raises(FormatError, match=r"b\.json: expected one file a photo, but .*a\.json labels a\.jpg"):
        read_labelme([tmp_path / "a.json", tmp_path / "b.json"], photos_of)
    (tmp_path / "a.json").write_text(labelme("").replace('"imageWidth": 80', '"imageWidth": 60'))
    with pytest.raises(FormatError, match=r"expected the size of a\.jpg, 80 × 60, found 60 × 60"):
        read_labelme([tmp_path / "a.json"], photos_of)


def save_ids(path: Path, ids: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), ids)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_images_of_ids(tmp_path: Path, dtype: type) -> None:
    ids = np.zeros((HEIGHT, WIDTH), dtype)
    ids[5:15, 10:30], ids[40:50, 60:75], ids[45, 65] = 7, 200, 7
    save_ids(tmp_path / "masks" / "a_mask.png", ids)
    photo(tmp_path / "images" / "a.jpg"), photo(tmp_path / "images" / "not labelled.jpg")
    (one,) = find_label_sets(tmp_path)
    assert (one.kind, one.rendered) == ("masks", False)
    (found,) = read_label_set(one, size_of)
    np.testing.assert_array_equal(pixels_of(found.fruits[0]), ids == 7)
    np.testing.assert_array_equal(pixels_of(found.fruits[1]), ids == 200)


def test_images_with_a_colour_for_each_fruit(tmp_path: Path) -> None:
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[5:15, 10:30], image[40:50, 60:75] = (0, 0, 128), (0, 128, 0)
    save_ids(tmp_path / "masks" / "a.png", image)
    photo(tmp_path / "a.jpg")
    (found,) = read_png_masks(tmp_path, size_of)
    boxes = sorted(fruit.box_px for fruit in found.fruits)
    assert boxes == [(10, 5, 30, 15), (60, 40, 75, 50)]


def test_images_of_ids_that_cannot_be(tmp_path: Path) -> None:
    mask = tmp_path / "masks" / "a.png"
    save_ids(mask, np.eye(HEIGHT, WIDTH, dtype=np.uint8))
    with pytest.raises(MissingFileError, match=r"a\.png: expected a photo of the same name"):
        read_png_masks(tmp_path, size_of)
    photo(tmp_path / "images" / "a.jpg")
    save_ids(mask, np.eye(20, dtype=np.uint8))
    with pytest.raises(FormatError, match=r"a\.png: expected the size of a\.jpg, 80 × 60, found 20 × 20"):
        read_png_masks(tmp_path, size_of)
    for shape in ((HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)):
        save_ids(mask, np.where(np.arange(HEIGHT).reshape(-1, *[1] * (len(shape) - 1)) < 9, 255, np.zeros(shape)))
        with pytest.raises(FormatError, match="black and white alone"):
            read_png_masks(tmp_path, size_of)
    mask.write_bytes(b"")
    with pytest.raises(FormatError, match=r"a\.png: expected an image of fruit ids"):
        read_png_masks(tmp_path, size_of)
    save_ids(mask, np.eye(HEIGHT, WIDTH, dtype=np.uint8))
    save_ids(tmp_path / "masks" / "a_mask.png", np.eye(HEIGHT, WIDTH, dtype=np.uint8))
    with pytest.raises(FormatError, match="one image of ids a photo"):
        read_png_masks(tmp_path, size_of)


COCO = """{
 "images": [{"id": 3, "file_name": "a.jpg", "width": 80, "height": 60}],
 "categories": [{"id": 1, "name": "apple"}, {"id": 2, "name": "heap"}],
 "annotations": [
  {"id": 1, "image_id": 3, "category_id": 1, "bbox": [10, 10, 20, 20], "segmentation": [[10, 10, 30, 10, 30, 30]]},
  {"id": 2, "image_id": 3, "category_id": 1, "bbox": [40, 10, 10, 12]},
  {"id": 3, "image_id": 3, "category_id": 1, "bbox": [50, 40, 9, 9],
   "segmentation": [[50, 40, 59, 40, 59, 49, 50, 49]]},
  {"id": 4, "image_id": 3, "category_id": 2, "iscrowd": 1, "bbox": [2, 0, 1, 5],
   "segmentation": {"size": [60, 80], "counts": [120, 5, 4675]}}]
}"""


def test_coco_with_polygons_boxes_and_a_crowd(tmp_path: Path) -> None:
    photo(tmp_path / "images" / "a.jpg")
    (tmp_path / "labels.json").write_text(COCO)
    (one,) = find_label_sets(tmp_path)
    assert one.kind == "coco"
    (found,) = read_label_set(one, size_of)
    polygon, box, rectangle, crowd = found.fruits
    assert 180 <= area(polygon) <= 220
    assert box.mask is None
    assert box.box_px == (40, 10, 50, 22)
    assert rectangle.mask is None
    assert crowd.ignored
    assert np.argwhere(pixels_of(crowd)).tolist() == [[k, 2] for k in range(5)]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"id": 2, "image_id"', '"id": 1, "image_id"', "annotation 1: expected unique ids"),
        ('"category_id": 2', '"category_id": 9', "category_id: expected one of 1 .apple., 2 .heap., found 9"),
        ("[10, 10, 30, 10, 30, 30]", "[10, 10, 130, 10, 30, 30]", "annotation 1: segmentation: .*inside the photo"),
        ('"width": 80, "height": 60', '"width": 60, "height": 80', "inside the photo|size"),
        ('[{"id": 3, "file_name"', '[{"id": 4, "file_name": "b.jpg", "width": 80, "height": 60}, {"id": 3, "file_name"',
         "'b.jpg' is not there"),
        ('[{"id": 3, "file_name"', '[{"id": 4, "file_name": "a.jpg", "width": 80, "height": 60}, {"id": 3, "file_name"',
         "image 3: expected each photo once"),
        ('"id": 1, "name": "apple"', '"id": 1, "id": 7, "name": "apple"', None),
    ],
)  # fmt: skip
def test_coco_that_cannot_be(tmp_path: Path, old: str, new: str, message: str | None) -> None:
    photo(tmp_path / "a.jpg")
    file = tmp_path / "labels.json"
    file.write_text(COCO.replace(old, new))
    if message is None:  # a key twice in one object is found before the file is taken for COCO's
        with pytest.raises(FormatError, match=r"labels\.json: .*'id' is there twice"):
            find_label_sets(tmp_path)
        return
    with pytest.raises((FormatError, MissingFileError), match=rf"labels\.json: .*({message})"):
        read_coco_labels(file, photos_of)


def test_sizes_that_do_not_fit_the_photo_say_how_to_turn_it(tmp_path: Path) -> None:
    photo(tmp_path / "a.jpg")
    (tmp_path / "labels.json").write_text(
        '{"images": [{"id": 1, "file_name": "a.jpg", "width": 60, "height": 80}], "annotations": []}'
    )
    with pytest.raises(FormatError, match="80 × 60, found 60 × 80: annotate the photo upright"):
        read_coco_labels(tmp_path / "labels.json", photos_of)


def test_nothing_broken_and_mixed_folders_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="expected a folder of labelled photos"):
        find_label_sets(tmp_path / "none")
    photo(tmp_path / "a.jpg")
    (tmp_path / "package.json").write_text('{"name": "something else"}')
    with pytest.raises(InputError, match=r"found none of: a COCO file.*LabelMe.*YOLO.*masks/\*\.png.*rendered row"):
        find_label_sets(tmp_path)
    for content, message in (("", "the file is empty"), ("{", "no JSON"), ("[" * 100_000, "recursion")):
        (tmp_path / "labels.json").write_text(content)
        with pytest.raises(FormatError, match=rf"labels\.json: expected labels of photos, but.*{message}"):
            find_label_sets(tmp_path)
    (tmp_path / "labels.json").write_bytes(b"\xff\xfe\x00{")
    with pytest.raises(FormatError, match=r"labels\.json.*cannot be read"):
        find_label_sets(tmp_path)
    (tmp_path / "labels.json").write_text(COCO)
    (tmp_path / "via.csv").write_text(VIA_TABLE)
    with pytest.raises(InputError, match=r"one format, found coco \(labels\.json\), via-csv \(via\.csv\)"):
        find_label_sets(tmp_path)
    (one,) = find_label_sets(tmp_path / "labels.json")
    assert one.kind == "coco"


def test_a_folder_of_mixed_sets_and_cocos_own_folders(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("bought, drawn, collected")
    photo(tmp_path / "bought" / "train2017" / "a.jpg")
    (tmp_path / "bought" / "annotations").mkdir()
    (tmp_path / "bought" / "annotations" / "instances_train2017.json").write_text(COCO)
    photo(tmp_path / "drawn" / "a.jpg")
    (tmp_path / "drawn" / "a.json").write_text(labelme(""))
    for part in ("training", "validation"):
        photo(tmp_path / "fuji" / "1-Mask-set" / part / "a.jpg")
        (tmp_path / "fuji" / "1-Mask-set" / part / "via_region_data.json").write_text(
            broken_via('{"name": "circle", "cx": 9, "cy": 9, "r": 5}')
        )
    photo(tmp_path / "fuji" / "2-SfM-set" / "east" / "IMG_1.jpg")
    found = find_label_sets(tmp_path)
    assert [(s.kind, s.part) for s in found] == [
        ("coco", "training"), ("labelme", ""), ("via", "training"), ("via", "validation"),
    ]  # fmt: skip
    for one in found:
        (labelled,) = read_label_set(one, size_of)
        assert labelled.path.name == "a.jpg"


def test_what_folders_say_their_photos_are_for() -> None:
    names = ("images/train2017", "Valid", "val/images", "my_test_set", "training", "contest", "strain", "east")
    expected = ["training", "validation", "validation", "test", "training", "", "", ""]
    assert [part_of(name) for name in names] == expected
    names = ("tests", "testset", "TestSet", "test_data", "trainset2", "train-images", "ValidationSet", "valdata")
    expected = ["test", "test", "test", "test", "training", "training", "validation", "validation"]
    assert [part_of(name) for name in names] == expected
    assert not any(part_of(name) for name in ("Valencia", "valley", "trainer", "testament", "trainval", "latests"))


YOLO = "0 0.5 0.5 0.25 0.2\n1 0.1 0.1 0.3 0.1 0.3 0.4\n"
LABELME = labelme(
    '{"label": "apple", "points": [[10, 10], [30.5, 10], [30.5, 30]], "group_id": 1, "shape_type": "polygon"},'
    '{"label": "apple", "points": [[70, 10], [70, 16]], "group_id": null, "shape_type": "circle"}'
)


@pytest.mark.parametrize(
    ("name", "text"),
    [("a.json", VIA_PROJECT), ("a.csv", VIA_TABLE), ("a.json", COCO), ("a.json", LABELME), ("labels/a.txt", YOLO)],
)
def test_files_damaged_anyhow_are_read_or_refused_in_words(tmp_path: Path, name: str, text: str) -> None:
    for there in ("a.jpg", "IMG_1.jpg", "IMG_2.jpg", "images/a.jpg"):
        photo(tmp_path / there)
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    pieces = ['"', "{}", "[]", "null", "-1", "1e999", "9" * 30, ":", ",", "\n", "NaN", "é", "\x00", '"name"', "true"]
    rng = np.random.default_rng(0)
    refused = []
    for _ in range(150):
        at, end = sorted(rng.integers(0, len(text) + 1, 2))
        end = end if rng.random() < 0.2 else min(at + int(rng.integers(0, 6)), len(text))
        file.write_text(text[:at] + str(rng.choice(pieces)) + text[end:])
        try:
            for one in find_label_sets(tmp_path):
                read_label_set(one, size_of)
        except (FormatError, InputError, MissingFileError) as error:
            refused.append(str(error))
    assert len(refused) > 40
    assert all(str(tmp_path) in message for message in refused)


@pytest.mark.parametrize("places", [("A.JPG", "A.TXT"), ("images/A.JPG", "labels/A.Txt")])
def test_yolo_with_suffixes_in_capitals(tmp_path: Path, places: tuple[str, str]) -> None:
    photo(tmp_path / places[0])
    (tmp_path / places[1]).parent.mkdir(exist_ok=True)
    (tmp_path / places[1]).write_text("0 0.5 0.5 0.25 0.2\n")
    (tmp_path / "data.YAML").write_text("names: [apple]\n")
    (one,) = find_label_sets(tmp_path)
    (found,) = read_label_set(one, size_of)
    assert one.kind == "yolo"
    assert found.name == places[0]
    assert [fruit.category for fruit in found.fruits] == ["apple"]
    assert found.fruits[0].box_px == pytest.approx((30, 24, 50, 36))


def test_two_files_of_yolo_for_one_photo_are_refused(tmp_path: Path) -> None:
    photo(tmp_path / "a.jpg")
    (tmp_path / "a.txt").write_text("0 0.5 0.5 0.25 0.2\n")
    (tmp_path / "a.TXT").write_text("0 0.2 0.5 0.25 0.2\n")
    if len(list(tmp_path.iterdir())) < 3:
        pytest.skip("this disk takes both names for one")
    with pytest.raises(FormatError, match=r"a\.txt: expected one file of labels a photo, found a\.TXT beside"):
        read_yolo(tmp_path, size_of)


def test_images_of_ids_with_suffixes_in_capitals(tmp_path: Path) -> None:
    photo(tmp_path / "images" / "A.JPG")
    (tmp_path / "masks").mkdir()
    ids = np.zeros((HEIGHT, WIDTH), np.uint8)
    ids[10:20, 30:50] = 7
    (tmp_path / "masks" / "A.PNG").write_bytes(cv2.imencode(".png", ids)[1].tobytes())
    (one,) = find_label_sets(tmp_path)
    (found,) = read_label_set(one, size_of)
    assert one.kind == "masks"
    assert [(fruit.id, fruit.box_px) for fruit in found.fruits] == [(7, (30, 10, 50, 20))]


def voc(name: str = "apple", head: str = "") -> str:
    box = "<bndbox><xmin>31</xmin><ymin>11</ymin><xmax>50</xmax><ymax>20</ymax></bndbox>"
    return f"{head}<annotation><filename>A.JPG</filename><object><name>{name}</name>{box}</object></annotation>"


def test_pascal_voc_with_suffixes_in_capitals(tmp_path: Path) -> None:
    photo(tmp_path / "A.JPG")
    (tmp_path / "A.XML").write_text(voc())
    (one,) = find_label_sets(tmp_path)
    (found,) = read_label_set(one, size_of)
    assert one.kind == "voc"
    assert [fruit.box_px for fruit in found.fruits] == [(30, 10, 50, 20)]


def test_what_is_difficult_in_pascal_voc_is_ignored(tmp_path: Path) -> None:
    photo(tmp_path / "A.JPG")
    first, rest = voc().split("</object>")
    second = first.partition("<object>")[2].replace("31", "11")
    objects = (f"{first}<difficult>0</difficult>", f"<object>{second}<difficult>1</difficult>", f"{rest}")
    (tmp_path / "A.xml").write_text("</object>".join(objects))
    (found,) = read_voc([tmp_path / "A.xml"], photos_of)
    assert [(fruit.box_px, fruit.ignored) for fruit in found.fruits] == [
        ((30, 10, 50, 20), False),
        ((10, 10, 50, 20), True),
    ]


def test_labelme_of_a_renamed_photo_with_its_suffix_in_capitals(tmp_path: Path) -> None:
    photo(tmp_path / "b.JPEG")
    (tmp_path / "b.json").write_text(labelme("", "gone.jpg"))
    (found,) = read_labelme([tmp_path / "b.json"], photos_of)
    assert found.name == "b.JPEG"


@pytest.mark.parametrize(
    ("declared", "stored", "name"),
    [
        ("ISO-8859-1", "iso-8859-1", "Äpfel"),
        ("windows-1252", "cp1252", "„Äpfel“"),
        ("GBK", "gbk", "苹果"),
        ("ISO-8859-1", "utf-8", "Äpfel"),  # the declaration is wrong
        ("utf-8", "utf-8-sig", "Äpfel"),
        ("", "utf-8", "Äpfel"),
        ("utf-16", "utf-16", "Äpfel"),
        ("utf-8", "utf-16", "Äpfel"),  # written by PowerShell, which leaves the declaration as it is
        ("UTF-16", "utf-16-be", "Äpfel"),
    ],
)
def test_xml_is_read_in_the_encoding_that_it_is_in(tmp_path: Path, declared: str, stored: str, name: str) -> None:
    photo(tmp_path / "A.JPG")
    head = f'<?xml version="1.0" encoding="{declared}"?>\n' if declared else ""
    (tmp_path / "A.xml").write_bytes(voc(name, head).encode(stored))
    (one,) = find_label_sets(tmp_path)
    assert one.kind == "voc"
    assert classes_of(read_label_set(one, size_of)) == (name,)


@pytest.mark.parametrize("stored", ["utf-8", "iso-8859-1", "utf-16", "utf-16-le", "utf-16-be", "utf-7"])
def test_xml_defines_no_entities_in_any_encoding(tmp_path: Path, stored: str) -> None:
    text = f'<?xml version="1.0" encoding="{stored}"?><!DOCTYPE a [<!ENTITY e "ä">]><a>&e;</a>'
    # UTF-7 may hide what it says, but then says nothing to the parser.
    data = text.replace("<!E", "+ADwAIQ-E").encode() + b"\xe4" if stored == "utf-7" else text.encode(stored)
    (tmp_path / "a.xml").write_bytes(data)
    with pytest.raises(FormatError, match=r"a\.xml: expected cameras, (found XML that defines|but it cannot be read)"):
        load_xml(tmp_path / "a.xml", "cameras")


@pytest.mark.parametrize("declared", ["", "utf-8", "hex", "punycode", "idna", "klingon"])
def test_xml_whose_encoding_nobody_knows_is_refused(tmp_path: Path, declared: str) -> None:
    head = f'<?xml version="1.0" encoding="{declared}"?>' if declared else ""
    (tmp_path / "a.xml").write_bytes(f"{head}<a>ä</a>".encode("latin-1"))
    with pytest.raises(FormatError, match=r"a\.xml: expected cameras, but it cannot be read: "):
        load_xml(tmp_path / "a.xml", "cameras")


def test_labels_in_utf16_that_are_no_xml_are_refused_in_words(tmp_path: Path) -> None:
    photo(tmp_path / "a.jpg")
    (tmp_path / "labels.json").write_text(COCO, encoding="utf-16")
    with pytest.raises(FormatError, match=r"labels\.json: .* UTF-16, as PowerShell's > writes it; save it as UTF-8"):
        find_label_sets(tmp_path)
    (tmp_path / "labels.json").unlink()
    (tmp_path / "a.txt").write_text("0 0.5 0.5 0.25 0.2\n", encoding="utf-16")
    with pytest.raises(FormatError, match=r"a\.txt: .* UTF-16, as PowerShell's > writes it; save it as UTF-8"):
        read_yolo(tmp_path, size_of)


def test_a_file_of_yolo_with_a_byte_order_mark_alone_is_a_photo_without_fruit(tmp_path: Path) -> None:
    for name, data in (("a", b"\xef\xbb\xbf"), ("b", b"\xff\xfe"), ("c", b"\xef\xbb\xbf0 0.5 0.5 0.25 0.2\n")):
        photo(tmp_path / f"{name}.jpg")
        (tmp_path / f"{name}.txt").write_bytes(data)
    assert [len(found.fruits) for found in read_yolo(tmp_path, size_of)] == [0, 0, 1]


def test_yaml_of_other_programs_beside_labels_of_yolo_is_passed_over(tmp_path: Path) -> None:
    photo(tmp_path / "a.jpg")
    (tmp_path / "a.txt").write_text("0 0.5 0.5 0.25 0.2\n")
    (tmp_path / ".pre-commit.yml").write_text("")
    (tmp_path / "mkdocs.yml").write_text("emoji: !!python/name:material.emoji\n")
    (tmp_path / "z.yml").write_text("names: [pear]\n")
    assert classes_of(read_yolo(tmp_path, size_of)) == ("pear",)
    (tmp_path / "data.yaml").write_text("names: [apple]\n")
    assert classes_of(read_yolo(tmp_path, size_of)) == ("apple",)
    (tmp_path / "data.yaml").write_text("")
    with pytest.raises(FormatError, match=r"data\.yaml: .*the file is empty"):
        read_yolo(tmp_path, size_of)


def test_labels_of_yolo_have_no_track(tmp_path: Path) -> None:
    photo(tmp_path / "a.jpg")
    (tmp_path / "a.txt").write_text("0 .5 .5 .2 .2 .9 1\n")
    assert read_yolo(tmp_path, size_of)[0].fruits[0].mask is not None
