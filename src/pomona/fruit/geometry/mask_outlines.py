"""The outer edges of masks, in pixels."""

from __future__ import annotations

import cv2
import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.values.detections import Mask


def outline_px(mask: Mask, width_px: int, height_px: int) -> FloatArray:
    """Return the outer edge (k, 2) of a mask in pixels, in order around it; without what lies on the photo's edge.

    Points are moved half a pixel outwards, from the centres of the outermost pixels to the mask's edge.
    """
    contours, _ = cv2.findContours(
        mask.pixels.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(mask.x_px, mask.y_px)
    )
    pixels = np.concatenate([contour[:, 0] for contour in contours]).astype(np.float64)
    inner = (pixels > 0).all(1) & (pixels < (width_px - 1, height_px - 1)).all(1)
    xy_px = pixels[inner] + 0.5
    outwards = xy_px - mask.center_px
    length = np.maximum(np.linalg.norm(outwards, axis=1, keepdims=True), 1e-9)
    moved: FloatArray = xy_px + 0.5 * outwards / length
    return moved


def depths_in_hull(points_px: FloatArray) -> FloatArray:
    """Return how deep points (k, 2) lie inside the convex hull of them all (k,): 0 along it."""
    corners = cv2.convexHull(points_px.astype(np.float32))[:, 0].astype(np.float64)
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edges, axis=1)
    corners, edges, lengths = corners[lengths > 0], edges[lengths > 0], lengths[lengths > 0]
    if len(edges) < 3:  # all on one line
        return np.zeros(len(points_px))
    off = points_px[:, None] - corners
    areas = edges[:, 0] * off[:, :, 1] - edges[:, 1] * off[:, :, 0]
    depths: FloatArray = np.maximum(np.abs(areas / lengths).min(axis=1), 0.0)
    return depths
