"""Photos for tests of training, with truth known beforehand: red discs on green noise."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from pomona.train.samples import Sample, labels_from_ids


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


def samples_of_discs(folder: Path, count: int = 6) -> list[Sample]:
    """Samples of photos of discs, each a photo of its own."""
    made = []
    for k in range(count):
        pixels, ids = discs(k)
        labels, boxes = labels_from_ids(ids)
        cv2.imwrite(str(folder / f"{k}.png"), pixels[:, :, ::-1])
        cv2.imwrite(str(folder / f"{k}-labels.png"), labels.view(np.uint16))
        made.append(Sample(folder / f"{k}.png", folder / f"{k}-labels.png", boxes, f"g{k}", "rendered"))
    return made
