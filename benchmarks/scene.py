"""How near a dense scene is to true leaves, wood and fruits, and how much of them it has: for docs/lab/scene.md.

python benchmarks/scene.py SURVEY [--row demo|r00|r01] [--fruits fruits.csv] [--plane-sweep] [--options JSON]

SURVEY is of rendered photos, in the frame of their truth. With --row, the true surfaces are those of one of Pomona's
own rows, as its cameras see them; --fruits are true fruits of any. --plane-sweep compares patches (ZNCC) at all depths,
as the paper's method does inside masks, in place of semi-global matching.
"""

import json
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree

import pomona.stages.scene
from command_line import parser_of
from pomona.basics.arrays import FloatArray
from pomona.evaluate.fruits import read_truth
from pomona.fruit.geometry.cloud_points import fruit_of_points
from pomona.learning.synth.cameras import row_cameras
from pomona.learning.synth.layout import lay_out_row
from pomona.learning.synth.options import RowOptions
from pomona.learning.synth.presets import DEMO, ROWS
from pomona.learning.synth.quick.row import row_scene
from pomona.learning.synth.render import marker_cells
from pomona.stages.dense.atlas import pack
from pomona.stages.dense.correlation import MatchOptions, best_inverse_depth, sweep
from pomona.stages.dense.views import View
from pomona.stages.scene import DenseSceneOptions, dense_scene
from pomona.stages.scene.maps import SceneMap
from pomona.survey import SurveyFolder
from pomona.survey.reader import SurveyReader

_SAMPLE = 20_000


def true_surfaces(options: RowOptions) -> FloatArray:
    """Points of the row's true surfaces that some photo shows, 3 mm apart."""
    row = lay_out_row(options)
    scene = row_scene(row, marker_cells(row.plates), options, photo_idx=0)
    near = np.abs(scene.vertices[scene.triangles, 1]).max(1) < 1.0
    a, b, c = np.moveaxis(scene.vertices[scene.triangles[near], :3].astype(float), 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    rng = np.random.default_rng(0)
    count = rng.poisson(area / 0.003**2)
    u, v = rng.random((2, count.sum(), 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = (np.repeat(corner, count, axis=0) for corner in (a, b, c))
    points = a + u * (b - a) + v * (c - a)
    shown = np.zeros(len(points), bool)
    for camera in row_cameras(options):
        xy, depth = camera.project(points)
        cells = np.floor(xy / 2).astype(int)  # 2 × 2 pixels, wider than the points are apart
        size = camera.width_px // 2, camera.height_px // 2
        inside = np.flatnonzero((depth > 0) & (cells >= 0).all(1) & (cells < size).all(1))
        cell = cells[inside, 1] * size[0] + cells[inside, 0]
        nearest = np.full(size[0] * size[1], np.inf)
        np.minimum.at(nearest, cell, depth[inside])
        shown[inside[depth[inside] < nearest[cell] + 0.004]] = True
    return points[shown]


def by_plane_sweep(view: View, partners: Sequence[View], depth_m: float, options: DenseSceneOptions) -> SceneMap | None:
    """A map by comparing windows of 7 pixels at all depths, a pixel of parallax apart."""
    if not partners:
        return None
    whole = View(view.photo_idx, view.rgb, np.ones_like(view.label), view.matrix, view.cam_from_world)
    others = [View(p.photo_idx, p.rgb, np.ones_like(p.label), p.matrix, p.cam_from_world) for p in partners]
    centers = [-v.cam_from_world[:, :3].T @ v.cam_from_world[:, 3] for v in (whole, *others)]
    parallax = float(np.median([np.linalg.norm(c - centers[0]) for c in centers[1:]])) * view.matrix[0, 0]
    low, high = 1 / (2 * options.farthest * depth_m), 1 / (options.nearest * depth_m)
    inverse = np.linspace(low, high, int((high - low) * parallax) + 2).astype(np.float32)
    atlas = pack(whole, 0)
    scores = sweep(atlas, whole, others, 0.0, inverse, MatchOptions(window_px=7, best=1))
    best, score = best_inverse_depth(scores, 0.0, inverse)
    height, width = view.label.shape  # the atlas is wider
    known = np.where(score > 0.6, best, np.nan).astype(np.float32)[:height, :width]
    return SceneMap(view, known, np.zeros(known.shape, bool), options.agreement_px / parallax)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("survey", type=Path)
    parser.add_argument("--row", choices=["demo", *ROWS])
    parser.add_argument("--fruits", type=Path)
    parser.add_argument("--plane-sweep", action="store_true")
    parser.add_argument("--options", type=json.loads, default={})
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    survey = SurveyReader(SurveyFolder.open(arguments.survey))
    photos, cameras, detections = survey.photos, survey.cameras, survey.detections.at_least(survey.score_threshold)
    if arguments.plane_sweep:
        pomona.stages.scene.scene_map = by_plane_sweep
    began = time.process_time()
    cloud = dense_scene(photos, detections, cameras, options=DenseSceneOptions(**arguments.options))
    seconds = (time.process_time() - began) / len(cameras)
    print(f"{len(cloud)} points, {seconds:.2f} processor seconds a photo")
    rng, points = np.random.default_rng(0), cloud.points_in_world
    if arguments.row:
        true = true_surfaces({"demo": DEMO, **ROWS}[arguments.row])
        low, high = cameras.centers_in_world.min(0)[0], cameras.centers_in_world.max(0)[0]

        def of_row(p: FloatArray) -> FloatArray:
            """Beside the photographer's path, without the ground: a sample."""
            kept = p[(np.abs(p[:, 1]) < 0.95) & (p[:, 2] > 0.25) & (p[:, 0] > low) & (p[:, 0] < high)]
            return kept[rng.choice(len(kept), min(_SAMPLE, len(kept)), replace=False)]

        off = 1e3 * cKDTree(true).query(of_row(points))[0]
        gap = 1e3 * cKDTree(points).query(of_row(true))[0]
        shares = ", ".join(f"{(off < mm).mean():.3f} within {mm} mm" for mm in (5, 10, 20))
        print(f"to true surfaces: median {np.median(off):.1f} mm, {shares}, {(off > 50).mean():.3f} beyond 50 mm")
        print(f"surfaces with a point within 10 mm {(gap < 10).mean():.3f}, within 20 mm {(gap < 20).mean():.3f}")
    if arguments.fruits:
        truth = read_truth(arguments.fruits)
        labelled = points[fruit_of_points(points, survey.fruits) > 0]
        distance, nearest = cKDTree(truth.centers_in_world).query(labelled)
        off = 1e3 * np.abs(distance - truth.diameters_m[nearest] / 2)
        shares = ", ".join(f"{(off < mm).mean():.3f} within {mm} mm" for mm in (5, 10))
        print(f"{len(labelled)} points on fruits, to true spheres: median {np.median(off):.1f} mm, {shares}")


if __name__ == "__main__":
    main()
