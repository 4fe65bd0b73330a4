"""Write a survey in the form that the paper's authors' program reads (github.com/GRAP-UdL-AT/SfM_3D_fruit_detection).

python benchmarks/octave/write_survey.py SURVEY OUT

SURVEY is a folder of `pomona run --method paper`, of photos of two sides. OUT/data gets the cameras and tie points
(Bundler), the cloud before it is cut into fruits, and a label image with scores a photo. Names are the program's own:
the first side is its west. It takes the n-th photo by name for the n-th camera, so that photos are numbered here.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.io import savemat

from pomona.errors import InputError, MissingFileError
from pomona.formats.cameras.colmap import read_colmap
from pomona.formats.detections.coco import read_coco
from pomona.formats.xyz import write_xyz
from pomona.survey import SurveyFolder
from pomona.survey.values import columns_from, read_arrays
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections
from pomona.values.fruits import FruitCloud
from pomona.values.photos import Photos

SIDES = ("west", "east")
FLIP = np.diag([1.0, -1.0, -1.0])  # from OpenCV's camera axes to Bundler's


def bundler_lines(cameras: Cameras, photo_idx: Sequence[int]) -> Iterator[str]:
    """The cameras of some photos and the points that two of them see, as Bundler's text."""
    order = {photo: k for k, photo in enumerate(photo_idx)}
    here = np.isin(cameras.track_photo_idx, list(order))
    points, views = np.unique(cameras.track_point_idx[here], return_counts=True)
    kept = points[views >= 2]
    yield "# Bundle file v0.3"
    yield f"{len(order)} {len(kept)}"
    for photo in photo_idx:
        lens, pose = cameras.intrinsics_of(photo), cameras.cam_from_world[photo]
        k1, k2 = lens.distortion[:2]
        yield f"{lens.focal_px:.6f} {k1:.8f} {k2:.8f}"
        for row in (*(FLIP @ pose[:, :3]), FLIP @ pose[:, 3]):
            yield " ".join(f"{v:.10f}" for v in row)
    by_point: dict[int, list[int]] = {int(point): [] for point in kept}
    for k in np.flatnonzero(here):
        by_point.get(int(cameras.track_point_idx[k]), []).append(int(k))
    for point, of_point in by_point.items():
        yield " ".join(f"{v:.6f}" for v in cameras.points_in_world[point])
        yield " ".join(str(v) for v in cameras.points_rgb[point])
        seen = [f"{order[int(cameras.track_photo_idx[k])]} {point} {from_middle(cameras, k)}" for k in of_point]
        yield " ".join([str(len(seen)), *seen])


def from_middle(cameras: Cameras, k: int) -> str:
    lens = cameras.intrinsics_of(int(cameras.track_photo_idx[k]))
    x, y = cameras.track_xy_px[k]
    return f"{x - lens.width_px / 2:.4f} {lens.height_px / 2 - y:.4f}"


def label_image(found: Detections) -> tuple[np.ndarray, np.ndarray]:
    """Labels from 1 (h, w), surer detections over others, and the scores of all labels."""
    labels = np.zeros((found.height_px, found.width_px), np.uint16)
    for k in np.argsort(found.scores, kind="stable"):
        mask = found.masks[k]
        part = labels[mask.y_px : mask.y_px + mask.height_px, mask.x_px : mask.x_px + mask.width_px]
        part[mask.pixels] = k + 1
    return labels, found.scores.astype(np.float32)


def write(survey: SurveyFolder, out: Path) -> None:
    cloud_file = survey.work("dense.npz")
    if not cloud_file.is_file():
        raise MissingFileError(
            f"{cloud_file} does not exist: run `pomona run PHOTOS --out SURVEY --method paper` first"
        )
    cameras = read_colmap(survey.cameras)
    noted = survey.get("photos")
    sides = {photo["name"]: photo["side"] for photo in noted}
    names = tuple(dict.fromkeys(sides[photo] for photo in cameras.photos))
    if len(names) != len(SIDES):
        raise InputError(f"{survey.folder}: expected photos of two sides, found {', '.join(names) or 'none'}")
    detections = read_coco(survey.detections, photos_of(survey))
    cloud = columns_from(FruitCloud, read_arrays(cloud_file))
    for name in ("camaras", "pt_clouds", *(f"masks/{side}_side_masks" for side in SIDES)):
        (out / "data" / name).mkdir(parents=True, exist_ok=True)
    for side, ours in zip(SIDES, names, strict=True):
        of_side = [k for k, photo in enumerate(cameras.photos) if sides[photo] == ours]
        text = "\n".join(bundler_lines(cameras, of_side)) + "\n"
        (out / "data" / "camaras" / f"{side}_side_cameras.out").write_text(text)
        for number, k in enumerate(of_side):
            labels, scores = label_image(detections[cameras.photos[k]])
            path = out / "data" / "masks" / f"{side}_side_masks" / f"photo_{number:04d}.mat"
            savemat(path, {"mask": labels, "scores": scores})
    # The program reads both clouds as one; whose side a point is of does not matter.
    half = np.arange(len(cloud)) < len(cloud) // 2
    for side, own in zip(SIDES, (half, ~half), strict=True):
        part = replace(
            cloud, points_in_world=cloud.points_in_world[own], rgb=cloud.rgb[own], fruit_id=cloud.fruit_id[own],
            detections=cloud.detections[own], scores=cloud.scores[own],
        )  # fmt: skip
        write_xyz(out / "data" / "pt_clouds" / f"{side}_side_pc.txt", part)


def photos_of(survey: SurveyFolder) -> Photos:
    from pomona.stages.capture import load_photos

    sources = [Path(source) for source in survey.get("sources")]
    return load_photos(sources, sides=survey.get("options")["sides"], frames_dir=survey.work("frames"), min_photos=1)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("survey", type=Path)
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    write(SurveyFolder.open(arguments.survey), arguments.out)


if __name__ == "__main__":
    main()
