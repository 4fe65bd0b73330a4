"""All formats of cameras. A new one is a module with a `CameraFormat`, and its line here."""

from __future__ import annotations

from pomona.formats.cameras import bundler_photos, colmap, metashape, nerfstudio, openmvg, opensfm
from pomona.formats.cameras.format import CameraFile, CameraFormat

CAMERA_FORMATS: tuple[CameraFormat, ...] = (
    colmap.FORMAT,
    bundler_photos.FORMAT,
    metashape.FORMAT,
    opensfm.FORMAT,
    nerfstudio.FORMAT,
    openmvg.FORMAT,
)


def recognised(file: CameraFile) -> CameraFormat | None:
    """Return the format of a file or folder, None where it is of none; raises `FormatError` where it cannot be read."""
    found = next((each for each in CAMERA_FORMATS if each.recognise(file)), None)
    if found is None and file.is_json:
        return next((each for each in CAMERA_FORMATS if each.json_name == file.path.name), None)
    return found
