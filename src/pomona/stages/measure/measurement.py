"""Each fruit's centre, diameter, height, visibility and sides, from its points and from the masks that saw it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pomona.basics.arrays import Array, BoolArray, FloatArray, IntArray, robust_sd
from pomona.basics.geometry import frame_along
from pomona.fruit.geometry.mask_rays import MaskRays, mask_rays
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.progress import Progress, Silent
from pomona.stages.fuse import Fused
from pomona.stages.measure.allometry import weigh
from pomona.stages.measure.circle_network import CirclesNetwork
from pomona.stages.measure.circle_options import CircleOptions
from pomona.stages.measure.circles import CircleTerms, circle_terms, see_circles
from pomona.stages.measure.neighbours import edges_of_others
from pomona.stages.measure.options import MeasureOptions
from pomona.stages.measure.spheroid_fit import Fitted, SpheroidEvidence, SpheroidPrior, fit_spheroids
from pomona.stages.measure.spheroids import Spheroids
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, side_of
from pomona.values.photos import Photos

_ANY_SIZE = 0.3  # the spread of widths, as a share, before any fruit is measured
_LEAST_SPREAD = 0.02  # fruits of one survey differ at least so much
_GUESSED_UP = 0.2  # radians: how far the cameras' mean up may be from up
_NOISES = (0.3, 6.0)  # how many times the usual noise the masks of a survey may have
_POINT_NOISE = 0.06  # radii: stereo flattens round things
_PLAIN = 0.75  # the visibility from which a fruit is hardly hidden
_MEDIAN_OF_BELL = 0.6745  # standard deviations: the median distance from the mean


@dataclass(frozen=True, eq=False)
class _Seen:
    """What is seen of n fruits: masks (k,) by their indices, sorted by fruit, and `points` (m, 3) by fruit."""

    fruit_idx: IntArray
    mask_idx: IntArray
    points: dict[int, FloatArray]
    views: IntArray


def measure(
    fused: Fused,
    detections: SurveyDetections,
    cameras: Cameras,
    photos: Photos | None = None,
    *,
    network: CirclesNetwork | None = None,
    options: MeasureOptions | None = None,
    progress: Progress | None = None,
) -> Fruits:
    """Return the fruits with centre, diameter and its standard deviation, height, visibility, weight and sides.

    `fused` are the fruits with the detections that saw them (`pomona.stages.fuse`), `detections` those of all photos,
    in which the observations' ids are looked up, and `cameras` those in metres; sides need `photos`. The n fruits keep
    their ids and order; centres (n, 3) and lengths (n,) are metres in the cameras' frame.

    A spheroid is fitted to the fruit's points and to the outlines of its masks together, first by itself, then with
    what the well-seen fruits of the survey say of the others, and with the circles that `network` (by default the
    shipped one) sees in `photos`, of round kinds of fruit that have no points. `visibility` is the share of the fruit's
    disc that the photo which shows most of it shows. A fruit that is hidden too far to be measured keeps its centre,
    and has NaN, a reason, and how large it is likely to be as `rough_diameters_m`.
    """
    options, progress = options or MeasureOptions(), progress or Silent()
    if len(fused.fruits) == 0:
        return fused.fruits
    masks = mask_rays(
        detections,
        cameras,
        rays_per_mask=options.rays_per_photo,
        only=fused.observations,
        hull_slack=options.hull_slack,
    )
    seen = _all_seen(fused, masks, options)
    widths_m, reasons = _first_widths(fused, seen, masks)
    fitting = np.array([not reason for reason in reasons])
    if fitting.any():
        circles = None
        if photos is not None and options.circles is not None and options.kind.is_round and not seen.points:
            circles = _circles(
                fused, detections, cameras, photos, widths_m, fitting, network, options.circles, progress
            )
        options = options.known_by(points=len(fused.cloud) > 0, circles=circles is not None)
        fitted = _fit(fused, seen, masks, cameras, widths_m / 2, fitting, options, circles)
        fruits = _fruits(
            fused,
            fitted,
            fitting,
            reasons,
            _visibilities(fitted.spheroids, seen, masks, fitting),
            options,
            metric=cameras.frame.metric,
        )
    else:
        fruits = replace(fused.fruits, diameters_m=np.full(len(reasons), np.nan), reasons=tuple(reasons))
    if photos is not None:
        fruits = replace(fruits, sides=sides_of(fused, photos))
    return weigh(fruits, options.allometry, cameras.frame)


def _all_seen(fused: Fused, masks: MaskRays, options: MeasureOptions) -> _Seen:
    """Return what is seen of each fruit; detections in photos without a camera are of no use."""
    fruit_idx, mask_idx = masks.seen(fused.observations, fused.fruits.ids)
    order = np.lexsort((mask_idx, fruit_idx))
    fruit_idx, mask_idx = fruit_idx[order], mask_idx[order]
    pairs = np.unique(np.column_stack([fruit_idx, masks.photo_idx[mask_idx]]), axis=0)
    views = np.bincount(pairs[:, 0], minlength=len(fused.fruits))
    place_of = {fruit_id: i for i, fruit_id in enumerate(fused.fruits.ids.tolist())}
    points = {place_of[i]: xyz for i, xyz in _points(fused.cloud, options).items() if i in place_of and len(xyz) >= 4}
    return _Seen(fruit_idx, mask_idx, points, views)


def _points(cloud: FruitCloud, options: MeasureOptions) -> dict[int, FloatArray]:
    """Return at most `points_per_fruit` points (m, 3) of each fruit, evenly from all of them, by id."""
    result = {}
    for fruit_id, idx in cloud.by_fruit():
        step = max(1, -(-len(idx) // options.points_per_fruit))
        result[fruit_id] = cloud.points_in_world[idx[::step]]
    return result


def _first_widths(fused: Fused, seen: _Seen, masks: MaskRays) -> tuple[FloatArray, list[str]]:
    """Return how wide each fruit is at first sight (n,), and why it cannot be measured, "" where it can."""
    places = fused.fruits.centers_in_world
    mask_widths_m = masks.extents[seen.mask_idx] * masks.distances(places[seen.fruit_idx], seen.mask_idx)
    widths_m, reasons = np.full(len(places), np.nan), []
    bounds = np.searchsorted(seen.fruit_idx, np.arange(len(places) + 1))
    for i, (low, high) in enumerate(pairwise(bounds.tolist())):
        reason = ""
        if seen.views[i] == 0:
            reason = "no mask of it in a photo with a camera"
        elif i not in seen.points and seen.views[i] < 2:
            reason = "seen in one photo only, and without points: its distance is not known"
        else:
            # Most masks are partly hidden, and a few hold two fruits.
            widths_m[i] = np.percentile(mask_widths_m[low:high], 75)
            if not widths_m[i] > 0:
                reason = "its points lie behind the cameras that saw it"
        reasons.append(reason)
    return widths_m, reasons


def _fit(
    fused: Fused,
    seen: _Seen,
    masks: MaskRays,
    cameras: Cameras,
    radii_m: FloatArray,
    fitting: BoolArray,
    options: MeasureOptions,
    circles: CircleTerms | None,
) -> Fitted:
    """Return the spheroids of the fruits that can be fitted: by themselves, then with what all have in common."""
    n = int(fitting.sum())
    up_is_known = cameras.frame.up_is_known
    frame = frame_along(np.array([0, 0, 1.0]) if up_is_known else -cameras.cam_from_world[:, 1, :3].mean(axis=0))
    start = Spheroids(
        fused.fruits.centers_in_world[fitting],
        radii_m[fitting],
        np.full(n, options.kind.height_to_width),
        np.zeros((n, 2)),
        frame,
    )
    assert options.place_radii is not None
    prior = SpheroidPrior(
        radius_m=float(np.median(start.radii)),
        radius_sd=_ANY_SIZE,
        ratio=options.kind.height_to_width,
        ratio_sd=float(np.hypot(options.ratio_sd, options.single_ratio_sd)),
        tilt_sd=options.tilt_sd if up_is_known else float(np.hypot(options.tilt_sd, _GUESSED_UP)),
        place_radii=options.place_radii,
    )
    evidence = _evidence(seen, masks, start, fitting, options)
    alone = fit_spheroids(start, evidence, prior)
    if n >= options.fewest_clear:  # of fewer, noise is not told from what is wrong with a fruit
        evidence = _as_noisy_as_it_is(alone, evidence)
        if not seen.points:  # a cloud's clusters may be parts of one fruit, whose outline is then none of another's
            evidence = replace(evidence, others=edges_of_others(alone.spheroids, evidence))
        alone = fit_spheroids(start, evidence, prior)
        if circles is not None and options.circles is not None:
            circles = circles.as_outlines_have_it(
                alone.spheroids, alone.covariances[:, 3, 3], _clear(alone, options), options.circles
            )
            alone = fit_spheroids(start, evidence, prior, circles)
        prior = _prior_of_all(alone, prior, options)
    elif circles is None:
        return alone
    return fit_spheroids(start, evidence, prior, circles)


def _circles(
    fused: Fused,
    detections: SurveyDetections,
    cameras: Cameras,
    photos: Photos,
    widths_m: FloatArray,
    fitting: BoolArray,
    network: CirclesNetwork | None,
    options: CircleOptions,
    progress: Progress,
) -> CircleTerms:
    """Return what photos show of the fruits that can be fitted, as they see it."""
    number = np.full(len(fitting), -1)
    number[fitting] = np.arange(fitting.sum())
    place_of = dict(zip(fused.fruits.ids.tolist(), number.tolist(), strict=True))
    fruit_idx = np.array([place_of.get(i, -1) for i in fused.observations.fruit_id.tolist()], np.int64)
    seen = see_circles(
        fused.fruits.centers_in_world[fitting],
        float(np.median(widths_m[fitting])) / 2,
        fruit_idx,
        fused.observations,
        detections,
        photos,
        cameras,
        network or CirclesNetwork(),
        options,
        progress,
    )
    return circle_terms(seen, options)


def _clear(alone: Fitted, options: MeasureOptions) -> BoolArray:
    """Return which fruits' widths are known best."""
    sds = np.sqrt(alone.covariances[:, 3, 3])
    return np.asarray(sds <= max(options.clear_sd, float(np.percentile(sds, 100 * options.clear_share))))


def _evidence(
    seen: _Seen, masks: MaskRays, start: Spheroids, fitting: BoolArray, options: MeasureOptions
) -> SpheroidEvidence:
    """Return the rays along the outlines of the fruits' masks, and the points on them, each group for one fruit."""
    number = np.cumsum(fitting) - 1
    mine = fitting[seen.fruit_idx]
    of, mask_idx = number[seen.fruit_idx[mine]], seen.mask_idx[mine]
    rays = masks.outlines[mask_idx]
    photo_idx = masks.photo_idx[mask_idx]
    pixels_m = masks.distances(start.centers[of], mask_idx) * masks.px_angles[mask_idx]
    typical_m = float(np.median(start.radii))
    # Of a small mask's few pixels, each is a ray more than once; of an outline that leaves cut, less is on the hull.
    whole = options.independent * masks.edge_shares[mask_idx]
    says = np.minimum(whole, masks.edge_counts[mask_idx] / 2) / options.rays_per_photo
    # Photos beside each other show the same bumps, leaves and shadows: their masks err together.
    counts = np.bincount(of, minlength=len(start))[of]
    says /= 1 + (counts - 1) * options.photos_together
    parts: list[tuple[Array, ...]] = [
        (
            of,
            np.repeat(masks.eyes_in_world[photo_idx][:, None], rays.shape[1], axis=1),
            rays,
            np.repeat(says[:, None], rays.shape[1], axis=1),
            np.hypot(options.pixel_noise * pixels_m, options.shape_noise * typical_m),
            np.ones(len(of)),
            np.zeros(rays.shape[:2]),
        )
    ]
    for i, points in seen.points.items():
        if fitting[i]:
            parts.append(_point_groups(int(number[i]), points, typical_m, options))
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.argsort(columns[0], kind="stable")
    return SpheroidEvidence(*(column[order] for column in columns))


def _point_groups(number: int, points: FloatArray, typical_m: float, options: MeasureOptions) -> tuple[Array, ...]:
    """Return the points of one fruit in groups as large as those of rays, the last filled up with what says nothing."""
    k = options.rays_per_photo
    groups = -(-len(points) // k)
    places = np.concatenate([points, np.repeat(points[:1], groups * k - len(points), axis=0)])
    weights = np.zeros(groups * k)
    weights[: len(points)] = options.points_as_masks * options.independent / len(points)
    return (
        np.full(groups, number),
        places.reshape(groups, k, 3),
        np.zeros((groups, k, 3)),
        weights.reshape(groups, k),
        np.full(groups, _POINT_NOISE * typical_m),
        np.ones(groups),
        np.zeros((groups, k)),
    )


def _as_noisy_as_it_is(fitted: Fitted, evidence: SpheroidEvidence) -> SpheroidEvidence:
    """Return the evidence with the noise of its outlines: rays that pass outside tell it, which no leaf explains.

    Where outlines are noisy they are wrong in whole pieces, in several photos alike, so each ray says less: of places
    and sizes, and even less of how exact these are.
    """
    is_ray = (evidence.weights > 0) & (np.abs(evidence.rays).sum(axis=2) > 0)
    off = (fitted.distances_m / evidence.noises_m[:, None])[is_ray & (fitted.distances_m > 0)]
    if len(off) == 0:
        return evidence
    noise = float(np.clip(np.median(off) / _MEDIAN_OF_BELL, *_NOISES))
    rough = max(noise, 1.0)
    weights = np.where(is_ray, evidence.weights / rough**2, evidence.weights)
    return replace(evidence, noises_m=noise * evidence.noises_m, weights=weights, trust=evidence.trust / rough**2)


def _prior_of_all(alone: Fitted, prior: SpheroidPrior, options: MeasureOptions) -> SpheroidPrior:
    """Return what the fruits that are seen well say of the others: how wide, and how high for that, they are."""
    variances = alone.covariances[:, 3, 3]
    clear = _clear(alone, options)
    if clear.sum() < options.fewest_clear:
        return prior
    logs = np.log(alone.spheroids.radii[clear])
    middle = float(np.median(logs))
    spread2 = robust_sd(logs) ** 2 - float(variances[clear].mean())
    # What the prior itself said of each ratio is taken out before they are put together.
    known = 1 / alone.covariances[clear, 4, 4]
    said = np.maximum(known - prior.ratio_sd**-2, 1e-6)
    off = np.log(alone.spheroids.ratios[clear] / prior.ratio) * known / said
    weights = 1 / (1 / said + options.single_ratio_sd**2)
    total = float(weights.sum()) + options.ratio_sd**-2
    return replace(
        prior,
        radius_m=float(np.exp(middle)),
        radius_sd=max(float(np.sqrt(max(spread2, 0.0))), _LEAST_SPREAD),
        ratio=prior.ratio * float(np.exp((weights * off).sum() / total)),
        ratio_sd=options.single_ratio_sd,
    )


def _visibilities(spheroids: Spheroids, seen: _Seen, masks: MaskRays, fitting: BoolArray) -> FloatArray:
    """Return the share (n,) of its disc that the photo shows which shows most of a fruit."""
    mine = fitting[seen.fruit_idx]
    of, mask_idx = (np.cumsum(fitting) - 1)[seen.fruit_idx[mine]], seen.mask_idx[mine]
    discs_m2 = spheroids.disc_areas(masks.rays[mask_idx], of)
    shares = masks.areas[mask_idx] * masks.distances(spheroids.centers[of], mask_idx) ** 2 / discs_m2
    most = np.zeros(len(spheroids))
    np.maximum.at(most, of, shares)
    return np.asarray(np.minimum(most, 1.0))


def doubted_sds(sds: FloatArray, own_sds: FloatArray, options: MeasureOptions) -> FloatArray:
    """Return standard deviations (n,) of widths, as shares, had `own_sds` (n,) been as large as they turn out to be.

    Where little is seen of a fruit, it is more often altogether wrong (a mask holds a neighbour, too, or leaves cut it
    alike in all photos) than a fit supposes. What `sds` (n,) owe to what was known beforehand is not in doubt.
    """
    known_beforehand = np.maximum(sds**-2 - own_sds**-2, 0)
    turn_out = own_sds * np.maximum(own_sds / options.trusted_sd, 1) ** options.doubt
    return np.asarray((turn_out**-2 + known_beforehand) ** -0.5)


def _fruits(
    fused: Fused,
    fitted: Fitted,
    fitting: BoolArray,
    reasons: list[str],
    visibilities: FloatArray,
    options: MeasureOptions,
    *,
    metric: bool,
) -> Fruits:
    """Return the fruits as measured; sizes that are far from the others', or hardly known, are taken back."""
    diameters_m = 2 * fitted.spheroids.radii
    heights_m = diameters_m * fitted.spheroids.ratios
    sds = np.hypot(doubted_sds(np.sqrt(fitted.covariances[:, 3, 3]), fitted.own_sds, options), options.relative_sd)
    median_m = size_of_fruits(diameters_m, FruitSize()).diameter_m
    far = (diameters_m < options.smallest * median_m) | (diameters_m > options.largest * median_m)
    assert options.largest_sd is not None
    vague = fitted.own_sds > options.largest_sd
    for k, i in enumerate(np.flatnonzero(fitting).tolist()):
        if far[k]:
            reasons[i] = (
                f"{1000 * diameters_m[k]:.0f} mm would fit, far from the median of {1000 * median_m:.0f} mm"
                if metric
                else f"{diameters_m[k] / median_m:.2g} times the median width would fit, far from it"
            )
        elif vague[k]:
            why = "hidden too far" if visibilities[k] < _PLAIN else "not clear enough"
            reasons[i] = f"{why}: its width is not known to {100 * options.largest_sd:g} %"
    centers = fused.fruits.centers_in_world.copy()
    centers[fitting] = fitted.spheroids.centers
    good = ~(far | vague)

    def of_all(values: FloatArray, known: BoolArray = good) -> FloatArray:
        every = np.full(len(fitting), np.nan)
        every[np.flatnonzero(fitting)[known]] = values[known]
        return every

    return replace(
        fused.fruits,
        centers_in_world=centers,
        diameters_m=of_all(diameters_m),
        diameter_sds_m=of_all(sds * diameters_m),
        heights_m=of_all(heights_m),
        rough_diameters_m=of_all(diameters_m, vague & ~far),
        rough_diameter_sds_m=of_all(sds * diameters_m, vague & ~far),
        visibilities=of_all(visibilities, ~far),
        reasons=tuple(reasons),
    )


def sides_of(fused: Fused, photos: Photos) -> tuple[str, ...]:
    """Return for each fruit the side whose photos saw it, "both" for more than one, "" for none."""
    side_of_photo = {photo.name: photo.side for photo in photos}
    sides: dict[int, set[str]] = {i: set() for i in fused.fruits.ids.tolist()}
    for fruit_id, name in zip(fused.observations.fruit_id.tolist(), fused.observations.photo, strict=True):
        if fruit_id in sides and name in side_of_photo:
            sides[fruit_id].add(side_of_photo[name])
    return tuple(side_of(seen) for seen in sides.values())
