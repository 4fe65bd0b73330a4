"""The GPU engine: COLMAP's PatchMatch stereo (Schönberger et al. 2016), of which only fruit pixels are kept.

COLMAP is given a workspace made from the views: undistorted photos at working scale, pinhole cameras, and for each
photo the neighbours to compare it with. Its depth maps then pass the same check between views as the plane sweep's.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from pomona.basics.arrays import Array
from pomona.basics.gpu import own_signals
from pomona.errors import FormatError
from pomona.formats.cameras.colmap import write_colmap
from pomona.progress import Progress, track
from pomona.stages.dense.depth_maps import DepthMap, empty_map
from pomona.stages.dense.scene import StereoScene
from pomona.stages.dense.views import View
from pomona.values.cameras import Cameras
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos


@contextmanager
def depth_maps(scene: StereoScene, progress: Progress) -> Iterator[Callable[[int], DepthMap]]:
    """Run PatchMatch on all photos that have neighbours; give a function from photo index to depth map.

    The workspace is temporary and goes when the context is left.
    """
    with own_signals():
        import pycolmap

    with tempfile.TemporaryDirectory(prefix="pomona-patchmatch-") as name:
        folder = Path(name)
        write_workspace(scene, folder, progress)
        options = pycolmap.PatchMatchOptions()
        options.depth_min, options.depth_max = float(scene.ranges.near_m.min()), float(scene.ranges.far_m.max())
        options.geom_consistency = True
        progress.start("dense", None)
        pycolmap.patch_match_stereo(str(folder), options=options)

        def depth_map(photo_idx: int) -> DepthMap:
            path = folder / "stereo" / "depth_maps" / f"{image_name(photo_idx)}.geometric.bin"
            view = scene.view(photo_idx)
            return map_of_depths(view, read_array(path)) if path.is_file() else empty_map(view)

        yield depth_map


def image_name(photo_idx: int) -> str:
    """Return the name of a photo in the workspace."""
    return f"{photo_idx:06d}.png"


def write_workspace(scene: StereoScene, folder: Path, progress: Progress) -> None:
    """Write what COLMAP's dense stereo reads: images/, sparse/ and stereo/ with its configuration."""
    (folder / "images").mkdir(parents=True)
    for kind in ("depth_maps", "normal_maps", "consistency_graphs"):
        (folder / "stereo" / kind).mkdir(parents=True)
    photos, intrinsics, lines = [], [], []
    for i in track(range(len(scene.cameras)), progress, "dense"):
        view = scene.view(i)
        height, width = view.label.shape
        path = folder / "images" / image_name(i)
        cv2.imwrite(str(path), cv2.cvtColor(view.rgb, cv2.COLOR_RGB2BGR))
        photos.append(Photo(path.name, path, width, height))
        intrinsics.append(_pinhole(view))
        if len(scene.neighbours[i]):
            lines += [path.name, ", ".join(image_name(int(j)) for j in scene.neighbours[i])]
    (folder / "stereo" / "patch-match.cfg").write_text("\n".join(lines) + "\n")
    names = tuple(photo.name for photo in photos)
    poses = scene.cameras.cam_from_world
    cameras = Cameras(names, tuple(intrinsics), np.arange(len(names)), poses)
    write_colmap(folder / "sparse", cameras, Photos(tuple(photos)))


def _pinhole(view: View) -> Intrinsics:
    matrix, (height, width) = view.matrix, view.label.shape
    # From OpenCV's pixels, where the first one's centre is 0, to COLMAP's, where it is 0.5.
    params = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2] + 0.5, matrix[1, 2] + 0.5])
    return Intrinsics("PINHOLE", width, height, params)


def read_array(path: Path) -> Array:
    """Read one of COLMAP's depth maps, float32 (h, w): "width&height&channels&", then columns of the image's rows.

    Raises `FormatError` where the file is not one.
    """
    content = path.read_bytes()
    header = content.split(b"&", 3)
    try:
        width, height, channels = (int(number) for number in header[:3])
        depth: Array = np.frombuffer(header[3], "<f4").reshape(channels, height, width)[0]
        return depth
    except (ValueError, IndexError) as error:
        raise FormatError(f"{path}: expected a depth map of COLMAP (width&height&channels& and floats)") from error


def map_of_depths(view: View, depth_m: Array) -> DepthMap:
    """Keep the depths (h, w) of the view's fruit pixels; 0 is COLMAP's for none."""
    rows, columns = np.nonzero((view.label > 0) & (depth_m > 0))
    shape = (view.label.shape[0], view.label.shape[1])
    flat_idx = rows * shape[1] + columns
    rgb = view.rgb[rows, columns]
    return DepthMap(view.photo_idx, shape, view.matrix, view.cam_from_world, flat_idx, depth_m[rows, columns], rgb)
