"""What other fruits explain of the evidence. Only those near a photo's line of sight are asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray, IntArray, groups
from pomona.fruit.crops.sights import images_px
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.second_look.evidence import Evidence
from pomona.stages.second_look.options import SecondLookOptions
from pomona.stages.second_look.peaks import Peaks
from pomona.values.cameras import Cameras

_BLOCK = 64  # fruits beside each other, which are left out together where a photo looks elsewhere
# At the rim of wide lenses a pixel is a wider angle than in the middle: by less than this, and across its diagonal.
_WIDER = 2 * np.sqrt(2)


def unexplained(
    evidence: Evidence,
    spheres: Spheres,
    seen: FloatArray,
    cameras: Cameras,
    options: SecondLookOptions,
    *,
    own: bool = False,
) -> Evidence:
    """Return the evidence less what other fruits explain: each sight's map without the peaks of its neighbours.

    Around the images of the spheres that are `seen` (n,), as probabilities, maps lose as much as is seen of these.
    With `own`, what sights show of their own spheres is explained, too: `spheres` may then be others. Maps are not
    copied, but lose it when they are asked for (`Evidence.about`); what earlier calls left out is in them again.
    """
    sights, cells_per_px = evidence.sights, evidence.scales / evidence.cell_px
    reach_px = evidence.maps.shape[1] / cells_per_px
    plain = np.flatnonzero(np.nan_to_num(seen) >= options.plain)
    strength = np.minimum(1, np.nan_to_num(seen) / options.sure)
    blocks = _Blocks(spheres.centers_in_world[plain])
    found = [(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), np.zeros(0))]
    for photo, mine in groups(sights.photo_idx):
        others = plain[_near_sights(blocks, photo, sights.centers_px[mine], reach_px[mine], cameras)]
        xy_px, depths = cameras.project(photo, spheres.centers_in_world[others])
        shown = (depths > 0) & np.isfinite(xy_px).all(1)
        others, xy_px = others[shown], xy_px[shown]
        radii_px = images_px(cameras, photo, spheres[others])
        row, beside = _within(sights.centers_px[mine], reach_px[mine], xy_px)
        if not own:
            apart = others[beside] != sights.sphere_idx[mine[row]]
            row, beside = row[apart], beside[apart]
        k = mine[row]
        cells = (xy_px[beside] - sights.centers_px[k]) * cells_per_px[k, None]
        widths = options.peak_width * radii_px[beside] * evidence.scales[k] / evidence.cell_px
        found.append((k, cells, widths, strength[others[beside]]))
    of, cells, widths, shares = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.argsort(of, kind="stable")
    bounds = np.searchsorted(of[order], np.arange(len(sights.sphere_idx) + 1))
    return replace(evidence, peaks=Peaks(bounds, cells[order], widths[order], shares[order]))


def _within(places: FloatArray, reach: FloatArray, points: FloatArray) -> tuple[IntArray, IntArray]:
    """Return pairs (place, point), in order, where points (n, 2) lie in the squares about places (m, 2)."""
    if len(points) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    found = cKDTree(points).query_ball_point(places, reach, p=np.inf, return_sorted=True)
    row = np.repeat(np.arange(len(places)), [len(near) for near in found])
    return row, np.concatenate([np.array(near, np.int64) for near in found])


def _near_sights(
    blocks: _Blocks, photo: int, centers_px: FloatArray, reach_px: FloatArray, cameras: Cameras
) -> IntArray:
    """Return points whose images may be in reach (m,) of pixels (m, 2): all that are, and some beside."""
    rays = cameras.rays_in_world(photo, centers_px)
    axis = rays.mean(0)
    axis /= max(float(np.linalg.norm(axis)), 1e-12)
    widest = float(np.arccos(np.clip(rays @ axis, -1, 1)).max())
    half_angle = widest + _WIDER * float(reach_px.max()) / cameras.intrinsics_of(photo).focal_px
    return blocks.in_cone(cameras.cam_from_world[photo], axis, half_angle)


class _Blocks:
    """Points (n, 3) in blocks along the row, each in a ball: of most, nothing is in a photo."""

    def __init__(self, points: FloatArray) -> None:
        starts = np.arange(0, len(points), _BLOCK)
        if len(points):
            along = np.linalg.svd(points - points.mean(0), full_matrices=False)[2][0]
            order = np.argsort(points @ along, kind="stable")
        else:
            order = np.zeros(0, np.int64)
        self._order, self._starts = order, starts
        counts = np.diff(np.append(starts, len(points)))
        self._centers = np.add.reduceat(points[order], starts) / counts[:, None] if len(points) else np.zeros((0, 3))
        off = np.linalg.norm(points[order] - np.repeat(self._centers, counts, axis=0), axis=1)
        self._radii = np.maximum.reduceat(off, starts) if len(points) else np.zeros(0)

    def in_cone(self, pose: FloatArray, axis: FloatArray, half_angle: float) -> IntArray:
        """Return the points, in order, of the blocks that reach into a cone about an axis from a camera's centre."""
        away = self._centers + pose[:, 3] @ pose[:, :3]
        distances = np.maximum(np.linalg.norm(away, axis=1), 1e-12)
        angles = np.arccos(np.clip(away @ axis / distances, -1, 1))
        reach = np.where(distances > self._radii, np.arcsin(np.minimum(self._radii / distances, 1)), np.pi)
        chosen = self._starts[angles <= half_angle + reach + 1e-6]
        places = (chosen[:, None] + np.arange(_BLOCK)).ravel()
        return np.sort(self._order[places[places < len(self._order)]])
