"""A coloured point cloud of fruit surfaces only: the pixels inside the masks, checked between several views."""

from __future__ import annotations

from functools import partial

import numpy as np

from pomona.basics.gpu import what_colmap_lacks
from pomona.progress import Progress, Silent
from pomona.stages.dense import patchmatch
from pomona.stages.dense.options import DenseOptions, SphereCloudOptions
from pomona.stages.dense.plane_sweep import plane_sweep_map
from pomona.stages.dense.scene import StereoScene, cloud_of_maps
from pomona.stages.dense.sphere_points import sphere_cloud
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import FruitCloud
from pomona.values.photos import Photos

__all__ = ["DenseOptions", "SphereCloudOptions", "fruit_cloud", "sphere_cloud"]


def fruit_cloud(
    photos: Photos,
    detections: SurveyDetections,
    cameras: Cameras,
    *,
    options: DenseOptions | None = None,
    progress: Progress | None = None,
) -> FruitCloud:
    """Return a point cloud of what the detections cover, in the world frame, `fruit_id` 0 throughout.

    Engine "patchmatch" falls back to the plane sweep, with a warning, where COLMAP's cannot run. Photos that cannot be
    decoded are left out, with a warning.
    """
    options, progress = options or DenseOptions(), progress or Silent()
    scene = StereoScene(photos, detections, cameras, options, progress)
    missing = what_colmap_lacks() if options.engine != "opencv" else "not asked for"
    if options.engine == "patchmatch" and missing:
        progress.warn(f"COLMAP's PatchMatch cannot run: {missing}. The cloud is made on the CPU instead.")
    if missing:
        points, rgb = cloud_of_maps(scene, partial(plane_sweep_map, scene), progress)
    else:
        with patchmatch.depth_maps(scene, progress) as depth_map:
            points, rgb = cloud_of_maps(scene, depth_map, progress)
    return FruitCloud(points, rgb, np.zeros(len(points), np.int64))
