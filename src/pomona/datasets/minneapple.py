"""MinneApple: apples in photos of orchards, `detection/{train,test}/{images,masks}`; masks are images of fruit ids.

Source of the layout: github.com/nicolaihaeni/MinneApple, data/apple_dataset.py.
"""

from __future__ import annotations

from pathlib import Path

from pomona.datasets.pictures import read_labels, segment_pictures
from pomona.datasets.published import MINNEAPPLE
from pomona.datasets.values import BenchmarkResult, ComparedTable, Figure
from pomona.errors import InputError, MissingFileError
from pomona.evaluate.detections import EvaluateDetectionsOptions, evaluate_detections, truth_of_labelled
from pomona.formats.detections.label_sets import LabelSet
from pomona.progress import Progress

NAME = "MinneApple"
# All are scored, as by COCO's evaluation: photos are small, and so are apples in them.
_BY_BOXES = EvaluateDetectionsOptions(match="boxes", min_size_px=0)
_BY_MASKS = EvaluateDetectionsOptions(match="masks", min_size_px=0)


def benchmark_minneapple(root: Path, *, model: str | None, progress: Progress) -> BenchmarkResult:
    """Return AP of the photos that have masks: those of `test` where there are some, else those of `train`.

    Raises `MissingFileError`, `InputError` where there are no masks, and `FormatError` for files that are broken.
    """
    folder = _folder(root)
    labelled = read_labels(LabelSet("masks", folder))
    found = segment_pictures(labelled, model=model, progress=progress)
    truth = truth_of_labelled(labelled)
    boxes = evaluate_detections(found, truth, options=_BY_BOXES, progress=progress)
    masks = evaluate_detections(found, truth, options=_BY_MASKS, progress=progress)
    printed = MINNEAPPLE.figures
    figures = (
        Figure("AP (IoU 0.50 to 0.95)", {"by boxes": boxes.ap, "by masks": masks.ap}, printed["AP (IoU 0.50 to 0.95)"]),
        Figure("AP50", {"by boxes": boxes.ap50, "by masks": masks.ap50}, printed["AP50"]),
        Figure("best F1 (IoU > 0.5)", {n: s.best.f1 for n, s in (("by boxes", boxes), ("by masks", masks)) if s.best}),
    )
    notes = [f"{boxes.true_fruits} apples on {len(labelled)} photos of {folder.relative_to(root).as_posix()}"]
    if folder.name != "test":
        notes.append("the printed figures are of the test photos, whose masks are not among those published")
    table = ComparedTable("Apple detection", figures, MINNEAPPLE.source, tuple(notes))
    return BenchmarkResult(NAME, (f"photos and masks in {folder.relative_to(root).as_posix()}",), (table,))


def _folder(root: Path) -> Path:
    """The folder with `images/` and `masks/`."""
    if not root.is_dir():
        raise MissingFileError(f"{root}: expected the folder of the unpacked MinneApple dataset, but there is none")
    folders = [path.parent for path in sorted(root.rglob("masks")) if (path.parent / "images").is_dir()]
    if (root / "masks").is_dir() and root not in folders:
        folders = [root, *folders]
    if not folders:
        raise InputError(f"{root}: expected detection/train with the folders images and masks, found none such")
    return min(folders, key=lambda folder: (folder.name != "test", folder.as_posix()))
