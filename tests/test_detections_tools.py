"""Files that supervision and SAHI write themselves, where they are installed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from detection_scenes import FRUITS, HEIGHT, SCENE, WIDTH, scene_photos, whole
from pomona.errors import FormatError
from pomona.formats.detections.read import read_detections
from pomona.progress import Silent
from pomona.values.detections import SurveyDetections


def check(found: SurveyDetections, *, scored: bool) -> None:
    """The masks and scores are the scene's, to the pixel."""
    assert found.total == len(FRUITS)
    for name, fruits in SCENE.items():
        read = found.get(name, ())
        assert len(read) == len(fruits)
        for fruit in fruits:
            fitting = [k for k, mask in enumerate(found[name].masks) if np.array_equal(whole(mask), fruit.pixels)]
            assert len(fitting) == 1
            assert found[name].scores[fitting[0]] == pytest.approx(fruit.score if scored else 1)


@pytest.fixture
def sv() -> Any:
    return pytest.importorskip("supervision")


def detections(sv: Any, name: str, cut: bool = False) -> Any:
    masks = np.array([fruit.pixels for fruit in SCENE[name]], bool).reshape(-1, HEIGHT, WIDTH)
    if cut:
        masks[0, 66:72] = False  # a leaf across the first fruit
    return sv.Detections(
        xyxy=sv.mask_to_xyxy(masks).astype(float),
        mask=masks,
        confidence=np.array([fruit.score for fruit in SCENE[name]]),
        class_id=np.zeros(len(masks), int),
    )


def dataset(sv: Any, folder: Path, cut: bool = False) -> Any:
    images = {}
    for name in SCENE:
        path = folder / Path(name).with_suffix(".png").name
        cv2.imwrite(str(path), np.zeros((HEIGHT, WIDTH, 3), np.uint8))
        images[str(path)] = name
    found = {path: detections(sv, name, cut and bool(SCENE[name])) for path, name in images.items()}
    return sv.DetectionDataset(classes=["apple"], images=list(images), annotations=found)


def test_supervisions_data_sets_are_read_to_the_pixel(tmp_path: Path, sv: Any) -> None:
    written = dataset(sv, tmp_path)
    out = tmp_path / "out"
    written.as_coco(annotations_path=str(out / "coco" / "annotations.json"))
    written.as_yolo(annotations_directory_path=str(out / "yolo" / "labels"), data_yaml_path=str(out / "yolo/data.yaml"))
    written.as_pascal_voc(annotations_directory_path=str(out / "voc"))
    for form in ("coco", "yolo", "voc"):
        check(read_detections(out / form, scene_photos()), scored=False)
    check(read_detections(out / "coco" / "annotations.json", scene_photos()), scored=False)


def test_a_fruit_cut_in_two_is_one_in_supervisions_coco(tmp_path: Path, sv: Any) -> None:
    dataset(sv, tmp_path, cut=True).as_coco(annotations_path=str(tmp_path / "out" / "annotations.json"))
    assert '"iscrowd": 1' in (tmp_path / "out" / "annotations.json").read_text()
    progress = Silent()
    found = read_detections(tmp_path / "out", scene_photos(), progress=progress)
    assert found.total == len(FRUITS)
    assert not any("crowd" in warning for warning in progress.warnings)
    whole_area = SCENE["east/IMG_1.JPG"][0].pixels.sum()
    assert sorted(m.area_px for m in found["east/IMG_1.JPG"].masks)[-1] < whole_area


def test_supervisions_sinks_have_no_masks_and_say_so(tmp_path: Path, sv: Any) -> None:
    found = detections(sv, "east/IMG_1.JPG")
    with sv.CSVSink(str(tmp_path / "a.csv")) as sink:
        sink.append(found, {"photo": "IMG_1.JPG"})
    with sv.JSONSink(str(tmp_path / "a.json")) as sink:
        sink.append(found, {"photo": "IMG_1.JPG"})
    for name in ("a.csv", "a.json"):
        with pytest.raises(FormatError, match=rf"{name}: expected masks .*, found boxes alone.*as_coco"):
            read_detections(tmp_path / name, scene_photos())


def test_sahis_results(tmp_path: Path) -> None:
    pytest.importorskip("sahi")
    from sahi.prediction import ObjectPrediction, PredictionResult
    from sahi.utils.cv import get_coco_segmentation_from_bool_mask

    def result(name: str) -> Any:
        objects = [
            ObjectPrediction(
                segmentation=get_coco_segmentation_from_bool_mask(fruit.pixels),
                category_id=0,
                category_name="apple",
                score=fruit.score,
                full_shape=[HEIGHT, WIDTH],
            )
            for fruit in SCENE[name]
        ]
        return PredictionResult(objects, np.zeros((HEIGHT, WIDTH, 3), np.uint8))

    # `sahi predict --dataset_json_path`: one list for the images of a COCO file.
    ids = {name: k for k, name in enumerate(SCENE, start=1)}
    whole_list = [entry for name in SCENE for entry in result(name).to_coco_predictions(image_id=ids[name])]
    (tmp_path / "result.json").write_text(json.dumps(whole_list))
    with pytest.raises(
        FormatError, match=r"image_id: expected a photo's name, found 1: .*put the COCO file that has these"
    ):
        read_detections(tmp_path / "result.json", scene_photos())
    images = [{"id": ids[name], "file_name": name, "width": WIDTH, "height": HEIGHT} for name in SCENE]
    (tmp_path / "dataset.json").write_text(json.dumps({"images": images, "annotations": [], "categories": []}))
    check(read_detections(tmp_path, scene_photos()), scored=True)

    # `to_coco_predictions()` of each photo, in files of the photos' names.
    for name in SCENE:
        if SCENE[name]:
            path = (tmp_path / "single" / name).with_suffix(".json")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(result(name).to_coco_predictions()))
    check(read_detections(tmp_path / "single", scene_photos()), scored=True)
