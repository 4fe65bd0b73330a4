"""The outline of a mask as viewing rays: where nothing hides a fruit, they touch its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import Cameras
from pomona.detections import Mask
from pomona.outlines import outline_px


@dataclass(frozen=True, eq=False)
class Sight:
    """One detection of a fruit: k rays along its mask's outline, and how large the mask is.

    `eye_in_world` (3,) the camera's centre, `rays_in_world` (k, 3) unit directions, `photo_idx` into the cameras;
    `extent` and `area` are the mask's longest side and area at unit depth: times the depth (squared) they are metres.
    """

    photo_idx: int
    eye_in_world: FloatArray
    rays_in_world: FloatArray
    axis_in_world: FloatArray
    extent: float
    area: float

    def depth_m(self, point_in_world: FloatArray) -> float:
        """Return the depth of a point (3,) along the camera's axis."""
        return float((point_in_world - self.eye_in_world) @ self.axis_in_world)


def sight_of(mask: Mask, photo_idx: int, cameras: Cameras, eye_in_world: FloatArray, *, rays: int) -> Sight:
    """Return a mask as at most `rays` rays, evenly along its outline; edges of the photo are no outline."""
    intrinsics = cameras.intrinsics_of(photo_idx)
    xy_px = outline_px(mask, intrinsics.width_px, intrinsics.height_px)
    xy_px = xy_px[np.linspace(0, len(xy_px), min(rays, len(xy_px)), endpoint=False).astype(np.int64)]
    return Sight(
        photo_idx,
        eye_in_world,
        cameras.rays_in_world(photo_idx, xy_px),
        cameras.cam_from_world[photo_idx, 2, :3],
        max(mask.width_px, mask.height_px) / intrinsics.focal_px,
        mask.area_px / intrinsics.focal_px**2,
    )
