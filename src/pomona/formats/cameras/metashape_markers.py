"""Metashape's markers as a check: do the cameras see them where their reference coordinates say?"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.formats.cameras.metashape_frame import ChunkPlace
from pomona.formats.cameras.xml_fields import Element
from pomona.values.cameras import Cameras


def check_markers(chunk: Element, cameras: Cameras, idx_of_camera: Mapping[int, int], place: ChunkPlace) -> str:
    """Say how far markers with reference coordinates are from where at least two photos see them; "" without any."""
    references = _references(chunk)
    seen = _seen(chunk, idx_of_camera)
    wanted = [marker for marker in references if len(seen.get(marker, [])) >= 2]
    expected = place.of_reference(np.array([references[marker] for marker in wanted]).reshape(-1, 3))
    if not wanted or expected is None or not np.isfinite(expected).all():
        return ""
    found = np.array([_triangulated(cameras, seen[marker]) for marker in wanted])
    if not np.isfinite(found).all():
        return "its markers are seen at pixels that no camera has, so that they are no check"
    off_mm = 1000 * np.linalg.norm(found - expected, axis=1)
    return (
        f"{len(wanted)} markers of Metashape are {np.median(off_mm):.1f} mm (median; {off_mm.max():.1f} mm at most) "
        "from their reference coordinates"
    )


def _references(chunk: Element) -> Mapping[int, list[float]]:
    """The coordinates of the markers that have some, by marker id."""
    markers = chunk.get("markers")
    found = {}
    for marker in markers.everywhere("marker") if markers is not None else []:
        reference = marker.get("reference")
        if reference is None or reference.attribute("enabled", "true") in ("false", "0"):
            continue
        if {"x", "y", "z"} <= set(reference.node.attrib):
            found[marker.whole("id")] = [reference.number_of(axis) for axis in "xyz"]
    return found


def _seen(chunk: Element, idx_of_camera: Mapping[int, int]) -> Mapping[int, list[tuple[int, FloatArray]]]:
    """Where photos see each marker: indices of cameras and pixels, by marker id."""
    frames = chunk.get("frames")
    found: dict[int, list[tuple[int, FloatArray]]] = {}
    for marker in frames.everywhere("marker") if frames is not None else []:
        for location in marker.all("location"):
            camera = idx_of_camera.get(location.whole("camera_id"))
            if camera is not None and location.attribute("valid", "1") not in ("0", "false"):
                xy_px = np.array([location.number_of("x"), location.number_of("y")])
                found.setdefault(marker.whole("marker_id"), []).append((camera, xy_px))
    return found


def _triangulated(cameras: Cameras, seen: list[tuple[int, FloatArray]]) -> FloatArray:
    """The point (3,) nearest to the rays; NaN where these are none."""
    normal, target = np.zeros((3, 3)), np.zeros(3)
    for camera, xy_px in seen:
        ray = cameras.rays_in_world(camera, xy_px[None])[0]
        across = np.eye(3) - np.outer(ray, ray)
        normal += across
        target += across @ cameras.centers_in_world[camera]
    if not np.isfinite([*normal.ravel(), *target]).all():
        return np.full(3, np.nan)
    return np.asarray(np.linalg.lstsq(normal, target, rcond=None)[0])
