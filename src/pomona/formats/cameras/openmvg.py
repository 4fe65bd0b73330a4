"""OpenMVG's `sfm_data.json`: pinhole cameras without distortion, with k1 or k1 to k3, with Brown's, and fisheyes.

Source: https://openmvg.readthedocs.io/en/latest/software/SfM/SfM_OutputFormat/ and `src/openMVG/cameras/`. A pose is a
rotation from the world to the camera and the camera's centre; axes are OpenCV's. Distortion is added to ideal pixels,
as in OpenCV, with T1, T2 its p1, p2. Photos are sampled at whole numbers, so that the first pixel's centre is (0, 0):
half a pixel less than COLMAP's. The scale of the world is arbitrary.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePosixPath

import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray, IntArray
from pomona.formats.cameras.fields import Field
from pomona.formats.cameras.format import CameraFormat
from pomona.formats.cameras.given import GivenCameras
from pomona.formats.cameras.lenses import Curve, FittedLens, Lens, fit_lens
from pomona.formats.cameras.poses import pose_from, rotation_from
from pomona.values.cameras import Cameras

_HALF_PX = 0.5
# By OpenMVG's names of its lenses: where the coefficients are, how many there are (k…, then t1 t2), and the curve.
_MODELS: dict[str, tuple[str, int, int, Curve]] = {
    "pinhole": ("", 0, 0, "perspective"),
    "pinhole_radial_k1": ("disto_k1", 1, 0, "perspective"),
    "pinhole_radial_k3": ("disto_k3", 3, 0, "perspective"),
    "pinhole_brown_t2": ("disto_t2", 3, 2, "perspective"),
    "fisheye": ("fisheye", 4, 0, "equidistant"),
}
# The archive's mark of what is written in full; later it is named by its number alone.
_FIRST = 2**31


def read_openmvg(path: Path) -> GivenCameras:
    """Read a `sfm_data.json` with its poses.

    Raises `MissingFileError`, and `FormatError` naming the field that is not what OpenMVG writes.
    """
    root = Field.of_file(path, "OpenMVG's sfm_data.json")
    archive = _Archive()
    views = {_key(entry): archive.data(entry.at("value")) for entry in root.at("views").items()}
    lenses = {_key(entry): _lens(entry, archive) for entry in root.at("intrinsics").items()}
    poses = {_key(entry): _pose(entry.at("value")) for entry in root.at("extrinsics").items()}
    used = {key: view for key, view in views.items() if _number(view, "id_pose") in poses}
    if not used:
        raise root.at("extrinsics").error("poses of views (of a reconstruction, not of the list of photos)")
    folder = PurePosixPath(str(root.value.get("root_path") or "").replace("\\", "/"))
    order, lens_order = {key: i for i, key in enumerate(used)}, {key: i for i, key in enumerate(lenses)}
    points, rgb, tracks = _structure(root.get("structure"), order)
    names, lens_idx = [], []
    for view in used.values():
        lens_id = _number(view, "id_intrinsic")
        if lens_id not in lens_order:
            raise view.at("id_intrinsic").error("a key of 'intrinsics'")
        local = view.get("local_path")
        names.append(str(folder / (str(local.value) if local is not None else "") / view.at("filename").text()))
        lens_idx.append(lens_order[lens_id])
    cameras = Cameras(
        photos=tuple(names),
        intrinsics=tuple(lens.intrinsics for lens in lenses.values()),
        intrinsics_idx=np.array(lens_idx, np.int64),
        cam_from_world=np.array([poses[_number(view, "id_pose")] for view in used.values()]),
        points_in_world=points,
        points_rgb=rgb,
        points_error_px=np.full(len(points), np.nan),
        track_point_idx=tracks[0],
        track_photo_idx=tracks[1],
        track_xy_px=tracks[2] + _HALF_PX,
    )
    notes = tuple(filter(None, (lens.note(f"intrinsic {key}") for key, lens in lenses.items())))
    if len(used) < len(views):
        notes = (*notes, f"{len(views) - len(used)} of {len(views)} views of {path.name} have no pose")
    return GivenCameras(cameras, "OpenMVG", notes)


class _Archive:
    """What an archive of the cereal library wrote in full once and names by number from then on."""

    def __init__(self) -> None:
        self._kinds: dict[int, str] = {}
        self._data: dict[int, Field] = {}

    def kind(self, value: Field) -> str:
        """The name of a lens's class."""
        number = value.at("polymorphic_id").whole()
        name = value.get("polymorphic_name")
        if name is not None:
            self._kinds[number % _FIRST] = name.text()
        if number % _FIRST not in self._kinds:
            raise value.at("polymorphic_id").error("the number of a kind that was named before")
        return self._kinds[number % _FIRST]

    def data(self, value: Field) -> Field:
        """The object that a pointer points to."""
        pointer = value.at("ptr_wrapper")
        number, data = pointer.at("id").whole(), pointer.get("data")
        if data is not None:
            self._data[number % _FIRST] = data
        if number % _FIRST not in self._data:
            raise pointer.at("id").error("the number of an object that was written before")
        return self._data[number % _FIRST]


def _key(entry: Field) -> int:
    return entry.at("key").whole()


def _number(view: Field, key: str) -> int:
    return view.at(key).whole()


def _lens(entry: Field, archive: _Archive) -> FittedLens:
    value = entry.at("value")
    kind, data = archive.kind(value), archive.data(value)
    if kind not in _MODELS:
        raise value.at("polymorphic_id").error(f"one of {', '.join(_MODELS)} (it is {kind})")
    where, radial, tangential, curve = _MODELS[kind]
    pinhole = data.get("value0") or data
    k = data.at(where).numbers(radial + tangential).tolist() if where else []
    focal_px, middle = pinhole.at("focal_length").positive(), pinhole.at("principal_point").numbers(2) + _HALF_PX
    t1, t2 = k[radial:] if tangential else (0.0, 0.0)
    lens = Lens(
        width_px=pinhole.at("width").whole(least=1),
        height_px=pinhole.at("height").whole(least=1),
        fx=focal_px,
        fy=focal_px,
        cx=float(middle[0]),
        cy=float(middle[1]),
        radial=tuple(k[:radial]),
        p1=t1,
        p2=t2,
        curve=curve,
    )
    return fit_lens(lens, f"{entry.path}: {entry.place}")


def _pose(value: Field) -> FloatArray:
    field = value.at("rotation")
    rotation = rotation_from(field.numbers(3, 3), f"{field.path}: {field.place}")
    return pose_from(rotation, -rotation @ value.at("center").numbers(3))


def _structure(
    field: Field | None, order: Mapping[int, int]
) -> tuple[FloatArray, ByteArray, tuple[IntArray, IntArray, FloatArray]]:
    places: list[FloatArray] = []
    point_idx: list[int] = []
    photo_idx: list[int] = []
    xy: list[FloatArray] = []
    for entry in field.items() if field is not None else ():
        value = entry.at("value")
        places.append(value.at("X").numbers(3))
        for observation in value.at("observations").items():
            photo = order.get(_key(observation))
            if photo is not None:
                point_idx.append(len(places) - 1)
                photo_idx.append(photo)
                xy.append(observation.at("value").at("x").numbers(2))
    points = np.array(places).reshape(-1, 3)
    grey = np.full((len(points), 3), 128, np.uint8)  # the file has no colours
    tracks = (np.array(point_idx, np.int64), np.array(photo_idx, np.int64), np.array(xy).reshape(-1, 2))
    return points, grey, tracks


FORMAT = CameraFormat(
    kind="openmvg",
    title="OpenMVG (sfm_data.json)",
    recognise=lambda file: file.has_key("sfm_data_version"),
    read=lambda path, photos: read_openmvg(path),
    places=("sfm_data.json", "reconstruction/sfm_data.json"),
    json_name="sfm_data.json",
)
