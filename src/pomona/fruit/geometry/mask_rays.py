"""Detections as viewing rays in the world frame: lens distortion and pixels are left behind here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import Array, FloatArray, IntArray, among, set_checked
from pomona.fruit.geometry.mask_outlines import depths_in_hull, outline_px
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import Observations

USUAL_RAGGEDNESS = 0.04


@dataclass(frozen=True, eq=False)
class MaskRays:
    """n detections of p photos, sorted by photo.

    `photo_idx` (n,) into the photos; `ids`, `scores` (n,) the detections'; `rays` (n, 3) unit directions to the masks'
    centres of mass, `centers_px` (n, 2) these; `outlines` (n, k, 3) unit directions along their edges, and
    `edge_counts` (n,), how many pixels these have: less than k are repeated, and a mask without any, which lies along
    the photo's edge, has its centre in their place; `edge_shares` (n,): which share of the whole outline these are.
    `widths`, `extents` and `areas` (n,) are the mean and the longer side of the box in radians, and the solid angle:
    times the distance (squared) they are metres across the sight, wherever in the photo a mask is; `px_angles` (n,) is
    the angle of a pixel there. Of the photos: their names `photos` (p,), centres `eyes_in_world` (p, 3) and
    `cam_from_world` (p, 3, 4).

    `raggedness`: how far masks reach out of the fruits that they show, in radii (RMS along outlines, the mean of all),
    as masks and cameras are not exact; until fruits tell that it is less, that of masks which a network finds.
    """

    photo_idx: IntArray
    ids: IntArray
    scores: FloatArray
    rays: FloatArray
    centers_px: FloatArray
    outlines: FloatArray
    edge_counts: IntArray
    edge_shares: FloatArray
    widths: FloatArray
    extents: FloatArray
    areas: FloatArray
    px_angles: FloatArray
    photos: tuple[str, ...]
    eyes_in_world: FloatArray
    cam_from_world: FloatArray
    raggedness: float = USUAL_RAGGEDNESS

    def __post_init__(self) -> None:
        n, p = len(self.photo_idx), len(self.photos)
        for name in ("photo_idx", "ids", "edge_counts"):
            set_checked(self, name, (n,), np.int64)
        for name in ("scores", "edge_shares", "widths", "extents", "areas", "px_angles"):
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

    def distances(self, points_in_world: FloatArray, mask_idx: IntArray) -> FloatArray:
        """Return how far points (k, 3), or one (3,), are from the photos of masks (k,); behind these, below 0."""
        photo_idx = self.photo_idx[mask_idx]
        away = points_in_world - self.eyes_in_world[photo_idx]
        ahead = (away * self.axes_in_world[photo_idx]).sum(1)
        return np.asarray(np.copysign(np.linalg.norm(away, axis=1), ahead))

    def seen(self, observations: Observations, fruit_ids: IntArray) -> tuple[IntArray, IntArray]:
        """Return which fruit (k,), an index into `fruit_ids` (n,), each observation is of, and which mask (k,) it is.

        Observations of other fruits, and those of detections that are not here, are left out.
        """
        mask_of = {
            (self.photos[photo_idx], detection_id): k
            for k, (photo_idx, detection_id) in enumerate(zip(self.photo_idx.tolist(), self.ids.tolist(), strict=True))
        }
        fruit_of = {fruit_id: i for i, fruit_id in enumerate(fruit_ids.tolist())}
        pairs = [
            (fruit_of[fruit_id], mask_of[photo, detection_id])
            for fruit_id, photo, detection_id in zip(
                observations.fruit_id.tolist(), observations.photo, observations.detection_id.tolist(), strict=True
            )
            if fruit_id in fruit_of and (photo, detection_id) in mask_of
        ]
        fruit_idx, mask_idx = np.array(pairs, np.int64).reshape(-1, 2).T
        return fruit_idx, mask_idx


def mask_rays(
    detections: SurveyDetections,
    cameras: Cameras,
    *,
    rays_per_mask: int,
    only: Observations | None = None,
    hull_slack: float | None = None,
) -> MaskRays:
    """Return the detections of all photos that have a camera, each outline as `rays_per_mask` rays.

    `only`: those that these observations are of. `hull_slack`: outlines are just those pixels of them that lie at most
    so many of the mask's longer sides, or a pixel, inside its convex hull. Within a photo they are sorted by where they
    are, so that what follows does not depend on the order they come in.

    `fuse`, `filter` and `measure` each make their own, as they differ in detections, order of photos and number of rays
    (16, 16 and 24). All three together take less than a second for 28 photos.
    """
    wanted = None if only is None else np.unique(only.detection_id)
    parts = []
    for photo_idx, photo in enumerate(cameras.photos):
        found = detections.get(photo)
        if found is not None and wanted is not None:
            found = found[among(found.ids, wanted)]
        if found is not None and len(found):
            parts.append(_of_photo(photo_idx, found, cameras, rays_per_mask, hull_slack))
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)] if parts else _nothing(rays_per_mask)
    return MaskRays(*[*columns, cameras.photos, cameras.centers_in_world, cameras.cam_from_world])


def _of_photo(photo_idx: int, found: Detections, cameras: Cameras, rays: int, hull_slack: float | None) -> list[Array]:
    """Return the first twelve columns of `MaskRays` for one photo."""
    centers_px = np.array([mask.center_px for mask in found.masks])
    order = np.lexsort(centers_px.T)
    masks = [found.masks[k] for k in order]
    intrinsics = cameras.intrinsics_of(photo_idx)
    size_px = intrinsics.width_px, intrinsics.height_px
    outlines = [_outline(mask, centers_px[k], size_px, rays, hull_slack) for mask, k in zip(masks, order, strict=True)]
    outlines_px = np.concatenate([xy_px for xy_px, _, _ in outlines])
    px_angles = intrinsics.px_angles(centers_px[order])
    return [
        np.full(len(found), photo_idx),
        found.ids[order],
        found.scores[order],
        cameras.rays_in_world(photo_idx, centers_px[order]),
        centers_px[order],
        cameras.rays_in_world(photo_idx, outlines_px).reshape(len(found), rays, 3),
        np.array([count for _, count, _ in outlines]),
        np.array([share for _, _, share in outlines]),
        np.array([mask.width_px + mask.height_px for mask in masks]) / 2 * px_angles,
        np.array([max(mask.width_px, mask.height_px) for mask in masks]) * px_angles,
        np.array([mask.area_px for mask in masks]) * px_angles**2,
        px_angles,
    ]


def _outline(
    mask: Mask, center_px: FloatArray, size_px: tuple[int, int], rays: int, hull_slack: float | None
) -> tuple[FloatArray, int, float]:
    """Return `rays` points (rays, 2) along a mask's edge, how many pixels that has, and which share of all.

    The mask's centre and 0 pixels, where it has none.
    """
    edge_px = outline_px(mask, *size_px)
    if len(edge_px) == 0:
        return np.repeat(center_px[None], rays, axis=0), 0, 1.0
    kept_px = edge_px
    if hull_slack is not None:
        kept_px = edge_px[depths_in_hull(edge_px) <= max(1.0, hull_slack * max(mask.width_px, mask.height_px))]
    return kept_px[_evenly_spaced(len(kept_px), rays)], len(kept_px), len(kept_px) / len(edge_px)


def _evenly_spaced(count: int, places: int) -> IntArray:
    """Return indices of `places` of `count` pixels, evenly; of fewer than that each at least once, of none none."""
    return np.linspace(0, count, places if count else 0, endpoint=False).astype(np.int64)


def _nothing(rays: int) -> list[Array]:
    shapes: list[tuple[int, ...]] = [(0,), (0,), (0,), (0, 3), (0, 2), (0, rays, 3), *[(0,)] * 6]
    return [np.zeros(shape) for shape in shapes]
