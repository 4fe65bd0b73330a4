"""Photos for tests of training, with truth known beforehand: red discs on green noise."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from pomona.learning.train.samples import Sample, boxes_of


def discs(seed: int, size: int = 200, count: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """A photo of red discs on green noise, and its image of ids."""
    rng = np.random.default_rng(seed)
    pixels = rng.integers(40, 110, (size, size, 3)).astype(np.uint8)
    pixels[:, :, 0] //= 2
    ids = np.zeros((size, size), np.uint16)
    rows, columns = np.mgrid[:size, :size]
    cells = rng.permutation(16)[:count]
    for k, cell in enumerate(cells, start=1):
        cx, cy, r = 25 + 50 * (cell % 4), 25 + 50 * (cell // 4), rng.uniform(11, 20)
        inside = (columns - cx) ** 2 + (rows - cy) ** 2 < r**2
        ids[inside] = k
        pixels[inside] = [200, 30, 30]
    return pixels, ids


def samples_of_discs(folder: Path, count: int = 6, larger: int = 1) -> list[Sample]:
    """Samples of photos of discs, each a photo of its own, so many times as large."""
    made = []
    for k in range(count):
        pixels, ids = (np.repeat(np.repeat(image, larger, 0), larger, 1) for image in discs(k))
        labels = ids.astype(np.int16)
        boxes = boxes_of(labels, ids.max())
        cv2.imwrite(str(folder / f"{k}.png"), pixels[:, :, ::-1])
        cv2.imwrite(str(folder / f"{k}-labels.png"), labels.view(np.uint16))
        made.append(Sample(folder / f"{k}.png", folder / f"{k}-labels.png", boxes, f"g{k}", "rendered"))
    return made


def coco_folder(folder: Path, count: int) -> Path:
    """A folder of photos with a COCO file of polygons."""
    folder.mkdir()
    images, annotations = [], []
    for k in range(count):
        pixels, ids = discs(k)
        cv2.imwrite(str(folder / f"{k}.png"), pixels[:, :, ::-1])
        images.append({"id": k + 1, "file_name": f"{k}.png", "width": 200, "height": 200})
        labels = ids.astype(np.int16)
        boxes = boxes_of(labels, ids.max())
        for label, (x0, y0, x1, y1) in enumerate(boxes.tolist(), start=1):
            contours, _ = cv2.findContours((labels == label).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            polygon = contours[0].astype(float).reshape(-1).tolist()
            fruit = {"id": len(annotations) + 1, "image_id": k + 1, "category_id": 1}
            annotations.append(fruit | {"bbox": [x0, y0, x1 - x0, y1 - y0], "segmentation": [polygon]})
    categories = [{"id": 1, "name": "apple"}]
    (folder / "coco.json").write_text(
        json.dumps({"images": images, "annotations": annotations, "categories": categories})
    )
    return folder
