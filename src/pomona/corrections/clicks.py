"""From clicks in photos to places and sizes in the world."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.corrections.log import Mark
from pomona.errors import InputError
from pomona.values.cameras import Cameras

# A person clicks the middle of a fruit to so many pixels, or to so large a share of its width.
_CLICK_PX = 2.0
_CLICK_SHARE = 0.05
_LINE_POINTS = 24  # of a line, which lens distortion bends
_MOST_LINES = 300  # photos that a person is shown at most
# From there two lines cross well, and a photo still shows what the first did.
_BEST_ANGLE_DEG = 15.0


def place_from_marks(cameras: Cameras, marks: Sequence[Mark], typical_diameter: float) -> FloatArray:
    """Return the place (3,) nearest to the rays of all marks, which are in two or more photos.

    Raises `InputError` where that says nothing of the place: one photo only, photos taken from nearly the same place,
    two rays that pass each other by more than a typical fruit is wide (one of several: the place by half of that), or
    rays that meet behind a camera.
    """
    if len({mark.photo for mark in marks}) < 2:
        raise InputError("Click the fruit in two photos at least")
    eyes, rays = np.array([eye_and_ray(cameras, mark) for mark in marks]).transpose(1, 0, 2)
    # Sum over the rays of the squared distance to the place: (I − r rᵀ)(x − eye).
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    normal = across.sum(0)
    if np.linalg.eigvalsh(normal)[0] < 1e-9:
        raise InputError(_same_place())
    place: FloatArray = np.linalg.solve(normal, np.einsum("nij,nj->i", across, eyes))
    along = ((place - eyes) * rays).sum(1)
    if (along <= 0).any():
        raise InputError("The clicks meet behind a camera: they are not of the same fruit")
    off = np.linalg.norm(place - eyes - along[:, None] * rays, axis=1)
    if off.max() > typical_diameter / 2:
        raise InputError(
            f"The clicks are not of the same fruit: their lines pass each other by {2 * off.max():.3f}, and a fruit is "
            f"{typical_diameter:.3f} wide. Click it again where the line runs through it"
        )
    focals = np.array([cameras.intrinsics_of(_index(cameras, mark)).focal_px for mark in marks])
    sds = np.maximum(_CLICK_PX * along / focals, _CLICK_SHARE * typical_diameter)
    spread = np.linalg.inv((across / sds[:, None, None] ** 2).sum(0))
    if np.sqrt(np.linalg.eigvalsh(spread)[-1]) > typical_diameter:
        raise InputError(_same_place())
    return place


def place_at_depth(cameras: Cameras, mark: Mark, like: FloatArray) -> FloatArray:
    """Return the place (3,) where a mark's ray is as deep in its photo as the place `like` (3,)."""
    eye, ray = eye_and_ray(cameras, mark)
    axis = cameras.cam_from_world[_index(cameras, mark), 2, :3]
    depth = float((like - eye) @ axis)
    if depth <= 0:
        raise InputError(f"The fruit is not in front of the camera of {mark.photo}: click it in another photo")
    place: FloatArray = eye + ray * depth / float(ray @ axis)
    return place


def diameter_from_edges(cameras: Cameras, edges: Sequence[Mark], center: FloatArray) -> tuple[float, float]:
    """Return diameter and standard deviation of a sphere around `center` (3,) from marks on opposite edges.

    The rays touch the sphere, so that half the angle between them has the sine radius / distance. Raises `InputError`.
    """
    if len(edges) != 2 or edges[0].photo != edges[1].photo:
        raise InputError("Size: expected two clicks on opposite edges of the fruit, in one photo")
    (eye, one), (_, other) = (eye_and_ray(cameras, mark) for mark in edges)
    distance = float(np.linalg.norm(center - eye))
    half_angle = np.arccos(np.clip(one @ other, -1, 1)) / 2
    diameter = float(2 * distance * np.sin(half_angle))
    focal_px = cameras.intrinsics_of(_index(cameras, edges[0])).focal_px
    sd = float(np.sqrt(2) * _CLICK_PX * distance / focal_px)
    if diameter <= sd:
        raise InputError("Size: the two clicks are at the same place: click opposite edges of the fruit")
    return diameter, sd


def lines_in_photos(cameras: Cameras, mark: Mark, depths: tuple[float, float]) -> list[tuple[int, FloatArray]]:
    """Return the photos that may show what was marked, with the line (k, 2) in pixels on which it lies there.

    `depths`, the least and the greatest, are how far from the camera fruits are. Photos that see the place from beside,
    but from not too far beside, come first: their lines are crossed best.
    """
    mine = _index(cameras, mark)
    eye, ray = eye_and_ray(cameras, mark)
    # Evenly in inverse depth, which is nearly evenly in pixels.
    far = 1 / np.linspace(1 / depths[0], 1 / depths[1], _LINE_POINTS)
    points = eye + far[:, None] * ray
    middle = points[_LINE_POINTS // 2]
    centers = cameras.centers_in_world
    towards = middle - centers
    towards = towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
    angles = np.degrees(np.arccos(np.clip(towards @ ray, -1, 1)))
    found: list[tuple[int, FloatArray]] = []
    for i in np.argsort(np.abs(angles - _BEST_ANGLE_DEG), kind="stable").tolist():
        lens = cameras.intrinsics_of(i)
        xy_px, _ = cameras.project(i, points)
        with np.errstate(invalid="ignore"):
            inside = ((xy_px >= 0) & (xy_px <= (lens.width_px, lens.height_px))).all(1)
        if i != mine and inside.sum() > 1:
            found.append((i, xy_px[np.flatnonzero(inside)[0] : np.flatnonzero(inside)[-1] + 1]))
        if len(found) == _MOST_LINES:
            break
    return found


def eye_and_ray(cameras: Cameras, mark: Mark) -> tuple[FloatArray, FloatArray]:
    """Return the camera's centre (3,) and the unit direction (3,) of a mark."""
    i = _index(cameras, mark)
    return cameras.centers_in_world[i], cameras.rays_in_world(i, np.array([[mark.x_px, mark.y_px]]))[0]


def _index(cameras: Cameras, mark: Mark) -> int:
    i = cameras.index_of(mark.photo)
    if i is None:
        raise InputError(f"{mark.photo} is not a photo with a place in this survey")
    return i


def _same_place() -> str:
    return "These photos were taken from nearly the same place: click the fruit in one that saw it from beside"
