"""Fruits as spheres in a cloud of fruit surfaces: for clouds that come without photos (LiDAR, other programs)."""

from __future__ import annotations

from pomona.stages.fuse.cloud.fusion import fruits_of_cloud
from pomona.stages.fuse.cloud.options import CloudOptions

__all__ = ["CloudOptions", "fruits_of_cloud"]
