"""COLMAP, by way of pycolmap, which is touched here alone: the database, matching, mapping.

Everything in the database is in working pixels (`features.working_scale`), so that COLMAP's thresholds, all given in
pixels, mean the same for photos of any size; what comes out is in pixels of the whole photo.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, unquote

import numpy as np

from pomona.basics.arrays import Array, ByteArray, FloatArray, IntArray
from pomona.basics.gpu import own_signals, what_colmap_lacks
from pomona.basics.threads import cores, in_order
from pomona.stages.sfm.epipolar import DescribedPoints
from pomona.stages.sfm.options import SfmOptions

with own_signals():
    import pycolmap

if TYPE_CHECKING:
    from pomona.stages.sfm.features import Features

CAMERA_MODEL = "SIMPLE_RADIAL"
# Global mapping begins with so many tracks a photo, and triangulates the others when all photos have their places.
_TRACKS_TO_START = 300
# A join of pieces is first off by so much that many points are not found; they are with the adjusted poses.
_ADJUSTMENTS = 2
# Solvers with several threads add up in the order in which these come to an end: each run would have other last digits.
_MAPPING_THREADS = 1
# What a verified match takes on the disk: twice two numbers of four bytes, and as much in the log of its transaction.
_BYTES_OF_A_MATCH = 32
# What is free on a disk that can be worked on: COLMAP writes through buffers that are much smaller.
_LITTLE_BYTES = 1_000_000
pycolmap.logging.minloglevel = 2
pycolmap.logging.logtostderr = True


@dataclass(frozen=True)
class ImageEntry:
    """A photo as the database knows it; `camera_idx` into the cameras, sizes in pixels of the whole photo."""

    name: str
    camera_idx: int


@dataclass(frozen=True)
class CameraEntry:
    """A camera as the database knows it, in pixels of the whole photo; `scale` makes working pixels of them."""

    width_px: int
    height_px: int
    focal_px: float
    focal_is_known: bool
    scale: float


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


def create_database(path: Path, cameras: Sequence[CameraEntry], images: Sequence[ImageEntry]) -> None:
    """Write a new database that knows cameras and photos; image i has id i + 1."""
    _unlink(path)
    with pycolmap.Database.open(path) as database:
        for i, entry in enumerate(cameras):
            _write_camera(database, i, entry)
        for i, photo in enumerate(images):
            _write_image(database, i, photo)


def _unlink(path: Path) -> None:
    for suffix in ("", "-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)


def _need_room(folder: Path, size: int) -> None:
    """Raise `OSError` where the disk, or a quota, has no room for so many bytes in `folder`.

    COLMAP writes models without looking whether all of them arrived, and where its threads find no room for matches, it
    ends the program.
    """
    if not hasattr(os, "posix_fallocate"):
        return
    place = folder / "room"
    try:
        with place.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # of some file systems, which say no more
            raise
    finally:
        place.unlink(missing_ok=True)


def is_whole(path: Path) -> bool:
    """Say whether a database can be read, and is one of COLMAP's, as far as SQLite can say."""
    try:
        with contextlib.closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=rw", uri=True)) as database:
            found = database.execute("PRAGMA quick_check(1)").fetchone()
            tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    except sqlite3.Error:
        return False
    return found == ("ok",) and {"cameras", "images", "keypoints", "descriptors", "matches"} <= tables


def add_to_database(path: Path, i: int, image: ImageEntry, new_camera: CameraEntry | None) -> None:
    """Write photo i, and its camera where no photo before it has that, to a database that knows those before."""
    with pycolmap.Database.open(path) as database:
        if new_camera is not None:
            _write_camera(database, image.camera_idx, new_camera)
        _write_image(database, i, image)


def _write_camera(database: Any, i: int, entry: CameraEntry) -> None:
    width, height = entry.width_px * entry.scale, entry.height_px * entry.scale
    camera = pycolmap.Camera(
        model=CAMERA_MODEL,
        width=round(width),
        height=round(height),
        params=[entry.focal_px * entry.scale, width / 2, height / 2, 0.0],
        camera_id=i + 1,
        has_prior_focal_length=entry.focal_is_known,
    )
    database.write_camera(camera, use_camera_id=True)
    rig = pycolmap.Rig(rig_id=i + 1)
    rig.add_ref_sensor(camera.sensor_id)
    database.write_rig(rig, use_rig_id=True)


def _write_image(database: Any, i: int, photo: ImageEntry) -> None:
    camera_id = photo.camera_idx + 1
    image = pycolmap.Image(name=_colmap_name(photo.name), camera_id=camera_id, image_id=i + 1)
    database.write_image(image, use_image_id=True)
    frame = pycolmap.Frame(frame_id=i + 1, rig_id=camera_id)
    frame.add_data_id(image.data_id)
    database.write_frame(frame, use_frame_id=True)


def _colmap_name(photo: str) -> str:
    """A photo's name in the database: COLMAP parts lists of pairs at spaces, and takes # for a comment's beginning."""
    return quote(photo, errors="surrogateescape")


def photo_name(image: Any) -> str:
    """Return the name of the photo that an image of a COLMAP model is."""
    return unquote(image.name, errors="surrogateescape")


def missing_features(path: Path, count: int) -> list[int]:
    """Return which of the photos 0 to count - 1 have no features in the database yet."""
    with pycolmap.Database.open(path) as database:
        return [i for i in range(count) if not database.exists_descriptors(i + 1)]


def write_features(path: Path, batch: Mapping[int, Features]) -> None:
    """Store the features of some photos, by photo index."""
    sift = pycolmap.FeatureExtractorType.SIFT
    with pycolmap.Database.open(path) as database:
        for i, features in batch.items():
            if not database.exists_keypoints(i + 1):
                database.write_keypoints(i + 1, features.keypoints)
            # Descriptors last: they are what says that a photo is done.
            database.write_descriptors(i + 1, pycolmap.FeatureDescriptors(sift, features.descriptors))


def add_keypoints(path: Path, added: Mapping[int, Array]) -> None:
    """Put keypoints (n, 4) behind those of photos that have descriptors; what was there before is replaced."""
    with pycolmap.Database.open(path) as database:
        for i, keypoints in added.items():
            described = database.read_keypoints(i + 1)[: database.num_descriptors_for_image(i + 1)]
            database.update_keypoints(i + 1, np.concatenate([described, keypoints]).astype(np.float32))


def copy_largest(source: Path, path: Path, count: int, most: int) -> None:
    """Store in another database the `most` largest features of each of the photos 0 to count - 1."""
    sift = pycolmap.FeatureExtractorType.SIFT
    with pycolmap.Database.open(source) as full, pycolmap.Database.open(path) as database:
        for i in range(count):
            if not full.exists_descriptors(i + 1):
                continue
            keypoints, descriptors = full.read_keypoints(i + 1), full.read_descriptors(i + 1).data
            largest = np.sort(np.argsort(-keypoints[:, 2], kind="stable")[:most])
            database.write_keypoints(i + 1, keypoints[largest])
            database.write_descriptors(i + 1, pycolmap.FeatureDescriptors(sift, descriptors[largest]))


def count_features(path: Path, count: int) -> list[int]:
    """Return how many described features each of the photos 0 to count - 1 has."""
    with pycolmap.Database.open(path) as database:
        return [database.num_descriptors_for_image(i + 1) for i in range(count)]


def iter_descriptors(path: Path) -> Iterator[ByteArray]:
    """Yield the descriptors (n, 128) of each photo."""
    with pycolmap.Database.open(path) as database:
        for i in range(database.num_images()):
            yield np.asarray(database.read_descriptors(i + 1).data, np.uint8)


def read_points(path: Path, i: int) -> DescribedPoints:
    """Return all features of photo i that have descriptors, in working pixels."""
    with pycolmap.Database.open(path) as database:
        descriptors = np.asarray(database.read_descriptors(i + 1).data, np.uint8)
        return DescribedPoints(np.asarray(database.read_keypoints(i + 1), float)[: len(descriptors), :2], descriptors)


def read_keypoints(path: Path, count: int) -> list[FloatArray]:
    """Return the keypoints' places (n, 2) of each photo, in working pixels."""
    with pycolmap.Database.open(path) as database:
        found = [np.asarray(database.read_keypoints(i + 1), float) for i in range(count)]
    return [points.reshape(len(points), -1)[:, :2] if len(points) else np.zeros((0, 2)) for points in found]


def match(path: Path, pairs: Sequence[tuple[str, str]], options: SfmOptions) -> None:
    """Match and verify pairs of photos, on a GPU where there is one; what was matched before is left as it is.

    Raises `KeyboardInterrupt` as soon as Ctrl-C is pressed: what was matched by then stays. Raises `OSError` where the
    disk may not have room for what is found.
    """
    with pycolmap.Database.open(path) as database:
        images = [image.image_id for image in database.read_all_images()]
        most = max((database.num_descriptors_for_image(i) for i in images), default=0)
    _need_room(path.parent, _LITTLE_BYTES + len(pairs) * most * _BYTES_OF_A_MATCH)
    listing = path.with_suffix(".pairs.txt")
    listing.write_text(
        "".join(f"{_colmap_name(first)} {_colmap_name(second)}\n" for first, second in pairs), encoding="utf-8"
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
    """Verify the matches (k, 2) of pairs of photos, as `match` does, and store them."""
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
    _unlink(apart)
    with pycolmap.Database.open(apart) as database:
        for (i, j), geometry in geometries.items():
            database.write_two_view_geometry(i + 1, j + 1, geometry)
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute("ATTACH ? AS apart", (str(apart),))
        with database:
            database.execute("REPLACE INTO main.two_view_geometries SELECT * FROM apart.two_view_geometries")
    _unlink(apart)


def _verified(
    database: Any, matches: Mapping[tuple[int, int], IntArray], options: SfmOptions
) -> dict[tuple[int, int], Any]:
    """Return the geometry of each pair that its matches (k, 2) have, as `match` does."""
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


def create_mapping_database(
    source: Path, path: Path, cameras: Sequence[CameraEntry], images: Sequence[ImageEntry], overlaps: Sequence[Overlap]
) -> None:
    """Write what the mappers read: a database without descriptors, with the matches of `overlaps` alone.

    Focal lengths that are not known are estimated from the matches before anything is placed: a mapper that begins
    with a wrong one (a video that is cropped has twice that of its camera) often ends with a few photos.
    """
    create_database(path, cameras, images)
    with pycolmap.Database.open(source) as full, pycolmap.Database.open(path) as database:
        for i in range(len(images)):
            if full.exists_keypoints(i + 1):
                database.write_keypoints(i + 1, full.read_keypoints(i + 1))
        for overlap in overlaps:
            first, second = overlap.first + 1, overlap.second + 1
            geometry = full.read_two_view_geometry(first, second)
            geometry.inlier_matches = overlap.idx.astype(np.uint32)
            database.write_matches(first, second, geometry.inlier_matches)
            database.write_two_view_geometry(first, second, geometry)
    if not all(camera.focal_is_known for camera in cameras):
        settings = pycolmap.ViewGraphCalibrationOptions(random_seed=0, cross_validate_prior_focal_lengths=False)
        # False where the matches do not tell: then the prior stays, and mapping refines it.
        pycolmap.calibrate_view_graph(path, settings)


def seed_cameras(path: Path, folder: Path, cameras: Sequence[CameraEntry]) -> list[int]:
    """Give cameras of unknown focal length what the largest model in `folder` found; return which ones (indices)."""
    models = open_models(folder)
    if not models:
        return []
    largest = max(models, key=lambda model: model.num_reg_images())
    used = {largest.image(image_id).camera_id for image_id in largest.reg_image_ids()}
    seeded = [i for i, camera in enumerate(cameras) if not camera.focal_is_known and i + 1 in used]
    with pycolmap.Database.open(path) as database:
        for i in seeded:
            camera = largest.camera(i + 1)
            camera.has_prior_focal_length = True
            database.update_camera(camera)
    return seeded


def map_incremental(
    path: Path, out: Path, options: SfmOptions, fixed: Sequence[int], on_photo: Callable[[], None]
) -> None:
    """Place photos one after the other, and write the models found to `out`/0, `out`/1, ...

    `fixed` cameras keep the intrinsics that they have in the database: on the first two or three photos, focal length
    and distortion that nobody knows are often refined to nonsense, from which nothing recovers.
    """
    settings = _incremental_settings(
        options,
        constant_cameras={i + 1 for i in fixed},
        # Refining all less often than COLMAP does by default costs no precision: all is refined at the end.
        ba_global_frames_ratio=1.2,
        ba_global_points_ratio=1.2,
        ba_global_max_refinements=3,
    )
    pycolmap.set_random_seed(options.seed)
    pycolmap.incremental_mapping(
        path, path.parent, out, settings, initial_image_pair_callback=on_photo, next_image_callback=on_photo
    )


def _incremental_settings(options: SfmOptions, **more: Any) -> Any:
    settings = pycolmap.IncrementalPipelineOptions(
        min_num_matches=options.min_matches,
        min_model_size=options.min_piece_photos,
        num_threads=_MAPPING_THREADS,
        random_seed=options.seed,
        extract_colors=False,
        **more,
    )
    settings.mapper.init_min_tri_angle = options.first_pair_angle_deg
    settings.mapper.abs_pose_min_num_inliers = options.least_known_points
    settings.mapper.random_seed = settings.triangulation.random_seed = options.seed
    return settings


def map_further(path: Path, out: Path, options: SfmOptions, names: Sequence[str], before: Path | None) -> None:
    """Add those of `names` to the model in folder `before` that have no place in it, and write the model to `out`/0.

    Without `before` a model is begun. What is new is adjusted among its neighbours, all of it only now and then: this
    is for an answer at once, not for the best one.
    """
    settings = _incremental_settings(
        options,
        multiple_models=False,
        image_names=[_colmap_name(name) for name in names],
        ba_global_max_num_iterations=10,
        ba_global_max_refinements=1,
    )
    pycolmap.set_random_seed(options.seed)
    if before is None:
        pycolmap.incremental_mapping(path, path.parent, out, settings)
    else:  # COLMAP writes a model that goes on to the folder itself
        (out / "0").mkdir()
        pycolmap.incremental_mapping(path, path.parent, out / "0", settings, input_path=before)


def map_global(path: Path, out: Path, options: SfmOptions) -> None:
    """Place all photos at once (GLOMAP), and write the models found to `out`/0, `out`/1, ..."""
    settings = pycolmap.GlobalPipelineOptions(
        min_num_matches=options.min_matches,
        min_model_size=options.min_piece_photos,
        num_threads=_MAPPING_THREADS,
        random_seed=options.seed,
    )
    mapper = settings.mapper
    mapper.track_required_tracks_per_view = _TRACKS_TO_START
    mapper.ba_num_iterations = 2
    mapper.global_positioning.use_gpu = mapper.bundle_adjustment.ceres.use_gpu = False
    mapper.bundle_adjustment.ceres.solver_options.max_num_iterations = 50
    pycolmap.set_random_seed(options.seed)
    pycolmap.global_mapping(path, path.parent, out, settings)


def adjust_poses(
    path: Path, out: Path, poses: Mapping[int, FloatArray], params: Mapping[int, FloatArray], options: SfmOptions
) -> None:
    """Triangulate the matches in the database from poses that are nearly right, adjust all, and write `out`/0.

    `poses` maps photos to [R | t], `params` cameras to their parameters, in working pixels. Points that only two photos
    see count, too: where a walk turns a corner there are few others.
    """
    reconstruction = pycolmap.Reconstruction()
    with pycolmap.Database.open(path) as database:
        for i, values in params.items():
            camera = database.read_camera(i + 1)
            camera.params = values
            reconstruction.add_camera_with_trivial_rig(camera)
        for i, pose in poses.items():
            image = database.read_image(i + 1)
            reconstruction.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose))
    settings = pycolmap.IncrementalPipelineOptions(
        min_num_matches=options.min_matches,
        num_threads=_MAPPING_THREADS,
        random_seed=options.seed,
        extract_colors=False,
    )
    settings.triangulation.ignore_two_view_tracks = False
    settings.triangulation.random_seed = settings.mapper.random_seed = options.seed
    adjustment = pycolmap.BundleAdjustmentOptions()
    adjustment.print_summary = False
    adjustment.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    adjustment.ceres.solver_options.num_threads = _MAPPING_THREADS
    folder = out / "0"
    folder.mkdir(parents=True, exist_ok=True)
    for _ in range(_ADJUSTMENTS):
        reconstruction = pycolmap.triangulate_points(reconstruction, path, path.parent, folder, True, settings)
        pycolmap.bundle_adjustment(reconstruction, adjustment)
    pycolmap.ObservationManager(reconstruction).filter_all_points3D(
        settings.mapper.filter_max_reproj_error, settings.mapper.filter_min_tri_angle
    )
    reconstruction.write(folder)


def open_models(folder: Path) -> list[Any]:
    """Return the models in `folder` as pycolmap's `Reconstruction` objects, in COLMAP's order.

    Raises `OSError` where the disk is full: they may be there in part only, which nothing in them says.
    """
    if folder.is_dir():
        _need_room(folder, _LITTLE_BYTES)
    return [pycolmap.Reconstruction(sub) for sub in _model_folders(folder)]


def _model_folders(folder: Path) -> list[Path]:
    return sorted(sub for sub in folder.glob("*") if (sub / "images.bin").is_file()) if folder.is_dir() else []
