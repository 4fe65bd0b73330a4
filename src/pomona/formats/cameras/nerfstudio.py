"""nerfstudio's and instant-ngp's `transforms.json`, with the sparse points in its PLY.

Source: https://docs.nerf.studio/quickstart/data_conventions.html and `nerfstudio/process_data/`. A frame has the pose
of its camera in the world; camera axes are OpenGL's (y up, looking along -z); lenses are in the file, or in each frame.
Pixels are COLMAP's. `applied_transform` and `applied_scale` are what nerfstudio did to the world that it was given:
here they are undone. The scale of the world is arbitrary, unless Pomona wrote the file and says so in `world_frame`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray
from pomona.basics.geometry import Similarity
from pomona.formats.cameras.fields import Field
from pomona.formats.cameras.format import CameraFormat
from pomona.formats.cameras.frames import frame_from_field
from pomona.formats.cameras.given import GivenCameras, shared
from pomona.formats.cameras.lenses import FittedLens, Lens, fit_lens
from pomona.formats.cameras.names import match_names
from pomona.formats.cameras.onto_photos import stored_size
from pomona.formats.cameras.poses import pose_from, rotation_from
from pomona.formats.ply_points import read_ply_points
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.photos import Photos

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0])
_PERSPECTIVE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
_FISHEYE = "OPENCV_FISHEYE"
_MODELS = (*_PERSPECTIVE, _FISHEYE)

_Size = tuple[int, int]


def read_nerfstudio(path: Path, photos: Photos) -> GivenCameras:
    """Read a `transforms.json`; `photos` give the size where the file does not, as in NeRF's own.

    Raises `MissingFileError`, and `FormatError` naming the field that is not what nerfstudio writes.
    """
    root = Field.of_file(path, "nerfstudio's transforms.json")
    frames = list(root.at("frames").items())
    names = [frame.at("file_path").text() for frame in frames]
    if not names or len(set(names)) < len(names):
        raise root.at("frames").error("frames, each of another file")
    fitted: dict[Lens, FittedLens] = {}
    kept, lenses = [], []
    for i, size_px in enumerate(_sizes(root, frames, names, photos)):
        if size_px is not None:
            lens = _lens(frames[i], root, size_px)
            if lens not in fitted:
                fitted[lens] = fit_lens(lens, f"{path}: {frames[i].place}")
            kept.append(i)
            lenses.append(fitted[lens].intrinsics)
    intrinsics, intrinsics_idx = shared(lenses)
    points, rgb = _points(root)
    ours = root.get("world_frame")
    cameras = Cameras(
        photos=tuple(names[i] for i in kept),
        intrinsics=intrinsics,
        intrinsics_idx=intrinsics_idx,
        cam_from_world=np.array([_pose(frames[i].at("transform_matrix")) for i in kept]).reshape(-1, 3, 4),
        points_in_world=points,
        points_rgb=rgb,
        points_error_px=np.full(len(points), np.nan),
        frame=WorldFrame() if ours is None else frame_from_field(ours),
    )
    notes = [lens.note(path.name) for lens in fitted.values()]
    if len(kept) < len(names):
        notes.append(
            f"{len(names) - len(kept)} of {len(names)} frames have no size in {path.name} and no photo that has one"
        )
    cameras = cameras.transformed(_nerfstudio_from_world(root).inverse())
    return GivenCameras(cameras, "nerfstudio", tuple(filter(None, notes)))


def _sizes(root: Field, frames: Sequence[Field], names: Sequence[str], photos: Photos) -> list[_Size | None]:
    """Each frame's size: by the file, or else by the photo; None where neither is there."""
    stated = [(_either(frame, root, "w"), _either(frame, root, "h")) for frame in frames]
    known = all(width is not None and height is not None for width, height in stated)
    of_photo = {} if known else {name: stored_size(photo) for name, photo in match_names(names, photos).items()}
    return [
        (width.whole(least=1), height.whole(least=1))
        if width is not None and height is not None
        else of_photo.get(name)
        for name, (width, height) in zip(names, stated, strict=True)
    ]


def _either(frame: Field, root: Field, key: str) -> Field | None:
    """An entry of a frame, or of the file where the frame has none."""
    return frame.get(key) or root.get(key)


def _lens(frame: Field, root: Field, size_px: tuple[int, int]) -> Lens:
    model = _either(frame, root, "camera_model")
    if model is not None and model.value not in _MODELS:
        raise model.error("one of " + ", ".join(_MODELS))
    flag = root.get("is_fisheye")
    fisheye = (model is not None and model.value == _FISHEYE) or (flag is not None and flag.value is True)
    width_px, height_px = size_px

    def number(key: str, default: float) -> float:
        field = _either(frame, root, key)
        return default if field is None else field.number()

    fx = number("fl_x", 0.0) or _focal(frame, root, "camera_angle_x", width_px)
    if fx is None:
        raise frame.error("'fl_x' or 'camera_angle_x' here or in the file")
    return Lens(
        width_px=width_px,
        height_px=height_px,
        fx=fx,
        fy=number("fl_y", 0.0) or _focal(frame, root, "camera_angle_y", height_px) or fx,
        cx=number("cx", width_px / 2),
        cy=number("cy", height_px / 2),
        radial=tuple(number(key, 0.0) for key in ("k1", "k2", "k3", "k4")),
        p1=0.0 if fisheye else number("p1", 0.0),
        p2=0.0 if fisheye else number("p2", 0.0),
        curve="equidistant" if fisheye else "perspective",
    )


def _focal(frame: Field, root: Field, key: str, size_px: int) -> float | None:
    """Pixels from the angle that the photo sees."""
    field = _either(frame, root, key)
    if field is None:
        return None
    angle = field.number()
    if not 0 < angle < np.pi:
        raise field.error("an angle between 0 and π")
    return float(size_px / 2 / np.tan(angle / 2))


def _pose(field: Field) -> FloatArray:
    """[R | t] from the world to the camera."""
    rows = len(field.value) if isinstance(field.value, list) else 0
    world_from_cam = field.numbers(3 if rows == 3 else 4, 4)
    rotation = rotation_from(world_from_cam[:3, :3], f"{field.path}: {field.place}")
    cam_from_world = OPENGL_FROM_OPENCV @ rotation.T
    return pose_from(cam_from_world, -cam_from_world @ world_from_cam[:3, 3])


def _nerfstudio_from_world(root: Field) -> Similarity:
    applied, scale = root.get("applied_transform"), root.get("applied_scale")
    factor = 1.0 if scale is None else scale.positive()
    if applied is None:
        return Similarity(factor, np.eye(3), np.zeros(3))
    rows = len(applied.value) if isinstance(applied.value, list) else 0
    matrix = applied.numbers(3 if rows == 3 else 4, 4)
    rotation = rotation_from(matrix[:3, :3], f"{applied.path}: {applied.place}")
    return Similarity(factor, rotation, factor * matrix[:3, 3])


def _points(root: Field) -> tuple[FloatArray, ByteArray]:
    field = root.get("ply_file_path")
    if field is None:
        return np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    return read_ply_points(root.path.parent / field.text())


FORMAT = CameraFormat(
    kind="nerfstudio",
    title="nerfstudio (transforms.json)",
    recognise=lambda file: file.has_key("frames"),
    read=read_nerfstudio,
    places=("transforms.json",),
    json_name="transforms.json",
    companions=lambda path: sorted(path.parent.glob("*.ply")),
)
