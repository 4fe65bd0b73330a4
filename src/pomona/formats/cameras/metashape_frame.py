"""Where Metashape's world is: local metres, or geocentric metres of a chunk with a place on Earth (pyproj).

A chunk whose reference is a coordinate system of the Earth, geographic or projected, is geocentric inside: it becomes
metres east, north and up around its cameras. A chunk in local coordinates is in metres where anything gave it a scale.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import Similarity
from pomona.formats.cameras.xml_fields import Element
from pomona.values.cameras import WorldFrame, local_crs

_UNIT = re.compile(r'UNIT\[\s*"[^"]*"\s*,\s*([0-9.eE+-]+)')
_EARTH_RADIUS_M = (6.3e6, 6.4e6)


@dataclass(frozen=True, eq=False)
class ChunkPlace:
    """What leads from Metashape's world into ours, and what that means. `crs` is the reference system on Earth, if any.

    `unit_m` is the unit of reference coordinates where they are local.
    """

    local_from_world: Similarity
    frame: WorldFrame
    crs: CRS | None = None
    unit_m: float = 1.0

    def of_reference(self, places: FloatArray) -> FloatArray | None:
        """Return coordinates of the reference system (n, 3) as ours, None where heights need a geoid for that."""
        if self.crs is None:
            return self.local_from_world.apply(places * self.unit_m)
        if self.crs.is_compound:
            return None
        geocentric = _transformed(self.crs.to_3d(), _on_ellipsoid(self.crs, "geocent"), places)
        return self.local_from_world.apply(geocentric)


def place_of(chunk: Element, centers_in_world: FloatArray) -> ChunkPlace | None:
    """Return where the chunk is by its `<reference>`, None where nothing in the file gives it a scale.

    Raises `FormatError` where the reference system is not one that PROJ knows, or the cameras are not on Earth in it.
    """
    reference = chunk.get("reference")
    wkt = ((reference.node.text or "") if reference is not None else "").strip()
    if reference is not None and wkt and not wkt.upper().startswith("LOCAL_CS"):
        return _on_earth(reference, wkt, centers_in_world)
    if not _has_scale(chunk):
        return None
    unit = _UNIT.search(wkt)
    try:
        unit_m = float(unit.group(1)) if unit else 1.0
    except ValueError:
        unit_m = 0.0
    if reference is not None and not 1e-6 < unit_m < 1e6:
        raise reference.error(f"a local coordinate system with a unit of length, found '{wkt[:80]}'")
    return ChunkPlace(Similarity.identity(), WorldFrame("given", approximate=False, up_is_known=True), unit_m=unit_m)


def _has_scale(chunk: Element) -> bool:
    """Whether a camera or marker has reference coordinates, or a scale bar a length."""
    references = [
        reference
        for kind in ("camera", "marker", "scalebar")
        for element in chunk.everywhere(kind)
        if (reference := element.get("reference")) is not None
    ]
    enabled = [r for r in references if r.attribute("enabled", "true") not in ("false", "0")]
    given = [set(reference.node.attrib) for reference in enabled]
    return any({"x", "y", "z"} <= names or "distance" in names for names in given)


def _on_earth(reference: Element, wkt: str, centers_in_world: FloatArray) -> ChunkPlace:
    try:
        crs = CRS.from_wkt(wkt)
    except CRSError:
        crs = None
    if crs is None or crs.geodetic_crs is None:
        raise reference.error(f"a coordinate system that PROJ knows, found '{wkt[:80]}': choose WGS 84 in Metashape")
    center = np.median(centers_in_world, axis=0)
    if not _EARTH_RADIUS_M[0] < np.linalg.norm(center) < _EARTH_RADIUS_M[1]:
        raise reference.error("cameras on the Earth's surface, as the reference system says: update it in Metashape")
    longlat, geocent = _on_ellipsoid(crs, "longlat"), _on_ellipsoid(crs, "geocent")
    longitude, latitude, altitude = _transformed(geocent, longlat, center[None])[0].tolist()
    middle = np.array([round(longitude, 7), round(latitude, 7), round(altitude, 2)])
    rotation = _enu_from_geocentric(middle[1], middle[0])
    origin = _transformed(longlat, geocent, middle[None])[0]
    wgs84 = _transformed(crs.geodetic_crs, CRS.from_epsg(4326), middle[None])[0]
    on_earth = (round(float(wgs84[1]), 9), round(float(wgs84[0]), 9), float(middle[2]))
    frame = WorldFrame("given", approximate=False, up_is_known=True, crs=local_crs(*on_earth[:2]), origin=on_earth)
    return ChunkPlace(Similarity(1.0, rotation, -rotation @ origin), frame, crs=crs)


def _on_ellipsoid(crs: CRS, projection: str) -> CRS:
    """Geocentric or geographic coordinates of the reference system's own ellipsoid: no datum is changed."""
    ellipsoid = crs.ellipsoid
    assert ellipsoid is not None
    return CRS.from_dict({"proj": projection, "a": ellipsoid.semi_major_metre, "b": ellipsoid.semi_minor_metre})


def _transformed(source: CRS, target: CRS, places: FloatArray) -> FloatArray:
    """Coordinates (n, 3), east before north."""
    try:
        moved = Transformer.from_crs(source, target, always_xy=True).transform(*np.asarray(places, float).T.tolist())
    except ProjError:
        return np.full((len(places), 3), np.nan)
    return np.stack(moved, axis=1)


def _enu_from_geocentric(latitude_deg: float, longitude_deg: float) -> FloatArray:
    sin_lat, cos_lat = np.sin(np.radians(latitude_deg)), np.cos(np.radians(latitude_deg))
    sin_lon, cos_lon = np.sin(np.radians(longitude_deg)), np.cos(np.radians(longitude_deg))
    east, north = [-sin_lon, cos_lon, 0.0], [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat]
    return np.array([east, north, [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat]])


# As Metashape writes them.
_WGS84 = (
    'GEOGCS["WGS 84",DATUM["World Geodetic System 1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG",'
    '"7030"]],TOWGS84[0,0,0,0,0,0,0],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],'
    'UNIT["degree",0.01745329251994328,AUTHORITY["EPSG","9102"]],AUTHORITY["EPSG","4326"]]'
)
_LOCAL = 'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]]]'


@dataclass(frozen=True, eq=False)
class EarthlyWorld:
    """Our frame as Metashape's world: what leads there, and the reference system as WKT."""

    world_from_local: Similarity
    wkt: str

    @classmethod
    def of(cls, frame: WorldFrame) -> EarthlyWorld:
        """Return a world of local metres, or a geocentric one where the frame has a place on Earth."""
        if frame.crs is None or frame.origin is None:
            return cls(Similarity.identity(), _LOCAL)
        latitude, longitude, altitude = frame.origin
        crs = CRS.from_epsg(4326)
        place = np.array([[longitude, latitude, altitude]])
        origin = _transformed(_on_ellipsoid(crs, "longlat"), _on_ellipsoid(crs, "geocent"), place)[0]
        return cls(Similarity(1.0, _enu_from_geocentric(latitude, longitude).T, origin), _WGS84)

    def references(self, places_in_local: FloatArray) -> FloatArray:
        """Return places (n, 3) in the reference system: x, y, z, or longitude, latitude, height."""
        world = self.world_from_local.apply(places_in_local)
        if self.wkt == _LOCAL:
            return world
        crs = CRS.from_epsg(4326)
        return _transformed(_on_ellipsoid(crs, "geocent"), _on_ellipsoid(crs, "longlat"), world)
