"""Why a true fruit was missed or merged with another, and why a found one is false or the second of a true one."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import counted
from pomona.evaluate.diagnosis.associations import Associations
from pomona.evaluate.diagnosis.mistakes import Kind, Mistake, MistakeView, Stage

# What happens in one photo alone is no cause: it takes two to place a fruit.
_FEWEST = 2
# So many true fruits are listed at most where a found fruit's detections show several.
_MOST_LISTED = 4


@dataclass(frozen=True, eq=False)
class _Sightings:
    """What photos show of a true fruit.

    `px_of`: the pixels that each photo shows (NaN: not known), of photos that show enough or have a usable detection.
    `rows` are the detections in these that show it, `usable` those that could become fruit. `covering`: the detection
    of a neighbour that covers it, by photo, where it was not detected itself. `joined_in`: which found fruits its
    usable detections became part of, and how many.
    """

    true_idx: int
    px_of: Mapping[int, float]
    rows: Sequence[int]
    usable: Sequence[int]
    covering: Mapping[int, int]
    joined_in: Counter[int]

    @property
    def best_px(self) -> float:
        """The most pixels that a photo shows; NaN where it is not known."""
        return max((px for px in self.px_of.values() if math.isfinite(px)), default=math.nan)


def explain_lost(kind: Kind, true_idx: int, links: Associations, dropped: int | None) -> Mistake:
    """Return why a true fruit, missed or merged, was not found. `dropped`: the fruit there that did not stay."""
    seen = _sightings(true_idx, links)
    stage, reason, others = _why_not_found(seen, links, dropped)
    inside = _nearest(true_idx, links) if kind == "merged" else None
    if inside is not None:
        what = "" if inside in others else f", {_match_of(inside, links)},"
        reason += f" Fruit {inside}{what} covers its centre."
        others = tuple(dict.fromkeys((inside, *others)))
    truth = links.truth
    x, y, z = (float(v) for v in truth.centers_in_world[true_idx])
    return Mistake(
        kind=kind,
        stage=stage,
        reason=reason,
        fruit_id=None,
        truth_id=links.true_id(true_idx),
        center_in_world=(x, y, z),
        diameter_m=float(truth.diameters_m[true_idx]),
        facts=_facts(seen),
        fruit_ids=others,
        weight=float(len(seen.px_of)) if math.isnan(seen.best_px) else seen.best_px,
        views=tuple(_view(photo_idx, seen, links) for photo_idx in seen.px_of),
    )


def _sightings(true_idx: int, links: Associations) -> _Sightings:
    compared, least_px = links.compared, links.options.visible_px
    rows = links.rows_of_true.get(true_idx, [])
    usable = [row for row in rows if links.usable(row)]
    detected = {links.photo(row) for row in usable}
    sights = links.sights_of_true.get(true_idx, [])
    all_px = {int(compared.sight_photo_idx[s]): float(compared.sight_px[s]) for s in sights}
    enough = {photo: px for photo, px in all_px.items() if photo in detected or not px < least_px} or all_px
    px_of = {**enough, **{photo: math.nan for photo in detected if photo not in enough}}
    covering = {
        int(compared.sight_photo_idx[s]): int(compared.covering[s]) for s in sights if compared.covering[s] >= 0
    }
    return _Sightings(
        true_idx,
        px_of,
        [row for row in rows if links.photo(row) in px_of],
        usable,
        {photo: row for photo, row in covering.items() if photo in px_of and photo not in detected},
        Counter(links.fruit_of_row[row] for row in usable if row in links.fruit_of_row),
    )


def _why_not_found(seen: _Sightings, links: Associations, dropped: int | None) -> tuple[Stage, str, tuple[int, ...]]:
    """Return the stage, the reason in words, and the found fruits concerned."""
    n, k = len(seen.px_of), links.photos(seen.usable)
    of = f"Detected in {k} of {counted(n, 'photo')}{_in_pieces(seen, links)}"
    if n == 0:
        return "unplaced", "No photo that has a camera shows it.", ()
    if dropped is not None:
        mm, views = links.distance_mm(dropped, seen.true_idx), links.unfiltered.views[links.place_of[dropped]]
        found = f"found as fruit {dropped} from {views} photos, {mm:.0f} mm off its place"
        stage, loss = links.loss_of(dropped)
        return stage, f"{of}; {found}, and then {loss}.", (dropped,)
    if k == 0:
        return _undetected(seen, links)
    if k == 1:
        return "once", f"{of}: one photo does not tell how far away it is.", _fruits_of(seen)
    return _detected(seen, links, of)


def _undetected(seen: _Sightings, links: Associations) -> tuple[Stage, str, tuple[int, ...]]:
    n, weak, covered = len(seen.px_of), links.photos(seen.rows), len(seen.covering)
    unsure = "" if math.isfinite(seen.best_px) else ", if leaves do not hide it there"
    if weak >= _FEWEST and weak >= covered:
        best = max(float(links.compared.scores[row]) for row in seen.rows)
        reason = f"Detected in {weak} of {counted(n, 'photo')}, but with scores of up to {best:.2f}"
        return "weak", f"{reason}, and those below {links.survey.least_score:.2f} are not used.", ()
    if covered >= _FEWEST:
        reason = f"Not detected by itself in any of {counted(n, 'photo')}{unsure}"
        return "covered", f"{reason}; in {covered} a neighbour's detection covers it.", ()
    also = [f"; weakly in {weak}"] * (weak > 0) + [f"; a neighbour's detection covers it in {covered}"] * (covered > 0)
    return "undetected", f"Not detected in any of {counted(n, 'photo')}{unsure}{''.join(also)}.", ()


def _detected(seen: _Sightings, links: Associations, of: str) -> tuple[Stage, str, tuple[int, ...]]:
    fruit_ids, total = _fruits_of(seen), len(seen.usable)
    if not fruit_ids:
        return "apart", f"{of}; none of these detections became part of a fruit.", ()
    fruit_id, count = fruit_ids[0], seen.joined_in[fruit_ids[0]]
    if count < _FEWEST:
        names = ", ".join(links.name_of(fruit_id) for fruit_id in fruit_ids[:3])
        return "apart", f"{of}, not joined; {len(fruit_ids)} of {total} detections went to {names}.", fruit_ids
    if links.true_of_fruit(fruit_id) == seen.true_idx:
        mm = links.distance_mm(fruit_id, seen.true_idx)
        made = f"{count} of {total} detections make {links.name_of(fruit_id)}, {mm:.0f} mm off its place"
        return "elsewhere", f"{of}; {made}.", fruit_ids
    went = f"{count} of {total} detections went to {links.name_of(fruit_id)}, {_match_of(fruit_id, links)}"
    return "taken", f"{of}; {went}.", fruit_ids


def _in_pieces(seen: _Sightings, links: Associations) -> str:
    """In how many photos more than one detection shows it, where there are any."""
    several = sum(count > 1 for count in Counter(links.photo(row) for row in seen.usable).values())
    return f", in pieces in {several}" if several else ""


def _fruits_of(seen: _Sightings) -> tuple[int, ...]:
    """The found fruits that have its detections, most first; those that have but one only where none has more."""
    most = seen.joined_in.most_common()
    return tuple(fruit_id for fruit_id, count in most if count >= min(_FEWEST, most[0][1]))


def _match_of(fruit_id: int, links: Associations) -> str:
    true_idx = links.true_of_fruit(fruit_id)
    if true_idx is None:
        return "whose detections show several true fruits"
    most = "no true fruit" if true_idx < 0 else f"true fruit {links.true_id(true_idx)}"
    return f"whose detections mostly show {most}"


def _nearest(true_idx: int, links: Associations) -> int | None:
    fruits = links.survey.fruits
    if not len(fruits):
        return None
    apart_m = np.linalg.norm(fruits.centers_in_world - links.truth.centers_in_world[true_idx], axis=1)
    return int(fruits.ids[int(np.nanargmin(apart_m))])


def _facts(seen: _Sightings) -> str:
    if not seen.px_of:
        return ""
    if math.isnan(seen.best_px):
        return f"in the picture of {counted(len(seen.px_of), 'photo')}"
    return f"shown by {counted(len(seen.px_of), 'photo')}, at best {seen.best_px:.0f} pixels"


def _view(photo_idx: int, seen: _Sightings, links: Associations) -> MistakeView:
    cameras, pixels = links.survey.cameras, seen.px_of[photo_idx]
    rows = [row for row in seen.rows if links.photo(row) == photo_idx]
    away = cameras.centers_in_world[photo_idx] - links.truth.centers_in_world[seen.true_idx]
    note = _note(rows, seen.covering.get(photo_idx), links)
    return MistakeView(
        cameras.photos[photo_idx],
        f"{pixels:.0f} pixels: {note}" if math.isfinite(pixels) else note,
        pixels if math.isfinite(pixels) else -float(np.linalg.norm(away)),
        tuple(int(links.compared.detection_ids[row]) for row in rows),
        links.side(photo_idx),
    )


def _note(rows: Sequence[int], covering: int | None, links: Associations) -> str:
    """What a photo has of a fruit, in words."""
    usable = [row for row in rows if links.usable(row)]
    if usable:
        best = max(usable, key=lambda row: float(links.compared.scores[row]))
        fruit_id = links.fruit_of_row.get(best)
        to = "not joined" if fruit_id is None else f"in {links.name_of(fruit_id)}"
        return f"detected ({links.compared.scores[best]:.2f}), {to}"
    if rows:
        return f"only weakly detected ({max(float(links.compared.scores[row]) for row in rows):.2f})"
    if covering is not None:
        return f"inside a detection of true fruit {links.true_id(int(links.compared.true_idx[covering]))}"
    return "not detected"


def explain_found(kind: Kind, fruit_id: int, links: Associations, doubled: tuple[int, int] | None) -> Mistake:
    """Return why a found fruit is false or double. `doubled`: the true fruit beside it, and the fruit that is it."""
    fruits = links.survey.fruits
    i = int(np.flatnonzero(fruits.ids == fruit_id)[0])
    stage, reason, true_idx = _why_found(fruit_id, links, doubled)
    x, y, z = (float(v) for v in fruits.centers_in_world[i])
    score = float(fruits.scores[i])
    views = int(fruits.views[i])
    facts = [] if math.isnan(score) else [f"score {score:.2f}"]
    facts.append(f"seen in {counted(views, 'photo')}")
    concerned = (fruit_id,) if doubled is None else (fruit_id, doubled[1])
    return Mistake(
        kind=kind,
        stage=stage,
        reason=reason,
        fruit_id=fruit_id,
        truth_id=None if true_idx is None else links.true_id(true_idx),
        center_in_world=(x, y, z),
        diameter_m=float(fruits.diameters_m[i]),
        facts=", ".join(facts),
        fruit_ids=concerned,
        weight=float(views) if math.isnan(score) else score,
        views=tuple(view for one in concerned for view in _views(one, links, several=len(concerned) > 1)),
    )


def _why_found(fruit_id: int, links: Associations, doubled: tuple[int, int] | None) -> tuple[Stage, str, int | None]:
    """Return the stage, the reason in words, and the true fruit concerned."""
    counts = links.trues_of_fruit(fruit_id)
    total, shows = counts.total(), links.true_of_fruit(fruit_id)
    beside = None if doubled is None else doubled[0]
    if total == 0:
        return "unknown", "Which detections made it is not known.", beside
    if shows is None:
        named = [f"{count} true fruit {links.true_id(true)}" for true, count in counts.most_common() if true >= 0]
        none = [f"{counts[-1]} none"] * (counts[-1] > 0)
        listed = ", ".join([*named[:_MOST_LISTED], *none])
        return "mixed", f"Its {total} detections show several true fruits: {listed}.", beside
    if shows < 0:
        return "nothing", f"{counts[-1]} of its {total} detections show no true fruit.", beside
    if doubled is not None and shows == beside:
        return _twice(fruit_id, links, doubled)
    mm = links.distance_mm(fruit_id, shows)
    reason = f"{counts[shows]} of its {total} detections show true fruit {links.true_id(shows)}, {mm:.0f} mm away"
    if doubled is not None:
        reason += f"; it lies on true fruit {links.true_id(doubled[0])}, which fruit {doubled[1]} is"
    return "misplaced", f"{reason}.", shows


def _twice(fruit_id: int, links: Associations, doubled: tuple[int, int]) -> tuple[Stage, str, int]:
    true_idx, other = doubled
    mine, its = (
        {links.side(links.photo(row)) for row in links.rows_of_fruit.get(one, ())} for one in (fruit_id, other)
    )
    start = f"It and fruit {other} both are true fruit {links.true_id(true_idx)}"
    if mine and its and not mine & its:
        sides = f"seen from {' and '.join(sorted(mine))}, the other from {' and '.join(sorted(its))}"
        return "sides", f"{start}; this one was {sides}.", true_idx
    sides = " and ".join(sorted(side for side in mine & its if side)) or "one side"
    return "twice", f"{start}, and photos of {sides} saw both.", true_idx


def _views(fruit_id: int, links: Associations, *, several: bool) -> list[MistakeView]:
    """Return the photos that saw a fruit, with what its detection there shows."""
    compared, cameras = links.compared, links.survey.cameras
    views = []
    for row in links.rows_of_fruit.get(fruit_id, ()):
        photo = cameras.photos[links.photo(row)]
        true_idx = int(compared.true_idx[row])
        shows = "no true fruit" if true_idx < 0 else f"true fruit {links.true_id(true_idx)}"
        name = f"detection of fruit {fruit_id}" if several else "detection"
        note = f"{name} ({compared.scores[row]:.2f}) shows {shows}"
        side = links.side(links.photo(row))
        group = f"{fruit_id} {side}" if several else side
        detection_id = int(compared.detection_ids[row])
        views.append(MistakeView(photo, note, _area_px(photo, detection_id, links), (detection_id,), group))
    return views


def _area_px(photo: str, detection_id: int, links: Associations) -> float:
    found = links.survey.detections[photo]
    return float(found.masks[int(np.flatnonzero(found.ids == detection_id)[0])].area_px)
