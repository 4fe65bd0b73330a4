"""All detections of a survey as rays in the world frame: lens distortion and pixels are left behind here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import Array, FloatArray, IntArray, set_checked
from pomona.cameras import Cameras
from pomona.detections import Detections, Mask, SurveyDetections
from pomona.outlines import outline_px


@dataclass(frozen=True, eq=False)
class Masks:
    """n detections of p photos, sorted by photo.

    `photo_idx` (n,) into the photos; `ids`, `scores` (n,) the detections'; `rays` (n, 3) unit directions to the masks'
    centres of mass, `centers_px` (n, 2) these; `outlines` (n, k, 3) unit directions along their edges;
    `widths`, `areas` (n,) the mean side of the box, and the area, at unit depth. Of the photos: `eyes_in_world` (p, 3),
    `axes_in_world` (p, 3), the viewing directions, and `cam_from_world` (p, 3, 4).
    """

    photo_idx: IntArray
    ids: IntArray
    scores: FloatArray
    rays: FloatArray
    centers_px: FloatArray
    outlines: FloatArray
    widths: FloatArray
    areas: FloatArray
    eyes_in_world: FloatArray
    cam_from_world: FloatArray

    def __post_init__(self) -> None:
        n, p = len(self.photo_idx), len(self.eyes_in_world)
        for name in ("photo_idx", "ids"):
            set_checked(self, name, (n,), np.int64)
        for name in ("scores", "widths", "areas"):
            set_checked(self, name, (n,), np.float64)
        set_checked(self, "rays", (n, 3), np.float64)
        set_checked(self, "centers_px", (n, 2), np.float64)
        set_checked(self, "outlines", (n, None, 3), np.float64)
        set_checked(self, "eyes_in_world", (p, 3), np.float64)
        set_checked(self, "cam_from_world", (p, 3, 4), np.float64)

    def __len__(self) -> int:
        return len(self.photo_idx)

    @property
    def axes_in_world(self) -> FloatArray:
        """(p, 3): the photos' viewing directions."""
        return self.cam_from_world[:, 2, :3]

    def of_photo(self, photo_idx: int) -> slice:
        """Return where the detections of one photo are."""
        first, last = np.searchsorted(self.photo_idx, [photo_idx, photo_idx + 1])
        return slice(int(first), int(last))


def masks_of(detections: SurveyDetections, cameras: Cameras, *, rays: int) -> Masks:
    """Return the detections of all photos that have a camera, each outline as `rays` rays.

    Within a photo they are sorted by where they are, so that what follows does not depend on the order they come in.
    """
    parts = [
        _of_photo(photo_idx, found, cameras, rays)
        for photo_idx, photo in enumerate(cameras.photos)
        if (found := detections.get(photo)) is not None and len(found)
    ]
    together = [np.concatenate(column) for column in zip(*parts, strict=True)] if parts else _nothing(rays)
    return Masks(*[*together, cameras.centers_in_world, cameras.cam_from_world])


def _of_photo(photo_idx: int, found: Detections, cameras: Cameras, rays: int) -> list[Array]:
    """Return the first eight columns of `Masks` for one photo."""
    centers_px = np.array([mask.center_px for mask in found.masks])
    order = np.lexsort(centers_px.T)
    masks = [found.masks[k] for k in order]
    intrinsics = cameras.intrinsics_of(photo_idx)
    size_px = intrinsics.width_px, intrinsics.height_px
    outlines_px = np.concatenate(
        [_evenly(mask, centers_px[k], size_px, rays) for mask, k in zip(masks, order, strict=True)]
    )
    return [
        np.full(len(found), photo_idx),
        found.ids[order],
        found.scores[order],
        cameras.rays_in_world(photo_idx, centers_px[order]),
        centers_px[order],
        cameras.rays_in_world(photo_idx, outlines_px).reshape(len(found), rays, 3),
        np.array([mask.width_px + mask.height_px for mask in masks]) / (2 * intrinsics.focal_px),
        np.array([mask.area_px for mask in masks]) / intrinsics.focal_px**2,
    ]


def _evenly(mask: Mask, center_px: FloatArray, size_px: tuple[int, int], rays: int) -> FloatArray:
    """Return `rays` points (rays, 2) along a mask's edge; its centre, for one that lies along the photo's edge."""
    edge_px = outline_px(mask, *size_px)
    if len(edge_px) == 0:
        return np.repeat(center_px[None], rays, axis=0)
    return edge_px[np.linspace(0, len(edge_px), rays, endpoint=False).astype(np.int64)]


def _nothing(rays: int) -> list[Array]:
    shapes: list[tuple[int, ...]] = [(0,), (0,), (0,), (0, 3), (0, 2), (0, rays, 3), (0,), (0,)]
    return [np.zeros(shape) for shape in shapes]
