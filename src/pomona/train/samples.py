"""What the network learns from: photos with a box and a label image each, from COCO boxes or rendered rows."""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from pomona.arrays import ByteArray, FloatArray
from pomona.detections import Mask
from pomona.errors import FormatError, MissingFileError
from pomona.formats.coco_file import parse_coco
from pomona.train.weak_masks import label_image_from_boxes

Labels = npt.NDArray[np.int16]
"""A label image (h, w): 0 is not fruit, k ≥ 1 is the k-th fruit, −1 is doubtful and teaches nothing."""

IGNORED = -1
_FEWEST_PIXELS = 30  # a fruit of which less is seen is doubtful


@dataclass(frozen=True)
class Sample:
    """A photo on disk with its fruits; `group` names the photo that a tile was cut from, so that splits respect it.
    `weak`: its masks were made from boxes.

    `boxes_px` (n, 4) x0, y0, x1, y1; `labels` is a PNG of int16 stored as uint16 with −1 as 65535.
    """

    image: Path
    labels: Path
    boxes_px: FloatArray
    group: str
    source: str
    weak: bool = False

    def pixels(self) -> ByteArray:
        """Read the photo, uint8 (h, w, 3) RGB."""
        bgr = cv2.imread(str(self.image), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        if bgr is None:
            raise FormatError(f"{self.image}: expected a photo that can be read")
        return np.ascontiguousarray(bgr[:, :, ::-1])

    def label_image(self) -> Labels:
        """Read the label image, int16 (h, w)."""
        stored = cv2.imread(str(self.labels), cv2.IMREAD_UNCHANGED)
        if stored is None:
            raise FormatError(f"{self.labels}: expected a label image that can be read")
        return np.asarray(stored).view(np.int16)


def samples_from_coco(coco: Path, images: Path, cache: Path) -> list[Sample]:
    """Return the samples of a COCO file; where it has boxes alone, masks are made once, with GrabCut, under `cache`."""
    file = parse_coco(coco)
    samples = []
    for entry in file.images:
        fruits = [a for a in file.annotations if a.image_id == entry.id and a.box_px and not a.crowd]
        boxes = np.array([a.box_px for a in fruits], float).reshape(-1, 4)
        image = images / entry.file_name
        if not image.is_file():
            raise MissingFileError(f"{image}: named in {coco}, but there is no such file")
        labels = cache / coco.parent.name / f"{image.stem}.png"
        weak = any(a.from_box for a in fruits)
        sample = Sample(image, labels, boxes, group_of(image.stem), coco.parent.name, weak)
        if not labels.is_file():
            labels.parent.mkdir(parents=True, exist_ok=True)
            if weak:
                made = label_image_from_boxes(sample.pixels(), boxes)
            else:
                made = _labels_from_masks([a.mask for a in fruits], entry.width_px, entry.height_px)
            _write(labels, made)
        samples.append(sample)
    return samples


def _labels_from_masks(masks: Sequence[Mask | None], width_px: int, height_px: int) -> Labels:
    labels = np.zeros((height_px, width_px), np.int16)
    for k, mask in enumerate(masks, start=1):
        if mask is not None:
            x0, y0, x1, y1 = mask.box_px
            labels[y0:y1, x0:x1][mask.pixels] = k
    return labels


def samples_from_row(row: Path, cache: Path) -> list[Sample]:
    """Return the samples of a rendered row's folder: its masks are exact; fruits hardly seen are doubtful."""
    samples = []
    for mask in sorted((row / "truth" / "masks").glob("*.png")):
        ids = cv2.imread(str(mask), cv2.IMREAD_UNCHANGED)
        if ids is None:
            raise FormatError(f"{mask}: expected an image of fruit ids that can be read")
        labels = cache / row.name / mask.name
        labels.parent.mkdir(parents=True, exist_ok=True)
        image, boxes = labels_from_ids(ids)
        _write(labels, image)
        samples.append(Sample(row / "images" / f"{mask.stem}.jpg", labels, boxes, row.name, "rendered"))
    return samples


def labels_from_ids(ids: npt.NDArray[np.uint16]) -> tuple[Labels, FloatArray]:
    """Return labels 1 … n and boxes (n, 4) from an image of fruit ids (0: none)."""
    found, inverse, counts = np.unique(ids, return_inverse=True, return_counts=True)
    new = np.zeros(len(found), np.int16)
    kept = (found > 0) & (counts >= _FEWEST_PIXELS)
    new[kept] = np.arange(1, kept.sum() + 1)
    new[(found > 0) & ~kept] = IGNORED
    labels = new[inverse.reshape(ids.shape)]
    return labels, boxes_of(labels, int(kept.sum()))


def boxes_of(labels: Labels, count: int) -> FloatArray:
    """Return the boxes (count, 4) of labels 1 … count; NaN where a label is not in the image."""
    boxes = np.full((count, 4), np.nan)
    rows, columns = np.nonzero(labels > 0)
    of = labels[rows, columns].astype(np.int64) - 1
    for axis, values in ((0, columns), (1, rows)):
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(low, of, values)
        np.maximum.at(high, of, values + 1)
        seen = np.isfinite(low)
        boxes[seen, axis], boxes[seen, axis + 2] = low[seen], high[seen]
    return boxes


def group_of(stem: str) -> str:
    """Return the photo that a tile was cut from: the tile's name less its last number."""
    head, _, tail = stem.rpartition("_")
    return head if head and tail.isdigit() else stem


def split(samples: Sequence[Sample], held_out: float) -> tuple[list[Sample], list[Sample]]:
    """Return (training, validation) samples; all samples of a group go to one side, chosen by the group's name."""

    def is_held_out(sample: Sample) -> bool:
        return zlib.crc32(sample.group.encode()) % 1000 < 1000 * held_out

    return [s for s in samples if not is_held_out(s)], [s for s in samples if is_held_out(s)]


def write_split(path: Path, training: Sequence[Sample], validation: Sequence[Sample]) -> None:
    """Write which photos were trained on and which held out, so that others can measure on the same ones."""
    names = {
        side: sorted(f"{s.source}/{s.image.name}" for s in samples)
        for side, samples in (("training", training), ("validation", validation))
    }
    path.write_text(json.dumps(names, indent=0) + "\n")


def _write(path: Path, labels: Labels) -> None:
    cv2.imwrite(str(path), np.ascontiguousarray(labels).view(np.uint16))
