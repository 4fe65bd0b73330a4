"""What pairs of photos have in common: matches, and the geometry that verifies them."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from pomona.basics.arrays import FloatArray, IntArray
from pomona.basics.gpu import what_colmap_lacks
from pomona.basics.threads import cores, in_order
from pomona.stages.sfm.colmap.database import LITTLE_BYTES, colmap_name, need_room, remove_database
from pomona.stages.sfm.options import SfmOptions

# What a verified match takes on the disk: twice two numbers of four bytes, and as much in the log of its transaction.
_BYTES_OF_A_MATCH = 32


@dataclass(frozen=True, eq=False)
class Overlap:
    """Verified matches between two photos: `idx` (k, 2) into their keypoints.

    `fundamental` (3, 3), in working pixels, is what they were verified by; None where they leave it open.
    """

    first: int
    second: int
    idx: IntArray
    fundamental: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class TwoViews:
    """Two photos that overlap; `fundamental` (3, 3) in working pixels, None where their matches leave it open."""

    first: int
    second: int
    fundamental: FloatArray | None


def match_pairs(path: Path, pairs: Sequence[tuple[str, str]], options: SfmOptions) -> None:
    """Match and verify pairs of photos, on a GPU where there is one; what was matched before is left as it is.

    Raises `KeyboardInterrupt` as soon as Ctrl-C is pressed: what was matched by then stays. Raises `OSError` where the
    disk may not have room for what is found.
    """
    with pycolmap.Database.open(path) as database:
        images = [image.image_id for image in database.read_all_images()]
        most = max((database.num_descriptors_for_image(i) for i in images), default=0)
    need_room(path.parent, LITTLE_BYTES + len(pairs) * most * _BYTES_OF_A_MATCH)
    listing = path.with_suffix(".pairs.txt")
    listing.write_text(
        "".join(f"{colmap_name(first)} {colmap_name(second)}\n" for first, second in pairs), encoding="utf-8"
    )
    on_gpu = not what_colmap_lacks()
    matching = pycolmap.FeatureMatchingOptions(use_gpu=on_gpu, num_threads=options.threads or -1)
    device = pycolmap.Device.cuda if on_gpu else pycolmap.Device.cpu
    pairing = pycolmap.ImportedPairingOptions(match_list_path=listing)
    pycolmap.match_image_pairs(path, matching, pairing, _verification(options), device)
    listing.unlink(missing_ok=True)


def matched_pairs(path: Path) -> set[tuple[int, int]]:
    """Return the pairs (i, j) of photos that were matched and verified, with or without success."""
    with pycolmap.Database.open(path) as database:
        ids, _ = database.read_two_view_geometries()
    return {_photos_of(pair_id) for pair_id in ids}


def write_verified(path: Path, matches: Mapping[tuple[int, int], IntArray], options: SfmOptions) -> None:
    """Verify the matches (k, 2) of pairs of photos, as `match_pairs` does, and store them."""
    with pycolmap.Database.open(path) as database:
        for (i, j), geometry in _verified(database, matches, options).items():
            database.write_matches(i + 1, j + 1, matches[i, j].astype(np.uint32))
            database.write_two_view_geometry(i + 1, j + 1, geometry)


def write_further(path: Path, matches: Mapping[tuple[int, int], IntArray], options: SfmOptions) -> None:
    """Verify further matches (k, 2) of pairs that have some; where more pass than did before, they take their place.

    What the pairs were matched with first stays in the database, as `read_matched` returns it.
    """
    better = {}
    with pycolmap.Database.open(path) as database:
        for (i, j), geometry in _verified(database, matches, options).items():
            if len(geometry.inlier_matches) > len(database.read_two_view_geometry(i + 1, j + 1).inlier_matches):
                better[i, j] = geometry
    if better:
        _replace_geometries(path, better)


def _replace_geometries(path: Path, geometries: Mapping[tuple[int, int], Any]) -> None:
    """Have pairs of photos other geometries: all of them, or none where the disk is full.

    COLMAP writes the whole database anew when it closes one in which something was replaced or deleted, and where the
    disk has no room for that it ends the program. So it writes these to a database of their own, from which they are
    taken.
    """
    apart = path.with_name(f"{path.stem}-better.db")
    remove_database(apart)
    with pycolmap.Database.open(apart) as database:
        for (i, j), geometry in geometries.items():
            database.write_two_view_geometry(i + 1, j + 1, geometry)
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute("ATTACH ? AS apart", (str(apart),))
        with database:
            database.execute("REPLACE INTO main.two_view_geometries SELECT * FROM apart.two_view_geometries")
    remove_database(apart)


def _verified(
    database: Any, matches: Mapping[tuple[int, int], IntArray], options: SfmOptions
) -> dict[tuple[int, int], Any]:
    """Return the geometry of each pair that its matches (k, 2) have, as `match_pairs` does."""
    settings = _verification(options)

    def seen() -> Iterator[tuple[Any, ...]]:
        for pair, idx in matches.items():
            of_each = [
                (
                    database.read_camera(database.read_image(photo + 1).camera_id),
                    np.asarray(database.read_keypoints(photo + 1), float)[:, :2],
                )
                for photo in pair
            ]
            yield *of_each[0], *of_each[1], idx.astype(np.uint32)

    def verified(views: tuple[Any, ...]) -> Any:
        return pycolmap.estimate_two_view_geometry(*views, settings)

    return dict(zip(matches, in_order(verified, seen(), options.threads or cores()), strict=True))


def read_two_views(path: Path) -> list[TwoViews]:
    """Return the pairs of photos whose matches passed verification."""
    with pycolmap.Database.open(path) as database:
        ids, geometries = database.read_two_view_geometries()
    return [
        _two_views(*_photos_of(pair_id), geometry)
        for pair_id, geometry in zip(ids, geometries, strict=True)
        if len(geometry.inlier_matches)
    ]


def read_matched(path: Path, pairs: Sequence[tuple[int, int]], options: SfmOptions) -> list[TwoViews]:
    """Return those of the pairs whose matches, as they were first written, pass verification."""
    kept, replaced = {}, {}
    with pycolmap.Database.open(path) as database:
        for i, j in pairs:
            idx = np.asarray(database.read_matches(i + 1, j + 1), np.int64)
            if len(idx) < options.min_matches:
                continue
            kept[i, j] = database.read_two_view_geometry(i + 1, j + 1)
            if not _is_of(kept[i, j], idx):
                replaced[i, j] = idx
        geometries = kept | _verified(database, replaced, options)
    return [_two_views(i, j, geometry) for (i, j), geometry in geometries.items() if len(geometry.inlier_matches)]


def _is_of(geometry: Any, matches: IntArray) -> bool:
    """Say whether a geometry is of these matches (k, 2), not of further ones or of none."""
    if geometry.config == pycolmap.TwoViewGeometryConfiguration.UNDEFINED:
        return False
    inliers = np.asarray(geometry.inlier_matches, np.int64).reshape(-1, 2)
    ours, theirs = (pairs[:, 0] << 32 | pairs[:, 1] for pairs in (inliers, matches))
    return bool(np.isin(ours, theirs).all())


def _two_views(first: int, second: int, geometry: Any) -> TwoViews:
    general = pycolmap.TwoViewGeometryConfiguration.CALIBRATED, pycolmap.TwoViewGeometryConfiguration.UNCALIBRATED
    return TwoViews(first, second, np.asarray(geometry.F, float) if geometry.config in general else None)


def _verification(options: SfmOptions) -> Any:
    settings = pycolmap.TwoViewGeometryOptions(min_num_inliers=options.min_matches)
    settings.ransac.random_seed = options.seed
    return settings


def _photos_of(pair_id: int) -> tuple[int, int]:
    first, second = pycolmap.pair_id_to_image_pair(pair_id)
    return first - 1, second - 1


def clear_matches(path: Path) -> None:
    """Forget all matches; cameras, photos and features stay."""
    # Not by COLMAP: see `_replace_geometries`.
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        database.execute("DELETE FROM two_view_geometries")
        database.execute("DELETE FROM matches")


def read_overlaps(path: Path) -> list[Overlap]:
    """Return all verified pairs with their matches, photos as indices."""
    with pycolmap.Database.open(path) as database:
        ids, geometries = database.read_two_view_geometries()
    overlaps = []
    for pair_id, geometry in zip(ids, geometries, strict=True):
        idx = np.asarray(geometry.inlier_matches, np.int64).reshape(-1, 2)
        if len(idx):
            views = _two_views(*_photos_of(pair_id), geometry)
            overlaps.append(Overlap(views.first, views.second, idx, views.fundamental))
    return overlaps


def count_matches(path: Path, pairs: Sequence[tuple[int, int]]) -> list[int]:
    """Return how many verified matches each pair of photos has."""
    with pycolmap.Database.open(path) as database:
        return [
            len(database.read_two_view_geometry(i + 1, j + 1).inlier_matches)
            if database.exists_two_view_geometry(i + 1, j + 1)
            else 0
            for i, j in pairs
        ]
