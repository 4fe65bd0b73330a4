"""A cloud as binary PLY, for programs that do not read LAS."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pomona.values.fruits import FruitCloud

_PROPERTIES = (
    ("x", "<f8", "double"), ("y", "<f8", "double"), ("z", "<f8", "double"),
    ("red", "u1", "uchar"), ("green", "u1", "uchar"), ("blue", "u1", "uchar"), ("fruit_id", "<i4", "int"),
)  # fmt: skip


def write_ply(path: Path, cloud: FruitCloud) -> None:
    """Write points (metres), colours and fruit ids (0: none) as little-endian PLY."""
    vertices = np.empty(len(cloud), [(name, kind) for name, kind, _ in _PROPERTIES])
    for k, name in enumerate("xyz"):
        vertices[name] = cloud.points_in_world[:, k]
    for k, name in enumerate(("red", "green", "blue")):
        vertices[name] = cloud.rgb[:, k]
    vertices["fruit_id"] = cloud.fruit_id
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}"]
    lines += [f"property {kind} {name}" for name, _, kind in _PROPERTIES]
    with path.open("wb") as file:
        file.write(("\n".join([*lines, "end_header"]) + "\n").encode())
        file.write(vertices.tobytes())
