"""Fruits in a cloud of fruit alone: spheres that explain its points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.errors import InputError
from pomona.fruit.geometry.spheres import Spheres
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.progress import Progress, Silent
from pomona.stages.fuse.cloud.hypotheses import sphere_hypotheses
from pomona.stages.fuse.cloud.neighbours import Near
from pomona.stages.fuse.cloud.options import CloudOptions
from pomona.stages.fuse.cloud.refinement import fit_spheres
from pomona.stages.fuse.cloud.selection import best_gains, fruit_of_points, prune, select, worths
from pomona.stages.fuse.cloud.surface import Surface, surface_of, thinned
from pomona.stages.fuse.cloud.unexplained import spheres_of_patches
from pomona.stages.fuse.fused import Fused
from pomona.values.fruits import FruitCloud, Fruits, Observations

_SEARCHES = 3  # the search begins anew, so often at most, where the size was off
_REFITS = 2
# A person is warned where spheres explain less of a cloud, and where a whole fruit has fewer points.
_FEW_EXPLAINED, _THIN = 0.5, 40


@dataclass(frozen=True, eq=False)
class _Found:
    """Fruits in radii of `size`, and the thinned cloud they are in; `mean_of` as of `thinned`."""

    fruits: Spheres
    surface: Surface
    mean_of: IntArray
    size: FruitSize


def fruits_of_cloud(
    cloud: FruitCloud, *, options: CloudOptions | None = None, progress: Progress | None = None
) -> Fused:
    """Return the fruits that explain the points of a cloud, in metres, of fruit alone, and which points are whose.

    Surfaces vote for centres of spheres of one size; of these hypotheses those are selected that together explain the
    points best; spheres are fitted to their points, and what is left over may be further fruits. The size is
    estimated anew from the fruits that show enough. The result does not depend on the order of points; fruits are
    numbered by where they are. `scores` say how clearly a fruit is worth its price, ½ just so; `views` are 0: a cloud
    knows no photos. No points give no fruits. `progress` is warned where the cloud seems to be of something else.

    Raises `InputError` where a point is not finite, or where points are too far from each other for an orchard.
    """
    options, progress = options or CloudOptions(), progress or Silent()
    bad = ~np.isfinite(cloud.points_in_world).all(1)
    if bad.any():
        raise InputError(
            f"Cloud: expected finite coordinates, found {bad.sum()} points of {len(cloud)} without, the first at index "
            f"{int(np.argmax(bad))}: remove them first"
        )
    if len(cloud) == 0:
        return Fused(Fruits.empty(), Observations.empty(), cloud)
    origin = cloud.points_in_world.min(0)
    found = _search(cloud.points_in_world - origin, options, progress)
    _warn_of_doubts(found, options, progress)
    return _fused(found, origin, cloud, options)


def _search(points: FloatArray, options: CloudOptions, progress: Progress) -> _Found:
    """Look for fruits, and again where they turn out to be of another size than was thought."""
    progress.start("fuse", _SEARCHES)
    size = FruitSize(options.fruit_diameter_m)
    for _ in range(_SEARCHES):
        means, mean_of = thinned(points / size.radius_m, 2 * options.cell_diameters)
        surface = surface_of(means)
        found = _Found(_fruits_in(surface, options), surface, mean_of, size)
        progress.advance()
        refined = _refined_size(found, options)
        if abs(refined.diameter_m / size.diameter_m - 1) <= options.same_size:
            break
        size = refined
    return found


def _fruits_in(surface: Surface, options: CloudOptions) -> Spheres:
    """Return the fruits in a surface, in rounds, each in what the earlier ones left."""
    fruits = Spheres.alike(np.zeros((0, 3)), 1.0)
    for _ in range(options.rounds):
        gains = best_gains(fruits, surface, options)
        wanting = np.where(gains < options.unexplained, 1 - gains, 0)
        hypotheses = sphere_hypotheses(surface, wanting, options)
        new = hypotheses[select(hypotheses, fruits, gains, surface, options)]
        if len(new) == 0:
            break
        fruits = _refine(Spheres.joined([fruits, new]), surface, options)
    return Spheres.joined([fruits, spheres_of_patches(fruits, surface, options)])


def _refine(fruits: Spheres, surface: Surface, options: CloudOptions) -> Spheres:
    """Give points to the nearest fruits and fit these to their points, in turns; drop who is not worth its price."""
    for _ in range(_REFITS):
        fruits, _sds = fit_spheres(fruits, _own(fruits, surface, options), surface, options, rounds=4)
    return prune(fruits, surface, options)


def _own(fruits: Spheres, surface: Surface, options: CloudOptions) -> Near:
    fruit_of = fruit_of_points(fruits, surface, options)
    held = np.flatnonzero(fruit_of >= 0)
    return Near.of_places(fruit_of[held], held, len(fruits))


def _refined_size(found: _Found, options: CloudOptions) -> FruitSize:
    """Return the median size of fruits whose own points say it; the size as it was, where they are few."""
    fruits = found.fruits
    own = _own(fruits, found.surface, options)
    fitted, sds = fit_spheres(fruits, own, found.surface, options, rounds=4)
    clear = sds < options.clear_sd
    if clear.sum() < options.fewest_clear:
        return found.size
    radii = size_of_fruits(fitted.radii_m[clear], found.size)  # in radii of the size as it was
    return replace(radii, diameter_m=found.size.diameter_m * radii.diameter_m, sd_m=found.size.diameter_m * radii.sd_m)


def _fused(found: _Found, origin: FloatArray, cloud: FruitCloud, options: CloudOptions) -> Fused:
    order = np.lexsort(found.fruits.centers_in_world.T)
    fruits, surface = found.fruits[order], found.surface
    _, sds = fit_spheres(fruits, _own(fruits, surface, options), surface, options, rounds=1)
    worth = np.maximum(worths(fruits, surface, options), 0)
    fruit_of = fruit_of_points(fruits, surface, options, reach=options.reach_radii)[found.mean_of]
    return Fused(
        Fruits(
            np.arange(1, len(fruits) + 1),
            fruits.centers_in_world * found.size.radius_m + origin,
            2 * fruits.radii_m * found.size.radius_m,
            worth / (worth + options.price),
            np.zeros(len(fruits), np.int64),
            2 * sds * found.size.radius_m,
        ),
        Observations.empty(),
        FruitCloud(cloud.points_in_world, cloud.rgb, fruit_of + 1),
    )


def _warn_of_doubts(found: _Found, options: CloudOptions, progress: Progress) -> None:
    """Warn where the cloud may not be what this method is for."""
    explained = float(best_gains(found.fruits, found.surface, options).mean())
    diameter_mm = 1000 * found.size.diameter_m
    if explained < _FEW_EXPLAINED:
        progress.warn(
            f"Spheres of about {diameter_mm:.0f} mm explain the cloud badly ({100 * explained:.0f} %, fruits "
            "alone: 50 to 90 %): does it show fruit alone, in metres, and is the fruit diameter right?"
        )
    if found.surface.whole < _THIN:
        progress.warn(
            f"The cloud is thin: a whole fruit of {diameter_mm:.0f} mm would have {found.surface.whole:.0f} "
            f"points, which do not show a surface; {_THIN} or more are wanted"
        )
