"""Detections and cameras become fruits: each object once, in the world frame.

`object` joins detections of all photos at once, without a cloud; `paper` is the method of Gené-Mola et al. 2020.
"""

from __future__ import annotations

from pomona.stages.fuse.fused import Fused, Shown

__all__ = ["Fused", "Shown"]
