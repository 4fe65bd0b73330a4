"""Bundler's text (`bundle.out`, `*_cameras.out`; version 0.3): cameras, points and what each point's photos saw.

Source: Snavely, Bundler v0.4 user's manual, section "Output format and scene representation"
(https://www.cs.cornell.edu/~snavely/bundler/bundler-v0.4-manual.html). A camera is `f k1 k2`, R (3 lines), t; it looks
along -z with y up. p = -P / P.z, p' = f (1 + k1 |p|² + k2 |p|⁴) p; pixels are counted from the photo's centre, y up.
Neither the photos' names nor their sizes are in the file: names are in a list beside it, in the order of the cameras.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray, IntArray, set_checked
from pomona.errors import FormatError, InputError
from pomona.formats.cameras.given import shared
from pomona.formats.cameras.poses import pose_from, rotation_from
from pomona.formats.files import read_text
from pomona.values.cameras import Cameras
from pomona.values.intrinsics import Intrinsics

_EXPECTED = "a Bundler file (# Bundle file v0.3)"
# From Bundler's camera axes (y up, looking along -z) to OpenCV's.
_OPENCV_FROM_BUNDLER = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, eq=False)
class Bundle:
    """What a Bundler file holds: n cameras in the file's order, m points, k observations.

    `lenses` (n, 3): f in pixels, k1, k2; f is 0 where the photo has no place. `cam_from_world` (n, 3, 4) has OpenCV's
    axes already. `points_in_world` (m, 3), `points_rgb` (m, 3). `track_point_idx`, `track_camera_idx` (k,),
    `track_xy_px` (k, 2) from the photo's centre, y down.
    """

    lenses: FloatArray
    cam_from_world: FloatArray
    points_in_world: FloatArray
    points_rgb: ByteArray
    track_point_idx: IntArray
    track_camera_idx: IntArray
    track_xy_px: FloatArray

    def __post_init__(self) -> None:
        n, m, k = len(self.lenses), len(self.points_in_world), len(self.track_point_idx)
        set_checked(self, "lenses", (n, 3), np.float64)
        set_checked(self, "cam_from_world", (n, 3, 4), np.float64)
        set_checked(self, "points_in_world", (m, 3), np.float64)
        set_checked(self, "points_rgb", (m, 3), np.uint8)
        set_checked(self, "track_point_idx", (k,), np.int64)
        set_checked(self, "track_camera_idx", (k,), np.int64)
        set_checked(self, "track_xy_px", (k, 2), np.float64)

    def __len__(self) -> int:
        return len(self.lenses)

    @property
    def placed(self) -> IntArray:
        """Indices of the cameras that have a place."""
        return np.flatnonzero(self.lenses[:, 0] > 0)


def parse_bundle(path: Path) -> Bundle:
    """Read a Bundler file, whatever its name.

    Raises `MissingFileError`, and `FormatError` naming the line where it is not what Bundler writes.
    """
    lines = _Lines(path)
    counts = lines.numbers(2, "the numbers of cameras and of points")
    cameras, points = (_count(value, lines) for value in counts)
    if 5 * cameras + 3 * points > lines.left:
        raise FormatError(
            f"{path}, line {lines.number}: {cameras} cameras and {points} points need {5 * cameras + 3 * points} more "
            f"lines, found {lines.left}: the file is cut short, or the counts are wrong"
        )
    lenses, poses = np.zeros((cameras, 3)), np.zeros((cameras, 3, 4))
    for i in range(cameras):
        lenses[i], poses[i] = _camera(lines, i)
    places, colours = np.zeros((points, 3)), np.zeros((points, 3), np.uint8)
    views: list[FloatArray] = []
    for i in range(points):
        places[i] = lines.numbers(3, f"x y z of point {i}")
        colours[i] = _colour(lines, i)
        views.append(_views(lines, i, cameras))
    lines.expect_end()
    track = np.concatenate(views) if views else np.zeros((0, 4))
    return Bundle(
        lenses=lenses,
        cam_from_world=poses,
        points_in_world=places,
        points_rgb=colours,
        track_point_idx=np.repeat(np.arange(points), [len(v) for v in views]),
        track_camera_idx=track[:, 0].astype(np.int64),
        track_xy_px=track[:, 2:] * [1.0, -1.0],
    )


def cameras_of(bundle: Bundle, names: Sequence[str], sizes_px: Sequence[tuple[int, int]]) -> Cameras:
    """Return the cameras that have a place, given every camera's photo name and size (width, height).

    Raises `InputError` when there are not as many names and sizes as cameras.
    """
    if not len(names) == len(sizes_px) == len(bundle):
        raise InputError(f"Expected a photo for each of the file's {len(bundle)} cameras, found {len(names)}")
    placed = bundle.placed
    new_idx = np.full(len(bundle), -1, np.int64)
    new_idx[placed] = np.arange(len(placed))
    seen = new_idx[bundle.track_camera_idx] >= 0
    photo_idx = bundle.track_camera_idx[seen]
    middles = np.array(sizes_px, float).reshape(-1, 2) / 2
    intrinsics, intrinsics_idx = shared([_intrinsics(bundle.lenses[i], sizes_px[i]) for i in placed])
    return Cameras(
        photos=tuple(names[i] for i in placed),
        intrinsics=intrinsics,
        intrinsics_idx=intrinsics_idx,
        cam_from_world=bundle.cam_from_world[placed],
        points_in_world=bundle.points_in_world,
        points_rgb=bundle.points_rgb,
        points_error_px=np.full(len(bundle.points_in_world), np.nan),
        track_point_idx=bundle.track_point_idx[seen],
        track_photo_idx=new_idx[photo_idx],
        track_xy_px=bundle.track_xy_px[seen] + middles[photo_idx],
    )


def _intrinsics(lens: FloatArray, size_px: tuple[int, int]) -> Intrinsics:
    focal_px, k1, k2 = lens
    width_px, height_px = size_px
    return Intrinsics("RADIAL", width_px, height_px, np.array([focal_px, width_px / 2, height_px / 2, k1, k2]))


class _Lines:
    """The lines of the file that are neither empty nor comments, one after the other."""

    def __init__(self, path: Path) -> None:
        text = read_text(path, _EXPECTED)
        numbered = ((i, line.split("#", 1)[0].split()) for i, line in enumerate(text.splitlines(), 1))
        self.path, self.number = path, 0
        self._lines = [(i, words) for i, words in numbered if words]
        self._next = 0

    @property
    def left(self) -> int:
        return len(self._lines) - self._next

    def numbers(self, count: int | None, what: str) -> FloatArray:
        """The next line's numbers, `count` of them where it is known."""
        if not self.left:
            raise FormatError(f"{self.path}, after line {self.number}: expected {what}, but the file ends here")
        self.number, words = self._lines[self._next]
        self._next += 1
        try:
            values = np.array([float(word) for word in words])
        except ValueError:
            raise self.error(f"expected {what}, found '{' '.join(words)[:60]}'") from None
        if count is not None and len(values) != count:
            raise self.error(f"expected {what} ({count} numbers), found {len(values)}")
        if not np.isfinite(values).all():
            raise self.error(f"expected {what}, found a number that is not finite")
        return values

    def expect_end(self) -> None:
        if self.left:
            self.number = self._lines[self._next][0]
            raise self.error(f"expected the end of the file, found {self.left} more lines: the counts are wrong")

    def error(self, message: str) -> FormatError:
        return FormatError(f"{self.path}, line {self.number}: {message}")


def _count(value: float, lines: _Lines) -> int:
    if value < 0 or value != int(value):
        raise lines.error(f"expected the numbers of cameras and of points, found {value:g}")
    return int(value)


def _camera(lines: _Lines, index: int) -> tuple[FloatArray, FloatArray]:
    what = f"camera {index}"
    lens = lines.numbers(3, f"f k1 k2 of {what}")
    if lens[0] < 0:
        raise lines.error(f"expected a focal length of {what} above 0 (0: no place), found {lens[0]:g}")
    first = lines.number + 1
    rows = np.array([lines.numbers(3, f"a row of the rotation of {what}") for _ in range(3)])
    translation = lines.numbers(3, f"the translation of {what}")
    if lens[0] == 0:
        return lens, np.zeros((3, 4))
    rotation = rotation_from(rows, f"{lines.path}, line {first}, {what}")
    return lens, _OPENCV_FROM_BUNDLER @ pose_from(rotation, translation)


def _colour(lines: _Lines, index: int) -> FloatArray:
    colour = lines.numbers(3, f"r g b of point {index}")
    if colour.min() < 0 or colour.max() > 255:
        raise lines.error(f"expected r g b of point {index} from 0 to 255, found {colour}")
    return colour


def _views(lines: _Lines, index: int, cameras: int) -> FloatArray:
    """(k, 4): camera, key, x, y of each photo that saw the point."""
    values = lines.numbers(None, f"the views of point {index}")
    if len(values) != 1 + 4 * values[0]:
        raise lines.error(f"expected {values[0]:g} views of point {index}, 4 numbers each, found {len(values) - 1}")
    views = values[1:].reshape(-1, 4)
    if len(views) and not ((views[:, 0] >= 0) & (views[:, 0] < cameras) & (views[:, 0] % 1 == 0)).all():
        raise lines.error(f"expected views of point {index} by cameras 0 to {cameras - 1}, found {views[:, 0]}")
    return views
