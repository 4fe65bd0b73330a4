"""WGISD: clusters of wine grapes in photos of vineyards, with boxes, and of 137 photos with masks.

The layout (README of github.com/thsant/wgisd): `data/NAME.jpg`, `data/NAME.txt` (YOLO boxes), `data/NAME.npz` (one
array (h, w, n) of masks, the i-th of the i-th box); `test.txt` and `test_masked.txt` name the photos of the test set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pomona.basics.arrays import Array
from pomona.datasets.pictures import read_labels, segment_pictures
from pomona.datasets.published import WGISD
from pomona.datasets.values import BenchmarkResult, ComparedTable, Figure
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.evaluate.detections import (
    DetectionScores,
    EvaluateDetectionsOptions,
    evaluate_detections,
    truth_of_labelled,
)
from pomona.formats.detections.label_sets import LabelSet
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto
from pomona.formats.npz import read_npz
from pomona.progress import Progress
from pomona.values.detections import Mask

NAME = "WGISD"
_LISTS = {"masks": "test_masked.txt", "boxes": "test.txt"}


def benchmark_wgisd(root: Path, *, model: str | None, progress: Progress) -> BenchmarkResult:
    """Return the scores on the test photos: by boxes on all of them, by masks on those that have masks.

    Raises `MissingFileError`, `InputError` where nothing of the dataset is there, and `FormatError` naming the file.
    """
    if not (root / "data").is_dir():
        raise MissingFileError(f"{root}: expected the folder data of the WGISD dataset, but there is none")
    photos = {Path(photo.name).stem: photo for photo in read_labels(LabelSet("yolo", root / "data"))}
    tables: list[ComparedTable] = []
    missing: dict[str, str] = {}
    for match, name in _LISTS.items():
        if not (root / name).is_file():
            missing[f"Scores by {match}"] = f"{name} is not there, which names the photos"
            continue
        chosen = [photos[stem] for stem in _stems(root / name, photos)]
        if match == "masks":
            chosen = [with_masks(photo) for photo in chosen]
        options = EvaluateDetectionsOptions(match=match)  # type: ignore[arg-type]
        found = segment_pictures(chosen, model=model, progress=progress)
        scores = evaluate_detections(found, truth_of_labelled(chosen), options=options, progress=progress)
        tables.append(_table(match, name, scores, len(chosen)))
    if not tables:
        raise InputError(f"{root}: expected {' or '.join(_LISTS.values())} beside data, found neither")
    return BenchmarkResult(NAME, (f"{len(photos)} photos with boxes in data",), tuple(tables), missing)


def with_masks(photo: LabelledPhoto) -> LabelledPhoto:
    """Return a photo whose fruits have the masks of the `.npz` beside it.

    Raises `MissingFileError`, and `FormatError` where it holds something else than a mask for each box.
    """
    path = photo.path.with_suffix(".npz")
    masks = _read_masks(path)
    expected = (photo.height_px, photo.width_px, len(photo.fruits))
    if masks.shape != expected:
        raise FormatError(
            f"{path}: expected masks of {expected[0]} × {expected[1]} pixels for the {expected[2]} boxes of "
            f"{photo.path.with_suffix('.txt').name}, found an array of {' × '.join(map(str, masks.shape))}"
        )
    fruits = [_fruit(path, masks[:, :, k].astype(bool), k) for k in range(masks.shape[2])]
    return replace(photo, fruits=tuple(fruits))


def _fruit(path: Path, pixels: Array, number: int) -> LabelledFruit:
    if not pixels.any():
        raise FormatError(f"{path}: mask {number}: expected the pixels of a cluster, found none")
    return LabelledFruit.from_mask(Mask.from_pixels(pixels))


def _read_masks(path: Path) -> Array:
    arrays = read_npz(path, f"NumPy's masks of {path.stem}")
    if len(arrays) != 1:
        raise FormatError(f"{path}: expected one array of masks, found {', '.join(arrays) or 'none'}")
    return next(iter(arrays.values()))


def _stems(file: Path, photos: dict[str, LabelledPhoto]) -> Sequence[str]:
    lines = [line.strip() for line in file.read_text(encoding="utf-8-sig").splitlines()]
    named = [(number, Path(line).stem) for number, line in enumerate(lines, start=1) if line]
    for number, stem in named:
        if stem not in photos:
            raise MissingFileError(f"{file}, line {number}: photo '{stem}' is not among those with boxes in data")
    if not named:
        raise FormatError(f"{file}: expected the names of photos, a line each, found an empty file")
    return [stem for _, stem in named]


def _table(match: str, name: str, scores: DetectionScores, photos: int) -> ComparedTable:
    best = scores.best
    figures = [Figure("AP (IoU 0.50 to 0.95)", {"Pomona": scores.ap}), Figure("AP50", {"Pomona": scores.ap50})]
    printed = WGISD.figures["best F1"] if match == "masks" else None
    figures.append(Figure("best F1 (IoU > 0.5)", {"Pomona": best.f1 if best else float("nan")}, printed))
    notes = (f"{scores.true_fruits} clusters on the {photos} photos of {name}",)
    return ComparedTable(f"Clusters by {match}", tuple(figures), WGISD.source if match == "masks" else "", notes)
