"""Coloured points on fruits that are known as spheres: what the photos show of each, without any stereo."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray
from pomona.errors import DamagedPhotoError
from pomona.fruit.traits.ranges import fruit_widths_px
from pomona.progress import Progress, Silent, track
from pomona.stages.capture import read_pixels
from pomona.stages.dense.options import SphereCloudOptions
from pomona.values.cameras import Cameras
from pomona.values.detections import Mask, SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.photos import Photos


def sphere_cloud(
    fruits: Fruits,
    observations: Observations,
    detections: SurveyDetections,
    cameras: Cameras,
    photos: Photos,
    *,
    options: SphereCloudOptions | None = None,
    progress: Progress | None = None,
) -> FruitCloud:
    """Return points (m, 3) where rays through fruits' masks meet their spheres, coloured by the photos.

    Only what photos show has points; places are those of the spheres, not measured one by one. Fruits without a
    diameter have none, and photos that cannot be decoded are left out, with a warning.
    """
    options, progress = options or SphereCloudOptions(), progress or Silent()
    shown = _most_shown(fruits, observations, detections, options.views)
    if not shown:
        return FruitCloud.empty()
    scales = np.minimum(1.0, options.work_fruit_px / fruit_widths_px(detections, cameras))
    by_name, index = photos.by_name(), {fruit_id: i for i, fruit_id in enumerate(fruits.ids.tolist())}
    photo_of = {name: i for i, name in enumerate(cameras.photos)}
    parts = []
    for name in track(sorted(shown), progress, "cloud", len(shown)):
        photo = by_name[name]
        photo_idx = photo_of[name]
        try:
            pixels = read_pixels(photo, max_side_px=photo.longer_side_px(scales[photo_idx]))
        except DamagedPhotoError as error:
            progress.warn(f"{name} is not in the cloud: {error.reason}")
            continue
        for fruit_id, mask in shown[name]:
            i = index[fruit_id]
            xy_px = _inside(mask, photo.width_px / pixels.shape[1])
            points, met = _on_sphere(
                cameras, photo_idx, xy_px, fruits.centers_in_world[i], float(fruits.diameters_m[i]) / 2
            )
            parts.append((points, _colours(pixels, xy_px[met], photo.width_px), np.full(len(points), fruit_id)))
    return FruitCloud(*(np.concatenate(column) for column in zip(*parts, strict=True))) if parts else FruitCloud.empty()


def _most_shown(
    fruits: Fruits, observations: Observations, detections: SurveyDetections, most_views: int
) -> dict[str, list[tuple[int, Mask]]]:
    """Return by photo the fruits that it shows better than most photos do, with their masks."""
    place = {name: {i: k for k, i in enumerate(found.ids.tolist())} for name, found in detections.items()}
    measured = set(fruits.ids[np.isfinite(fruits.diameters_m)].tolist())
    seen: defaultdict[int, list[tuple[int, str, Mask]]] = defaultdict(list)
    for fruit_id, name, detection_id in zip(
        observations.fruit_id.tolist(), observations.photo, observations.detection_id.tolist(), strict=True
    ):
        if fruit_id in measured:
            mask = detections[name].masks[place[name][detection_id]]
            seen[fruit_id].append((mask.area_px, name, mask))
    shown: defaultdict[str, list[tuple[int, Mask]]] = defaultdict(list)
    for fruit_id, views in seen.items():
        for _, name, mask in sorted(views, key=lambda view: (-view[0], view[1]))[:most_views]:
            shown[name].append((fruit_id, mask))
    return shown


def _inside(mask: Mask, step_px: float) -> FloatArray:
    """Return points (n, 2) of the photo inside a mask, `step_px` apart."""
    x, y = (
        np.arange(low, high, step_px) + step_px / 2
        for low, high in ((mask.box_px[0], mask.box_px[2]), (mask.box_px[1], mask.box_px[3]))
    )
    grid: FloatArray = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
    return grid[mask.contains(grid)]


def _on_sphere(
    cameras: Cameras, photo_idx: int, xy_px: FloatArray, center: FloatArray, radius_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return where rays through pixels (n, 2) first meet a sphere (m, 3), and which of them do (n,)."""
    eye = cameras.centers_in_world[photo_idx]
    rays = cameras.rays_in_world(photo_idx, xy_px)
    along = rays @ (center - eye)
    inside2 = radius_m**2 - (((center - eye) ** 2).sum() - along**2)
    met = inside2 > 0
    return eye + (along[met] - np.sqrt(inside2[met]))[:, None] * rays[met], met


def _colours(pixels: ByteArray, xy_px: FloatArray, width_px: int) -> ByteArray:
    columns, rows = (xy_px * pixels.shape[1] / width_px).astype(np.int64).T
    result: ByteArray = pixels[np.minimum(rows, pixels.shape[0] - 1), np.minimum(columns, pixels.shape[1] - 1)]
    return result
