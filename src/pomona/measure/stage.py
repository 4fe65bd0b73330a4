"""Each fruit's centre, diameter, visibility and sides, from its points and from the masks that saw it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.errors import InputError
from pomona.filter.features import fruit_points
from pomona.fruit_size import FruitSize, size_of_fruits
from pomona.fruits import BOTH_SIDES, FruitCloud, Fruits, Observations
from pomona.fuse import Fused
from pomona.measure.outlines import Sight, sight_of
from pomona.measure.sphere import Evidence, Prior, Sphere, fit_sphere
from pomona.photos import Photos
from pomona.progress import Progress, Silent


@dataclass(frozen=True, kw_only=True)
class MeasureOptions:
    """Options of `measure`.

    `rays_per_photo`, `points_per_fruit`: how much of each mask's outline and of the cloud is used. A diameter outside
    `smallest` to `largest` median diameters of the survey is no measurement. `relative_sd` is what a sphere leaves
    unsaid of a fruit that is none, as a share of its diameter. Fruits of which a photo shows at least
    `clear_visibility`, if there are `fewest_clear`, say how flat fruits are (at most `most_flattening`) and, as if by
    `prior_rays` rays more, how large: that steadies fruits of which little is seen. Centres are tied to where the
    fusion has them as by `center_tie` rays.
    """

    rays_per_photo: int = 24
    points_per_fruit: int = 300
    smallest: float = 0.4
    largest: float = 2.0
    relative_sd: float = 0.03
    clear_visibility: float = 0.7
    fewest_clear: int = 10
    prior_rays: float = 6.0
    most_flattening: float = 0.3
    center_tie: float = 0.03

    def __post_init__(self) -> None:
        if self.rays_per_photo < 4 or self.points_per_fruit < 4:
            raise InputError("rays_per_photo and points_per_fruit: expected at least 4")
        if not 0 <= self.smallest < 1 < self.largest:
            raise InputError(f"smallest < 1 < largest: expected, found {self.smallest} and {self.largest}")


@dataclass(frozen=True, eq=False)
class _Measured:
    """One fruit measured; NaN with a reason where it could not be."""

    center: FloatArray
    diameter_m: float
    sd_m: float
    visibility: float
    reason: str
    sphere: Sphere | None = None


def measure(
    fused: Fused,
    detections: SurveyDetections,
    cameras: Cameras,
    photos: Photos | None = None,
    *,
    options: MeasureOptions | None = None,
    progress: Progress | None = None,
) -> Fruits:
    """Return the fruits with centre, diameter and its standard deviation, visibility and, with `photos`, sides.

    A sphere is fitted to the fruit's points and to the outlines of its masks together, since of most fruits only one
    side is seen, and leaves hide part of that. `visibility` is the share of the fruit's disc that the photo which
    shows most of it shows. A fruit that no sphere fits keeps its centre, and has NaN and a reason.
    """
    options, progress = options or MeasureOptions(), progress or Silent()
    if len(fused.fruits) == 0:
        return fused.fruits
    sights = _sights(fused.observations, detections, cameras, options)
    points = _points(fused.cloud, options)
    each = [
        (fused.fruits.centers_in_world[i], points.get(fruit_id, np.zeros((0, 3))), sights.get(fruit_id, []))
        for i, fruit_id in enumerate(fused.fruits.ids.tolist())
    ]
    progress.start("measure", 2 * len(each))
    alone = [_advanced(progress, _measure_one(*one, None, options.center_tie)) for one in each]
    prior = _prior(alone, cameras.frame.up_is_known, options)
    measured = [_advanced(progress, _measure_one(*one, prior, options.center_tie)) for one in each]
    return _fruits(fused, _plausible(measured, options), photos, options)


def _advanced(progress: Progress, measured: _Measured) -> _Measured:
    progress.advance()
    return measured


def _prior(measured: list[_Measured], up_is_known: bool, options: MeasureOptions) -> Prior:
    """Return what the fruits that are well seen say of the others: their size, and how flat they are.

    Apples hang upright and are wider than high, so a sphere would measure them too small.
    """
    clear = [m for m in measured if m.sphere and m.visibility >= options.clear_visibility]
    if len(clear) < options.fewest_clear:
        return Prior()
    spheres = [m.sphere for m in clear if m.sphere]
    radius = size_of_fruits(np.array([2 * sphere.radius for sphere in spheres]), FruitSize()).radius_m
    if not up_is_known:
        return Prior(0.0, radius, options.prior_rays)
    off = np.concatenate([s.off_radii[s.touching] for s in spheres])
    z_square = np.concatenate([s.off_z[s.touching] for s in spheres]) ** 2
    slope, level = np.polyfit(z_square, off, 1)
    flattening = float(np.clip(-slope / level, 0, options.most_flattening))
    return Prior(flattening, radius * float(level), options.prior_rays)


def _sights(
    observations: Observations, detections: SurveyDetections, cameras: Cameras, options: MeasureOptions
) -> dict[int, list[Sight]]:
    """Return the detections of each fruit, by id; those in photos without a camera are of no use."""
    photo_idx = {name: i for i, name in enumerate(cameras.photos)}
    place = {
        (photo, detection_id): k
        for photo, found in detections.items()
        for k, detection_id in enumerate(found.ids.tolist())
    }
    eyes = cameras.centers_in_world
    result: dict[int, list[Sight]] = {}
    for fruit_id, photo, detection_id in zip(
        observations.fruit_id.tolist(), observations.photo, observations.detection_id.tolist(), strict=True
    ):
        i, k = photo_idx.get(photo), place.get((photo, detection_id))
        if i is None or k is None:
            continue
        sight = sight_of(detections[photo].masks[k], i, cameras, eyes[i], rays=options.rays_per_photo)
        result.setdefault(fruit_id, []).append(sight)
    return result


def _points(cloud: FruitCloud, options: MeasureOptions) -> dict[int, FloatArray]:
    """Return at most `points_per_fruit` points (m, 3) of each fruit, evenly from all of them, by id."""
    result = {}
    for fruit_id, points in fruit_points(cloud):
        step = max(1, len(points) // options.points_per_fruit)
        result[fruit_id] = points[::step]
    return result


def _measure_one(
    center: FloatArray, points: FloatArray, sights: list[Sight], prior: Prior | None, center_tie: float
) -> _Measured:
    nothing = _Measured(center, np.nan, np.nan, np.nan, "")
    views = len({sight.photo_idx for sight in sights})
    if views == 0:
        return replace(nothing, reason="no mask of it in a photo with a camera")
    if len(points) < 4 and views < 2:
        return replace(nothing, reason="seen in one photo only, and without points: its distance is not known")
    widths_m = [sight.extent * sight.depth_m(center) for sight in sights]
    # Most masks are partly hidden, and a few hold two fruits.
    radius = float(np.percentile(widths_m, 75)) / 2
    if not radius > 0:
        return replace(nothing, reason="its points lie behind the cameras that saw it")
    seen = Evidence(
        points,
        np.concatenate([np.broadcast_to(s.eye_in_world, s.rays_in_world.shape) for s in sights]),
        np.concatenate([s.rays_in_world for s in sights]),
        views,
    )
    sphere = fit_sphere(seen, center=center, radius=radius, prior=prior, center_tie=center_tie)
    if sphere is None:
        return replace(nothing, reason="no sphere fits its points and outlines")
    disc_m2 = np.pi * sphere.radius**2 * (1 - (prior.flattening if prior else 0.0))
    shown = max(sight.area * sight.depth_m(sphere.center) ** 2 / disc_m2 for sight in sights)
    return _Measured(sphere.center, 2 * sphere.radius, 2 * sphere.radius_sd, min(1.0, float(shown)), "", sphere)


def _plausible(measured: list[_Measured], options: MeasureOptions) -> list[_Measured]:
    """Take back diameters that are far from the survey's median."""
    median_m = size_of_fruits(np.array([m.diameter_m for m in measured]), FruitSize()).diameter_m
    low_m, high_m = options.smallest * median_m, options.largest * median_m
    return [
        m
        if m.reason or low_m <= m.diameter_m <= high_m
        else replace(
            m, diameter_m=np.nan, sd_m=np.nan, visibility=np.nan,
            reason=f"a sphere of {1000 * m.diameter_m:.0f} mm fits, far from the median of {1000 * median_m:.0f} mm",
        )
        for m in measured
    ]  # fmt: skip


def _fruits(fused: Fused, measured: list[_Measured], photos: Photos | None, options: MeasureOptions) -> Fruits:
    diameters_m = np.array([m.diameter_m for m in measured])
    sds_m = np.hypot([m.sd_m for m in measured], options.relative_sd * diameters_m)
    return replace(
        fused.fruits,
        centers_in_world=np.array([m.center for m in measured]),
        diameters_m=diameters_m,
        diameter_sds_m=sds_m,
        visibilities=np.array([m.visibility for m in measured]),
        sides=fused.fruits.sides if photos is None else sides_of(fused, photos),
        reasons=tuple(m.reason for m in measured),
    )


def sides_of(fused: Fused, photos: Photos) -> tuple[str, ...]:
    """Return for each fruit the side whose photos saw it, "both" for more than one, "" for none."""
    side_of_photo = {photo.name: photo.side for photo in photos}
    sides: dict[int, set[str]] = {i: set() for i in fused.fruits.ids.tolist()}
    for fruit_id, name in zip(fused.observations.fruit_id.tolist(), fused.observations.photo, strict=True):
        if fruit_id in sides and name in side_of_photo:
            sides[fruit_id].add(side_of_photo[name])
    return tuple(BOTH_SIDES if len(seen) > 1 else "".join(seen) for seen in sides.values())
