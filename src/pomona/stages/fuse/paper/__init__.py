"""Section 2.2.3 of Gené-Mola et al. 2020: a cloud of fruit surfaces, cut up by the detections."""

from __future__ import annotations

from pomona.stages.fuse.paper.fusion import fuse
from pomona.stages.fuse.paper.options import PaperOptions

__all__ = ["PaperOptions", "fuse"]
