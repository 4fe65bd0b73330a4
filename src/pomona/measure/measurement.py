"""Each fruit's centre, diameter, visibility and sides, from its points and from the masks that saw it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pomona.arrays import FloatArray, IntArray
from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.fruit_size import FruitSize, size_of_fruits
from pomona.fruits import BOTH_SIDES, FruitCloud, Fruits
from pomona.fuse import Fused
from pomona.mask_rays import MaskRays, mask_rays
from pomona.measure.allometry import weigh
from pomona.measure.options import MeasureOptions
from pomona.measure.sphere_fit import FittedSphere, FruitEvidence, Prior, fit_sphere
from pomona.photos import Photos
from pomona.progress import Progress, Silent


@dataclass(frozen=True, eq=False)
class _Measured:
    """One fruit measured; NaN with a reason where it could not be."""

    center: FloatArray
    diameter_m: float
    sd_m: float
    visibility: float
    reason: str
    sphere: FittedSphere | None = None


@dataclass(frozen=True, eq=False)
class _Seen:
    """One fruit as the fusion has it: its centre (3,), and what is seen of it: masks (k,), points and rays."""

    center: FloatArray
    mask_idx: IntArray
    evidence: FruitEvidence


def measure(
    fused: Fused,
    detections: SurveyDetections,
    cameras: Cameras,
    photos: Photos | None = None,
    *,
    options: MeasureOptions | None = None,
    progress: Progress | None = None,
) -> Fruits:
    """Return the fruits with centre, diameter and its standard deviation, visibility, weight and, with `photos`, sides.

    `fused` are the fruits with the detections that saw them (`pomona.fuse`), `detections` those of all photos, in which
    the observations' ids are looked up, and `cameras` those in metres. The n fruits keep their ids and order; centres
    (n, 3) and diameters (n,) are metres in the cameras' frame.

    A sphere is fitted to the fruit's points and to the outlines of its masks together, since of most fruits only one
    side is seen, and leaves hide part of that. `visibility` is the share of the fruit's disc that the photo which
    shows most of it shows. A fruit that no sphere fits keeps its centre, and has NaN and a reason.
    """
    options = (options or MeasureOptions()).tied(with_points=len(fused.cloud) > 0)
    progress = progress or Silent()
    if len(fused.fruits) == 0:
        return fused.fruits
    masks = mask_rays(detections, cameras, rays_per_mask=options.rays_per_photo, only=fused.observations)
    each = _all_seen(fused, masks, options)
    progress.start("measure", 2 * len(each))
    alone = [_advanced(progress, _measure_one(one, masks, None, options)) for one in each]
    prior = _prior(alone, cameras.frame.up_is_known, options)
    measured = [_advanced(progress, _measure_one(one, masks, prior, options)) for one in each]
    fruits = _fruits(fused, _plausible(measured, options), photos, options)
    return weigh(fruits, options.allometry, cameras.frame)


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


def _all_seen(fused: Fused, masks: MaskRays, options: MeasureOptions) -> list[_Seen]:
    """Return what is seen of each fruit; detections in photos without a camera are of no use."""
    fruit_idx, mask_idx = masks.seen(fused.observations, fused.fruits.ids)
    points = _points(fused.cloud, options)
    result = []
    for i, fruit_id in enumerate(fused.fruits.ids.tolist()):
        mine = mask_idx[fruit_idx == i]
        outlines = [np.zeros((0, 3)), *(masks.outline_of(k) for k in mine.tolist())]
        eyes = np.repeat(masks.eyes_in_world[masks.photo_idx[mine]], [len(rays) for rays in outlines[1:]], axis=0)
        views = len(np.unique(masks.photo_idx[mine]))
        evidence = FruitEvidence(points.get(fruit_id, np.zeros((0, 3))), eyes, np.concatenate(outlines), views)
        result.append(_Seen(fused.fruits.centers_in_world[i], mine, evidence))
    return result


def _points(cloud: FruitCloud, options: MeasureOptions) -> dict[int, FloatArray]:
    """Return at most `points_per_fruit` points (m, 3) of each fruit, evenly from all of them, by id."""
    result = {}
    for fruit_id, idx in cloud.by_fruit():
        step = max(1, len(idx) // options.points_per_fruit)
        result[fruit_id] = cloud.points_in_world[idx[::step]]
    return result


def _measure_one(seen: _Seen, masks: MaskRays, prior: Prior | None, options: MeasureOptions) -> _Measured:
    center, evidence = seen.center, seen.evidence
    nothing = _Measured(center, np.nan, np.nan, np.nan, "")
    if evidence.views == 0:
        return replace(nothing, reason="no mask of it in a photo with a camera")
    if len(evidence.points) < 4 and evidence.views < 2:
        return replace(nothing, reason="seen in one photo only, and without points: its distance is not known")
    widths_m = masks.extents[seen.mask_idx] * masks.depths(center, seen.mask_idx)
    # Most masks are partly hidden, and a few hold two fruits.
    radius = float(np.percentile(widths_m, 75)) / 2
    if not radius > 0:
        return replace(nothing, reason="its points lie behind the cameras that saw it")
    sphere = fit_sphere(evidence, center=center, radius=radius, prior=prior, options=options)
    if sphere is None:
        return replace(nothing, reason="no sphere fits its points and outlines")
    disc_m2 = np.pi * sphere.radius**2 * (1 - (prior.flattening if prior else 0.0))
    shown = (masks.areas[seen.mask_idx] * masks.depths(sphere.center, seen.mask_idx) ** 2 / disc_m2).max()
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
