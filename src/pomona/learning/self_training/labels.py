"""Labels that a survey makes itself: fruits that many photos confirm, in all photos that show them.

Self-training with geometry as the teacher: what is found in enough photos is a fruit in the others, too, where its
place, the second look and the colours of the survey's other fruits agree that it is to be seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pomona.basics.arrays import BoolArray, ByteArray, IntArray
from pomona.errors import DamagedPhotoError
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto
from pomona.fruit.crops.likeness import SeenFruits
from pomona.fruit.geometry.spheres import Spheres
from pomona.fruit.traits.colours import FruitColours
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.learning.marks import MarkedPhoto
from pomona.learning.self_training.colours import COLOURS_PX, disc_of, likely_in, pixels_in_copy, visible_part
from pomona.learning.self_training.marked import SAME_FRUIT, boxes_of, labels_of_marks, overlaps
from pomona.learning.self_training.options import AdaptOptions
from pomona.progress import Progress, Silent, track
from pomona.stages.capture import read_pixels
from pomona.stages.second_look import CentersNetwork, SecondLookOptions
from pomona.stages.second_look.evidence import find_sights, look
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import Fruits, Observations
from pomona.values.photos import Photo, Photos


@dataclass(frozen=True, eq=False)
class FoundFruits:
    """The fruits of one survey, as corrected, and what saw them.

    `detections` are all of the file, weak ones too. `by_hand` are ids of fruits that a person made or moved, and
    `false_ids` detections of which a person said that they are no fruit. `marked` are the photos in which a person
    marked fruits, by name.
    """

    name: str
    photos: Photos
    cameras: Cameras
    detections: SurveyDetections
    fruits: Fruits
    observations: Observations
    by_hand: frozenset[int] = frozenset()
    false_ids: frozenset[int] = frozenset()
    marked: Mapping[str, MarkedPhoto] = field(default_factory=dict)

    def confirmed(self, options: AdaptOptions) -> BoolArray:
        """Say of each fruit (n,) whether many photos, or a person, confirm it."""
        many = (self.fruits.scores >= options.least_score) & (self.fruits.views >= options.least_views)
        return np.asarray(many | np.isin(self.fruits.ids, list(self.by_hand)), bool)


@dataclass(frozen=True, eq=False)
class SurveyLabels:
    """The labelled photos of a survey: of its `confirmed` fruits, `detected` labels were found, `missed` not.

    A person `marked` so many fruits, those in the photos `by_hand` (names as in `photos`); `complete` are those of
    these photos in which all fruits are marked, so that one can measure on them.
    """

    photos: tuple[LabelledPhoto, ...]
    confirmed: int
    detected: int
    missed: int
    marked: int = 0
    by_hand: frozenset[str] = frozenset()
    complete: frozenset[str] = frozenset()


def label_photos(
    found: FoundFruits,
    *,
    options: AdaptOptions | None = None,
    progress: Progress | None = None,
) -> SurveyLabels:
    """Return a survey's photos with its confirmed fruits as labels.

    A detection of a confirmed fruit is a label as it is. Where a photo should show such a fruit and nothing was found,
    it is one if the second look and the colours say that it is to be seen; else its disc is doubtful. Detections of
    anything else are doubtful, but for those of which a person said that they are no fruit. What is left is background.
    In photos in which a person marked all fruits, the marks alone are labels; where some are marked, these are labels
    besides, and what is no label is doubtful. Photos that are not there, or without a camera or marks, are left out;
    so are those that cannot be decoded, with a warning.

    Raises `LostFileError` naming a photo that goes away meanwhile, and `InputError` for marks of photos of another
    size.
    """
    options, progress = options or AdaptOptions(), progress or Silent()
    mine = _Confirmed.of(found, options)
    by_name = found.photos.by_name()
    marked = {name: photo for name, photo in found.marked.items() if name in by_name}
    names = dict.fromkeys([*found.cameras.photos, *marked])
    photos = [by_name[name] for name in names if name in by_name and by_name[name].path.is_file()]
    unreadable: set[str] = set()
    colours = FruitColours.counted(_coloured(found, mine, photos, unreadable, progress))
    photos = [photo for photo in photos if photo.name not in unreadable]
    shown = _shown(mine, found, photos, progress) if len(mine.ids) else {}
    labelled: list[LabelledPhoto] = []
    detected = missed = 0
    for photo in track(photos, progress, "labelling photos"):
        by_hand, fruits = marked.get(photo.name), list[LabelledFruit]()
        if by_hand is None or not by_hand.complete:
            fruits, seen, added = _of_confirmed(found, mine, photo, shown.get(photo.name, {}), colours, options)
            detected, missed = detected + seen, missed + added
        if by_hand is not None:
            marks = labels_of_marks(found.detections.get(photo.name), photo, by_hand, colours, options)
            fruits = list(marks) if by_hand.complete else _with_marks(fruits, marks, photo)
        labelled.append(_labelled(found, photo, fruits))
    there = {photo.name for photo in photos} & marked.keys()
    return SurveyLabels(
        tuple(labelled),
        len(mine.ids),
        detected,
        missed,
        sum(not fruit.ignored for name in there for fruit in marked[name].fruits),
        frozenset(f"{found.name}/{name}" for name in there),
        frozenset(f"{found.name}/{name}" for name in there if marked[name].complete),
    )


def _labelled(found: FoundFruits, photo: Photo, fruits: Sequence[LabelledFruit]) -> LabelledPhoto:
    return LabelledPhoto(photo.path, f"{found.name}/{photo.name}", photo.width_px, photo.height_px, tuple(fruits))


def _with_marks(fruits: Sequence[LabelledFruit], marks: Sequence[LabelledFruit], photo: Photo) -> list[LabelledFruit]:
    """Return the labels of a photo in which some fruits are marked: those of other fruits, too, and doubt elsewhere."""
    whole = LabelledFruit((0.0, 0.0, float(photo.width_px), float(photo.height_px)), None, ignored=True)
    sure = [fruit for fruit in fruits if not fruit.ignored]
    if sure and marks:
        free = overlaps(boxes_of(sure), boxes_of(marks)).max(1) < SAME_FRUIT
        sure = [fruit for fruit, is_free in zip(sure, free.tolist(), strict=True) if is_free]
    return [whole, *sure, *marks]


@dataclass(frozen=True, eq=False)
class _Confirmed:
    """The confirmed fruits (m,), where they were `seen` (photo and index of the fruit), and of which fruit, by photo
    and id, a detection is."""

    ids: IntArray
    spheres: Spheres
    seen: tuple[tuple[str, int], ...]
    fruit_of: dict[tuple[str, int], int]

    @classmethod
    def of(cls, found: FoundFruits, options: AdaptOptions) -> _Confirmed:
        fruits = found.fruits
        sure = np.flatnonzero(found.confirmed(options))
        radius_m = size_of_fruits(fruits.diameters_m, FruitSize()).radius_m
        spheres = Spheres.of_fruits(fruits.centers_in_world[sure], fruits.diameters_m[sure], radius_m)
        place = {int(fruit_id): k for k, fruit_id in enumerate(fruits.ids[sure].tolist())}
        seen = found.observations
        triples = list(zip(seen.photo, seen.detection_id.tolist(), seen.fruit_id.tolist(), strict=True))
        mine = [(photo, detection, fruit) for photo, detection, fruit in triples if fruit in place]
        return cls(
            fruits.ids[sure],
            spheres,
            tuple((photo, place[fruit]) for photo, _, fruit in mine),
            {(photo, detection): fruit for photo, detection, fruit in mine},
        )


@dataclass(frozen=True)
class _Sight:
    """The image of a confirmed fruit in a photo that should show it, and how plainly its centre is seen there."""

    circle_px: tuple[float, float, float]
    shown: float


def _shown(
    mine: _Confirmed,
    found: FoundFruits,
    photos: Sequence[Photo],
    progress: Progress,
) -> dict[str, dict[int, _Sight]]:
    """Return for each photo, by name, the confirmed fruits, by id, that it should show."""
    cameras, options = found.cameras, SecondLookOptions()
    idx_of = {name: k for k, name in enumerate(cameras.photos)}
    seen = [(fruit, idx_of[photo]) for photo, fruit in mine.seen if photo in idx_of]
    sphere_idx, photo_idx = np.array(seen, np.int64).reshape(-1, 2).T
    sights = find_sights(mine.spheres, sphere_idx, photo_idx, cameras, options)
    # A photo that was marked may have no place: what it should show is not known.
    wanted = [idx_of[photo.name] for photo in photos if photo.name in idx_of]
    sights = sights[np.isin(sights.photo_idx, wanted)]
    detection_ids = np.array(sorted({detection_id for _, detection_id in mine.fruit_of}), np.int64)
    of_fruits = SeenFruits(found.detections, detection_ids)
    evidence = look(sights, of_fruits, Photos(tuple(photos)), cameras, CentersNetwork(), progress)
    middle = np.array(evidence.maps.shape[1:]) // 2
    plain = evidence.maps[:, middle[0] - 1 : middle[0] + 1, middle[1] - 1 : middle[1] + 1].max((1, 2), initial=0)
    result: dict[str, dict[int, _Sight]] = {}
    sights = evidence.sights
    for k, (sphere, photo) in enumerate(zip(sights.sphere_idx.tolist(), sights.photo_idx.tolist(), strict=True)):
        x, y = sights.centers_px[k].tolist()
        sight = _Sight((x, y, float(sights.radii_px[k])), float(plain[k]))
        result.setdefault(cameras.photos[photo], {})[int(mine.ids[sphere])] = sight
    return result


def _coloured(
    found: FoundFruits, mine: _Confirmed, photos: Sequence[Photo], unreadable: set[str], progress: Progress
) -> Iterator[tuple[ByteArray, BoolArray, BoolArray]]:
    """Yield of each photo, made smaller, its pixels, those on confirmed fruits, and those where nothing was found.

    Names of photos that cannot be decoded are put into `unreadable`, with a warning.
    """
    for photo in photos:
        try:
            pixels = read_pixels(photo, max_side_px=COLOURS_PX)
        except DamagedPhotoError as error:
            progress.warn(f"{photo.name} is not learnt from: {error.reason}")
            unreadable.add(photo.name)
            continue
        fruit, anything = np.zeros(pixels.shape[:2], bool), np.zeros(pixels.shape[:2], bool)
        detections = found.detections.get(photo.name)
        for detection_id, mask in zip(detections.ids.tolist(), detections.masks, strict=True) if detections else ():
            rows, columns = pixels_in_copy(mask, photo, pixels.shape[:2])
            anything[rows, columns] = True
            if (photo.name, detection_id) in mine.fruit_of:
                fruit[rows, columns] = True
        yield pixels, fruit, ~anything


def _of_confirmed(
    found: FoundFruits,
    mine: _Confirmed,
    photo: Photo,
    shown: Mapping[int, _Sight],
    colours: FruitColours,
    options: AdaptOptions,
) -> tuple[list[LabelledFruit], int, int]:
    """Return a photo's labels by what is confirmed, how many of these were found there, and how many were added.

    `shown` are the confirmed fruits that it should show, by id.
    """
    fruits = _of_detections(found, mine, photo)
    seen = {fruit.id for fruit in fruits if not fruit.ignored}
    unseen = [sight for fruit_id, sight in shown.items() if fruit_id not in seen]
    added = _of_unseen(photo, unseen, colours, options) if unseen else []
    circles = {fruit_id: sight.circle_px for fruit_id, sight in shown.items()}
    fruits = [replace(f, circle_px=circles[f.id]) if f.id in circles else f for f in fruits]
    return [*fruits, *added], len(seen), sum(not fruit.ignored for fruit in added)


def _of_detections(found: FoundFruits, mine: _Confirmed, photo: Photo) -> list[LabelledFruit]:
    """Return the detections of a photo: of confirmed fruits with these as `id`, of anything else as ignored."""
    detections = found.detections.get(photo.name)
    labels = []
    for detection_id, mask in zip(detections.ids.tolist(), detections.masks, strict=True) if detections else ():
        if detection_id in found.false_ids:
            continue
        fruit_id = mine.fruit_of.get((photo.name, detection_id))
        labels.append(replace(LabelledFruit.from_mask(mask), id=fruit_id, ignored=fruit_id is None))
    return labels


def _of_unseen(
    photo: Photo, sights: Sequence[_Sight], colours: FruitColours, options: AdaptOptions
) -> list[LabelledFruit]:
    """Return labels of confirmed fruits that a photo should show and in which nothing was found.

    The disc of each is doubtful; where it is plainly there, what has its colours is a fruit.
    """
    likely = likely_in(photo, colours, options.colour_nats)
    labels = []
    for sight in sights:
        disc = disc_of(sight.circle_px, photo)
        if disc is None:
            continue
        labels.append(replace(LabelledFruit.from_mask(disc), ignored=True))
        visible = None if sight.shown < options.least_shown else visible_part(disc, photo, likely, options.least_share)
        if visible is not None:
            labels.append(replace(LabelledFruit.from_mask(visible), circle_px=sight.circle_px))
    return labels
