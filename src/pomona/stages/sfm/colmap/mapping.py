"""Mapping: where the photos of a database were taken from, by each of COLMAP's mappers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from pomona.basics.arrays import FloatArray
from pomona.stages.sfm.colmap.database import (
    LITTLE_BYTES,
    CameraEntry,
    ImageEntry,
    colmap_name,
    create_database,
    need_room,
)
from pomona.stages.sfm.colmap.two_views import Overlap
from pomona.stages.sfm.options import SfmOptions

# Global mapping begins with so many tracks a photo, and triangulates the others when all photos have their places.
_TRACKS_TO_START = 300
# A join of pieces is first off by so much that many points are not found; they are with the adjusted poses.
_ADJUSTMENTS = 2
# Solvers with several threads add up in the order in which these come to an end: each run would have other last digits.
_MAPPING_THREADS = 1


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
        image_names=[colmap_name(name) for name in names],
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
        need_room(folder, LITTLE_BYTES)
    return [pycolmap.Reconstruction(sub) for sub in _model_folders(folder)]


def _model_folders(folder: Path) -> list[Path]:
    return sorted(sub for sub in folder.glob("*") if (sub / "images.bin").is_file()) if folder.is_dir() else []
