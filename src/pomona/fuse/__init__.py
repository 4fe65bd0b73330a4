"""Detections and cameras become fruits: each object once, in the world frame.

`paper` is section 2.2.3 of Gené-Mola et al. 2020: a cloud of fruit surfaces, cut up by the detections.
"""

from __future__ import annotations

from pomona.fuse.options import PaperOptions
from pomona.fuse.values import Fused

__all__ = ["Fused", "PaperOptions"]
