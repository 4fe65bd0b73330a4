"""Agisoft Metashape's (PhotoScan's) cameras as XML, by its File > Export > Export Cameras.

Source: Agisoft Metashape user manual, appendix "Camera models": camera axes are OpenCV's, the first pixel's centre is
(0.5, 0.5) as in COLMAP, cx and cy are counted from the photo's middle, x' = x (1 + K1 r² + … + K4 r⁸) + (P1 (r² + 2 x²)
+ 2 P2 x y) (1 + P3 r² + P4 r⁴), u = w / 2 + cx + x' f + x' B1 + y' B2: its P1, P2 are OpenCV's p2, p1. A camera's
`transform` leads from its axes into the chunk's; that of its component, or of the chunk, into the world, which is
geocentric where the chunk has a place on Earth. The file has neither points nor photos' paths: labels are file names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import Similarity
from pomona.formats.cameras.format import CameraFile, CameraFormat
from pomona.formats.cameras.given import GivenCameras, shared
from pomona.formats.cameras.lenses import Curve, FittedLens, Lens, fit_lens
from pomona.formats.cameras.metashape_frame import place_of
from pomona.formats.cameras.metashape_markers import check_markers
from pomona.formats.cameras.poses import pose_from, rotation_from
from pomona.formats.cameras.xml_fields import Element
from pomona.values.cameras import Cameras

_CURVES: dict[str, Curve] = {
    "frame": "perspective",
    "fisheye": "equidistant",
    "equidistant_fisheye": "equidistant",
    "equisolid_fisheye": "equisolid",
}


@dataclass(frozen=True, eq=False)
class _Camera:
    """An aligned camera: its pose in the chunk's own frame, and what leads from there into the world, if anything."""

    id: int
    label: str
    sensor_id: int
    cam_from_chunk: FloatArray
    component: str


def read_metashape(path: Path) -> GivenCameras:
    """Read the cameras of a chunk, in metres where it has been referenced.

    Raises `MissingFileError`, and `FormatError` naming the element that is not what Metashape writes.
    """
    chunk = _chunk(Element.of_file(path, "Metashape's cameras (XML)"))
    cameras, notes = _cameras(chunk)
    transforms = _transforms(chunk)
    cameras, world_from_chunk, more = _in_one_frame(cameras, transforms)
    lenses = {
        sensor_id: _lens(sensor_id, sensor)
        for sensor_id, sensor in _sensors(chunk).items()
        if any(camera.sensor_id == sensor_id for camera in cameras)
    }
    strangers = sorted({camera.sensor_id for camera in cameras} - lenses.keys())
    if strangers:
        raise chunk.at("sensors").error(f"sensor {strangers[0]}, which cameras name")
    intrinsics, intrinsics_idx = shared([lenses[camera.sensor_id].intrinsics for camera in cameras])
    read = Cameras(
        photos=tuple(camera.label for camera in cameras),
        intrinsics=intrinsics,
        intrinsics_idx=intrinsics_idx,
        cam_from_world=np.array([camera.cam_from_chunk for camera in cameras]),
    )
    notes += more + [lens.note(f"sensor {sensor_id}") for sensor_id, lens in lenses.items()]
    in_world = read if world_from_chunk is None else read.transformed(world_from_chunk)
    place = None if world_from_chunk is None else place_of(chunk, in_world.centers_in_world)
    if place is None:
        notes.append("nothing in the file gives the chunk a scale (no transform, or no reference coordinates)")
        return GivenCameras(in_world, "Metashape", tuple(filter(None, notes)))
    placed = in_world.transformed(place.local_from_world, place.frame)
    notes.append(check_markers(chunk, placed, {camera.id: i for i, camera in enumerate(cameras)}, place))
    return GivenCameras(placed, "Metashape", tuple(filter(None, notes)))


def _chunk(document: Element) -> Element:
    chunks = document.all("chunk")
    if document.tag != "document" or len(chunks) != 1:
        raise document.error(f"a document of one chunk (found {len(chunks)}): export the cameras of one chunk")
    return chunks[0]


def _cameras(chunk: Element) -> tuple[list[_Camera], list[str]]:
    """The cameras that are enabled and aligned, and notes of those that are not."""
    found = chunk.at("cameras").everywhere("camera")
    enabled = [camera for camera in found if camera.attribute("enabled", "true") not in ("false", "0")]
    aligned = [camera for camera in enabled if camera.get("transform") is not None]
    if not aligned:
        raise chunk.at("cameras").error("cameras with a transform: align the photos in Metashape first")
    notes = []
    if len(enabled) < len(found):
        notes.append(f"{len(found) - len(enabled)} cameras are disabled in Metashape and left out")
    if len(aligned) < len(enabled):
        notes.append(f"{len(enabled) - len(aligned)} of {len(enabled)} cameras were not aligned in Metashape")
    cameras = [_camera(camera) for camera in aligned]
    labels = [camera.label for camera in cameras]
    if len(set(labels)) < len(labels):
        twice = next(label for label in labels if labels.count(label) > 1)
        raise chunk.at("cameras").error(
            f"cameras of different labels, but '{twice}' is there twice: put folders into them"
        )
    return cameras, notes


def _camera(camera: Element) -> _Camera:
    label, transform = camera.attribute("label"), camera.at("transform")
    chunk_from_cam = transform.numbers(4, 4)
    if not np.allclose(chunk_from_cam[3], [0, 0, 0, 1]):
        raise transform.error("a transform whose last row is 0 0 0 1")
    rotation = rotation_from(chunk_from_cam[:3, :3], f"{transform.where} of {label}").T
    return _Camera(
        id=camera.whole("id"),
        label=label,
        sensor_id=camera.whole("sensor_id"),
        cam_from_chunk=pose_from(rotation, -rotation @ chunk_from_cam[:3, 3]),
        component=camera.attribute("component_id", ""),
    )


def _transforms(chunk: Element) -> Mapping[str, Similarity]:
    """What leads from each component's frame into the world; the chunk's own is that of components without one."""
    components = chunk.get("components")
    found = {c.attribute("id"): c.get("transform") for c in (components.all("component") if components else [])}
    of_chunk = chunk.get("transform")
    result = {"": _similarity(of_chunk)} if of_chunk is not None else {}
    for component_id, transform in found.items():
        similarity = _similarity(transform) if transform is not None else result.get("")
        if similarity is not None:
            result[component_id] = similarity
    return {key: similarity for key, similarity in result.items() if similarity is not None}


def _similarity(transform: Element) -> Similarity | None:
    """None where not all is there, as before a chunk is referenced."""
    rotation, translation, scale = (transform.get(name) for name in ("rotation", "translation", "scale"))
    if rotation is None or translation is None or scale is None:
        return None
    return Similarity(scale.positive(), rotation_from(rotation.numbers(3, 3), rotation.where), translation.numbers(3))


def _in_one_frame(
    cameras: Sequence[_Camera], transforms: Mapping[str, Similarity]
) -> tuple[list[_Camera], Similarity | None, list[str]]:
    """The cameras of one component, whose frame is known best: components have each a frame of their own."""
    components = {camera.component for camera in cameras}
    if len(components) == 1:  # or none, as old versions of Metashape write it
        (own,) = components
        return list(cameras), transforms.get(own, transforms.get("")), []
    known = {key for key in components if key in transforms}
    if known:
        main = max(sorted(known), key=lambda key: sum(camera.component == key for camera in cameras))
        kept = [_moved(camera, transforms, main) for camera in cameras if camera.component in known]
    else:
        main = max(sorted(components), key=lambda key: sum(camera.component == key for camera in cameras))
        kept = [camera for camera in cameras if camera.component == main]
    left_out = len(cameras) - len(kept)
    note = f"{left_out} cameras are of components that nothing ties to the others in Metashape, and left out"
    return kept, transforms.get(main), [note] if left_out else []


def _moved(camera: _Camera, transforms: Mapping[str, Similarity], main: str) -> _Camera:
    """The camera with its pose in the frame of component `main`."""
    main_from_own = transforms[main].inverse().compose(transforms[camera.component])
    rotation = camera.cam_from_chunk[:, :3] @ main_from_own.rotation.T
    translation = main_from_own.scale * camera.cam_from_chunk[:, 3] - rotation @ main_from_own.translation
    return _Camera(camera.id, camera.label, camera.sensor_id, pose_from(rotation, translation), main)


def _sensors(chunk: Element) -> Mapping[int, Element]:
    return {sensor.whole("id"): sensor for sensor in chunk.at("sensors").everywhere("sensor")}


def _lens(sensor_id: int, sensor: Element) -> FittedLens:
    kind = sensor.attribute("type", "frame")
    calibrations = {c.attribute("class", ""): c for c in sensor.all("calibration")}
    calibration = calibrations.get("adjusted") or calibrations.get("initial") or next(iter(calibrations.values()), None)
    if calibration is None:
        raise sensor.error(f"a calibration of sensor {sensor_id} (type {kind}), as the export of aligned cameras has")
    kind = calibration.attribute("type", kind)
    if kind not in _CURVES:
        raise calibration.error(f"a camera of type {', '.join(_CURVES)}, found {kind}: no perspective photo")
    resolution = calibration.get("resolution") or sensor.at("resolution")
    width_px, height_px = resolution.whole("width", least=1), resolution.whole("height", least=1)

    def number(name: str) -> float:
        found = calibration.get(name)
        return 0.0 if found is None else found.number()

    focal_px = calibration.at("f").positive()
    lens = Lens(
        width_px=width_px,
        height_px=height_px,
        fx=focal_px + number("b1"),
        fy=focal_px,
        cx=width_px / 2 + number("cx"),
        cy=height_px / 2 + number("cy"),
        radial=tuple(number(name) for name in ("k1", "k2", "k3", "k4")),
        p1=number("p2"),
        p2=number("p1"),
        prism=tuple(number(name) for name in ("p3", "p4")),
        skew=number("b2"),
        curve=_CURVES[kind],
    )
    return fit_lens(lens, calibration.where)


def _recognise(file: CameraFile) -> bool:
    return file.head.startswith("<") and ("<document" in file.head or file.path.suffix.lower() == ".xml")


FORMAT = CameraFormat(
    kind="metashape",
    title="Metashape (.xml)",
    recognise=_recognise,
    read=lambda path, photos: read_metashape(path),
    places=(),
    patterns=("*.xml",),
)
