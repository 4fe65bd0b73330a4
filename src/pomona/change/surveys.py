"""Two surveys compared: from what their folders hold to a `Comparison`."""

from __future__ import annotations

from dataclasses import replace
from datetime import date, datetime

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, counted
from pomona.basics.geometry import estimate_similarity
from pomona.change.comparison import Comparison
from pomona.change.matching import Overlay, lay_over
from pomona.errors import InputError
from pomona.fruit.geometry.near_photos import in_view
from pomona.stages.planting import on_trees
from pomona.survey.reader import SurveyReader
from pomona.values.cameras import Cameras
from pomona.values.fruits import Fruits

# As many fruits have to be the same for two surveys to be laid over each other.
_LEAST_COMMON = 8
# Surveys in metres of their own contradict each other where scales differ by this share and so many sigmas.
_SAME_SCALE, _CONTRADICTION = 0.01, 4.0

Dates = tuple[date, date]


def compare_surveys(before: SurveyReader, after: SurveyReader, *, dates: Dates | None = None) -> Comparison:
    """Return what became of the fruits of one survey in a later one of the same row.

    `dates` are those of the two; otherwise those of their photos. Frames may be any. Raises `InputError` where it is
    the same survey twice, where one has too few fruits, and where they have too few fruits in common.
    """
    if before.folder == after.folder:
        raise InputError(f"{before.folder} is compared with itself: name two surveys of the row")
    for survey in (before, after):
        if len(survey.fruits) < _LEAST_COMMON:
            raise InputError(
                f"{survey.folder} has {counted(len(survey.fruits), 'fruit')}: at least {_LEAST_COMMON} are needed to "
                "find the place of one survey in another"
            )
    diameters = _usual_diameter(before), _usual_diameter(after)
    metric = before.frame.metric, after.frame.metric
    exact = metric[0] and metric[1] and not (before.frame.approximate or after.frame.approximate)
    overlay = lay_over(
        before.fruits.centers_in_world, after.fruits.centers_in_world, diameters,
        rigid=exact, same_frame=all(metric), least_common=_LEAST_COMMON,
    )  # fmt: skip
    if overlay is None:
        raise InputError(
            f"{before.folder.name} and {after.folder.name} have nothing in common: no place was found where clearly "
            f"more fruits of one lie on fruits of the other ({len(before.fruits)} and {len(after.fruits)}) than chance "
            "brings there. Are they of the same row, and did not most of its fruits leave it in between?"
        )
    days, warnings = _days(before, after, dates)
    warnings += _warnings_of_scale(before, after, overlay, exact) + _warnings_of_following(before, after, overlay)
    unit = _metres_per_unit(before, after, overlay)
    old, new = _in_one_frame(before, after, overlay)
    return Comparison(
        before=_scaled(old, unit),
        after=_scaled(new, unit),
        pairs=overlay.pairs,
        apart_m=unit * overlay.apart,
        after_from_before=overlay.target_from_source,
        before_in_view=_in_view(overlay.placed, after) & ~overlay.source_lost,
        after_in_view=_in_view(overlay.carried_back(after.fruits.centers_in_world), before) & ~overlay.target_lost,
        days=days,
        metric=any(metric),
        bent_m=unit * overlay.bent,
        warnings=tuple(warnings),
    )


def _usual_diameter(survey: SurveyReader) -> float:
    sizes = survey.fruits.diameters_m[np.isfinite(survey.fruits.diameters_m)]
    if not len(sizes):
        raise InputError(f"{survey.folder} has no fruit with a diameter, which all distances are compared with")
    return float(np.median(sizes))


def _metres_per_unit(before: SurveyReader, after: SurveyReader, overlay: Overlay) -> float:
    """Return what a unit of the second survey is in the better metres of the two."""
    one, other = before.frame, after.frame
    better = one.metric and (not other.metric or (other.approximate and not one.approximate))
    return 1 / overlay.target_from_source.scale if better else 1.0


def _in_one_frame(before: SurveyReader, after: SurveyReader, overlay: Overlay) -> tuple[Fruits, Fruits]:
    """Return both surveys' fruits in the frame of the second, on the trees of the one that knows trees.

    Those that are the same hang on the same tree, wherever a person moved them.
    """
    fruits, pairs = before.fruits, overlay.pairs
    old = replace(_scaled(fruits, overlay.target_from_source.scale), centers_in_world=overlay.placed)
    new = after.fruits
    # A person may have named trees of a few fruits where none are known.
    if len(after.trunks) or (new.tree_ids.any() and not len(before.trunks)):
        return _as_the_same(_on_trees_of(after, old), new, pairs), new
    if not fruits.tree_ids.any():
        return old, new
    # Where the survey is that knows trees: the other one may not know up, from where the nearest trunk is told.
    there = replace(new, centers_in_world=overlay.carried_back(new.centers_in_world))
    there = _on_trees_of(before, there)
    new = replace(new, tree_ids=there.tree_ids, other_tree_ids=there.other_tree_ids)
    return old, _as_the_same(new, old, pairs[:, ::-1])


def _as_the_same(fruits: Fruits, others: Fruits, pairs: IntArray) -> Fruits:
    """Return fruits (n) on the trees of those of others (m) that are the same by `pairs` (k, 2) of both."""
    tree_ids, beside = fruits.tree_ids.copy(), fruits.other_tree_ids.copy()
    tree_ids[pairs[:, 0]], beside[pairs[:, 0]] = others.tree_ids[pairs[:, 1]], others.other_tree_ids[pairs[:, 1]]
    return replace(fruits, tree_ids=tree_ids, other_tree_ids=beside)


def _on_trees_of(survey: SurveyReader, fruits: Fruits) -> Fruits:
    """Return fruits, in a survey's frame, on the tree of its nearest trunk.

    Of trees that a person named alone, which have no trunks and may be one fruit, on that of its nearest fruit.
    """
    if len(survey.trunks):
        return on_trees(fruits, survey.trunks)
    own = survey.fruits
    nearest = np.asarray(cKDTree(own.centers_in_world).query(fruits.centers_in_world)[1])
    return replace(fruits, tree_ids=own.tree_ids[nearest], other_tree_ids=own.other_tree_ids[nearest])


def _scaled(fruits: Fruits, factor: float) -> Fruits:
    if factor == 1.0:
        return fruits
    return replace(
        fruits,
        centers_in_world=factor * fruits.centers_in_world,
        diameters_m=factor * fruits.diameters_m,
        diameter_sds_m=factor * fruits.diameter_sds_m,
        heights_m=factor * fruits.heights_m,
        rough_diameters_m=factor * fruits.rough_diameters_m,
        rough_diameter_sds_m=factor * fruits.rough_diameter_sds_m,
    )


def _in_view(places: FloatArray, survey: SurveyReader) -> BoolArray:
    """Say of places (n, 3) in a survey's frame whether its photos show them, as near as it found fruits."""
    cameras: Cameras = survey.poses
    fruit, camera = _sightings(survey)
    if not len(fruit):
        return np.ones(len(places), bool)
    away = np.linalg.norm(survey.fruits.centers_in_world[fruit] - cameras.centers_in_world[camera], axis=1)
    return in_view(places, cameras, away)


def _sightings(survey: SurveyReader) -> tuple[IntArray, IntArray]:
    """Return indices (k,) of fruits and of the cameras that saw them."""
    place = {int(fruit): i for i, fruit in enumerate(survey.fruits.ids)}
    photo = {name: i for i, name in enumerate(survey.poses.photos)}
    seen = survey.observations
    both = [
        (place[int(fruit)], photo[name])
        for fruit, name in zip(seen.fruit_id, seen.photo, strict=True)
        if int(fruit) in place and name in photo
    ]
    pairs = np.array(both, np.int64).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


# ---- dates and scales ------------------------------------------------------------------------------------------------


def _days(before: SurveyReader, after: SurveyReader, dates: Dates | None) -> tuple[float, list[str]]:
    """Return the days between two surveys, NaN where they are not known, and what there is to say of them."""
    if dates is not None:
        first, second = (day.date() if isinstance(day, datetime) else day for day in dates)
        days = float((second - first).days)
    else:
        taken = _taken(before), _taken(after)
        without = [s.folder.name for s, when in zip((before, after), taken, strict=True) if when is None]
        if taken[0] is None or taken[1] is None:
            return float("nan"), [
                f"No photo of {' and '.join(without)} says when it was taken: growth a day is left out. "
                "Say the dates with `dates`"
            ]
        days = (taken[1] - taken[0]).total_seconds() / 86400
    if abs(days) < 0.5:
        return float("nan"), ["Both surveys are of one day: growth a day is left out"]
    if days < 0:
        older = f"{counted(round(-days), 'day')} older"
        return days, [
            f"{after.folder.name} is {older} than {before.folder.name}: what is called gone came, and "
            "what grew shrank. Name the older survey first"
        ]
    return days, []


def _taken(survey: SurveyReader) -> datetime | None:
    """When the middle one of the photos was taken, of those that say it."""
    times = sorted(photo.taken_at for photo in survey.photos if photo.taken_at is not None)
    return times[len(times) // 2] if times else None


def _warnings_of_following(before: SurveyReader, after: SurveyReader, overlay: Overlay) -> list[str]:
    """Say where only a part of the row could be laid over the other survey."""
    lost = [int(each.sum()) for each in (overlay.source_lost, overlay.target_lost)]
    if max(lost) < _LEAST_COMMON:
        return []
    return [
        f"{before.folder.name} could be laid over {after.folder.name} along a part of the row only: {lost[0]} of its "
        f"{len(before.fruits)} fruits and {lost[1]} of {len(after.fruits)} are at places where both surveys have "
        "fruits, but hardly any on the same place. They count as out of view and as not seen before, neither as gone "
        "nor as new. One of the surveys is probably bent, or has fruits of another row there: markers along the whole "
        "row keep it straight"
    ]


def _warnings_of_scale(before: SurveyReader, after: SurveyReader, overlay: Overlay, exact: bool) -> list[str]:
    """Say where sizes of the two cannot be compared, or not in millimetres."""
    if not (before.frame.metric or after.frame.metric):
        return ["Neither survey has a scale: growth is in units of the second, and only its share means something"]
    if not exact:
        if before.frame.approximate and after.frame.approximate:
            return ["Metres of both surveys are from an assumed fruit diameter: growth in mm is as exact as that"]
        return []
    a = before.fruits.centers_in_world[overlay.pairs[:, 0]]
    b = after.fruits.centers_in_world[overlay.pairs[:, 1]]
    free = estimate_similarity(a, b)
    spread = float(np.median(np.linalg.norm(free.apply(a) - b, axis=1))) / 1.54
    sd = spread / (float(np.sqrt(((a - a.mean(axis=0)) ** 2).sum())) or 1.0)
    if abs(free.scale - 1) > max(_SAME_SCALE, _CONTRADICTION * sd):
        return [
            f"The row is {100 * abs(free.scale - 1):.1f} % {'larger' if free.scale > 1 else 'smaller'} in "
            f"{after.folder.name} than in {before.folder.name}: the scale of one of them is off, and growth with it. "
            "Check the markers that each used"
        ]
    return []
