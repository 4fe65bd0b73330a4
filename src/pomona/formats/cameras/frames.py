"""World frames in files: Pomona's own note of one, and places on Earth as other programs give them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

from pomona.formats.cameras.fields import Field
from pomona.values.cameras import ScaleSource, WorldFrame

FRAME_FILE = "frame.json"


def frame_json(frame: WorldFrame) -> Mapping[str, Any]:
    """Return the world frame as what `frame_from_field` reads."""
    return asdict(frame)


def read_frame(path: Path) -> tuple[WorldFrame, bool]:
    """Read the world frame beside a model, and whether its photos are upright: `{"scale_source": "given"}` says metres.

    Raises `FormatError` when the file is something else.
    """
    field = Field.of_file(path, "the world frame of a survey")
    upright = field.get("upright")
    return frame_from_field(field), upright is not None and upright.truth()


def frame_from_field(field: Field) -> WorldFrame:
    """Return the world frame of which a file holds the entries; raises `FormatError` naming the one that is wrong."""
    source, origin, crs = field.at("scale_source"), field.get("origin"), field.get("crs")
    approximate, up_is_known = field.get("approximate"), field.get("up_is_known")
    if source.value not in get_args(ScaleSource):
        raise source.error("one of " + ", ".join(get_args(ScaleSource)))
    latitude, longitude, altitude = origin.numbers(3).tolist() if origin is not None else (0.0, 0.0, 0.0)
    return WorldFrame(
        scale_source=source.value,
        approximate=source.value == "none" if approximate is None else approximate.truth(),
        up_is_known=source.value != "none" if up_is_known is None else up_is_known.truth(),
        crs=None if crs is None else crs.text(),
        origin=None if origin is None else (latitude, longitude, altitude),
    )
