"""Labelled photos of any program, as samples to train on and samples to measure on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from pomona.errors import InputError
from pomona.formats.detections.label_sets import LabelSet, find_label_sets, part_of, read_label_set
from pomona.formats.detections.labelled import LabelledPhoto, classes_of
from pomona.learning.train.label_images import samples_of, typical_fruit_px
from pomona.learning.train.samples import RENDERED, Sample, split
from pomona.progress import Progress, Silent, track
from pomona.stages.capture.images import size_of
from pomona.survey.commands import command_line
from pomona.survey.manifest import MANIFEST

SPLITS = ("folders", "photos")


@dataclass(frozen=True, eq=False)
class _ReadSet:
    """A set that was read: `source` names it, `root` is the folder that was asked for."""

    one: LabelSet
    root: Path
    source: str
    photos: list[LabelledPhoto]


def gather(
    data: Sequence[Path],
    cache: Path,
    held_out: float,
    *,
    classes: Sequence[str] | None = None,
    split_by: str = "folders",
    progress: Progress | None = None,
) -> tuple[list[Sample], list[Sample]]:
    """Return (training, validation) samples of labelled photos; label images are made once, under `cache`.

    Each of `data` is a folder of photos with labels, a folder of such folders, or a label file; the format is found
    from the content (`formats.detections.label_sets`). `classes` names those which are fruit (None: all). Where a
    folder of `data`, or several of them by their names, say what is for training and what for validation,
    `split_by="folders"` does as they say and warns where parts of one photo are on both sides; further parts of those
    photos follow them, held out in doubt. "photos" splits anew, by photo. What is kept for tests is left out. Rendered
    rows are trained on only: what counts is how real fruits are found.

    Raises `MissingFileError`, `FormatError` naming file and place, or `InputError` when a side has no photo.
    """
    progress = progress or Silent()
    if split_by not in SPLITS:
        raise InputError(f"`split_by`: expected {' or '.join(SPLITS)}, found '{split_by}'")
    sets = [one for root in data for one in _read(root, progress)]
    _check_once(sets)
    if classes is not None:
        sets = _of_classes(sets, classes)
    samples = [(one, _samples(one, cache, progress)) for one in sets]
    real = [(one, found) for one, found in samples if not one.one.rendered]
    by_root = {
        root: [sample for one, found in real or samples if one.root == root for sample in found]
        for root in dict.fromkeys(one.root for one, _ in real or samples)
    }
    training, validation, free = _sides(by_root, split_by, progress)
    learnt, held = _split(free, training, validation, held_out, progress)
    training, validation = training + learnt, validation + held
    if real:
        training += [sample for one, found in samples if one.one.rendered for sample in found]
    if not training or not validation:
        raise InputError(
            f"{len(training)} photos to train on and {len(validation)} to measure on: expected some of each; "
            "give photos of more places, since tiles of one photo stay together"
        )
    return training, validation


def _read(root: Path, progress: Progress) -> list[_ReadSet]:
    if (root / MANIFEST).is_file():  # its detections.json is what was found, doubtful and uncorrected
        export = command_line(["pomona", "export", root, "--to", "coco", "--out", "PHOTOS/labels.json"])
        raise InputError(
            f"{root} is a survey: expected labelled photos. `{export}` writes its fruits as labels, where PHOTOS is "
            "the folder of its photos; then give that folder"
        )
    found = []
    for one in track(find_label_sets(root), progress, f"Reading labels in {root.name}"):
        photos = read_label_set(one, size_of)
        source = RENDERED if one.rendered else _source(root, one)
        if one.rendered:  # rows all call their photos the same
            photos = [replace(photo, name=f"{one.folder.name}/{photo.path.name}") for photo in photos]
        bare = sum(1 for photo in photos if not photo.fruits)
        if not one.rendered and 2 * bare > len(photos):
            progress.warn(
                f"{one.files[0] if one.files else one.folder}: {bare} of {len(photos)} photos have no label; they are "
                "taken as photos without fruit: leave them out where nobody has looked at them"
            )
        found.append(_ReadSet(one, root, source, photos))
    return found


def _check_once(sets: Sequence[_ReadSet]) -> None:
    """Raise `InputError` where two sets label the same photo file."""
    places: dict[Path, str] = {}
    for one in sets:
        place = str(one.one.files[0] if one.one.files else one.one.folder)
        for photo in one.photos:
            if (other := places.setdefault(photo.path.resolve(), place)) != place:
                raise InputError(
                    f"{photo.path}: expected labels of one file or folder, found them in {other} and in {place}; "
                    "give the one to use, or move the other away"
                )


def _source(root: Path, one: LabelSet) -> str:
    """The name of a set: its folder below `root`, without what says only which part it is."""
    top = root.parent if root.is_file() else root
    below = one.folder.relative_to(top).parts
    return "/".join([top.resolve().name, *(name for name in below if not part_of(name))])


def _of_classes(sets: Sequence[_ReadSet], classes: Sequence[str]) -> list[_ReadSet]:
    """Keep the fruits of some classes; those of sets that name no classes are all kept."""
    known = {name.casefold(): name for one in sets for name in classes_of(one.photos)}
    if unknown := [name for name in classes if name.casefold() not in known]:
        there = ", ".join(sorted(known.values())) or "none, as the labels name no classes"
        raise InputError(f"`classes`: expected some of those in the labels ({there}), found '{', '.join(unknown)}'")
    wanted = {name.casefold() for name in classes}
    result = []
    for one in sets:
        here = classes_of(one.photos)
        if here and not wanted & {name.casefold() for name in here}:
            raise InputError(
                f"{one.one.folder}: expected fruits of the classes {', '.join(classes)}, found only {', '.join(here)}"
            )
        kept = [
            replace(p, fruits=tuple(f for f in p.fruits if f.category is None or f.category.casefold() in wanted))
            for p in one.photos
        ]
        result.append(replace(one, photos=kept))
    return result


def _samples(one: _ReadSet, cache: Path, progress: Progress) -> list[Sample]:
    fruit_px = typical_fruit_px(one.photos)
    folder = cache / one.source.replace("/", "-")
    return [
        sample
        for photo in track(one.photos, progress, f"Preparing {one.source}")
        for sample in samples_of(
            photo,
            folder,
            source=one.source,
            part=one.one.part or part_of(PurePosixPath(photo.name).parent.as_posix()),
            group=one.one.folder.name if one.one.rendered else None,  # its photos show the same fruits
            fruit_px=fruit_px,
        )
    ]


def _sides(
    by_root: dict[Path, list[Sample]], split_by: str, progress: Progress
) -> tuple[list[Sample], list[Sample], list[Sample]]:
    """Return (training, validation, others): others are those that `data` leave to us to split."""
    training: list[Sample] = []
    validation: list[Sample] = []
    free: list[Sample] = []
    one_sided: dict[Path, list[Sample]] = {}
    for root, samples in by_root.items():
        kept = _without_tests(samples, str(root), progress) if {s.part for s in samples} != {"test"} else samples
        if split_by == "folders" and _has_both_sides(kept):
            learnt, held, rest = _as_said(kept, str(root), progress)
            training, validation, free = training + learnt, validation + held, free + rest
        elif split_by == "folders":
            one_sided[root] = kept
        else:
            free += kept
    together = [  # `train.json val.json`: what each of them is for is said by its own name
        replace(sample, part=sample.part or _part_of_root(root)) for root, kept in one_sided.items() for sample in kept
    ]
    if not _has_both_sides(together):
        return training, validation, free + [sample for kept in one_sided.values() for sample in kept]
    named = ", ".join(str(root) for root in one_sided)
    learnt, held, rest = _as_said(_without_tests(together, named, progress), named, progress)
    return training + learnt, validation + held, free + rest


def _part_of_root(root: Path) -> str:
    """What the name of one of `data` says it is for; of a file, its folder's name too: `valid/labels.json`."""
    return part_of("/".join(root.resolve().parts[-2 if root.is_file() else -1 :]))


def _has_both_sides(samples: Sequence[Sample]) -> bool:
    return {"training", "validation"} <= {sample.part for sample in samples}


def _without_tests(samples: list[Sample], where: str, progress: Progress) -> list[Sample]:
    kept = [sample for sample in samples if sample.part != "test"]
    if len(kept) < len(samples):
        progress.warn(f"{where}: {len(samples) - len(kept)} samples kept there for tests are not used")
    return kept


def _as_said(
    samples: Sequence[Sample], where: str, progress: Progress
) -> tuple[list[Sample], list[Sample], list[Sample]]:
    """Return (training, validation, others) as folders or files say; warn of photos that are on both sides."""
    training, validation, rest = ([s for s in samples if s.part == part] for part in ("training", "validation", ""))
    if both := {s.group for s in training} & {s.group for s in validation}:
        count = sum(1 for s in validation if s.group in both)
        progress.warn(
            f"{where}: {count} of {len(validation)} samples to measure on are of photos of which other parts are "
            "trained on, as its folders say: scores will be too good; split by photo (`split_by` photos) to avoid it"
        )
    return training, validation, rest


def _split(
    free: Sequence[Sample],
    training: Sequence[Sample],
    validation: Sequence[Sample],
    held_out: float,
    progress: Progress,
) -> tuple[list[Sample], list[Sample]]:
    """Return (training, validation) of samples whose side nobody has said: that of other parts of their photo."""
    measured_on = {sample.group for sample in validation}
    trained_on = {sample.group for sample in training} - measured_on
    learnt, held = split([s for s in free if s.group not in measured_on | trained_on], held_out)
    followers = [sample for sample in free if sample.group in measured_on]
    if followers:
        progress.warn(
            f"{len(followers)} samples that no folder says a side of, the first of them {followers[0].image.name}, are "
            "measured on and not trained on, as photos of the same name are for validation; rename them if they are "
            "other photos, or split by photo (`split_by` photos)"
        )
    return learnt + [s for s in free if s.group in trained_on], held + followers
