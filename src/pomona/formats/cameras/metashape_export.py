"""Writing cameras that Agisoft Metashape imports (File > Import > Import Cameras, Agisoft XML).

The conventions are those of `metashape.py`. XML, rather than Bundler's format, as it alone keeps the principal point,
tangential distortion, metres and the place on Earth. Metashape finds photos by their labels, which it makes of the
files' names without suffix. Every camera has its place as a reference, so that an update in Metashape keeps the metres.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.formats.cameras.metashape_frame import EarthlyWorld
from pomona.formats.cameras.onto_photos import as_stored
from pomona.formats.cameras.polynomial import polynomial_lens
from pomona.values.cameras import Cameras
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photos


def write_metashape(path: Path, cameras: Cameras, photos: Photos) -> None:
    """Write the cameras as one chunk, geocentric where the survey has a place on Earth.

    Raises `InputError` where a lens has no polynomial that is near enough.
    """
    stored, orientations = as_stored(cameras, photos), {photo.name: photo.orientation for photo in photos}
    world = EarthlyWorld.of(cameras.frame)
    document = Element("document", version="1.5.0")
    chunk = SubElement(document, "chunk", label="Pomona", enabled="true")
    sensors = SubElement(chunk, "sensors", next_id=str(len(stored.intrinsics)))
    for i, lens in enumerate(stored.intrinsics):
        _sensor(sensors, i, lens)
    components = SubElement(chunk, "components", next_id="1", active_id="0")
    component = SubElement(components, "component", id="0", label="Component 1")
    _transform(component, world)
    partition = SubElement(component, "partition")
    SubElement(partition, "camera_ids").text = " ".join(map(str, range(len(stored))))
    found = SubElement(chunk, "cameras", next_id=str(len(stored)), next_group_id="0")
    references = world.references(cameras.centers_in_world)
    for i, label in enumerate(_labels(stored.photos)):
        camera = SubElement(found, "camera", id=str(i), sensor_id=str(int(stored.intrinsics_idx[i])), component_id="0")
        camera.set("label", label)
        SubElement(camera, "transform").text = _numbers(_world_from_cam(stored, i))
        SubElement(camera, "orientation").text = str(orientations.get(stored.photos[i], 1))
        x, y, z = (repr(value) for value in references[i].tolist())
        SubElement(camera, "reference", x=x, y=y, z=z, enabled="true")
    SubElement(chunk, "reference").text = world.wkt
    ElementTree.indent(document)
    ElementTree.ElementTree(document).write(path, encoding="utf-8", xml_declaration=True)


def _labels(names: Sequence[str]) -> list[str]:
    """File names without suffix, with their folders where two are the same."""
    stems = [PurePosixPath(name).stem for name in names]
    counts = Counter(stems)
    return [
        stem if counts[stem] == 1 else PurePosixPath(name).with_suffix("").as_posix()
        for name, stem in zip(names, stems, strict=True)
    ]


def _sensor(sensors: Element, number: int, intrinsics: Intrinsics) -> None:
    lens = polynomial_lens(intrinsics, f"sensor {number}")
    size = {"width": str(lens.width_px), "height": str(lens.height_px)}
    sensor = SubElement(sensors, "sensor", id=str(number), label=f"camera {number}", type="frame")
    SubElement(sensor, "resolution", size)
    SubElement(sensor, "property", name="layer_index", value="0")
    calibration = SubElement(sensor, "calibration", {"type": "frame", "class": "adjusted"})
    SubElement(calibration, "resolution", size)
    k1, k2, k3, k4 = lens.radial
    values = {
        "f": lens.fy, "cx": lens.cx - lens.width_px / 2, "cy": lens.cy - lens.height_px / 2, "b1": lens.fx - lens.fy,
        "k1": k1, "k2": k2, "k3": k3, "k4": k4, "p1": lens.p2, "p2": lens.p1,
    }  # fmt: skip
    for name, value in values.items():
        SubElement(calibration, name).text = repr(value)


def _transform(component: Element, world: EarthlyWorld) -> None:
    transform = SubElement(component, "transform")
    similarity = world.world_from_local
    values = {"rotation": similarity.rotation, "translation": similarity.translation, "scale": np.ones(1)}
    for name, value in values.items():
        SubElement(transform, name, locked="true").text = _numbers(value)


def _world_from_cam(cameras: Cameras, i: int) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3] = cameras.cam_from_world[i, :, :3].T
    matrix[:3, 3] = cameras.centers_in_world[i]
    return matrix


def _numbers(values: FloatArray) -> str:
    return " ".join(repr(value) for value in np.ravel(values).tolist())
