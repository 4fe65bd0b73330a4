"""What mapping costs by the length of a row, and how far it drifts: a row walked to and fro; docs/lab/speed.md.

python benchmarks/mapping_length.py SURVEY ROW OUT [--photos 200 400 800]

SURVEY is what `benchmarks/row_length.py` made of the rendered ROW. Its photos follow each other forth, back, forth, …:
one walk of any length, in which photos are matched with their neighbours alone, as they were in SURVEY, and photos of
one place taken on different ways are not. Mapping, selection and the adjustment of all cameras are those of a run.
Errors are those of camera centres after one similarity.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from command_line import parser_of
from pomona.basics.geometry import estimate_similarity
from pomona.learning.synth.truth import RowFolder
from pomona.progress import Silent
from pomona.stages.capture import load_photos
from pomona.stages.sfm import SfmOptions
from pomona.stages.sfm.colmap.database import read_keypoints
from pomona.stages.sfm.colmap.two_views import read_overlaps, write_verified
from pomona.stages.sfm.features import Features
from pomona.stages.sfm.one_lens import with_one_lens
from pomona.stages.sfm.pieces import Piece
from pomona.stages.sfm.reconstruction import _map
from pomona.stages.sfm.selection import mean_error_px
from pomona.stages.sfm.workspace import Workspace
from pomona.values.photos import Photos
from row_cases import true_centers
from tables import table_head, table_row
from usage import processor_s


def to_and_fro(count: int, photos: int) -> list[int]:
    """Which of the photos is taken at each step of a walk that turns at both ends."""
    there_and_back = [*range(photos), *range(photos - 2, 0, -1)]
    return [there_and_back[i % len(there_and_back)] for i in range(count)]


def workspace_of(walk: list[int], source: Path, photos: Photos, folder: Path, options: SfmOptions) -> Workspace:
    """A work folder in which the photos of a walk are matched."""
    shutil.rmtree(folder, ignore_errors=True)
    items = [replace(photos.items[k], name=f"{i:04d}.jpg", side="") for i, k in enumerate(walk)]
    workspace = Workspace(folder, items, options)
    keypoints = read_keypoints(source, len(photos))
    for i, k in enumerate(walk):
        xy = np.column_stack([keypoints[k], np.ones(len(keypoints[k])), np.zeros(len(keypoints[k]))])
        blank = np.zeros((0, 128), np.uint8), np.zeros((len(xy), 3), np.uint8)
        workspace.save_features({i: Features(xy.astype(np.float32), *blank, 1.0)})
    known = {(o.first, o.second): o.idx for o in read_overlaps(source)}
    known |= {(j, i): idx[:, ::-1] for (i, j), idx in known.items()}
    reach = 2 * options.window
    pairs = [(i, j) for i in range(len(walk)) for j in range(i + 1, min(i + reach + 1, len(walk)))]
    found = {(i, j): known[walk[i], walk[j]] for i, j in pairs if (walk[i], walk[j]) in known}
    write_verified(workspace.database, found, options)
    return workspace


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("survey", type=Path)
    parser.add_argument("row", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--photos", type=int, nargs="+", default=[200, 400, 800])
    arguments = parser.parse_args()
    source = next((arguments.survey / "work" / "sfm").glob("*/features.db"))
    photos = load_photos([arguments.row / "images"])
    stations = true_centers(RowFolder(arguments.row), photos.names)
    titles = "photos | placed | pieces | mapping, processor s a photo | adjustment | RMS, mm | largest error, mm"
    print(table_head(titles))
    for count in arguments.photos:
        walk = to_and_fro(count, len(photos))
        workspace = workspace_of(walk, source, photos, arguments.out / str(count), SfmOptions())
        begun = processor_s()
        models, _ = _map(workspace, {}, "", Silent())
        mapped = processor_s()
        pieces = [Piece("", model.cameras, mean_error_px(model.cameras)) for model in models]
        pieces = with_one_lens(pieces, Photos(tuple(workspace.photos)), Silent())
        done = processor_s()
        largest = pieces[0].cameras
        true = stations[[walk[int(name[:4])] for name in largest.photos]]
        centers = largest.centers_in_world
        error_mm = 1e3 * np.linalg.norm(estimate_similarity(centers, true).apply(centers) - true, axis=1)
        placed = sum(len(piece.cameras) for piece in pieces)
        spent = f"{(mapped - begun) / count:.2f}", f"{(done - mapped) / count:.2f}"
        errors = f"{np.sqrt((error_mm**2).mean()):.1f}", f"{error_mm.max():.0f}"
        print(table_row([count, placed, len(pieces), *spent, *errors]), flush=True)


if __name__ == "__main__":
    main()
