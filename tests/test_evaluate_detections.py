"""Scores of detections: against pycocotools, against counts known beforehand, and what bad input says."""

from __future__ import annotations

import json
import re
import unicodedata
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval
from rich.console import Console
from typer.testing import CliRunner, Result

from pomona.cli.app import app
from pomona.errors import FormatError, InputError, MissingFileError, PomonaError
from pomona.evaluate.detections import (
    DetectionScores,
    DetectionTruth,
    EvaluateDetectionsOptions,
    PhotoTruth,
    average_precision,
    evaluate_detections,
    kinds,
    read_detection_truth,
    read_found,
    truth_from_ids,
    truth_of_labelled,
)
from pomona.evaluate.detections.matching import box_overlap, mask_overlap, right
from pomona.evaluate.detections.scores import precision_curve
from pomona.evaluate.tables import detections_table
from pomona.formats.detections.coco import write_coco
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto
from pomona.formats.detections.rle import encode
from pomona.progress import Silent
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.photo_names import PhotoNames, pair_names
from pomona.values.photos import Photo, Photos

WIDTH, HEIGHT = 160, 120
ALL = EvaluateDetectionsOptions(min_size_px=0)


def disc(x: float, y: float, radius: float) -> Mask:
    inside = (np.arange(WIDTH) + 0.5 - x) ** 2 + ((np.arange(HEIGHT) + 0.5 - y) ** 2)[:, None] <= radius**2
    return Mask.from_pixels(inside)


def square(x: int, y: int, side: int) -> Mask:
    return Mask.from_pixels(np.ones((side, side), bool), x, y)


def found_of(photo: str, masks: list[Mask], scores: list[float], first_id: int = 1) -> Detections:
    ids = np.arange(len(masks)) + first_id
    return Detections(photo, WIDTH, HEIGHT, tuple(masks), np.array(scores, float), ids)


def truth_of(photo: str, masks: list[Mask], **flags: list[bool]) -> PhotoTruth:
    boxes = np.array([mask.box_px for mask in masks], float).reshape(-1, 4)
    marks = {name: np.array(values, bool) for name, values in flags.items()}
    return PhotoTruth(photo, WIDTH, HEIGHT, np.arange(len(masks)) + 1, boxes, tuple(masks), **marks)


def scores_of(
    found: list[Detections], truth: list[PhotoTruth], options: EvaluateDetectionsOptions = ALL
) -> DetectionScores:
    by_photo = {t.photo: t for t in truth}
    return evaluate_detections({f.photo: f for f in found}, DetectionTruth(by_photo), options=options)


def orchard(seed: int, photos: int = 6, fruits: int = 14) -> tuple[list[Detections], list[PhotoTruth]]:
    """Photos with crowded fruits, some ignored or crowds; detections near most of them, some twice, some nowhere."""
    rng = np.random.default_rng(seed)
    found, truth = [], []
    for k in range(photos):
        places = rng.uniform([8, 8, 4], [WIDTH - 8, HEIGHT - 8, 12], (fruits, 3))
        seen = places[rng.integers(0, fruits, fruits + 4)]
        seen = seen + rng.normal(0, 1, seen.shape) * [1.5, 1.5, 0.8]
        seen[:2] = rng.uniform([8, 8, 4], [WIDTH - 8, HEIGHT - 8, 12], (2, 3))
        masks = [disc(x, y, max(2, radius)) for x, y, radius in seen]
        scores = rng.permutation(len(masks) * photos)[: len(masks)] / (len(masks) * photos) + k * 1e-4
        found.append(found_of(f"{k}.jpg", masks, scores.tolist(), 1 + 1000 * k))
        marks = rng.random(fruits)
        flags = {"ignored": (marks < 0.15).tolist(), "crowds": (marks > 0.9).tolist()}
        truth.append(truth_of(f"{k}.jpg", [disc(*place) for place in places], **flags))
    return found, truth


def coco_eval(found: list[Detections], truth: list[PhotoTruth], kind: str) -> Any:
    """pycocotools' answer; what is ignored has an area that its range leaves out, and crowds are crowds."""
    images = [{"id": k, "file_name": t.photo, "width": WIDTH, "height": HEIGHT} for k, t in enumerate(truth, start=1)]
    annotations, results = [], []
    for image, of_photo, f in zip(images, truth, found, strict=True):
        for j, mask in enumerate(of_photo.masks or ()):
            area = -1 if of_photo.ignored[j] else mask.area_px
            annotations.append(
                {**shape(mask), "id": len(annotations) + 1, "image_id": image["id"], "category_id": 1, "area": area}
                | {"iscrowd": int(of_photo.crowds[j])}
            )
        for mask, score in zip(f.masks, f.scores, strict=True):
            results.append({**shape(mask), "image_id": image["id"], "category_id": 1, "score": float(score)})
    expected = COCO()
    expected.dataset = {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "fruit"}]}
    expected.dataset["info"] = {}
    expected.createIndex()
    if kind == "bbox":
        results = [{k: v for k, v in r.items() if k != "segmentation"} for r in results]
    evaluation = COCOeval(expected, expected.loadRes(results), kind)
    evaluation.params.maxDets = [1, 10, 1000]
    evaluation.evaluate()
    evaluation.accumulate()
    return evaluation.eval


def shape(mask: Mask) -> dict[str, Any]:
    x0, y0, x1, y1 = mask.box_px
    runs = {"size": [HEIGHT, WIDTH], "counts": encode(mask, WIDTH, HEIGHT)}
    return {"bbox": [x0, y0, x1 - x0, y1 - y0], "segmentation": runs}


def at_101_recalls(scores: np.ndarray, hits: np.ndarray, fruits: int) -> float:
    """COCO's AP of our matches: the envelope's mean at 101 recalls."""
    _, right_ones, number = precision_curve(scores, hits)
    envelope = np.append(np.maximum.accumulate((right_ones / number)[::-1])[::-1], 0)
    places = np.searchsorted(right_ones / fruits, np.linspace(0, 1, 101), side="left")
    return float(envelope[np.minimum(places, len(right_ones))].mean())


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("kind", "match"), [("bbox", "boxes"), ("segm", "masks")])
def test_agrees_with_pycocotools(seed: int, kind: str, match: Any) -> None:
    found, truth = orchard(seed)
    ours = scores_of(found, truth, EvaluateDetectionsOptions(match=match, min_size_px=0))
    theirs = coco_eval(found, truth, kind)
    assert ours.true_fruits == sum(int((~t.ignored & ~t.crowds).sum()) for t in truth)
    for row in range(10):
        expected = float(theirs["precision"][row, :, 0, 0, -1].mean())
        hits = [right(m.coco_idx[row], m.scored) for m in ours.matches]
        kept = [hit | (m.coco_idx[row] < 0) for m, hit in zip(ours.matches, hits, strict=True)]
        scores = np.concatenate([m.scores[k] for m, k in zip(ours.matches, kept, strict=True)])
        flat = np.concatenate([h[k] for h, k in zip(hits, kept, strict=True)])
        assert at_101_recalls(scores, flat, ours.true_fruits) == pytest.approx(expected, abs=1e-9)
        assert ours.ap_by_iou[row] == pytest.approx(expected, abs=0.01)
        assert flat.sum() / ours.true_fruits == pytest.approx(theirs["recall"][row, 0, 0, -1])
    assert 0.1 < ours.ap < ours.ap50 < 0.95


def test_overlaps_are_those_of_whole_photos() -> None:
    rng = np.random.default_rng(0)
    a, b = ([disc(*rng.uniform([8, 8, 3], [90, 90, 20])) for _ in range(n)] for n in (7, 9))
    crowds = np.arange(9) == 4
    expected = np.array([[one.iou(other) for other in b] for one in a])
    expected[:, 4] = [one.intersection_px(b[4]) / one.area_px for one in a]
    np.testing.assert_allclose(mask_overlap(a, b, crowds), expected)
    boxes = box_overlap(np.array([[0.0, 0, 10, 10]]), np.array([[5.0, 0, 15, 10], [5, 0, 15, 10], [20, 20, 30, 30]]))
    np.testing.assert_allclose(boxes, [[1 / 3, 1 / 3, 0]])
    crowd = box_overlap(np.array([[0.0, 0, 10, 10]]), np.array([[5.0, 0, 15, 10]]), np.array([True]))
    np.testing.assert_allclose(crowd, [[0.5]])
    assert mask_overlap([], b).shape == (0, 9)


def test_average_precision_is_the_area_under_the_envelope() -> None:
    hits = np.array([True, False, True, True, False])
    # Precision 1, 1/2, 2/3, 3/4, 3/5 at recalls 1/4, 1/4, 2/4, 3/4, 3/4: the envelope is 1, then 3/4 twice.
    assert average_precision(np.array([0.9, 0.8, 0.7, 0.6, 0.5]), hits, 4) == pytest.approx((1 + 0.75 + 0.75) / 4)
    assert average_precision(np.zeros(0), np.zeros(0, bool), 4) == 0
    assert np.isnan(average_precision(np.ones(1), np.zeros(1, bool), 0))


def test_equal_scores_count_together_in_any_order() -> None:
    hits = np.array([True, False, True, False])
    for order in ([0, 1, 2, 3], [1, 3, 0, 2], [0, 2, 1, 3]):
        assert average_precision(np.ones(4), hits[order], 2) == pytest.approx(0.5)


def test_counts_by_confidence() -> None:
    fruits = [square(0, 0, 20), square(40, 0, 20), square(80, 0, 20), square(120, 0, 20)]
    seen = [square(0, 0, 20), square(40, 0, 20), square(42, 0, 20), square(0, 60, 20), square(80, 0, 20)]
    scores = scores_of([found_of("a", seen, [0.9, 0.6, 0.8, 0.7, 0.55])], [truth_of("a", fruits)])
    # The shifted square is surer, so it is the second fruit, and the exact one comes second: a double.
    assert kinds(scores.matches[0]) == ("right", "double", "right", "false", "right")
    half, full = scores.levels[0], scores.levels[5]
    assert (half.confidence, half.detections, half.true_positives) == (0.5, 5, 3)
    assert (half.recall, half.precision, half.f1) == pytest.approx((0.75, 0.6, 2 / 3))
    assert (full.confidence, full.detections, full.true_positives) == (0.75, 2, 2)
    assert half.mask_iou == pytest.approx((1 + 18 / 22 + 1) / 3)
    assert scores.best is not None
    # Two right of two at 0.8 have F1 2/3 as well: the surer one is the best.
    assert (scores.best.confidence, scores.best.f1) == pytest.approx((0.8, 2 / 3))
    assert scores.levels[-1].f1 == 0
    assert np.isnan(scores.levels[-1].precision)


def test_an_overlap_of_exactly_half_is_no_match_but_counts_for_coco() -> None:
    tall = Mask.from_pixels(np.ones((40, 20), bool))
    scores = scores_of([found_of("a", [square(0, 0, 20)], [0.9])], [truth_of("a", [tall])])
    assert scores.levels[0].true_positives == 0
    assert scores.ap50 == 1


def test_what_is_small_ignored_or_a_crowd_is_neither_right_nor_wrong() -> None:
    small, large, marked, crowd = square(0, 0, 8), square(30, 0, 20), square(60, 0, 20), square(90, 0, 60)
    truth = truth_of(
        "a", [small, large, marked, crowd], ignored=[False, False, True, False], crowds=[False, False, False, True]
    )
    in_crowd = [square(92, 4, 20), square(120, 20, 20)]
    found = found_of("a", [small, large, marked, *in_crowd, square(0, 80, 20)], [0.9, 0.9, 0.9, 0.9, 0.9, 0.6])
    scores = scores_of([found], [truth], EvaluateDetectionsOptions(min_size_px=12))
    assert (scores.true_fruits, scores.ignored, scores.detections) == (1, 3, 6)
    assert kinds(scores.matches[0]) == ("neither", "right", "neither", "neither", "neither", "false")
    assert (scores.levels[0].detections, scores.levels[0].true_positives) == (2, 1)
    assert scores.best is not None
    assert scores.best.f1 == 1
    with_small = scores_of([found], [truth])
    assert (with_small.true_fruits, with_small.levels[0].true_positives) == (2, 2)
    seen = scores_of([found], [truth], EvaluateDetectionsOptions(min_size_px=0, min_visible_px=65))
    assert seen.true_fruits == 1


def test_a_detection_takes_a_scored_fruit_before_an_ignored_one() -> None:
    truth = truth_of("a", [square(0, 0, 20), square(2, 0, 20)], ignored=[True, False])
    scores = scores_of([found_of("a", [square(0, 0, 20)], [0.9])], [truth])
    assert kinds(scores.matches[0]) == ("right",)


def test_no_detection_and_no_fruit() -> None:
    nothing = scores_of([found_of("a", [], [])], [truth_of("a", [square(0, 0, 20)])])
    assert (nothing.ap, nothing.levels[0].recall, nothing.levels[0].f1, nothing.best) == (0, 0, 0, None)
    bare = scores_of([found_of("a", [square(0, 0, 20)], [0.9])], [truth_of("a", [])])
    assert np.isnan(bare.ap)
    assert bare.to_json()["AP"] is None
    assert bare.levels[0].precision == 0
    for scores in (nothing, bare):
        Console(quiet=True).print(detections_table(scores))


def test_boxes_decide_where_one_side_has_no_masks() -> None:
    fruit, bar = disc(40, 40, 16), Mask.from_pixels(np.ones((33, 3), bool), 24, 24)
    truth = DetectionTruth({"a": truth_of("a", [fruit])})
    boxes = np.array([fruit.box_px], float)
    found = {"a": Detections("a", WIDTH, HEIGHT, (bar,), np.array([0.9]), np.array([1]), boxes)}
    assert evaluate_detections(found, truth).levels[0].true_positives == 0
    by_box = evaluate_detections(found, truth, found_masks=False)
    assert (by_box.by_masks, by_box.levels[0].true_positives) == (False, 1)
    assert np.isnan(by_box.levels[0].mask_iou)
    forced = evaluate_detections(found, truth, options=EvaluateDetectionsOptions(match="boxes"))
    assert 0 < forced.levels[0].mask_iou < 0.2
    with pytest.raises(InputError, match="the detections are boxes alone"):
        evaluate_detections(found, truth, found_masks=False, options=EvaluateDetectionsOptions(match="masks"))


@pytest.mark.parametrize("names", [["east/1.jpg", "west/1.jpg"], ["x/East/1.png", "x/west/1.png"]])
def test_names_are_paired_by_their_ends(names: list[str]) -> None:
    assert pair_names(names, ["west/1.jpg", "east/1.jpg"]) == dict(
        zip(names, ["east/1.jpg", "west/1.jpg"], strict=True)
    )


def test_names_that_fit_several_photos_are_refused() -> None:
    with pytest.raises(InputError, match=r"'1' fits several photos, east/1\.jpg, west/1\.jpg"):
        pair_names(["1"], ["east/1.jpg", "west/1.jpg"])
    with pytest.raises(InputError, match="both fit the photo"):
        pair_names(["a/1.png", "b/1.png"], ["c/1.jpg"])
    assert pair_names(["2"], ["1.jpg"]) == {}


def test_a_photo_that_is_gone_is_not_its_namesake_of_another_folder() -> None:
    photos = ["east/1.jpg", "west/1.jpg", "west/2.jpg"]
    for name in ("east/2.jpg", "x/East/2.png", "East\\2"):
        assert pair_names([name], photos) == {}
        assert PhotoNames(photos).meant_by(name) == ()
    rows = ["row1/east/1.jpg", "row2/east/2.jpg"]
    assert pair_names(["row1/east/2.jpg", "row2/east/2.png"], rows) == {"row2/east/2.png": "row2/east/2.jpg"}
    assert PhotoNames(rows).meant_by("row1/east/2.jpg") == ()
    # Folders that no photo is in, and that of another program, tell nothing.
    for name in ("2.jpg", "images/2.jpg", "row3/west/2"):
        assert pair_names([name], photos) == {name: "west/2.jpg"}
        assert PhotoNames(photos).meant_by(name) == ("west/2.jpg",)
    assert pair_names(["row3/east/2"], rows) == {"row3/east/2": "row2/east/2.jpg"}


def test_letter_case_and_suffix_tell_photos_apart_that_fit_alike() -> None:
    photos = ["east/IMG_1.JPG", "east/img_1.jpg", "east/img_1.png"]
    for name, photo in (("x/east/IMG_1.JPG", 0), ("IMG_1", 0), ("x/east/img_1.jpg", 1), ("img_1.png", 2)):
        assert pair_names([name], photos) == {name: photos[photo]}
        assert PhotoNames(photos).meant_by(name) == (photos[photo],)
    for name in ("img_1", "Img_1.jpg"):
        assert len(PhotoNames(photos).meant_by(name)) > 1
        with pytest.raises(InputError, match="fits several photos"):
            pair_names([name], photos)


def test_dots_and_accents_of_names_are_no_suffixes() -> None:
    photo = "2024-05-01 12.34.56.jpg"
    assert pair_names(["2024-05-01 12.34.56"], [photo]) == {"2024-05-01 12.34.56": photo}
    assert pair_names(["2024-05-01 12.34.56.TXT"], [photo]) == {"2024-05-01 12.34.56.TXT": photo}
    assert pair_names(["frame_1.5"], ["frame_1.jpg"]) == {}
    composed, parted = (unicodedata.normalize(form, "Süd_1.jpg") for form in ("NFC", "NFD"))
    assert composed != parted
    assert pair_names([composed], [parted]) == {composed: parted}


@pytest.mark.parametrize("label", ["a.txt", "A.XML", "all.csv", "coco.json"])
def test_photos_with_labels_beside_them_are_no_masks(tmp_path: Path, label: str) -> None:
    grey = np.linspace(0, 255, WIDTH * HEIGHT).reshape(HEIGHT, WIDTH).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), grey)
    (tmp_path / "readme.txt").write_text("masks of fruits")
    assert read_detection_truth(tmp_path).total > 200
    (tmp_path / label).write_text("0 0.5 0.5 0.2 0.2\n" if label == "a.txt" else "")
    if label == "a.txt":
        assert read_detection_truth(tmp_path).total == 1
    else:
        with pytest.raises(PomonaError):
            read_detection_truth(tmp_path)


def test_fruit_ids_become_masks() -> None:
    ids = np.zeros((HEIGHT, WIDTH), np.uint16)
    ids[10:20, 30:50], ids[15:40, 45:60] = 300, 7
    truth = truth_from_ids("a", ids)
    assert truth.ids.tolist() == [7, 300]
    assert truth.boxes_px.tolist() == [[45, 15, 60, 40], [30, 10, 50, 20]]
    assert truth.masks is not None
    assert truth.masks[1].area_px == 20 * 10 - 5 * 5


@pytest.mark.parametrize("masks", ["masks", "instances"])
@pytest.mark.parametrize("match", ["masks", "boxes"])
def test_pixels_to_be_ignored_are_crowds_each_where_it_is(tmp_path: Path, masks: str, match: Any) -> None:
    """Fruits of the row behind are neither right nor wrong, however many; what lies between them is false."""
    ids = np.zeros((HEIGHT, WIDTH), np.uint16)
    ids[10:30, 10:30] = 1
    ids[5:25, 60:80] = ids[35:55, 5:25] = ids[35:55, 70:90] = 65534
    (tmp_path / masks).mkdir()
    write_photo(tmp_path / "images" / "a.jpg")
    assert cv2.imwrite(str(tmp_path / masks / "a.png"), ids)
    truth = read_detection_truth(tmp_path).of_photos(("a.jpg",))
    behind = [square(62, 5, 16), square(6, 36, 16), square(72, 36, 16)]
    found = found_of("a.jpg", [square(10, 10, 20), *behind, square(40, 15, 16)], [0.6, 0.9, 0.8, 0.7, 0.5], 1)
    options = EvaluateDetectionsOptions(match=match)
    scores = evaluate_detections({"a.jpg": found}, truth, options=options)
    assert (scores.true_fruits, scores.ignored) == (1, 3)
    assert kinds(scores.matches[0]) == ("right", "neither", "neither", "neither", "false")
    assert scores.ap50 == 1


@pytest.mark.parametrize(
    ("masks", "photos"),
    [(["a_mask", "b_mask"], ("a", "b")), (["a_ids"], ("a",)), (["a_mask", "b"], ("a_mask", "b"))],
)
def test_masks_may_be_named_as_photos_with_an_ending_that_all_have(
    masks: list[str], photos: tuple[str, ...], tmp_path: Path
) -> None:
    for k, name in enumerate(masks):
        ids = np.zeros((HEIGHT, WIDTH), np.uint8)
        ids[10:30, 10 : 30 + 10 * k] = 1
        assert cv2.imwrite(str(tmp_path / f"{name}.png"), ids)
    truth = read_detection_truth(tmp_path)
    assert tuple(truth.by_photo) == photos
    assert [truth.by_photo[photo].boxes_px[0, 2] for photo in photos] == [30 + 10 * k for k in range(len(photos))]


def test_crowds_and_ignored_ones_are_the_same_in_one_coco_file_and_in_several(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_photo(tmp_path / "images" / f"{name}.jpg")
        image = {"id": 1, "file_name": f"{name}.jpg", "width": WIDTH, "height": HEIGHT}
        of = [(disc(15, 15, 8), {}), (disc(40, 15, 8), {"ignore": 1}), (disc(75, 35, 20), {"iscrowd": 1})]
        annotations = [
            {**shape(mask), "id": k, "image_id": 1, "category_id": 1, "iscrowd": 0, **marks}
            for k, (mask, marks) in enumerate(of, start=1)
        ]
        content = {"images": [image], "annotations": annotations, "categories": [{"id": 1, "name": "apple"}]}
        write_json(tmp_path / f"{name}.json", content)
    places = [(15, 15, 8), (40, 15, 8), (70, 30, 8), (80, 40, 8)]
    for path, photos in ((tmp_path / "a.json", 1), (tmp_path, 2)):
        names = ("a.jpg", "b.jpg")[:photos]
        truth = read_detection_truth(path).of_photos(names)
        found = {n: found_of(n, [disc(*p) for p in places], [0.6, 0.9, 0.8, 0.7], 10 * k) for k, n in enumerate(names)}
        scores = evaluate_detections(found, truth)
        assert scores.by_masks
        assert (scores.true_fruits, scores.ignored) == (photos, 2 * photos)
        assert kinds(scores.matches[-1]) == ("right", "neither", "neither", "neither")
        assert scores.ap50 == 1


# Files and the command line.


def write_photo(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.full((HEIGHT, WIDTH, 3), 90, np.uint8))


def write_json(path: Path, content: object) -> Path:
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.fixture
def row(tmp_path: Path) -> Path:
    """A row of two photos with three fruits, one of them under 12 px, as fruit ids."""
    folder = tmp_path / "row"
    (folder / "truth" / "masks").mkdir(parents=True)
    for name, fruits in (("east_0", [(1, 20, 20, 20), (2, 60, 20, 20)]), ("east_1", [(1, 20, 20, 20), (9, 90, 9, 9)])):
        write_photo(folder / "images" / f"{name}.jpg")
        ids = np.zeros((HEIGHT, WIDTH), np.uint16)
        for k, x, y, side in fruits:
            ids[y : y + side, x : x + side] = k
        assert cv2.imwrite(str(folder / "truth" / "masks" / f"{name}.png"), ids)
    return folder


@pytest.fixture
def detections(row: Path) -> Path:
    """Detections of that row: one right and one false in the first photo, the right and the small one in the second."""
    photos = Photos(tuple(Photo(f"{n}.jpg", row / "images" / f"{n}.jpg", WIDTH, HEIGHT) for n in ("east_0", "east_1")))
    first = found_of("east_0.jpg", [square(21, 20, 20), square(100, 80, 20)], [0.9, 0.6])
    second = found_of("east_1.jpg", [square(20, 20, 20), square(90, 9, 9)], [0.8, 0.7], 3)
    path = row / "detections.json"
    write_coco(path, photos, SurveyDetections({"east_0.jpg": first, "east_1.jpg": second}))
    return path


def pomona(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["evaluate", *map(str, arguments), "--detections"], env={"COLUMNS": "160"})


def test_command_prints_a_table(row: Path, detections: Path) -> None:
    result = pomona(detections, "--truth", row)
    assert result.exit_code == 0, result.stderr
    for text in ("by masks", "AP50", "best F1 (at confidence 0.800)", "0.95", "under 12 px wide"):
        assert text in result.stdout


def test_command_prints_json(row: Path, detections: Path) -> None:
    scores = json.loads(pomona(detections, "--truth", row / "truth", "--json", "--outcomes").stdout)
    assert (scores["T"], scores["ignored"], scores["detections"], scores["match"]) == (3, 1, 4, "masks")
    assert [scores["best"][name] for name in ("T", "D", "TP")] == [3, 2, 2]
    assert (scores["levels"][0]["R"], scores["levels"][0]["P"]) == pytest.approx((2 / 3, 2 / 3), abs=1e-5)
    first, second = scores["outcomes"]
    assert [entry["kind"] for entry in first["detections"]] == ["right", "false"]
    assert [entry["truth_id"] for entry in second["detections"]] == [1, 9]
    assert (first["missed"], second["missed"]) == ([2], [])
    with_all = json.loads(pomona(detections, "--truth", row, "--min-size", 0, "--match", "boxes", "--json").stdout)
    assert (with_all["T"], with_all["levels"][0]["TP"], with_all["match"]) == (4, 3, "boxes")


def test_command_on_a_survey(row: Path, detections: Path, tmp_path: Path) -> None:
    survey = tmp_path / "survey"
    survey.mkdir()
    write_json(survey / "survey.json", {"format": "pomona-survey", "stages": {}, "sources": [str(row / "images")]})
    result = pomona(survey, "--truth", row)
    assert result.exit_code == 1
    assert "pomona segment PHOTOS --out" in result.stderr
    detections.rename(survey / "detections.json")
    result = pomona(survey, "--truth", row, "--pictures", tmp_path / "pictures", "--worst", 1)
    assert result.exit_code == 0, result.stderr
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["001_east_0.jpg"]
    assert f"1 picture in {tmp_path / 'pictures'}" in result.stdout
    (tmp_path / "pictures" / "001_east_0.jpg").rename(tmp_path / "pictures" / "002_west_9.jpg")
    again = pomona(survey, "--truth", row, "--pictures", tmp_path / "pictures", "--worst", 1)
    assert "has pictures of an earlier evaluation, too, which are no part of this one: 002_west_9.jpg" in again.stderr
    assert "earlier evaluation" not in result.stderr


def test_pictures_show_what_is_right_false_and_missed(row: Path, detections: Path, tmp_path: Path) -> None:
    data = write_json(tmp_path / "low.json", json.loads(detections.read_text(encoding="utf-8")))
    content = json.loads(data.read_text())
    for annotation in content["annotations"]:
        annotation["score"] = 0.9
    write_json(data, content)
    result = pomona(data, "--truth", row, "--pictures", tmp_path / "pictures")
    assert result.exit_code == 0, result.stderr
    assert "2 pictures, the worst photo first" in result.stdout
    picture = cv2.imread(str(tmp_path / "pictures" / "001_east_0.jpg"))[:, :, ::-1].astype(int)
    assert picture.shape == (2 * HEIGHT + 30, 900, 3)

    def near(x: float, y: float) -> np.ndarray:
        return picture[round(2 * y) - 2 : round(2 * y) + 3, round(2 * x) - 2 : round(2 * x) + 3].reshape(-1, 3)

    green, red, yellow = near(31, 30).mean(0), near(100, 90), near(60, 30)
    assert green[1] > green[0] + 20
    assert (red[:, 0] - red[:, 2]).max() > 80
    assert (np.minimum(yellow[:, 0], yellow[:, 1]) - yellow[:, 2]).max() > 80
    assert np.ptp(near(130, 30), axis=0).max() < 10


def test_boxes_and_lists_of_results(row: Path, tmp_path: Path) -> None:
    images = [{"id": 5, "file_name": "east_0.jpg", "width": WIDTH, "height": HEIGHT}]
    boxes = [
        {"id": 1, "image_id": 5, "category_id": 1, "bbox": [20, 20, 20, 20]},
        {"id": 2, "image_id": 5, "category_id": 1, "bbox": [60, 20, 20, 20], "ignore": 1},
        {"id": 3, "image_id": 5, "category_id": 1, "bbox": [90, 20, 20, 20]},
    ]
    truth = write_json(tmp_path / "truth.json", {"images": images, "annotations": boxes, "categories": []})
    hits = [{"image_id": 5, "category_id": 1, "bbox": [x, 20, 20, 20], "score": s} for x, s in ((20, 0.9), (61, 0.8))]
    results = write_json(tmp_path / "results.json", hits)
    scores = json.loads(pomona(results, "--truth", truth, "--json").stdout)
    assert (scores["match"], scores["T"], scores["AP50"], scores["best"]["P"]) == ("boxes", 2, 0.5, 1)
    assert scores["best"]["mask_iou"] is None
    hits[0]["category_id"] = 2
    assert "expected annotations of one category" in pomona(write_json(results, hits), "--truth", truth).stderr
    read = read_detection_truth(truth)
    assert (read.has_masks, read.total) == (False, 3)
    assert not read_found(write_json(results, hits[1:]), truth=read).masks


def test_detections_without_scores_are_said_to_have_none(tmp_path: Path) -> None:
    """supervision writes none: average precision was printed as if all had been found with equal certainty."""
    image = {"id": 5, "file_name": "east_0.jpg", "width": WIDTH, "height": HEIGHT}
    boxes = [{"id": k, "image_id": 5, "category_id": 1, "bbox": [20 * k, 20, 18, 18]} for k in (1, 2, 3)]
    content = {"images": [image], "annotations": boxes, "categories": [{"id": 1, "name": "apple"}]}
    truth = write_json(tmp_path / "truth.json", content)
    for scoreless, said in ((3, True), (1, True), (0, False)):
        scored = [box if k < scoreless else {**box, "score": 0.5} for k, box in enumerate(boxes)]
        done = pomona(write_json(tmp_path / "found.json", {**content, "annotations": scored}), "--truth", truth)
        warning = f"{scoreless} of 3 detections have no score: it is taken to be 1"
        assert (warning in " ".join(done.stderr.split())) == said


def test_truth_in_labels_of_other_programs(row: Path, detections: Path, tmp_path: Path) -> None:
    labels = tmp_path / "yolo"
    for name, line in (("east_0", "0 0.1875 0.25 0.125 0.1666667"), ("east_1", "")):
        write_photo(labels / "images" / f"{name}.jpg")
        (labels / "labels").mkdir(exist_ok=True)
        (labels / "labels" / f"{name}.txt").write_text(line)
    scores = json.loads(pomona(detections, "--truth", labels, "--json").stdout)
    assert (scores["match"], scores["photos"], scores["T"], scores["levels"][0]["TP"]) == ("boxes", 2, 1, 1)
    assert read_detection_truth(labels)["images/east_0.jpg"].boxes_px == pytest.approx(np.array([[20, 20, 40, 40]]))
    masks = truth_of_labelled(
        [
            LabelledPhoto(tmp_path / "a.jpg", "a.jpg", WIDTH, HEIGHT, (LabelledFruit.from_mask(disc(40, 40, 16)),)),
            LabelledPhoto(tmp_path / "b.jpg", "b.jpg", WIDTH, HEIGHT, (LabelledFruit((0, 0, 9, 9), None, None, True),)),
        ]
    )
    assert (masks.has_masks, len(masks["a.jpg"]), len(masks["b.jpg"])) == (True, 1, 0)
    with pytest.raises(FormatError, match=r"found 'a\.jpg' in two sets"):
        truth_of_labelled([LabelledPhoto(tmp_path / f"{k}" / "a.jpg", "a.jpg", WIDTH, HEIGHT, ()) for k in "12"])


def test_photos_without_truth_are_left_out_with_a_warning() -> None:
    truth = DetectionTruth({"1": truth_of("1", [square(0, 0, 20)]), "3": truth_of("3", [])})
    progress = Silent()
    assert list(truth.of_photos(["1.jpg", "2.jpg"], progress=progress)) == ["1.jpg"]
    assert progress.warnings[0] == "Photos without truth are left out: 2.jpg."
    assert progress.warnings[1] == "Truth of photos that were not searched is left out: 3."


def test_photos_that_nobody_labelled_are_warned_of(tmp_path: Path) -> None:
    """Of a folder of photos with YOLO's labels of a few, the others are without fruit, and what is there is false."""
    for k in range(5):
        write_photo(tmp_path / "images" / f"p{k}.jpg")
    (tmp_path / "labels").mkdir()
    names = tuple(f"p{k}.jpg" for k in range(5))
    found = {name: found_of(name, [square(20, 20, 20)], [0.9], 10 * k) for k, name in enumerate(names)}
    for labelled, warned in ((2, "3 of 5 photos have no true fruit, .* is false: .*p2.jpg"), (3, None)):
        for k in range(labelled):
            (tmp_path / "labels" / f"p{k}.txt").write_text("0 0.1875 0.25 0.125 0.1666667")
        heard = Silent()
        scores = evaluate_detections(found, read_detection_truth(tmp_path).of_photos(names), progress=heard)
        assert scores.best is not None
        assert scores.best.precision == labelled / 5
        assert bool(heard.warnings) == (warned is not None)
        assert warned is None or re.search(warned, heard.warnings[0])


def test_truth_of_other_photos(row: Path, detections: Path) -> None:
    for path in (row / "truth" / "masks").iterdir():
        path.rename(path.with_name(f"other_{path.name}"))
    result = pomona(detections, "--truth", row)
    assert result.exit_code == 1
    assert "The truth names no photo of the 2 that were searched" in result.stderr


def test_truth_that_cannot_be_read(row: Path, detections: Path, tmp_path: Path) -> None:
    mask = row / "truth" / "masks" / "east_0.png"
    whole = mask.read_bytes()
    mask.write_bytes(b"no image")
    with pytest.raises(FormatError, match=r"east_0\.png: expected an image of fruit ids \(8 or 16 bits\)"):
        read_detection_truth(row)
    noise = np.random.default_rng(0).integers(0, 256, (200, 300, 3))
    assert cv2.imwrite(str(mask), noise.astype(np.uint8))
    with pytest.raises(FormatError, match=r"found 3\d{3} colours and more: is it a photo\?"):
        read_detection_truth(row)
    mask.write_bytes(whole)
    with pytest.raises(MissingFileError, match="does not exist"):
        read_detection_truth(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"empty: expected labelled photos there .* a COCO file"):
        read_detection_truth(tmp_path / "empty")
    (tmp_path / "fruits.csv").write_text("id,x,y,z,diameter\n1,0,0,2,0.07\n")
    with pytest.raises(InputError, match="expected labels of photos: a COCO file"):
        read_detection_truth(tmp_path / "fruits.csv")
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(FormatError, match="no JSON"):
        read_detection_truth(tmp_path / "bad.json")
    result = pomona(tmp_path / "bad.json", "--truth", row)
    assert (result.exit_code, "no JSON" in result.stderr) == (1, True)


def test_truth_without_masks_and_boxes(tmp_path: Path) -> None:
    image = {"id": 1, "file_name": "a.jpg", "width": WIDTH, "height": HEIGHT}
    content = {"images": [image], "annotations": [{"id": 1, "image_id": 1, "category_id": 1}], "categories": []}
    with pytest.raises(FormatError, match="annotation 1: expected a segmentation or at least a bbox, found neither"):
        read_detection_truth(write_json(tmp_path / "truth.json", content))
    with pytest.raises(FormatError, match="found 1 images and no annotation"):
        read_detection_truth(write_json(tmp_path / "truth.json", content | {"annotations": []}))
    two = [{"id": k, "image_id": 1, "category_id": k, "bbox": [0, 0, 9, 9]} for k in (1, 2)]
    names = [{"id": 1, "name": "apple"}, {"id": 2, "name": "leaf"}]
    with pytest.raises(FormatError, match="expected annotations of one category, found apple, leaf"):
        read_detection_truth(write_json(tmp_path / "truth.json", content | {"annotations": two, "categories": names}))
    twice = content | {"images": [image, image | {"id": 2}], "annotations": two[:1]}
    with pytest.raises(FormatError, match="this photo is given twice"):
        read_detection_truth(write_json(tmp_path / "truth.json", twice))


def test_sizes_that_differ() -> None:
    truth = PhotoTruth("a", HEIGHT, WIDTH, np.array([1]), np.array([[0.0, 0, 20, 20]]))
    with pytest.raises(FormatError, match=r"a: the truth is of 120 × 160 pixels, .* not upright"):
        evaluate_detections({"a": found_of("a", [], [])}, DetectionTruth({"a": truth}))
    with pytest.raises(InputError, match="No photo has both"):
        evaluate_detections({"b": found_of("b", [], [])}, DetectionTruth({"a": truth}))


def test_options_that_cannot_be(row: Path, detections: Path, tmp_path: Path) -> None:
    for wrong in ({"match": "centers"}, {"min_iou": 1.0}, {"min_size_px": -1.0}, {"confidences": ()}):
        with pytest.raises(InputError, match="expected"):
            EvaluateDetectionsOptions(**wrong)  # type: ignore[arg-type]
    assert "expected one of auto, masks, boxes" in pomona(detections, "--truth", row, "--match", "centers").stderr
    result = CliRunner().invoke(app, ["evaluate", str(row), "--truth", str(row), "--pictures", str(tmp_path / "p")])
    assert (result.exit_code, "No truth found" in result.stderr) == (1, True)
    truth = (row / "truth").rename(tmp_path / "truth")
    nowhere = pomona(detections, "--truth", truth, "--pictures", tmp_path / "p")
    assert "say where they are with --photos" in nowhere.stderr
    there = pomona(detections, "--truth", truth, "--pictures", tmp_path / "p", "--photos", row / "images")
    assert there.exit_code == 0, there.stderr


def test_real_row_against_itself(shared_data: Path) -> None:
    """The true masks of two photos, as detections, are perfect."""
    folder = shared_data / "orchard-dev" / "truth" / "masks"
    ids = {p.stem: cv2.imread(str(p), cv2.IMREAD_UNCHANGED) for p in sorted(folder.glob("*.png"))[:2]}
    truth = DetectionTruth({name: truth_from_ids(name, image) for name, image in ids.items()})
    found = {
        name: Detections(name, t.width_px, t.height_px, t.masks or (), np.ones(len(t)), t.ids + 1000 * k)
        for k, (name, t) in enumerate(truth.items())
    }
    scores = evaluate_detections(found, truth, options=EvaluateDetectionsOptions(min_visible_px=120))
    assert 20 < scores.true_fruits < truth.total
    assert (scores.ap, scores.levels[-1].f1, scores.levels[-1].mask_iou) == (1, 1, 1)
