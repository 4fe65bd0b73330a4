"""Writing nerfstudio's `transforms.json` and its sparse points: for radiance fields and Gaussian splatting.

The conventions are those of `nerfstudio.py`. The world stays the survey's own, metres and z up, and `world_frame` keeps
what it means; nerfstudio does not read that.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from pomona.formats.cameras.frames import frame_json
from pomona.formats.cameras.nerfstudio import OPENGL_FROM_OPENCV
from pomona.formats.cameras.onto_photos import as_stored
from pomona.formats.cameras.polynomial import polynomial_lens
from pomona.formats.ply import write_ply
from pomona.progress import Progress, Silent
from pomona.values.cameras import Cameras
from pomona.values.fruits import FruitCloud
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos

POINTS = "sparse_pc.ply"
_OF_SPLATFACTO = 3  # coefficients: it asserts that there are no more where it undistorts photos


def write_nerfstudio(folder: Path, cameras: Cameras, photos: Photos, progress: Progress | None = None) -> None:
    """Write `transforms.json` and `sparse_pc.ply` to `folder`, with paths to the photos relative to it.

    Photos without a file are named as if they lay in `images/` there; those on another drive of Windows, to which no
    relative path leads, by their whole path. `progress` is warned of lenses that splatfacto does not take.

    Raises `InputError` where a lens has no polynomial that is near enough.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = {photo.name: _path_from(folder, photo) for photo in photos}
    cameras = as_stored(cameras, photos)
    lenses = [_lens_json(lens, cameras.photos[0]) for lens in cameras.intrinsics]
    if any(lens["k4"] for lens in lenses):
        (progress or Silent()).warn(
            "nerfstudio's splatfacto does not take lenses with k4, and a lens needs it here: train it on undistorted "
            "photos, which COLMAP makes of the export `colmap`"
        )
    one = len(lenses) == 1
    frames = [
        {
            "file_path": paths[name],
            "transform_matrix": _world_from_cam(cameras, i),
            **({} if one else lenses[int(cameras.intrinsics_idx[i])]),
        }
        for i, name in enumerate(cameras.photos)
    ]
    content: dict[str, Any] = {**(lenses[0] if one else {}), "world_frame": frame_json(cameras.frame)}
    if len(cameras.points_in_world):
        content["ply_file_path"] = POINTS
        none = np.zeros(len(cameras.points_in_world), np.int64)
        write_ply(folder / POINTS, FruitCloud(cameras.points_in_world, cameras.points_rgb, none))
    text = json.dumps({**content, "frames": frames}, indent=1, ensure_ascii=False)
    (folder / "transforms.json").write_text(text + "\n", encoding="utf-8")


def _path_from(folder: Path, photo: Photo) -> str:
    if not photo.path.is_file():
        return f"images/{photo.name}"
    path = photo.path.resolve()
    try:
        return Path(os.path.relpath(path, folder.resolve())).as_posix()
    except ValueError:  # another drive
        return path.as_posix()


def _lens_json(intrinsics: Intrinsics, name: str) -> dict[str, Any]:
    lens = polynomial_lens(intrinsics, name, fewest=_OF_SPLATFACTO)
    return {
        "camera_model": "OPENCV",
        "w": lens.width_px,
        "h": lens.height_px,
        "fl_x": lens.fx,
        "fl_y": lens.fy,
        "cx": lens.cx,
        "cy": lens.cy,
        **{f"k{n}": k for n, k in enumerate(lens.radial, 1)},
        "p1": lens.p1,
        "p2": lens.p2,
    }


def _world_from_cam(cameras: Cameras, i: int) -> list[list[float]]:
    """4 × 4, camera axes OpenGL's."""
    matrix = np.eye(4)
    matrix[:3, :3] = cameras.cam_from_world[i, :, :3].T @ OPENGL_FROM_OPENCV
    matrix[:3, 3] = cameras.centers_in_world[i]
    rows: list[list[float]] = matrix.tolist()
    return rows
