"""Multi-view association: detections of all photos become spheres, each seen at most once in a photo."""

from __future__ import annotations

from pomona.stages.fuse.object.fusion import fuse
from pomona.stages.fuse.object.options import ObjectOptions

__all__ = ["ObjectOptions", "fuse"]
