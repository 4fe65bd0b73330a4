"""A made scene of ellipses in three photos, its true masks, and writers of it in the formats of other programs.

The writers follow the formats' descriptions, with loops or the programs' own libraries, and share nothing with the
readers.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy.io
from PIL import Image
from pycocotools import mask as coco_mask

from pomona.values.detections import Mask
from pomona.values.photos import Photo, Photos

WIDTH, HEIGHT = 400, 300
Pixels = np.ndarray[Any, Any]


@dataclass(frozen=True)
class Ellipse:
    cx: float
    cy: float
    rx: float
    ry: float
    angle: float  # radians, clockwise as one sees the photo
    score: float

    @property
    def pixels(self) -> Pixels:
        """The pixels whose centres lie inside."""
        y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
        along = (x - self.cx) * math.cos(self.angle) + (y - self.cy) * math.sin(self.angle)
        across = -(x - self.cx) * math.sin(self.angle) + (y - self.cy) * math.cos(self.angle)
        return (along / self.rx) ** 2 + (across / self.ry) ** 2 <= 1

    def outline(self, count: int = 90) -> list[tuple[float, float]]:
        turns = [2 * math.pi * k / count for k in range(count)]
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        points = [(self.rx * math.cos(t), self.ry * math.sin(t)) for t in turns]
        return [(self.cx + a * cos - b * sin, self.cy + a * sin + b * cos) for a, b in points]


SCENE: dict[str, tuple[Ellipse, ...]] = {
    "east/IMG_1.JPG": (
        Ellipse(60.3, 70.8, 40.0, 31.0, 0.4, 0.9),
        Ellipse(200.0, 150.0, 28.5, 28.5, 0.0, 0.75),
        Ellipse(330.7, 60.2, 22.0, 35.0, 1.1, 0.5),
    ),
    "east/IMG_2.JPG": (),
    "west/IMG_3.JPG": (Ellipse(100.0, 200.0, 25.0, 20.0, 0.0, 0.25), Ellipse(301.5, 222.5, 33.0, 30.0, 2.0, 1.0)),
}
FRUITS = [(name, fruit) for name, fruits in SCENE.items() for fruit in fruits]


def scene_photos(folder: Path = Path("photos")) -> Photos:
    return Photos(tuple(Photo(name=name, path=folder / name, width_px=WIDTH, height_px=HEIGHT) for name in SCENE))


def whole(mask: Mask) -> Pixels:
    """A mask on the whole photo."""
    pixels = np.zeros((HEIGHT, WIDTH), bool)
    x0, y0, x1, y1 = mask.box_px
    pixels[y0:y1, x0:x1] = mask.pixels
    return pixels


def label_image(name: str, dtype: type = np.uint16, step: int = 1) -> Pixels:
    image = np.zeros((HEIGHT, WIDTH), dtype)
    for k, fruit in enumerate(SCENE[name], start=1):
        image[fruit.pixels] = k * step
    return image


def written(path: Path, content: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    if not isinstance(content, str):
        content = json.dumps(content)
    path.write_text(content, encoding="utf-8")
    return path


# COCO


def rle_of(pixels: Pixels) -> dict[str, Any]:
    """Compressed by pycocotools."""
    runs = coco_mask.encode(np.asfortranarray(pixels.astype(np.uint8)))
    return {"size": runs["size"], "counts": runs["counts"].decode()}


def runs_of(pixels: Pixels) -> dict[str, Any]:
    """Lengths of runs down the columns, counted one by one."""
    counts, current = [0], False
    for value in pixels.T.ravel().tolist():
        if value != current:
            counts.append(0)
            current = value
        counts[-1] += 1
    return {"size": list(pixels.shape), "counts": counts}


def polygon_of(fruit: Ellipse) -> list[list[float]]:
    return [[round(value, 2) for point in fruit.outline() for value in point]]


def contour_of(pixels: Pixels) -> list[list[int]]:
    """The pixels on the rim, as programs have them from OpenCV."""
    contours, _ = cv2.findContours(pixels.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [contour.ravel().tolist() for contour in contours if len(contour) >= 3]


def coco_images() -> list[dict[str, Any]]:
    return [{"id": 10 + k, "file_name": name, "width": WIDTH, "height": HEIGHT} for k, name in enumerate(SCENE)]


def coco_annotations(segmentation: Callable[[Ellipse], Any]) -> list[dict[str, Any]]:
    ids = {image["file_name"]: image["id"] for image in coco_images()}
    return [
        {"image_id": ids[name], "category_id": 3, "segmentation": segmentation(fruit), "score": fruit.score}
        for name, fruit in FRUITS
    ]


def coco_file(segmentation: Callable[[Ellipse], Any]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        annotations = [{"id": 50 - k, **entry} for k, entry in enumerate(coco_annotations(segmentation))]
        content = {"images": coco_images(), "categories": [{"id": 3, "name": "apple"}], "annotations": annotations}
        return written(folder / "masks.json", content)

    return write


def results_with_images(folder: Path) -> Path:
    """A list of results, and the file of the images that it is of."""
    written(folder / "dataset.json", {"images": coco_images(), "annotations": [], "categories": []})
    written(folder / "result.json", coco_annotations(lambda fruit: rle_of(fruit.pixels)))
    return folder


def results_of_names(folder: Path) -> Path:
    """As Ultralytics' predictions.json has them: `image_id` is the photo's stem."""
    results = [
        {"image_id": Path(name).stem, "category_id": 1, "score": f.score, "segmentation": rle_of(f.pixels)}
        for name, f in FRUITS
    ]
    return written(folder / "predictions.json", results)


def sahi_results(folder: Path) -> Path:
    """As SAHI's PredictionResult.to_coco_predictions has them: a list a photo, which does not say so."""
    for name, fruits in SCENE.items():
        results = [
            {
                "image_id": None, "bbox": [1, 1, 5, 5], "score": f.score, "category_id": 0, "category_name": "apple",
                "segmentation": contour_of(f.pixels), "iscrowd": 0, "area": 9,
            }
            for f in fruits
        ]  # fmt: skip
        written(folder / f"{Path(name).stem}.json", results)
    return folder


def supervision_coco(folder: Path) -> Path:
    """As supervision's as_coco writes: rims of masks; runs with `iscrowd` for those in parts; no scores."""
    annotations = [
        {"id": k, "image_id": e["image_id"], "category_id": 1, "bbox": [1, 1, 5, 5], "area": 9, "iscrowd": int(k == 2),
         "segmentation": runs_of(FRUITS[k - 1][1].pixels) if k == 2 else e["segmentation"]}
        for k, e in enumerate(coco_annotations(lambda fruit: contour_of(fruit.pixels)), start=1)
    ]  # fmt: skip
    categories = [{"id": 1, "name": "apple", "supercategory": "common-objects"}]
    images = [{**image, "file_name": Path(image["file_name"]).name, "license": 1} for image in coco_images()]
    content = {"info": {}, "licenses": [], "categories": categories, "images": images, "annotations": annotations}
    return written(folder / "annotations.json", content)


def cvat_coco(folder: Path) -> Path:
    """As CVAT exports COCO, by Datumaro: what was drawn with the brush as runs with `iscrowd`, other shapes without."""
    annotations = [
        {"id": k, "category_id": 3, "image_id": e["image_id"], "area": 9.0, "bbox": [1.0, 1.0, 5.0, 5.0],
         "segmentation": e["segmentation"] if k > 2 else polygon_of(FRUITS[k - 1][1]), "iscrowd": int(k > 2),
         "attributes": {"occluded": False}}
        for k, e in enumerate(coco_annotations(lambda fruit: runs_of(fruit.pixels)), start=1)
    ]  # fmt: skip
    images = [{**image, "license": 0, "flickr_url": "", "coco_url": "", "date_captured": 0} for image in coco_images()]
    content = {
        "licenses": [{"name": "", "id": 0, "url": ""}],
        "info": {"contributor": "", "date_created": "", "description": "", "url": "", "version": "", "year": ""},
        "categories": [{"id": 3, "name": "apple", "supercategory": ""}],
        "images": images,
        "annotations": annotations,
    }
    return written(folder / "instances_default.json", content)


# VIA


def via_shape(fruit: Ellipse) -> dict[str, Any]:
    if fruit.rx == fruit.ry:
        return {"name": "circle", "cx": fruit.cx, "cy": fruit.cy, "r": fruit.rx}
    if fruit.angle == 0:
        return {"name": "ellipse", "cx": fruit.cx, "cy": fruit.cy, "rx": fruit.rx, "ry": fruit.ry, "theta": 0}
    points = fruit.outline(60)
    return {
        "name": "polygon",
        "all_points_x": [round(x, 1) for x, _ in points],
        "all_points_y": [round(y, 1) for _, y in points],
    }


def via_entries(as_object: bool) -> dict[str, Any]:
    entries = {}
    for name, fruits in SCENE.items():
        regions: Any = [
            {"shape_attributes": via_shape(f), "region_attributes": {"score": str(f.score), "fruit": "apple"}}
            for f in fruits
        ]
        if as_object:
            regions = {str(k): region for k, region in enumerate(regions)}
        file = Path(name).name
        entries[f"{file}1234"] = {"filename": file, "size": 1234, "regions": regions, "file_attributes": {}}
    return entries


def via1(folder: Path) -> Path:
    return written(folder / "via_region_data.json", via_entries(as_object=True))


def via2(folder: Path) -> Path:
    return written(folder / "project.json", {"_via_settings": {}, "_via_img_metadata": via_entries(False)})


def via3(folder: Path) -> Path:
    views = {str(k): {"fid_list": [str(k)]} for k, _ in enumerate(SCENE, start=1)}
    files = {str(k): {"fid": str(k), "fname": name, "type": 2, "loc": 1, "src": ""} for k, name in enumerate(SCENE, 1)}
    of_photo = {name: str(k) for k, name in enumerate(SCENE, start=1)}
    metadata = {}
    for k, (name, fruit) in enumerate(FRUITS):
        if fruit.rx == fruit.ry:
            points = [fruit.outline(90)[i] for i in (0, 20, 55)]
            xy = [9, *(value for point in points for value in point)]  # a circle through three points
        elif fruit.angle == 0:
            xy = [4, fruit.cx, fruit.cy, fruit.rx, fruit.ry]
        else:
            xy = [7, *(round(value, 3) for point in fruit.outline(60) for value in point)]
        values = {"1": "a", "2": str(fruit.score)}
        metadata[f"{k}_x"] = {"vid": of_photo[name], "flg": 0, "z": [], "xy": xy, "av": values}
    attribute = {"1": {"aname": "kind", "type": 3, "options": {"a": "apple"}}, "2": {"aname": "score", "type": 1}}
    content = {"project": {}, "config": {}, "attribute": attribute, "file": files, "view": views, "metadata": metadata}
    return written(folder / "via3.json", content)


def via_csv(folder: Path) -> Path:
    path = written(folder / "via_export_csv.csv", "")
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        columns = "filename,file_size,file_attributes,region_count,region_id,region_shape_attributes,region_attributes"
        writer.writerow(columns.split(","))
        for name, fruits in SCENE.items():
            short = Path(name).name
            for k, fruit in enumerate(fruits):
                attributes = json.dumps({"confidence": fruit.score, "fruit": "apple"})
                writer.writerow([short, 9, "{}", len(fruits), k, json.dumps(via_shape(fruit)), attributes])
            if not fruits:
                writer.writerow([short, 9, "{}", 0, 0, "{}", "{}"])
    return path


# YOLO, label images, MATLAB


def yolo(folder: Path, *, scored: bool = True) -> Path:
    """As Ultralytics writes predictions: no file for a photo without fruit."""
    for name, fruits in SCENE.items():
        lines = []
        for fruit in fruits:
            shares = [f"{x / WIDTH:.6g} {y / HEIGHT:.6g}" for x, y in fruit.outline()]
            lines.append(" ".join(["0", *shares, *([f"{fruit.score:.6g}"] if scored else [])]))
        if lines:
            written((folder / "labels" / name).with_suffix(".txt"), "\n".join(lines) + "\n")
    written(folder / "data.yaml", "nc: 1\nnames: [apple]\n")
    return folder


def yolo_traced(folder: Path) -> Path:
    """As supervision's as_yolo writes: rims of masks, five digits, a file for every photo, no scores."""
    for name, fruits in SCENE.items():
        contours = [contour_of(fruit.pixels)[0] for fruit in fruits]
        lines = [
            "0 "
            + " ".join(
                f"{value / side:.5f}" for value, side in zip(flat, [WIDTH, HEIGHT] * (len(flat) // 2), strict=True)
            )
            for flat in contours
        ]
        written(folder / f"{Path(name).stem}.txt", "\n".join(lines))
    return folder


def label_images(folder: Path, kind: str) -> Path:
    for name in SCENE:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if kind == "8 bits":
            Image.fromarray(label_image(name, np.uint8, 40)).save(path.with_suffix(".png"))
        elif kind == "16 bits":
            cv2.imwrite(str(path.with_suffix(".png")), label_image(name, np.uint16, 300))
        elif kind == "colours":
            colours = np.array([[0, 0, 0], [255, 0, 0], [1, 0, 0], [0, 255, 7]], np.uint8)
            Image.fromarray(colours[label_image(name)]).save(path.with_name(f"{path.stem}_mask.png"))
        elif kind == "palette":
            image = Image.fromarray(label_image(name, np.uint8), mode="P")
            image.putpalette([9, 9, 9, 200, 0, 0, 200, 0, 0, 0, 200, 0])  # 1 and 2 of one colour, 0 not black
            image.save(path.with_name(f"{path.name}.png"))
        else:
            tiff(path.with_suffix(".tif"), label_image(name, np.uint16, 1), kind)
    return folder


def tiff(path: Path, image: Pixels, order: str) -> None:
    """A 16-bit TIFF of one strip, by hand, in either byte order (TIFF 6.0, section 2)."""
    data = image.astype(f"{order}u2").tobytes()
    height, width = image.shape
    entries = [(256, 4, width), (257, 4, height), (258, 3, 16), (259, 3, 1), (262, 3, 1), (273, 4, 8),
               (277, 3, 1), (278, 4, height), (279, 4, len(data))]  # fmt: skip

    def number(value: int, size: int) -> bytes:
        return value.to_bytes(size, "little" if order == "<" else "big")

    directory = number(len(entries), 2)
    for tag, kind, value in entries:
        field = number(value, 4) if kind == 4 else number(value, 2) + b"\0\0"
        directory += number(tag, 2) + number(kind, 2) + number(1, 4) + field
    head = (b"II" if order == "<" else b"MM") + number(42, 2) + number(8 + len(data), 4)
    path.write_bytes(head + data + directory + number(0, 4))


def mats(folder: Path) -> Path:
    for name, fruits in SCENE.items():
        path = (folder / f"{Path(name).parent}_side_masks" / Path(name).name).with_suffix(".mat")
        path.parent.mkdir(parents=True, exist_ok=True)
        scipy.io.savemat(path, {"mask": label_image(name), "scores": np.array([f.score for f in fruits])})
    return folder


# CVAT, Pascal VOC


def cvat_runs(pixels: Pixels) -> str:
    counts, current = [0], False
    for value in pixels.ravel().tolist():
        if value != current:
            counts.append(0)
            current = value
        counts[-1] += 1
    return ", ".join(map(str, counts))


def cvat_shape(k: int, fruit: Ellipse) -> str:
    common = f'label="apple" source="manual" occluded="0" z_order="0" score="{fruit.score}"'
    if k % 3 == 0:
        points = ";".join(f"{x:.2f},{y:.2f}" for x, y in fruit.outline())
        return f'<polygon {common} points="{points}"></polygon>'
    if k % 3 == 1:
        return (
            f'<ellipse {common} cx="{fruit.cx}" cy="{fruit.cy}" rx="{fruit.rx}" ry="{fruit.ry}" '
            f'rotation="{math.degrees(fruit.angle)}"></ellipse>'
        )
    rows, columns = np.flatnonzero(fruit.pixels.any(1)), np.flatnonzero(fruit.pixels.any(0))
    crop = fruit.pixels[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return (
        f'<mask {common} rle="{cvat_runs(crop)}" left="{columns[0]}" top="{rows[0]}" '
        f'width="{crop.shape[1]}" height="{crop.shape[0]}"><attribute name="side">east</attribute></mask>'
    )


def cvat(folder: Path) -> Path:
    images = []
    for i, (name, fruits) in enumerate(SCENE.items()):
        shapes = "\n".join(cvat_shape(k + i // 2, fruit) for k, fruit in enumerate(fruits))
        tag = '<tag label="sunny" source="manual"></tag>'
        images.append(f'<image id="{i}" name="{name}" width="{WIDTH}" height="{HEIGHT}">\n{shapes}{tag}</image>')
    text = '<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n<version>1.1</version>\n<meta><task/></meta>\n'
    return written(folder / "annotations.xml", text + "\n".join(images) + "\n</annotations>\n")


def voc(folder: Path) -> Path:
    for name, fruits in SCENE.items():
        objects = []
        for fruit in fruits:
            flat = contour_of(fruit.pixels)[0]
            pairs = list(zip(flat[::2], flat[1::2], strict=True))
            points = "".join(f"<x{k}>{x + 1}</x{k}><y{k}>{y + 1}</y{k}>" for k, (x, y) in enumerate(pairs, start=1))
            box = "<bndbox><xmin>1</xmin><ymin>1</ymin><xmax>5</xmax><ymax>5</ymax></bndbox>"
            objects.append(f"<object><name>apple</name>{box}<polygon>{points}</polygon></object>")
        size = f"<size><width>{WIDTH}</width><height>{HEIGHT}</height><depth>3</depth></size>"
        file = f"<filename>{Path(name).name}</filename>"
        text = f'<?xml version="1.0" ?>\n<annotation><folder>VOC</folder>{file}{size}{"".join(objects)}</annotation>'
        written(folder / f"{Path(name).stem}.xml", text)
    return folder


Writer = Callable[[Path], Path]
# Whether masks are as they were, to the pixel; and whether scores are there.
WRITERS: dict[str, tuple[Writer, bool, bool]] = {
    "COCO, compressed runs": (coco_file(lambda f: rle_of(f.pixels)), True, True),
    "COCO, runs": (coco_file(lambda f: runs_of(f.pixels)), True, True),
    "COCO, polygons": (coco_file(polygon_of), False, True),
    "COCO results and images": (results_with_images, True, True),
    "COCO results by name": (results_of_names, True, True),
    "SAHI": (sahi_results, True, True),
    "supervision, COCO": (supervision_coco, True, False),
    "CVAT, COCO": (cvat_coco, False, False),
    "supervision, YOLO": (yolo_traced, True, False),
    "supervision, Pascal VOC": (voc, True, False),
    "VIA 1": (via1, False, True),
    "VIA 2": (via2, False, True),
    "VIA 3": (via3, False, True),
    "VIA, a table": (via_csv, False, True),
    "YOLO": (yolo, False, True),
    "YOLO without scores": (partial(yolo, scored=False), False, False),
    "images of 8 bits": (partial(label_images, kind="8 bits"), True, False),
    "images of 16 bits": (partial(label_images, kind="16 bits"), True, False),
    "images of colours": (partial(label_images, kind="colours"), True, False),
    "images with a palette": (partial(label_images, kind="palette"), True, False),
    "TIFF, little-endian": (partial(label_images, kind="<"), True, False),
    "TIFF, big-endian": (partial(label_images, kind=">"), True, False),
    "MATLAB": (mats, True, True),
    "CVAT": (cvat, False, True),
}
