"""OpenSfM's `reconstruction.json`, which OpenDroneMap keeps in `opensfm/`, with `tracks.csv` where it is beside it.

Source: https://opensfm.org/docs/geometry.html and `opensfm/io.py`. Pixels are normalised: counted from the photo's
middle in units of its longer side. Shots have a rotation vector and a translation from the world to the camera, whose
axes are OpenCV's. With GPS the world is metres east, north and up around `reference_lla`; without, its scale is
arbitrary.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pomona.basics.arrays import ByteArray, FloatArray
from pomona.formats.cameras.fields import Field
from pomona.formats.cameras.format import CameraFormat
from pomona.formats.cameras.given import GivenCameras
from pomona.formats.cameras.lenses import Curve, FittedLens, Lens, fit_lens
from pomona.formats.cameras.opensfm_tracks import Tracks, read_tracks
from pomona.formats.cameras.poses import pose_from
from pomona.values.cameras import Cameras, WorldFrame, concatenate, local_crs

_EXPECTED = "OpenSfM's reconstruction.json"
_TRACKS = "tracks.csv"


@dataclass(frozen=True)
class _Model:
    """How a projection type names its numbers: one focal length or two, an own principal point, coefficients."""

    centred: bool
    radial: tuple[str, ...]
    tangential: bool = False
    curve: Curve = "perspective"


_MODELS = {
    "perspective": _Model(True, ("k1", "k2")),
    "simple_radial": _Model(False, ("k1",)),
    "radial": _Model(False, ("k1", "k2")),
    "brown": _Model(False, ("k1", "k2", "k3"), tangential=True),
    "fisheye": _Model(True, ("k1", "k2"), curve="equidistant"),
    "fisheye_opencv": _Model(False, ("k1", "k2", "k3", "k4"), curve="equidistant"),
    "fisheye62": _Model(False, ("k1", "k2", "k3", "k4", "k5", "k6"), tangential=True, curve="equidistant"),
}


def read_opensfm(path: Path) -> GivenCameras:
    """Read a `reconstruction.json`: all its parts where GPS put them into one frame, else the one of the most photos.

    Raises `MissingFileError`, and `FormatError` naming the field that is not what OpenSfM writes.
    """
    parts = [part for part in Field.of_file(path, _EXPECTED).items() if len(list(part.at("shots").entries()))]
    if not parts:
        raise Field(path, "", []).error("a reconstruction with shots")
    frames = [_frame(part) for part in parts]
    parts.sort(key=lambda part: -len(part.at("shots").value))
    notes = []
    one_frame = all(frame.crs is not None and frame == frames[0] for frame in frames)
    if len(parts) > 1 and not one_frame:
        left_out = sum(len(part.at("shots").value) for part in parts[1:])
        notes.append(
            f"{path.name} has {len(parts)} parts that are not in one frame: the largest is used, and {left_out} photos "
            "of the others are not"
        )
        parts = parts[:1]
    frame = _frame(parts[0])
    tracks = read_tracks(path.with_name(_TRACKS))
    read = [_part(part, tracks, frame) for part in parts]
    notes += [note for _, part_notes in read for note in part_notes]
    return GivenCameras(concatenate([cameras for cameras, _ in read], frame), "OpenSfM", tuple(notes))


def _frame(part: Field) -> WorldFrame:
    place = part.get("reference_lla")
    if place is None:
        return WorldFrame()
    latitude, longitude, altitude = (place.number_at(key) for key in ("latitude", "longitude", "altitude"))
    if latitude == 0 and longitude == 0:  # what OpenSfM writes without GPS
        return WorldFrame()
    origin = (latitude, longitude, altitude)
    return WorldFrame("given", approximate=False, up_is_known=True, crs=local_crs(latitude, longitude), origin=origin)


def _part(part: Field, tracks: Tracks, frame: WorldFrame) -> tuple[Cameras, tuple[str, ...]]:
    lenses = {key: _lens(key, field) for key, field in part.at("cameras").entries()}
    order = {key: i for i, key in enumerate(lenses)}
    names, lens_idx, poses = [], [], []
    for name, shot in part.at("shots").entries():
        camera = shot.at("camera")
        if camera.text() not in order:
            raise camera.error("a key of 'cameras'")
        rotation = Rotation.from_rotvec(shot.at("rotation").numbers(3)).as_matrix()
        names.append(name)
        lens_idx.append(order[camera.text()])
        poses.append(pose_from(rotation, shot.at("translation").numbers(3)))
    point_ids, points, rgb = _points(part)
    intrinsics = tuple(lens.intrinsics for lens in lenses.values())
    point_idx, photo_idx, normalised = tracks.of(point_ids, names)
    sizes = np.array([[intrinsics[i].width_px, intrinsics[i].height_px] for i in lens_idx], float).reshape(-1, 2)
    cameras = Cameras(
        photos=tuple(names),
        intrinsics=intrinsics,
        intrinsics_idx=np.array(lens_idx, np.int64),
        cam_from_world=np.array(poses),
        points_in_world=points,
        points_rgb=rgb,
        points_error_px=np.full(len(points), np.nan),
        track_point_idx=point_idx,
        track_photo_idx=photo_idx,
        track_xy_px=normalised * sizes.max(1)[photo_idx][:, None] + sizes[photo_idx] / 2,
        frame=frame,
    )
    return cameras, tuple(filter(None, (lens.note(f"camera '{key}'") for key, lens in lenses.items())))


def _lens(key: str, field: Field) -> FittedLens:
    kind = field.at("projection_type")
    model = _MODELS.get(kind.value) if isinstance(kind.value, str) else None
    if model is None:
        raise kind.error("one of " + ", ".join(_MODELS))
    width_px, height_px = (field.at(name).whole(least=1) for name in ("width", "height"))
    size = max(width_px, height_px)
    if model.centred:
        focals, middle = (field.number_at("focal"),) * 2, (0.0, 0.0)
    else:
        focals = (field.number_at("focal_x"), field.number_at("focal_y"))
        middle = (field.number_at("c_x", 0.0), field.number_at("c_y", 0.0))
    lens = Lens(
        width_px=width_px,
        height_px=height_px,
        fx=focals[0] * size,
        fy=focals[1] * size,
        cx=middle[0] * size + width_px / 2,
        cy=middle[1] * size + height_px / 2,
        radial=tuple(field.number_at(name, 0.0) for name in model.radial),
        p1=field.number_at("p1", 0.0) if model.tangential else 0.0,
        p2=field.number_at("p2", 0.0) if model.tangential else 0.0,
        curve=model.curve,
    )
    return fit_lens(lens, f"{field.path}: cameras.{key}")


def _points(part: Field) -> tuple[Sequence[str], FloatArray, ByteArray]:
    field = part.get("points")
    entries = list(field.entries()) if field is not None else []
    places = np.array([point.at("coordinates").numbers(3) for _, point in entries]).reshape(-1, 3)
    colours = np.array([point.at("color").numbers(3) for _, point in entries]).reshape(-1, 3)
    return [key for key, _ in entries], places, np.clip(np.round(colours), 0, 255).astype(np.uint8)


FORMAT = CameraFormat(
    kind="opensfm",
    title="OpenSfM and OpenDroneMap (reconstruction.json)",
    recognise=lambda file: file.has_key("shots"),
    read=lambda path, photos: read_opensfm(path),
    places=("opensfm/reconstruction.json", "reconstruction.json"),
    json_name="reconstruction.json",
    companions=lambda path: [path.with_name(_TRACKS)] if path.with_name(_TRACKS).is_file() else [],
)
