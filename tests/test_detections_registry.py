"""The registry of annotation formats: each is titled, documented, and recognises its own files and no other's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

import detection_scenes as scenes
from detection_scenes import written
from pomona.errors import FormatError
from pomona.evaluate.detections import read_detection_truth
from pomona.formats.detections.content import FileContent
from pomona.formats.detections.format import Format, file_by_file
from pomona.formats.detections.label_sets import find_label_sets, read_label_set
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto
from pomona.formats.detections.photo_source import Sources
from pomona.formats.detections.read import read_detections
from pomona.formats.detections.registry import FORMAT_OF, FORMATS, recognised
from pomona.formats.detections.shapes import ellipse_mask
from pomona.stages.capture.images import size_of

DOCS = Path(__file__).parent.parent / "docs" / "reference"


def labelme(folder: Path) -> Path:
    shape = {"label": "apple", "points": [[1, 1], [9, 1], [9, 9]], "shape_type": "polygon", "group_id": None}
    return written(folder / "IMG_1.json", {"imagePath": "IMG_1.JPG", "shapes": [shape]})


def sink(folder: Path) -> Path:
    return written(folder / "a.csv", "x_min,y_min,x_max,y_max,class_id,confidence,tracker_id\n1,1,5,5,0,0.9,\n")


def via_table(folder: Path) -> Path:
    scenes.via_csv(folder)
    return folder


SAMPLES: dict[str, Callable[[Path], Path]] = {
    "coco": scenes.coco_file(scenes.polygon_of),
    "coco-results": scenes.results_of_names,
    "via": scenes.via2,
    "via-csv": via_table,
    "cvat": scenes.cvat,
    "voc": scenes.voc,
    "labelme": labelme,
    "yolo": scenes.yolo,
    "masks": lambda folder: scenes.label_images(folder, "16 bits"),
    "mat": scenes.mats,
    "sink": sink,
}


def sample(kind: str, folder: Path) -> Path:
    """One file of a format: the one with most in it."""
    path = SAMPLES[kind](folder)
    files = [path] if path.is_file() else [p for p in sorted(path.rglob("*.*")) if p.is_file()]
    return max((file for file in files if file.suffix != ".yaml"), key=lambda file: file.stat().st_size)


@pytest.mark.parametrize("kind", FORMAT_OF)
def test_every_format_recognises_its_own_files_and_no_others(tmp_path: Path, kind: str) -> None:
    content = FileContent(sample(kind, tmp_path))
    assert [each.kind for each in FORMATS if each.recognise(content)] == [kind]
    found = recognised(content)
    assert found is not None
    assert found.kind == kind


@pytest.mark.parametrize("kind", FORMAT_OF)
def test_every_format_has_a_title_and_is_documented(kind: str) -> None:
    one = FORMAT_OF[kind]
    assert one.title
    if not one.refusal:
        said = {"coco-results": "results", "via-csv": "VIA", "masks": "label images", "mat": "MATLAB"}.get(
            kind, one.title
        )
        assert said in (DOCS / "detection-formats.md").read_text(encoding="utf-8")
    if one.labels:
        said = {"via-csv": "VGG Image Annotator", "via": "VGG Image Annotator", "masks": "images of ids"}.get(
            kind, one.title
        )
        assert said in (DOCS / "label-formats.md").read_text(encoding="utf-8")


def test_kinds_and_titles_are_unique() -> None:
    assert len(FORMAT_OF) == len(FORMATS) == len({each.title for each in FORMATS}) == len(SAMPLES)


def test_companions_are_formats_that_can_be_read() -> None:
    for one in FORMATS:
        assert all(not FORMAT_OF[kind].refusal for kind in one.companions)


def test_what_is_refused_says_why(tmp_path: Path) -> None:
    for one in FORMATS:
        if one.refusal:
            path = sample(one.kind, tmp_path)
            with pytest.raises(FormatError, match=r"found boxes alone.*as_coco"):
                read_detections(path, scenes.scene_photos())


@pytest.mark.parametrize("text", ["", "\n \n", "hello\n", '{"name": "something else"}', "<html></html>", "a,b\n1,2\n"])
def test_what_is_of_no_format_is_none(tmp_path: Path, text: str) -> None:
    assert recognised(FileContent(written(tmp_path / "a.dat", text))) is None


def _read_circles(file: Path, sources: Sources) -> list[LabelledPhoto]:
    """A format that nobody knows yet: the photo's name in the first line, then a circle a line."""
    name, *lines = file.read_text(encoding="utf-8").removeprefix("circles of ").splitlines()
    photo = sources(file).find(name, "its first line")
    if photo is None:
        return []
    circles = [tuple(float(cell) for cell in line.split()) for line in lines]
    masks = [ellipse_mask((x, y), (r, r), 0, photo.width_px, photo.height_px) for x, y, r in circles]
    return [LabelledPhoto.of(photo, [LabelledFruit.from_mask(mask) for mask in masks if mask is not None])]


CIRCLES = Format(
    kind="circles",
    title="circles",
    recognise=lambda content: content.lines.startswith("circles of "),
    read=file_by_file(_read_circles),
    labels="circles (*.csv)",
)


def test_a_new_format_is_a_record_for_detections_labels_and_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("registry", "read", "label_sets"):
        monkeypatch.setattr(f"pomona.formats.detections.{module}.FORMATS", (*FORMATS, CIRCLES))
    monkeypatch.setitem(FORMAT_OF, "circles", CIRCLES)  # type: ignore[misc]
    Image.new("RGB", (scenes.WIDTH, scenes.HEIGHT)).save(tmp_path / "IMG_1.JPG")
    path = written(tmp_path / "a.csv", "circles of IMG_1.JPG\n60 70 20\n200 150 30\n")
    detections = read_detections(path, scenes.scene_photos())["east/IMG_1.JPG"]
    (labelled,) = read_label_set(find_label_sets(tmp_path)[0], size_of)
    truth = read_detection_truth(tmp_path)["IMG_1.JPG"]
    assert truth.masks is not None
    for masks in (detections.masks, [fruit.mask for fruit in labelled.fruits], truth.masks):
        assert [mask.box_px for mask in masks if mask] == [(40, 50, 80, 90), (170, 120, 230, 180)]
