"""Compare the fruits of the authors' program with those of `--variant published-code`, fruit by fruit.

python benchmarks/octave/compare.py FOLDER [--result FILE]

FOLDER holds data/ as that program reads it, and results/Apple_detections.txt, which it writes (x y z r g b fruit). Both
are before the support vector machine, as the program is run with `shims/`. A fruit is the same where both have more
than half of the union of its points.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from pomona.basics.arrays import IntArray
from pomona.datasets.fuji_files import find_fuji_files
from pomona.datasets.fuji_row import read_fuji_row
from pomona.errors import InputError
from pomona.formats.xyz import read_xyz
from pomona.progress import Silent
from pomona.stages.fuse.paper import PaperOptions, fuse

SAME_POINT_M = 1e-4


@dataclass(frozen=True)
class Agreement:
    """Fruits of theirs and of ours, and the largest overlap (intersection over union) of each of theirs."""

    theirs: int
    ours: int
    overlaps: np.ndarray

    def lines(self) -> list[str]:
        alike = [f"{(self.overlaps > least).sum()} above {least:g}" for least in (0.5, 0.9, 0.99)]
        return [f"theirs {self.theirs}, ours {self.ours}", f"overlap of points: {', '.join(alike)}"]


def agreement(theirs: IntArray, ours: IntArray) -> Agreement:
    """Compare the fruit of each point (n,) by one program and by the other; 0 is none."""
    shape = int(theirs.max(initial=0)) + 1, int(ours.max(initial=0)) + 1
    shared = coo_array((np.ones(len(theirs)), (theirs, ours)), shape=shape).toarray()
    union = shared.sum(1)[:, None] + shared.sum(0)[None] - shared
    overlap = shared[1:, 1:] / np.maximum(union[1:, 1:], 1)
    there = shared[1:].sum(1) > 0
    best = overlap[there].max(1, initial=0)
    return Agreement(int(there.sum()), int((shared[:, 1:].sum(0) > 0).sum()), best)


def compare(folder: Path, result: Path) -> Agreement:
    row = read_fuji_row(find_fuji_files(folder / "data"), Silent())
    if row.cameras is None or row.detections is None or row.cloud is None:
        raise InputError(f"{folder / 'data'}: expected cameras, masks and clouds of all sides")
    fused = fuse(row.detections, row.cameras, row.cloud, options=PaperOptions.as_published_code())
    written = read_xyz(result)
    apart, _ = cKDTree(row.cloud.points_in_world).query(written.points_in_world)
    if apart.max(initial=0) > SAME_POINT_M:
        raise InputError(f"{result}: expected points of the clouds in {folder / 'data'}, found others")
    # Looked up from the cloud's side: a point may be in it twice.
    away, place = cKDTree(written.points_in_world).query(row.cloud.points_in_world)
    theirs = np.where(away <= SAME_POINT_M, written.fruit_id[place], 0)
    return agreement(theirs, fused.cloud.fruit_id)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--result", type=Path)
    arguments = parser.parse_args()
    result = arguments.result or arguments.folder / "results" / "Apple_detections.txt"
    print("\n".join(compare(arguments.folder, result).lines()))


if __name__ == "__main__":
    main()
