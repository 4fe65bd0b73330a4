"""Fruits that a person marked in photos: kept, labels to learn from, and photos to measure on."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import pomona
from pomona.browser.app.contract import GivenMarks, MarkView
from pomona.browser.app.teaching import keep_marks, marked_view, teaching
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto
from pomona.fruit.traits.colours import FruitColours
from pomona.learning.marks import MarkedPhoto, read_marks, write_marks
from pomona.learning.self_training.labels import FoundFruits, label_photos
from pomona.learning.self_training.learnt import Learnt, read_learnt, taught, write_learnt
from pomona.learning.self_training.marked import detections_of_marks, labels_of_marks
from pomona.learning.self_training.options import AdaptOptions
from pomona.learning.self_training.rerun import found_fruits
from pomona.progress import Silent
from pomona.survey import SurveyFolder
from pomona.survey.digest import file_digest
from pomona.values.detections import Detections, Mask
from pomona.values.photos import Photo
from view_scenes import write_view_survey

OPTIONS = AdaptOptions(least_score=0.5, least_views=2)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> FoundFruits:
    return found_fruits(pomona.open(write_view_survey(tmp_path_factory.mktemp("marks"))))


def marked(found: FoundFruits, name: str, *, count: int | None = None, complete: bool) -> MarkedPhoto:
    """Boxes drawn roughly around the first detections of a photo, and a circle where nothing was found."""
    detections = found.detections[name]
    assert detections.boxes_px is not None
    boxes = [tuple(map(float, box)) for box in detections.boxes_px[:count]]
    fruits = [LabelledFruit((x0 - 1, y0, x1, y1 + 2), None) for x0, y0, x1, y1 in boxes]
    fruits.append(LabelledFruit((2.0, 2.0, 32.0, 32.0), None, circle_px=(17.0, 17.0, 15.0)))
    return MarkedPhoto(name, detections.width_px, detections.height_px, tuple(fruits), complete)


def fullest(found: FoundFruits) -> str:
    return max(found.cameras.photos, key=lambda name: len(found.detections[name].ids))


def test_marks_are_read_as_they_were_written(tmp_path: Path) -> None:
    assert read_marks(tmp_path / "marks.json") == {}
    box, circle = (3.0, 4.0, 20.5, 24.0), (10.0, 12.0, 9.5)
    photos = [
        MarkedPhoto("east/a.jpg", 100, 80, (LabelledFruit(box, None), LabelledFruit(box, None, circle_px=circle))),
        MarkedPhoto("east/b.jpg", 100, 80, (), complete=True),
        MarkedPhoto("east/c.jpg", 100, 80, ()),
    ]

    write_marks(tmp_path / "marks.json", photos)

    read = read_marks(tmp_path / "marks.json")
    assert {name: (photo.complete, len(photo.fruits)) for name, photo in read.items()} == {
        "east/a.jpg": (False, 2),
        "east/b.jpg": (True, 0),
    }
    assert [(fruit.box_px, fruit.mask, fruit.circle_px) for fruit in read["east/a.jpg"].fruits] == [
        (box, None, None),
        (box, None, circle),
    ]


def test_labels_of_other_programs_are_marks_of_all_fruits(tmp_path: Path) -> None:
    image = {"id": 7, "file_name": "a.jpg", "width": 100, "height": 80}
    square = [10, 10, 30, 10, 30, 30, 10, 30]
    fruit = {"id": 1, "image_id": 7, "category_id": 1, "segmentation": [square], "bbox": [10, 10, 20, 20]}
    content = {"images": [image], "annotations": [fruit], "categories": [{"id": 1, "name": "apple"}]}
    path = tmp_path / "marks.json"
    path.write_text(json.dumps(content))

    (photo,) = read_marks(path).values()

    assert photo.complete
    (only,) = photo.fruits
    assert only.mask is not None
    assert only.mask.area_px == 400
    write_marks(path, [photo])
    (kept,) = read_marks(path)["a.jpg"].fruits
    assert kept.mask is not None
    assert kept.mask.area_px == kept.mask.intersection_px(only.mask) == 400
    assert kept.box_px == only.box_px
    path.write_text(json.dumps({**content, "annotations": [{**fruit, "circle_px": [1, 2]}]}))
    with pytest.raises(FormatError, match=r"annotation 1: circle_px: expected x, y, radius, found \[1, 2\]"):
        read_marks(path)


def test_marks_of_labelling_programs_are_of_the_photos_that_they_mean(tmp_path: Path) -> None:
    survey = pomona.open(write_view_survey(tmp_path))
    survey.files.note(photos=[{"name": photo.name, "digest": file_digest(photo.path)} for photo in survey.photos])
    photo, other = survey.photos.items[:2]
    box = LabelledFruit((5.0, 5.0, 25.0, 25.0), None)
    size = photo.width_px, photo.height_px
    named = [f"upload/{Path(photo.name).with_suffix('.png')}", "elsewhere.jpg"]
    write_marks(survey.files.marks, [MarkedPhoto(name, *size, (box, box), complete=True) for name in named])
    progress = Silent()

    found = found_fruits(pomona.open(survey.folder, progress=progress))

    assert set(found.marked) == {photo.name, "elsewhere.jpg"}
    assert label_photos(found, options=OPTIONS).marked == 2
    (warning,) = progress.warnings
    assert warning.endswith("marks of photos that the survey does not have were left out: elsewhere.jpg")
    assert (len(marked_view(survey.files, 0).marks), marked_view(survey.files, 0).complete) == (2, True)
    keep_marks(survey.files, 1, GivenMarks(complete=False, marks=[MarkView([5.0, 5.0, 25.0, 25.0], None)]))
    assert {name: len(each.fruits) for name, each in read_marks(survey.files.marks).items()} == {
        photo.name: 2, "elsewhere.jpg": 2, other.name: 1
    }  # fmt: skip
    write_marks(survey.files.marks, [MarkedPhoto(Path(photo.name).name, *size, (box,))])
    with pytest.raises(FormatError, match=r"marks\.json: 'IMG_0000.JPG' fits several photos, east/.*, west/"):
        found_fruits(survey)


def test_where_all_fruits_are_marked_the_marks_alone_are_labels(found: FoundFruits) -> None:
    name = fullest(found)
    by_hand = marked(found, name, count=3, complete=True)

    labels = label_photos(replace(found, marked={name: by_hand}), options=OPTIONS)

    (photo,) = [photo for photo in labels.photos if photo.name.endswith(f"/{name}")]
    assert [fruit.mask for fruit in photo.fruits] == [*found.detections[name].masks[:3], None]
    assert all(fruit.mask is None or fruit.box_px == fruit.mask.box_px for fruit in photo.fruits)
    assert not any(fruit.ignored for fruit in photo.fruits)
    assert labels.marked == 4
    assert labels.by_hand == labels.complete == {photo.name}


def test_where_some_fruits_are_marked_all_else_is_doubtful(found: FoundFruits) -> None:
    name = fullest(found)
    by_hand = marked(found, name, count=2, complete=False)

    labels = label_photos(replace(found, marked={name: by_hand}), options=OPTIONS)

    (photo,) = [photo for photo in labels.photos if photo.name.endswith(f"/{name}")]
    whole, *fruits = photo.fruits
    assert whole.ignored
    assert whole.box_px == (0, 0, photo.width_px, photo.height_px)
    # Fruits that were found and confirmed stay labels; those that were marked as well are one label each.
    assert sorted(fruit.box_px for fruit in fruits if fruit.mask is not None) == sorted(
        tuple(map(float, mask.box_px)) for mask in found.detections[name].masks
    )
    assert sum(fruit.mask is None for fruit in fruits) == 1
    assert labels.complete == frozenset()


@pytest.mark.parametrize("complete", [True, False])
def test_a_photo_without_a_place_can_be_marked(found: FoundFruits, complete: bool) -> None:
    name = fullest(found)
    by_hand = marked(found, name, count=2, complete=complete)
    others = [photo for photo in found.cameras.photos if photo != name]

    labels = label_photos(
        replace(found, cameras=found.cameras.of_photos(others), marked={name: by_hand}), options=OPTIONS
    )

    assert labels.by_hand == {f"{found.name}/{name}"}
    assert labels.marked == 3
    assert len(labels.photos) == len(others) + 1


def test_marks_of_another_photo_are_refused(found: FoundFruits) -> None:
    name = fullest(found)
    other = replace(marked(found, name, complete=True), width_px=10)
    with pytest.raises(InputError, match="expected the size of"):
        label_photos(replace(found, marked={name: other}), options=OPTIONS)


@pytest.mark.slow
def test_some_photos_marked_in_full_are_measured_on(found: FoundFruits, tmp_path: Path) -> None:
    learn = pytest.importorskip("pomona.learning.self_training.learn")
    names = sorted(found.cameras.photos)[:4]
    by_hand = {name: marked(found, name, complete=name != names[3]) for name in names}
    quick = replace(OPTIONS, steps=1, batch=1, held_out=0.5, shares=(1.0,), threads=1)

    outcome = learn.adapt([replace(found, marked=by_hand)], tmp_path / "mine.onnx", options=quick)

    assert outcome.marked == sum(len(photo.fruits) for photo in by_hand.values())
    assert outcome.by_hand is not None
    assert [scores.fruits for scores in outcome.by_hand] == [len(by_hand[names[1]].fruits)] * 2
    assert all(0.3 < scores.f1 <= 1 for scores in outcome.by_hand)
    split = json.loads((tmp_path / "mine.training" / "split.json").read_text())
    held = {name for name in names if any(entry.endswith(name) for entry in split["validation"])}
    assert held == {names[1]}


def test_too_few_marks_are_refused_with_what_to_do(found: FoundFruits, tmp_path: Path) -> None:
    learn = pytest.importorskip("pomona.learning.self_training.learn")
    name = fullest(found)
    few = replace(found, marked={name: marked(found, name, count=2, complete=True)})
    with pytest.raises(InputError, match=r"0 fruits are confirmed .* and 3 marked in photos, expected 10 .*mark some"):
        learn.adapt([few], tmp_path / "mine.onnx", options=replace(OPTIONS, least_score=0.9999))


def test_what_was_learnt_is_kept_with_what_it_was_taught(tmp_path: Path) -> None:
    survey = SurveyFolder.create(tmp_path / "row")
    assert read_learnt(survey) is None
    nothing = taught(survey)
    write_marks(survey.marks, [MarkedPhoto("a.jpg", 100, 80, (), complete=True)])
    assert taught(survey) != nothing

    learnt = Learnt(True, taught(survey), 12, (0.8, 0.9), 5, (float("nan"), 0.7), (0.8, 0.85), (50, 52), (300, 310))
    write_learnt(survey, learnt)

    assert read_learnt(survey) == replace(learnt, by_hand_f1=(None, 0.7))
    view = teaching(survey, None)
    assert view.learnt is not None
    assert (view.learnt.f1, view.learnt.by_hand_f1, view.learnt.fruits) == ([0.8, 0.9], [0.7], [50, 52])
    survey.learnt.write_text("{")
    with pytest.raises(FormatError, match=r"learnt\.json"):
        read_learnt(survey)


def test_the_page_keeps_marks_photo_by_photo(tmp_path: Path) -> None:
    survey = pomona.open(write_view_survey(tmp_path)).files
    survey.note(photos=[{"name": p.name, "digest": "1"} for p in pomona.open(survey.folder).photos])
    first = marked_view(survey, 0)
    assert (first.marks, first.complete) == ([], False)
    assert len(first.found) == 4 * len(pomona.open(survey.folder).detections[first.name].ids)
    box, circle = MarkView([-5.0, 10.0, 40.0, 50.0], None), MarkView([60.0, 60.0, 90.0, 90.0], [75.0, 75.0, 15.0])

    keep_marks(survey, 0, GivenMarks(complete=False, marks=[box, circle]))
    keep_marks(survey, 1, GivenMarks(complete=True, marks=[]))

    assert marked_view(survey, 0).marks == [MarkView([0.0, 10.0, 40.0, 50.0], None), circle]
    assert [(count.marks, count.complete) for count in teaching(survey, None).marks] == [(2, False), (0, True)]
    for wrong in (MarkView([0.0, 0.0, 1.0, 1.0], None), MarkView([0.0, 0.0, 9.0], None), MarkView([0, 0, 9, 9], [1.0])):
        with pytest.raises(InputError, match="A mark: expected"):
            keep_marks(survey, 0, GivenMarks(complete=False, marks=[wrong]))
    with pytest.raises(MissingFileError):
        keep_marks(survey, 10_000, GivenMarks(complete=False, marks=[]))
    assert len(marked_view(survey, 0).marks) == 2
    assert np.allclose(np.array(first.found), np.array(marked_view(survey, 0).found))


def square(x: int, y: int, width: int, height: int) -> Mask:
    return Mask.from_pixels(np.ones((height, width), bool), x, y)


def circle(x: float, y: float, radius: float) -> LabelledFruit:
    return LabelledFruit((x - radius, y - radius, x + radius, y + radius), None, circle_px=(x, y, radius))


def test_a_circle_is_of_the_detection_that_shows_a_part_of_its_fruit() -> None:
    """Boxes alone would not say so: what leaves let see is a third of the fruit."""
    half_hidden, beside = square(40, 40, 10, 16), square(75, 40, 30, 30)
    marks = [circle(48, 48, 12), circle(90, 55, 16), circle(200, 200, 10)]
    assert detections_of_marks(marks, [half_hidden, beside]).tolist() == [0, 1, -1]
    # One detection is of one mark, that whose disc it fills more; one that reaches over two fruits is of neither.
    assert detections_of_marks([circle(48, 48, 12), circle(48, 50, 20)], [half_hidden]).tolist() == [0, -1]
    assert detections_of_marks([circle(30, 50, 10), circle(50, 50, 10)], [square(20, 42, 40, 16)]).tolist() == [-1, -1]
    boxes = [LabelledFruit((74.0, 39.0, 106.0, 71.0), None), LabelledFruit((0.0, 0.0, 60.0, 60.0), None)]
    assert detections_of_marks(boxes, [half_hidden, beside]).tolist() == [1, -1]
    assert detections_of_marks([], [beside]).tolist() == []


def test_a_missed_fruit_is_learnt_as_far_as_its_colours_show(tmp_path: Path) -> None:
    pixels = np.full((120, 160, 3), (40, 90, 30), np.uint8)
    pixels[40:80, 60:80] = (200, 30, 20)  # the right half of the fruit is behind a leaf
    pixels[40:80, 20:50] = (200, 30, 20)  # another fruit, which was found
    Image.fromarray(pixels).save(tmp_path / "a.png")
    photo = Photo("a.png", tmp_path / "a.png", 160, 120)
    neighbour = square(20, 40, 30, 40)
    fruit = np.zeros(pixels.shape[:2], bool)
    fruit[40:80, 20:50] = True
    colours = FruitColours.counted([(pixels, fruit, pixels[:, :, 0] < 100)])
    marks = MarkedPhoto("a.png", 160, 120, (circle(35, 60, 22), circle(80, 60, 20), circle(140, 100, 12)), True)
    found = Detections("a.png", 160, 120, (neighbour,), np.ones(1), np.array([3]))

    first, missed, unseen = labels_of_marks(found, photo, marks, colours, AdaptOptions())

    assert first.mask is neighbour
    assert missed.circle_px == (80, 60, 20)
    assert missed.mask is not None
    x0, _, x1, _ = missed.box_px
    assert 59 <= x0 <= 62
    assert 79 <= x1 <= 82
    assert 0.3 < missed.mask.area_px / (np.pi * 20**2) < 0.6
    # Nothing there has fruit's colours: the person's circle is all that is known.
    assert (unseen.mask, unseen.box_px) == (None, (128, 88, 152, 112))


def test_a_marked_fruit_of_few_pixels_is_learnt_all_the_same(tmp_path: Path) -> None:
    """Of a rendered fruit so little would be doubtful; a person has seen this one."""
    Image.fromarray(np.full((60, 80, 3), (40, 90, 30), np.uint8)).save(tmp_path / "a.png")
    photo, tiny = Photo("a.png", tmp_path / "a.png", 80, 60), square(40, 20, 5, 5)
    marks = MarkedPhoto("a.png", 80, 60, (circle(42.5, 22.5, 3),), True)
    found = Detections("a.png", 80, 60, (tiny,), np.ones(1), np.array([0]))
    colours = FruitColours.counted([])

    (label,) = labels_of_marks(found, photo, marks, colours, AdaptOptions())

    assert (label.mask, label.box_px) == (None, (40, 20, 45, 25))
    samples_of = pytest.importorskip("pomona.learning.train.label_images").samples_of
    (sample,) = samples_of(LabelledPhoto(photo.path, "a.png", 80, 60, (label,)), tmp_path / "cache", source="marked")
    assert sample.boxes_px.tolist() == [[40, 20, 45, 25]]
