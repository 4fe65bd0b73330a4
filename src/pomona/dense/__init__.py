"""A coloured point cloud of fruit surfaces only: the pixels inside the masks, checked between several views."""

from __future__ import annotations

import numpy as np

from pomona.cameras import Cameras
from pomona.dense.options import DenseOptions
from pomona.dense.planesweep import plane_sweep_cloud
from pomona.detections import SurveyDetections
from pomona.fruits import FruitCloud
from pomona.photos import Photos
from pomona.progress import Progress, Silent

__all__ = ["DenseOptions", "fruit_cloud"]


def fruit_cloud(
    photos: Photos,
    detections: SurveyDetections,
    cameras: Cameras,
    *,
    options: DenseOptions | None = None,
    progress: Progress | None = None,
) -> FruitCloud:
    """Return a point cloud of what the detections cover, in the world frame, `fruit_id` 0 throughout."""
    options, progress = options or DenseOptions(), progress or Silent()
    points, rgb = plane_sweep_cloud(photos, detections, cameras, options, progress)
    return FruitCloud(points, rgb, np.zeros(len(points), np.int64))
