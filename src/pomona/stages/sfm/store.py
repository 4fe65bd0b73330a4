"""A reconstruction in a folder, between stages: one COLMAP text model a piece, and reconstruction.json."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from pathlib import Path

from pomona.errors import FormatError, MissingFileError
from pomona.formats.cameras.colmap import read_colmap, write_colmap
from pomona.stages.sfm.pieces import Piece, Reconstruction, Unregistered
from pomona.values.photos import Photos

_INDEX = "reconstruction.json"


def write_reconstruction(folder: Path, reconstruction: Reconstruction, photos: Photos) -> None:
    """Write a reconstruction to `folder`, which is replaced."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    entries = []
    for i, piece in enumerate(reconstruction.pieces):
        write_colmap(folder / f"piece-{i}", piece.cameras, photos)
        entries.append({"side": piece.side, "mean_reprojection_error_px": piece.mean_reprojection_error_px})
    index = {"pieces": entries, "unregistered": [asdict(photo) for photo in reconstruction.unregistered]}
    # The index comes last, under a temporary name first: with it there, all else is there.
    part = folder / f"{_INDEX}.part"
    part.write_text(json.dumps(index, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    part.replace(folder / _INDEX)


def read_reconstruction(folder: Path, photos: Photos) -> Reconstruction:
    """Read what `write_reconstruction` wrote.

    Raises `MissingFileError` when there is none, or none that was written to its end, and `FormatError` or `InputError`
    when it cannot be understood or is of other photos.
    """
    path = folder / _INDEX
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist: {folder} holds no complete reconstruction")
    try:
        index = json.loads(path.read_text(encoding="utf-8"))
        sides = [(str(entry["side"]), float(entry["mean_reprojection_error_px"])) for entry in index["pieces"]]
        lost = tuple(Unregistered(**entry) for entry in index["unregistered"])
    except (ValueError, KeyError, TypeError) as error:
        raise FormatError(f"{path}: expected the index of a reconstruction ({error!r})") from None
    pieces = (Piece(side, read_colmap(folder / f"piece-{i}", photos), e) for i, (side, e) in enumerate(sides))
    return Reconstruction(tuple(pieces), lost)
