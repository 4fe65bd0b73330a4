"""The outline of a mask as viewing rays: where nothing hides a fruit, they touch its surface."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import Cameras
from pomona.detections import Mask


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


def outline_px(mask: Mask, width_px: int, height_px: int) -> FloatArray:
    """Return the outer edge (k, 2) of a mask in pixels, in order around it; without what lies on the photo's edge.

    Points are moved half a pixel outwards, from the centres of the outermost pixels to the mask's edge.
    """
    contours, _ = cv2.findContours(
        mask.pixels.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(mask.x_px, mask.y_px)
    )
    pixels = np.concatenate([contour[:, 0] for contour in contours]).astype(np.float64)
    inner = (pixels > 0).all(1) & (pixels < (width_px - 1, height_px - 1)).all(1)
    xy_px = pixels[inner] + 0.5
    outwards = xy_px - mask.center_px
    length = np.maximum(np.linalg.norm(outwards, axis=1, keepdims=True), 1e-9)
    moved: FloatArray = xy_px + 0.5 * outwards / length
    return moved
