"""The data of the view: fruits, photos, points and where to look, bounded in size where a page has to carry them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.stages.report.axes import RowAxes, row_axes, scene_points, seen_from, sightings_idx
from pomona.stages.report.contract import (
    F32,
    U32,
    CorrectionState,
    DetectionColumns,
    EarlierFruits,
    FruitColumns,
    PhotoColumns,
    Source,
    SurveyData,
    TreePlaces,
    TruthData,
    ViewHints,
    packed,
    vector,
)
from pomona.stages.report.data import ReportData
from pomona.stages.report.options import ReportOptions
from pomona.stages.report.points import Box, packed_cloud, sampled, shown_box
from pomona.stages.report.seen import sightings
from pomona.values.cameras import Cameras

# So many points say how high the ground is; sorting more would only take longer.
_HEIGHTS = 500_000
# Sizes of the ground's cells in metres, from a single branch to a field: what a person can count in.
_GRIDS = (0.01, 0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """What beside the geometry goes into the data, and where the page finds the rest.

    A server is asked for sightings and detections; other pages carry them. `crops` are JPEGs by detection
    id; `files` names of resized photos by photo; `detections` are outlines. `max_points` None: all of them.
    `corrections` are what a person changed, where more can be changed. `photos_note` is told where a photo would be
    shown that is not there; `photos_version` is another one where photos or their cameras are others.
    """

    source: Source = "report"
    max_points: int | None = ReportOptions.max_points
    max_sightings: int = ReportOptions.max_sightings
    crops: dict[int, bytes] | None = None
    files: dict[str, str] | None = None
    detections: DetectionColumns | None = None
    truth: TruthData | None = None
    earlier: EarlierFruits | None = None
    corrections: CorrectionState | None = None
    photos_note: str = ""
    photos_version: str = ""


def origin_of(data: ReportData) -> FloatArray:
    """Return the middle (3,) of the scene, to which the view's positions are relative."""
    middle: FloatArray = np.median(scene_points(data), axis=0)
    return middle


def survey_data(data: ReportData, options: SceneOptions | None = None) -> SurveyData:
    """Return what the viewer shows; positions are relative to the middle of the scene.

    At most `max_points` points are kept, a fixed random sample of each of the scene's and the fruits' points.
    """
    options = options or SceneOptions()
    axes, middle = row_axes(data), origin_of(data)
    box = shown_box(data, middle)
    scene, fruit = sampled(data.cloud, box, options.max_points)
    hints = _view(data, axes, middle, box)
    return SurveyData(
        source=options.source,
        photos_note=options.photos_note,
        photos_version=options.photos_version,
        title=data.title,
        unit="m" if data.cameras.frame.metric else "units",
        metric=data.cameras.frame.metric,
        origin=vector(middle),
        scene=packed_cloud(data.cloud, scene, middle),
        fruit_points=packed_cloud(data.cloud, fruit, middle),
        fruits=_fruits(data, middle),
        photos=_photos(data, middle, options.files or {}),
        sightings=None
        if options.source == "server"
        else sightings(data, crops=options.crops or {}, most=options.max_sightings),
        detections=options.detections,
        trees=_trees(data, middle, hints.ground),
        view=hints,
        truth=options.truth,
        earlier=options.earlier,
        corrections=options.corrections,
        provisional=data.provisional,
    )


def _fruits(data: ReportData, middle: FloatArray) -> FruitColumns:
    fruits = data.fruits
    return FruitColumns(
        ids=fruits.ids.tolist(),
        centers=F32(packed(fruits.centers_in_world - middle, "<f4")),
        diameters=F32(packed(fruits.diameters_m, "<f4")),
        diameter_sds=F32(packed(fruits.diameter_sds_m, "<f4")),
        visibilities=F32(packed(fruits.visibilities, "<f4")),
        weights=F32(packed(fruits.weights_g, "<f4")),
        scores=F32(packed(fruits.scores, "<f4")),
        views=U32(packed(fruits.views, "<u4")),
        # Of one side, there is nothing to tell apart.
        sides=list(fruits.sides) if len(data.photos.sides) > 1 else [""] * len(fruits),
        trees=fruits.tree_ids.tolist(),
        reasons=list(fruits.reasons),
    )


def _frustum_depth(data: ReportData, middle: FloatArray) -> float:
    """How deep a drawn frustum is: a twentieth of the distance from which fruits were seen."""
    centers = data.cameras.centers_in_world
    if not len(centers):
        return 0.1
    _, fruit, camera = sightings_idx(data)
    from_camera = data.fruits.centers_in_world[fruit] - centers[camera] if len(fruit) else middle - centers
    return float(np.median(np.linalg.norm(from_camera, axis=1))) / 20


def _photos(data: ReportData, middle: FloatArray, files: dict[str, str]) -> PhotoColumns:
    cameras = data.cameras
    side_of = {photo.name: photo.side for photo in data.photos}
    lenses = [cameras.intrinsics_of(i) for i in range(len(cameras))]
    return PhotoColumns(
        names=list(cameras.photos),
        sides=[side_of.get(name, "") for name in cameras.photos],
        widths=[lens.width_px for lens in lenses],
        heights=[lens.height_px for lens in lenses],
        frusta=F32(packed(_frusta(cameras, middle, _frustum_depth(data, middle)), "<f4")),
        rotations=F32(packed(cameras.cam_from_world[:, :, :3], "<f4")),
        lenses=F32(packed(np.array([lens.opencv_params[:4] for lens in lenses]).reshape(-1, 4), "<f4")),
        files=[files.get(name, "") for name in cameras.photos],
    )


def _frusta(cameras: Cameras, middle: FloatArray, depth: float) -> FloatArray:
    """Five points a camera: the centre and the photo's corners at `depth`, without lens distortion."""
    corners = np.zeros((len(cameras), 5, 3))
    for i in range(len(cameras)):
        lens = cameras.intrinsics_of(i)
        fx, fy, cx, cy = lens.opencv_params[:4]
        x, y = np.array([0, lens.width_px, lens.width_px, 0]), np.array([0, 0, lens.height_px, lens.height_px])
        rays_in_cam = np.stack([(x - cx) / fx, (y - cy) / fy, np.ones(4)], axis=1)
        corners[i, 1:] = depth * rays_in_cam @ cameras.cam_from_world[i][:, :3]
    corners += (cameras.centers_in_world - middle)[:, None]
    return corners


def _trees(data: ReportData, middle: FloatArray, ground: float) -> TreePlaces:
    """Where trees stand; those of which no place is known are left out."""
    known = np.isfinite(data.trees.xy_in_world).all(axis=1)
    places = np.column_stack([data.trees.xy_in_world[known] - middle[:2], np.full(int(known.sum()), ground)])
    return TreePlaces(ids=data.trees.ids[known].tolist(), places=F32(packed(places, "<f4")))


def _view(data: ReportData, axes: RowAxes, middle: FloatArray, box: Box) -> ViewHints:
    points = scene_points(data)
    radius = float(np.percentile(np.linalg.norm(points - middle, axis=1), 98))
    if not radius > 0:
        radius = max(float(np.linalg.norm(box.high - box.low)) / 4, 1e-3)
    some = data.cloud.points_in_world[:: max(1, len(data.cloud) // _HEIGHTS)]
    inside = some[box.contains(some)]
    ground = float(np.percentile(inside[:, 2], 1)) if len(inside) else float(points[:, 2].min())
    along = axes.along_row(points - middle)
    heights = np.concatenate([inside[:, 2], points[:, 2]]) - middle[2]
    return ViewHints(
        radius=radius,
        toward=vector(seen_from(data, axes)),
        along=vector(axes.along),
        across=vector(axes.toward),
        row=(float(along.min()), float(along.max())),
        low=float(heights.min()),
        high=float(heights.max()),
        ground=ground - float(middle[2]),
        grid=next((grid for grid in _GRIDS if grid >= radius / 6), _GRIDS[-1]),
    )
