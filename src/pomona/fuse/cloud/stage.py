"""Fruits in a cloud of fruit alone: spheres that explain its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import FloatArray, IntArray
from pomona.errors import InputError
from pomona.fruits import FruitCloud, Fruits, Observations
from pomona.fuse.cloud.choice import best_gains, claimed, elected, pruned, worths
from pomona.fuse.cloud.fit import fit_spheres
from pomona.fuse.cloud.guesses import guessed_spheres
from pomona.fuse.cloud.leftovers import left_over
from pomona.fuse.cloud.neighbours import Near
from pomona.fuse.cloud.options import CloudOptions
from pomona.fuse.cloud.surface import Surface, surface_of, thinned
from pomona.fuse.fused import Fused
from pomona.progress import Progress, Silent
from pomona.spheres import Spheres

_TURNS, _SAME_SIZE = 3, 0.03  # the search begins anew, so often at most, where the usual size was off by more
_CLEAR_SD, _FEWEST_CLEAR = 0.05, 8  # fruits that tell the usual size: their own points say their radius, and so many
_REFITS = 2
_LEFT = 0.6  # points explained less well than this may be another fruit's
_FEW_EXPLAINED, _THIN = 0.5, 40


@dataclass(frozen=True, eq=False)
class _Found:
    """Fruits in radii of the usual fruit, `usual_m`, and the thinned cloud they are in; `mean_of` as of `thinned`."""

    fruits: Spheres
    surface: Surface
    mean_of: IntArray
    usual_m: float


def fruits_of_cloud(
    cloud: FruitCloud, *, options: CloudOptions | None = None, progress: Progress | None = None
) -> Fused:
    """Return the fruits that explain the points of a cloud, in metres, of fruit alone, and which points are whose.

    Surfaces vote for centres of spheres of the usual size; of these guesses those are elected that together explain the
    points best; spheres are fitted to their points, and what is left over may be further fruits. The usual size is
    measured anew from the fruits that show enough. The result does not depend on the order of points; fruits are
    numbered by where they are. `scores` say how clearly a fruit is worth its price, ½ just so; `views` are 0: a cloud
    tells of no photos. No points give no fruits. `progress` is warned where the cloud seems to be of something else.

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
    _tell_doubts(found, options, progress)
    return _fused(found, origin, cloud, options)


def _search(points: FloatArray, options: CloudOptions, progress: Progress) -> _Found:
    """Look for fruits, and again where they turn out to be of another size than was thought."""
    progress.start("fuse", _TURNS)
    usual_m = options.fruit_diameter_m / 2
    for _ in range(_TURNS):
        means, mean_of = thinned(points / usual_m, 2 * options.cell_diameters)
        surface = surface_of(means)
        found = _Found(_fruits_in(surface, options), surface, mean_of, usual_m)
        progress.advance()
        seen = _usual_radius(found, options)
        if abs(seen - 1) <= _SAME_SIZE:
            break
        usual_m *= seen
    return found


def _fruits_in(surface: Surface, options: CloudOptions) -> Spheres:
    """Return the fruits in a surface, in rounds, each in what the earlier ones left."""
    fruits = Spheres.alike(np.zeros((0, 3)), 1.0)
    for _ in range(options.rounds):
        gains = best_gains(fruits, surface, options)
        wanting = np.where(gains < _LEFT, 1 - gains, 0)
        guesses = guessed_spheres(surface, wanting, options)
        new = guesses[elected(guesses, fruits, gains, surface, options)]
        if len(new) == 0:
            break
        fruits = _settled(Spheres.joined([fruits, new]), surface, options)
    return Spheres.joined([fruits, left_over(fruits, surface, options)])


def _settled(fruits: Spheres, surface: Surface, options: CloudOptions) -> Spheres:
    """Give points to the nearest fruits and fit these to their points, in turns; drop who is not worth its price."""
    for _ in range(_REFITS):
        fruits, _sds = fit_spheres(fruits, _own(fruits, surface, options), surface, options, rounds=4)
    return pruned(fruits, surface, options)


def _own(fruits: Spheres, surface: Surface, options: CloudOptions) -> Near:
    fruit_of = claimed(fruits, surface, options)
    held = np.flatnonzero(fruit_of >= 0)
    return Near.of_places(fruit_of[held], held, len(fruits))


def _usual_radius(found: _Found, options: CloudOptions) -> float:
    """Return the median radius of fruits whose points say it, as a share of what it was thought to be."""
    fruits = found.fruits
    own = _own(fruits, found.surface, options)
    fitted, sds = fit_spheres(fruits, own, found.surface, options, rounds=4)
    clear = sds < _CLEAR_SD
    return float(np.median(fitted.radii_m[clear])) if clear.sum() >= _FEWEST_CLEAR else 1.0


def _fused(found: _Found, origin: FloatArray, cloud: FruitCloud, options: CloudOptions) -> Fused:
    order = np.lexsort(found.fruits.centers_in_world.T)
    fruits, surface = found.fruits[order], found.surface
    _, sds = fit_spheres(fruits, _own(fruits, surface, options), surface, options, rounds=1)
    worth = np.maximum(worths(fruits, surface, options), 0)
    fruit_of = claimed(fruits, surface, options, reach=options.reach_radii)[found.mean_of]
    return Fused(
        Fruits(
            np.arange(1, len(fruits) + 1),
            fruits.centers_in_world * found.usual_m + origin,
            2 * fruits.radii_m * found.usual_m,
            worth / (worth + options.price),
            np.zeros(len(fruits), np.int64),
            2 * sds * found.usual_m,
        ),
        Observations.empty(),
        FruitCloud(cloud.points_in_world, cloud.rgb, fruit_of + 1),
    )


def _tell_doubts(found: _Found, options: CloudOptions, progress: Progress) -> None:
    """Warn where the cloud may not be what this method is for."""
    explained = float(best_gains(found.fruits, found.surface, options).mean())
    if explained < _FEW_EXPLAINED:
        progress.warn(
            f"Spheres of about {2000 * found.usual_m:.0f} mm explain the cloud badly ({100 * explained:.0f} %, fruits "
            "alone: 50 to 90 %): does it show fruit alone, in metres, and is the fruit diameter right?"
        )
    if found.surface.whole < _THIN:
        progress.warn(
            f"The cloud is thin: a whole fruit of {2000 * found.usual_m:.0f} mm would have {found.surface.whole:.0f} "
            f"points, which do not show a surface; {_THIN} or more are wanted"
        )
