"""Hard sets of photos with exact truth, made of rendered rows: for `benchmarks/camera_bed.py`.

A row is read as shots (pixels, fruit ids, true camera, what EXIF says); each case changes the shots, the table of
markers, or both, and is written as the folder of a rendered row. The same case is the same to the last bit.
"""

import csv
import json
import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from pomona.basics.arrays import Array, ByteArray
from pomona.learning.synth import RowOptions
from pomona.learning.synth.cameras import RowCamera
from pomona.learning.synth.truth import (
    Ids,
    RowFolder,
    read_cameras,
    read_mask,
    write_cameras,
    write_mask,
    write_masks_as_coco,
    write_visible_pixels,
)

_WALK = RowOptions(
    seed=7100, trees=2, spacing_m=1.1, fruits_per_tree=45, light="sun", sun_azimuth_deg=150.0, photos_per_side=10,
    photos_round_end=13, step_m=0.3, distance_m=2.2, marker_offset_m=0.7, camera_height_m=1.6, width_px=720,
    height_px=1080, focal_35mm=36, rough=True,
)  # fmt: skip
SCENES = {
    "walk": _WALK,
    "walk-wind": replace(_WALK, wind_m=0.004, width_px=360, height_px=540),
    "walk-near-markers": replace(_WALK, distance_m=2.1, marker_offset_m=1.05),  # so near that photos seldom hold them
    "video": replace(
        _WALK, seed=7102, photos_per_side=30, photos_round_end=30, step_m=0.1, width_px=400, height_px=600,
    ),
    "sides": replace(
        _WALK, seed=7101, photos_round_end=0, photos_per_side=9, step_m=0.35, light="overcast", width_px=360,
        height_px=540,
    ),
}  # fmt: skip
"""Rendered where they are not there yet."""


@dataclass(frozen=True, eq=False)
class Shot:
    """One photo: `pixels` (h, w, 3), fruit ids (h, w), its true camera; `focal_35mm` None: no EXIF."""

    name: str
    pixels: ByteArray
    ids: Ids
    camera: RowCamera
    focal_35mm: float | None
    model: str = "Bed A"


Markers = list[dict[str, float]]  # rows of markers.csv


@dataclass(frozen=True)
class Case:
    """One set of photos. `fault` is what a warning must contain where the input is wrong (a regular expression).

    `others`: a row of which five photos lie among these; `given`: the true cameras are given as such a file; `plates`:
    the table of markers says how large they are and where they face, too.
    """

    row: str
    shots: Callable[[list[Shot], np.random.Generator], list[Shot]] = lambda shots, rng: shots
    markers: Callable[[Markers], Markers] = lambda markers: markers
    fault: str | None = None
    others: str | None = None
    given: str | None = None
    plates: bool = False
    width_px: int = 360


# ---- changes of shots ------------------------------------------------------------------------------------------------


def scaled(shot: Shot, factor: float) -> Shot:
    """The photo at another size."""
    size = round(shot.camera.width_px * factor), round(shot.camera.height_px * factor)
    how = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    pixels = cv2.resize(shot.pixels, size, interpolation=how)
    ids = resized_ids(shot.ids, size)
    camera = replace(shot.camera, focal_px=shot.camera.focal_px * factor, width_px=size[0], height_px=size[1])
    return replace(shot, pixels=np.asarray(pixels, np.uint8), ids=ids, camera=camera)


def resized_ids(ids: Array, size: tuple[int, int]) -> Array:
    """Ids in a photo of another size: of each pixel, the fruit that covers most of it, if that is half.

    The nearest pixel is not in the middle: in a photo half as large it moves all masks by a quarter of a pixel.
    """
    if size[0] >= ids.shape[1]:
        return np.asarray(cv2.resize(ids, size, interpolation=cv2.INTER_NEAREST_EXACT))
    resized = np.zeros(size[::-1], ids.dtype)
    # Where an edge runs through the middles of pixels, every other one is the fruit's: masks stay as large as they are.
    most = 0.5 + 1e-3 * (-1.0) ** np.indices(size[::-1]).sum(0)
    for fruit in np.unique(ids[ids > 0]):
        share = cv2.resize((ids == fruit).astype(np.float32), size, interpolation=cv2.INTER_AREA)
        here = share > most
        resized[here], most[here] = fruit, share[here]
    return resized


def cropped(shot: Shot, left_px: int, top_px: int, width_px: int, height_px: int, *, enlarged: bool) -> Shot:
    """A part of the photo, as small as it is or `enlarged` to the size of the whole; EXIF says nothing of it."""
    h, w = shot.ids.shape
    part = slice(top_px, top_px + height_px), slice(left_px, left_px + width_px)
    pixels, ids = shot.pixels[part], shot.ids[part]
    camera = replace(shot.camera, width_px=width_px, height_px=height_px)
    if enlarged:
        pixels = np.asarray(cv2.resize(pixels, (w, h), interpolation=cv2.INTER_CUBIC))
        ids = resized_ids(ids, (w, h))
        camera = replace(shot.camera, focal_px=shot.camera.focal_px * w / width_px)
    return replace(shot, pixels=pixels.copy(), ids=ids.copy(), camera=camera)


def zoomed(shot: Shot, factor: float, *, told: bool, model: str = "Bed A") -> Shot:
    """The middle of the photo as large as the whole; `told` says whether EXIF has the new focal length."""
    h, w = shot.ids.shape
    dy, dx = round(h * (1 - 1 / factor) / 2), round(w * (1 - 1 / factor) / 2)
    exact = w / (w - 2 * dx)
    part = slice(dy, h - dy), slice(dx, w - dx)
    pixels = cv2.resize(shot.pixels[part], (w, h), interpolation=cv2.INTER_CUBIC)
    ids = resized_ids(shot.ids[part], (w, h))
    focal = shot.focal_35mm and (shot.focal_35mm * exact if told else shot.focal_35mm)
    camera = replace(shot.camera, focal_px=shot.camera.focal_px * exact)
    return replace(shot, pixels=np.asarray(pixels), ids=ids, camera=camera, focal_35mm=focal, model=model)


def sideways(shot: Shot) -> Shot:
    """The photo as a camera held on its side takes it."""
    camera, turn = shot.camera, np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    turned = replace(
        camera,
        rotation_cam_from_world=turn @ camera.rotation_cam_from_world,
        translation_m=turn @ camera.translation_m,
        width_px=camera.height_px,
        height_px=camera.width_px,
    )
    return replace(shot, pixels=np.rot90(shot.pixels).copy(), ids=np.rot90(shot.ids).copy(), camera=turned)


def every_second(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    return shots[::2]


def noisy(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    return [replace(s, pixels=_clipped(s.pixels + rng.normal(0, 14, s.pixels.shape))) for s in shots]


def blurred(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    """Photos shaken along a line of 1 to 6 pixels."""
    return [replace(s, pixels=_shaken(s.pixels, rng.uniform(1, 6), rng.uniform(0, np.pi))) for s in shots]


def exposed(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    """Every other photo at half the exposure."""
    return [
        replace(s, pixels=_clipped(255 * (s.pixels / 255.0) / 2 ** (1 / 2.2))) if i % 2 else s
        for i, s in enumerate(shots)
    ]


def without_exif(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    return [replace(s, focal_35mm=None) for s in shots]


def one_side_without_exif(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    side = [s for s in shots if s.name.startswith("east")]
    return [replace(s, pixels=_clipped(s.pixels + rng.normal(0, 3, s.pixels.shape)), focal_35mm=None) for s in side]


def wrong_exif(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    return [replace(s, focal_35mm=s.focal_35mm and 1.3 * s.focal_35mm) for s in shots]


def mixed_formats(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    return [sideways(s) if i % 3 == 1 else s for i, s in enumerate(shots)]


def shuffled(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    order = rng.permutation(len(shots))
    return [replace(s, name=f"photo_{k:03d}") for s, k in zip(shots, order, strict=True)]


def two_cameras(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    return [zoomed(s, 1.25, told=True, model="Bed B") if i % 2 else s for i, s in enumerate(shots)]


def zoom_changed(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    """From half the walk on, nearer by a fifth, of which EXIF says nothing."""
    return [zoomed(s, 1.2, told=False) if i >= len(shots) // 2 else s for i, s in enumerate(shots)]


def edited(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    """Photos of which an editor cut off a strip at the right and at the bottom, and left EXIF as it was."""
    return [cropped(s, 0, 0, round(0.8 * s.ids.shape[1]), round(0.9 * s.ids.shape[0]), enlarged=False) for s in shots]


def stabilised(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    """Frames of a video as a phone steadies it: of each another part of the sensor, which is off by up to 3 %."""
    frames = []
    for s in shots:
        h, w = s.ids.shape
        width, height = 2 * round(0.45 * w), 2 * round(0.45 * h)
        across, down = np.round(rng.uniform(-0.03, 0.03, 2) * w).astype(int)
        left, top = (w - width) // 2 + int(across), (h - height) // 2 + int(down)
        frames.append(replace(cropped(s, left, top, width, height, enlarged=True), focal_35mm=None))
    return frames


def mirrored(shots: list[Shot], rng: np.random.Generator) -> list[Shot]:
    """Photos as a selfie camera saves them."""
    return [replace(s, pixels=s.pixels[:, ::-1].copy(), ids=s.ids[:, ::-1].copy()) for s in shots]


def _clipped(pixels: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> ByteArray:
    return np.clip(np.round(pixels), 0, 255).astype(np.uint8)


def _shaken(pixels: ByteArray, length_px: float, direction: float) -> ByteArray:
    size = 2 * math.ceil(length_px / 2) + 1
    kernel = np.zeros((16 * size, 16 * size), np.float32)
    reach = 8 * length_px * np.array([math.cos(direction), math.sin(direction)])
    ends = [tuple(int(v) for v in np.round(8 * size + s * reach)) for s in (-1, 1)]
    cv2.line(kernel, ends[0], ends[1], 1.0, thickness=16)
    kernel = cv2.resize(kernel, (size, size), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.filter2D(pixels, -1, kernel / kernel.sum()), np.uint8)


# ---- changes of the markers' table -----------------------------------------------------------------------------------


def three_markers(markers: Markers) -> Markers:
    return [markers[0], markers[5], markers[-2]]


def coplanar_markers(markers: Markers) -> Markers:
    """Those of the first side, which hang in one plane."""
    return [m for m in markers if m["y"] < 0]


def one_moved(markers: Markers) -> Markers:
    """One marker 15 cm from where it was."""
    return [{**m, "x": m["x"] + 0.15} if m is markers[4] else m for m in markers]


def side_moved(markers: Markers) -> Markers:
    """All markers of the second side 10 cm along the row."""
    return [{**m, "x": m["x"] + 0.10} if m["y"] > 0 else m for m in markers]


# ---- cases -----------------------------------------------------------------------------------------------------------

CASES = {
    "walk": Case("walk"),
    "walk, 0.7 MP": Case("walk", width_px=720),
    "walk, every second photo": Case("walk", every_second),
    "walk, every second photo, table with plates": Case("walk", every_second, plates=True),
    "walk, wind": Case("walk-wind"),
    "walk, noise": Case("walk", noisy),
    "walk, shaken": Case("walk", blurred),
    "walk, half exposure": Case("walk", exposed),
    "walk, no EXIF": Case("walk", without_exif),
    "walk, wrong EXIF": Case("walk", wrong_exif, fault="EXIF|focal"),
    "walk, portrait and landscape": Case("walk", mixed_formats),
    "walk, shuffled names": Case("walk", shuffled),
    "walk, two cameras": Case("walk", two_cameras),
    "walk, zoom changed": Case("walk", zoom_changed, fault="zoom|focal"),
    "walk, cropped by an editor": Case("walk", edited, fault="EXIF|crop"),
    "walk, stabilised": Case("walk", stabilised, fault="stabilis"),
    "walk, mirrored": Case("walk", mirrored, fault="are mirrored"),
    "video": Case("video", without_exif),
    "video, stabilised": Case("video", stabilised, fault="stabilis"),
    "walk, photos of another place": Case("walk", others="orchard-dev", fault="other"),
    "walk, three markers": Case("walk", markers=three_markers),
    "walk, markers of one side": Case("walk", markers=coplanar_markers),
    "walk, a marker moved": Case("walk", markers=one_moved, fault="marker 4"),
    "walk, markers of a side moved": Case("walk", markers=side_moved, fault="marker"),
    "walk, markers seldom seen": Case("walk-near-markers"),
    "sides, steps of 0.35 m": Case("sides"),
    "orchard-dev": Case("orchard-dev", width_px=432),
    "orchard-dev, every second photo": Case("orchard-dev", every_second, width_px=432),
    "orchard-dev, no EXIF": Case("orchard-dev", without_exif, width_px=432),
    "orchard-dev, bundle.out": Case("orchard-dev", given="bundle.out", width_px=432),
    "orchard-dev, transforms.json": Case("orchard-dev", given="transforms.json", width_px=432),
    "one side, 18 MP, no EXIF": Case("orchard-dev", one_side_without_exif, width_px=3456),
}


# ---- reading and writing ---------------------------------------------------------------------------------------------


def read_shots(row: Path, width_px: int) -> list[Shot]:
    """Return the shots of a rendered row, scaled to a width."""
    folder, shots = RowFolder(row), []
    for camera in read_cameras(folder.truth("cameras.json")):
        with Image.open(folder.photo(camera.name)) as image:
            pixels = np.asarray(image.convert("RGB"))
            focal_35mm = camera.focal_px / float(np.hypot(*image.size)) * 43.2666
        mask = folder.mask(camera.name)
        ids = read_mask(mask) if mask.is_file() else np.zeros(pixels.shape[:2], np.uint16)
        shot = Shot(camera.name, pixels, ids, camera, round(focal_35mm))
        shots.append(shot if pixels.shape[1] == width_px else scaled(shot, width_px / pixels.shape[1]))
    return shots


def write_case(case: Case, rows: Mapping[str, Path], folder: Path, *, seed: int = 0) -> None:
    """Write a case of the rendered rows in these folders as the folder of a rendered row."""
    row = rows[case.row]
    more = read_shots(rows[case.others], case.width_px)[:10:2] if case.others else []
    more = [replace(shot, name=f"other_{i}") for i, shot in enumerate(more)]
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    out = RowFolder(part)
    out.make()
    shots = case.shots(read_shots(row, case.width_px), np.random.default_rng(seed))
    for i, shot in enumerate([*shots, *more]):
        exif = _exif(shot, i)
        Image.fromarray(shot.pixels).save(out.photo(shot.name), quality=92, exif=exif, subsampling="4:2:0")
        write_mask(out.mask(shot.name), shot.ids if i < len(shots) else np.zeros_like(shot.ids))
    cameras = tuple(replace(s.camera, name=s.name) for s in shots)
    write_cameras(out.truth("cameras.json"), cameras)
    write_visible_pixels(out, [shot.name for shot in shots])
    shutil.copyfile(row / "truth" / "fruits.csv", out.truth("fruits.csv"))
    columns = ("id", "x", "y", "z", *(("yaw", "size") if case.plates else ()))
    _write_markers(part / "markers.csv", case.markers(_read_markers(row)), columns)
    write_masks_as_coco(part, part / "masks.json")
    if case.given:
        _write_given(part / case.given, cameras)
    part.rename(folder)


def _exif(shot: Shot, number: int) -> Image.Exif:
    exif = Image.Exif()
    exif[0x010F], exif[0x0110] = "Bed", shot.model
    details = exif.get_ifd(0x8769)
    details[0x9003] = f"2024:09:01 10:{number // 20:02d}:{3 * (number % 20):02d}"
    if shot.focal_35mm is not None:
        details[0x920A], details[0xA405] = round(shot.focal_35mm / 1.6, 2), round(shot.focal_35mm)
    return exif


def _read_markers(row: Path) -> Markers:
    path = row / "truth" / "markers.csv"
    path = path if path.is_file() else row / "markers.csv"
    with path.open(newline="") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def _write_markers(path: Path, markers: Markers, columns: Sequence[str]) -> None:
    lines = [",".join(f"{m[name]:.12g}" for name in columns) for m in markers]
    path.write_text("\n".join([",".join(columns), *lines]) + "\n", encoding="utf-8")


def _write_given(path: Path, cameras: Sequence[RowCamera]) -> None:
    """The true cameras as another program would hand them on, without points."""
    flip = np.diag([1.0, -1.0, -1.0])  # both formats' cameras look along -z, y up
    if path.suffix == ".out":
        lines = ["# Bundle file v0.3", f"{len(cameras)} 0"]
        for camera in cameras:
            lines.append(f"{camera.focal_px} 0 0")
            rows = np.vstack([flip @ camera.rotation_cam_from_world, flip @ camera.translation_m])
            lines += [" ".join(f"{v:.12g}" for v in row) for row in rows]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        path.with_name("list.txt").write_text("".join(f"{camera.name}.jpg\n" for camera in cameras))
        return
    frames = []
    for camera in cameras:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = camera.rotation_cam_from_world.T @ flip, camera.centre_in_world
        frames.append({"file_path": f"images/{camera.name}.jpg", "transform_matrix": pose.tolist()})
    one = cameras[0]
    intrinsics = {"fl_x": one.focal_px, "fl_y": one.focal_px, "cx": one.width_px / 2, "cy": one.height_px / 2,
                  "w": one.width_px, "h": one.height_px, "camera_model": "OPENCV"}  # fmt: skip
    path.write_text(json.dumps({**intrinsics, "frames": frames}), encoding="utf-8")
