"""The registry of annotation formats: each is titled, documented, and recognises its own files and no other's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import detection_scenes as scenes
from detection_scenes import written
from pomona.errors import FormatError
from pomona.formats.detections.content import FileContent
from pomona.formats.detections.read import read_detections
from pomona.formats.detections.registry import FORMAT_OF, FORMATS, recognised

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
