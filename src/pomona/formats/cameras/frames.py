"""World frames in files: Pomona's own note of one, and places on Earth as other programs give them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

from pomona.cameras import ScaleSource, WorldFrame
from pomona.formats.cameras.fields import Field


def frame_json(frame: WorldFrame) -> Mapping[str, Any]:
    """Return the world frame as what `frame_from_field` reads."""
    return asdict(frame)


def parse_frame(path: Path) -> WorldFrame:
    """Read the world frame that is kept beside a model; raises `FormatError` when the file is something else."""
    return frame_from_field(Field.of_file(path, "the world frame of a survey"))


def frame_from_field(field: Field) -> WorldFrame:
    """Return the world frame of which a file holds the entries; raises `FormatError` naming the one that is wrong."""
    source, origin, crs = field.at("scale_source"), field.get("origin"), field.get("crs")
    if source.value not in get_args(ScaleSource):
        raise source.error("one of " + ", ".join(get_args(ScaleSource)))
    latitude, longitude, altitude = origin.numbers(3).tolist() if origin is not None else (0.0, 0.0, 0.0)
    return WorldFrame(
        scale_source=source.value,
        approximate=bool(field.at("approximate").value),
        up_is_known=bool(field.at("up_is_known").value),
        crs=None if crs is None else crs.text(),
        origin=None if origin is None else (latitude, longitude, altitude),
    )
