"""The paper's method with true masks and true cameras: what dense and fuse lose by themselves.

python benchmarks/true_masks.py FOLDER [--cloud true] [--options printed|code] [--json FILE]

FOLDER holds images/ and truth/ as orchard-dev does. Scores are over all fruits and over the visible ones (at least
120 pixels in at least 2 photos). `--cloud true` lifts every mask pixel onto its true sphere instead of running dense:
what is lost then is lost by fuse. Each fruit that was not found, and each found fruit that is none, is named.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np

from pomona.cameras import Cameras, Intrinsics, WorldFrame
from pomona.dense import DenseOptions, fruit_cloud
from pomona.dense.depth_maps import thin
from pomona.detections import Detections, Mask, SurveyDetections
from pomona.evaluate import Truth, evaluate, read_truth, scores_table
from pomona.fruits import FruitCloud
from pomona.fuse import Fused
from pomona.fuse.paper import PaperOptions, fuse
from pomona.photos import Photo, Photos

_OPTIONS = {"default": PaperOptions, "printed": PaperOptions.as_printed, "code": PaperOptions.as_published_code}
# A network would not see less than this either.
_MIN_MASK_PX = 20


def read_row(folder: Path) -> tuple[Photos, SurveyDetections, Cameras, list[np.ndarray]]:
    """Photos, true masks and true cameras, and for each photo the true ids (h, w) of its pixels."""
    cameras = json.loads((folder / "truth" / "cameras.json").read_text())
    paths = {path.stem: path for path in sorted((folder / "images").iterdir())}
    names = [name for name in sorted(cameras) if name in paths]
    photos, by_photo, ids_of_pixels, next_id = [], {}, [], 1
    for name in names:
        camera, path = cameras[name], paths[name]
        ids = cv2.imread(str(folder / "truth" / "masks" / f"{name}.png"), cv2.IMREAD_UNCHANGED)
        ids_of_pixels.append(ids)
        values, counts = np.unique(ids[ids > 0], return_counts=True)
        masks = tuple(Mask.from_pixels(ids == value) for value in values[counts >= _MIN_MASK_PX])
        numbers = np.arange(next_id, next_id + len(masks))
        next_id += len(masks)
        side, (height, width) = name.split("_")[0], ids.shape
        photos.append(Photo(path.name, path, width, height, side=side, focal_px=camera["f"]))
        by_photo[path.name] = Detections(path.name, width, height, masks, np.ones(len(masks)), numbers)
    return (
        Photos(tuple(photos)),
        SurveyDetections(by_photo),
        _cameras(photos, [cameras[n] for n in names]),
        ids_of_pixels,
    )


def _cameras(photos: list[Photo], entries: list[dict]) -> Cameras:
    """True cameras: the principal point of `cx`, `cy` is in pixels from the photo's corner, as COLMAP's is."""
    intrinsics = tuple(
        Intrinsics("PINHOLE", e["width"], e["height"], np.array([e["f"], e["f"], e["cx"], e["cy"]])) for e in entries
    )
    poses = np.stack([np.c_[np.array(e["R"]), np.array(e["t"])] for e in entries])
    frame = WorldFrame("markers", approximate=False, up_is_known=True)
    return Cameras(tuple(p.name for p in photos), intrinsics, np.arange(len(photos)), poses, frame=frame)


def true_cloud(cameras: Cameras, ids_of_pixels: list[np.ndarray], truth: Truth, spacing_m: float) -> FruitCloud:
    """Every mask pixel lifted onto its true sphere."""
    place = {int(id_): k for k, id_ in enumerate(truth.ids)}
    parts = []
    for photo_idx, ids in enumerate(ids_of_pixels):
        rows, columns = np.nonzero(ids)
        k = np.array([place[int(id_)] for id_ in ids[rows, columns]])
        eye, rays = cameras.centers_in_world[photo_idx], cameras.rays_in_world(photo_idx, np.c_[columns, rows] + 0.5)
        to_center = truth.centers_in_world[k] - eye
        along = (to_center * rays).sum(1)
        under_root = along**2 - (to_center**2).sum(1) + (truth.diameters_m[k] / 2) ** 2
        depth = along - np.sqrt(np.maximum(under_root, 0))
        parts.append(eye + rays * depth[:, None])
    points, rgb = thin(np.concatenate(parts), np.zeros((sum(map(len, parts)), 3), np.uint8), spacing_m)
    return FruitCloud(points, rgb, np.zeros(len(points), np.int64))


def explain(fused: Fused, truth: Truth, cloud: FruitCloud) -> list[str]:
    """A line for each error over the visible fruits: what it is and what the cloud holds there."""
    tally = evaluate(fused.fruits, truth).visible
    assert tally is not None
    lines = []
    for outcome in tally.outcomes:
        if outcome.kind in ("matched", "hidden"):
            continue
        distance = np.linalg.norm(truth.centers_in_world - np.array(outcome.center_in_world), axis=1)
        if outcome.truth_id is not None:
            k = int(np.flatnonzero(truth.ids == outcome.truth_id)[0])
            radius = truth.diameters_m[k] / 2
            off = np.abs(np.linalg.norm(cloud.points_in_world - truth.centers_in_world[k], axis=1) - radius)
            seen = np.sort(truth.seen_px[truth.seen_id == outcome.truth_id])[::-1][:4].tolist()
            others = np.sort(distance)[1] / truth.diameters_m[k]
            on_surface = int((off < 0.15 * 2 * radius).sum())
            lines.append(
                f"{outcome.kind:7s} true {outcome.truth_id:4d}: {on_surface:5d} points on its surface, "
                f"seen with {seen} px, next fruit {others:.2f} diameters away"
            )
        else:
            k = int(np.flatnonzero(fused.fruits.ids == outcome.fruit_id)[0])
            points = int((fused.cloud.fruit_id == outcome.fruit_id).sum())
            nearest = int(distance.argmin())
            apart = distance[nearest] / truth.diameters_m[nearest]
            lines.append(
                f"{outcome.kind:7s} found {outcome.fruit_id:4d}: {points:5d} points, "
                f"{fused.fruits.views[k]:2d} photos, "
                f"diameter {1000 * fused.fruits.diameters_m[k]:.0f} mm, "
                f"{apart:.2f} diameters from true {truth.ids[nearest]}"
            )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cloud", choices=["dense", "true"], default="dense")
    parser.add_argument("--options", choices=list(_OPTIONS), default="default")
    parser.add_argument("--min-points", type=int, help="fruits with fewer points are dropped")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    from dataclasses import replace

    photos, detections, cameras, ids_of_pixels = read_row(asked.folder)
    truth = read_truth(asked.folder / "truth")
    options = _OPTIONS[asked.options]()
    if asked.min_points:
        options = replace(options, min_points=asked.min_points)
    start = time.perf_counter()
    if asked.cloud == "true":
        cloud = true_cloud(cameras, ids_of_pixels, truth, 0.075 / 40)
    else:
        cloud = fruit_cloud(photos, detections, cameras, options=DenseOptions())
    dense_s, start = time.perf_counter() - start, time.perf_counter()
    fused = fuse(detections, cameras, cloud, options=options)
    fuse_s = time.perf_counter() - start
    scores = evaluate(fused.fruits, truth)

    from rich.console import Console

    Console().print(scores_table(scores))
    print("\n".join(explain(fused, truth, cloud)))
    print(
        f"{len(cloud)} points; dense {dense_s / len(photos):.2f} s a photo, fuse {fuse_s / len(photos):.2f} s a photo"
    )
    if asked.json:
        asked.json.write_text(json.dumps(scores.to_json(), indent=1))


if __name__ == "__main__":
    sys.exit(main())
