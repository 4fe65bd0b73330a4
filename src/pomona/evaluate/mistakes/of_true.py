"""Why a true fruit was missed, or merged with another."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pomona.evaluate.mistakes.ledger import Ledger
from pomona.evaluate.mistakes.stages import Kind, Stage
from pomona.evaluate.mistakes.values import Mistake, View

# What happens in one photo alone is no reason: one photo makes no fruit.
_SOME = 2


@dataclass(frozen=True, eq=False)
class _Story:
    """What photos tell of a true fruit.

    `px_of`: the pixels that each photo shows (NaN: not known), of photos that show enough or have a usable detection.
    `rows` are the detections in these that show it, `usable` those that could become fruit. `covering`: the detection
    of a neighbour that covers it, by photo, where it was not detected itself. `holders`: which found fruits have its
    usable detections, and how many.
    """

    true_idx: int
    px_of: Mapping[int, float]
    rows: Sequence[int]
    usable: Sequence[int]
    covering: Mapping[int, int]
    holders: Counter[int]

    @property
    def best_px(self) -> float:
        """The most pixels that a photo shows; NaN where it is not known."""
        return max((px for px in self.px_of.values() if math.isfinite(px)), default=math.nan)


def explain_true(kind: Kind, true_idx: int, ledger: Ledger, dropped: int | None) -> Mistake:
    """Return why a true fruit, missed or merged, was not found. `dropped`: the fruit there before the filter."""
    story = _story(true_idx, ledger)
    stage, reason, others = _stage(story, ledger, dropped)
    inside = _nearest(true_idx, ledger) if kind == "merged" else None
    if inside is not None:
        what = "" if inside in others else f", {_match_of(inside, ledger)},"
        reason += f" Fruit {inside}{what} covers its centre."
        others = tuple(dict.fromkeys((inside, *others)))
    truth = ledger.truth
    x, y, z = (float(v) for v in truth.centers_in_world[true_idx])
    return Mistake(
        kind=kind,
        stage=stage,
        reason=reason,
        fruit_id=None,
        truth_id=ledger.true_id(true_idx),
        center_in_world=(x, y, z),
        diameter_m=float(truth.diameters_m[true_idx]),
        facts=_facts(story),
        fruit_ids=others,
        weight=float(len(story.px_of)) if math.isnan(story.best_px) else story.best_px,
        views=tuple(_view(photo_idx, story, ledger) for photo_idx in story.px_of),
    )


def _story(true_idx: int, ledger: Ledger) -> _Story:
    shown, least_px = ledger.shown, ledger.options.visible_px
    rows = ledger.rows_of_true.get(true_idx, [])
    usable = [row for row in rows if ledger.usable(row)]
    detected = {ledger.photo(row) for row in usable}
    sights = ledger.sights_of_true.get(true_idx, [])
    all_px = {int(shown.sight_photo_idx[s]): float(shown.sight_px[s]) for s in sights}
    enough = {photo: px for photo, px in all_px.items() if photo in detected or not px < least_px} or all_px
    px_of = {**enough, **{photo: math.nan for photo in detected if photo not in enough}}
    covering = {int(shown.sight_photo_idx[s]): int(shown.covering[s]) for s in sights if shown.covering[s] >= 0}
    return _Story(
        true_idx,
        px_of,
        [row for row in rows if ledger.photo(row) in px_of],
        usable,
        {photo: row for photo, row in covering.items() if photo in px_of and photo not in detected},
        Counter(ledger.fruit_of_row[row] for row in usable if row in ledger.fruit_of_row),
    )


def _stage(story: _Story, ledger: Ledger, dropped: int | None) -> tuple[Stage, str, tuple[int, ...]]:
    """Return the stage, the reason in words, and the found fruits concerned."""
    n, k = len(story.px_of), ledger.photos(story.usable)
    of = f"Detected in {k} of {_photos(n)}{_in_pieces(story, ledger)}"
    if n == 0:
        return "unplaced", "No photo that has a camera shows it.", ()
    if dropped is not None:
        mm, views = ledger.apart_mm(dropped, story.true_idx), ledger.joined.views[ledger.place_of[dropped]]
        found = f"found as fruit {dropped} from {views} photos, {mm:.0f} mm off its place"
        return "dropped", f"{of}; {found}, and then dropped by the filter.", (dropped,)
    if k == 0:
        return _undetected(story, ledger)
    if k == 1:
        return "once", f"{of}: one photo does not tell how far away it is.", _holders(story)
    return _detected(story, ledger, of)


def _undetected(story: _Story, ledger: Ledger) -> tuple[Stage, str, tuple[int, ...]]:
    n, weak, covered = len(story.px_of), ledger.photos(story.rows), len(story.covering)
    unsure = "" if math.isfinite(story.best_px) else ", if leaves do not hide it there"
    if weak >= _SOME and weak >= covered:
        best = max(float(ledger.shown.scores[row]) for row in story.rows)
        reason = f"Detected in {weak} of {_photos(n)}, but with scores of up to {best:.2f}"
        return "weak", f"{reason}, and those below {ledger.evidence.least_score:.2f} are not used.", ()
    if covered >= _SOME:
        reason = f"Not detected by itself in any of {_photos(n)}{unsure}"
        return "covered", f"{reason}; in {covered} a neighbour's detection covers it.", ()
    also = [f"; weakly in {weak}"] * (weak > 0) + [f"; a neighbour's detection covers it in {covered}"] * (covered > 0)
    return "undetected", f"Not detected in any of {_photos(n)}{unsure}{''.join(also)}.", ()


def _detected(story: _Story, ledger: Ledger, of: str) -> tuple[Stage, str, tuple[int, ...]]:
    holders, total = _holders(story), len(story.usable)
    if not holders:
        return "apart", f"{of}; none of these detections became part of a fruit.", ()
    holder, count = holders[0], story.holders[holders[0]]
    if count < _SOME:
        names = ", ".join(ledger.called(fruit_id) for fruit_id in holders[:3])
        return "apart", f"{of}, not joined; {len(holders)} of {total} detections went to {names}.", holders
    if ledger.true_of_fruit(holder) == story.true_idx:
        mm = ledger.apart_mm(holder, story.true_idx)
        made = f"{count} of {total} detections make {ledger.called(holder)}, {mm:.0f} mm off its place"
        return "elsewhere", f"{of}; {made}.", holders
    went = f"{count} of {total} detections went to {ledger.called(holder)}, {_match_of(holder, ledger)}"
    return "taken", f"{of}; {went}.", holders


def _in_pieces(story: _Story, ledger: Ledger) -> str:
    """In how many photos more than one detection shows it, where there are any."""
    several = sum(count > 1 for count in Counter(ledger.photo(row) for row in story.usable).values())
    return f", in pieces in {several}" if several else ""


def _photos(count: int) -> str:
    return f"{count} photo{'s' * (count != 1)}"


def _holders(story: _Story) -> tuple[int, ...]:
    """The found fruits that have its detections, most first; those that have but one only where none has more."""
    most = story.holders.most_common()
    return tuple(fruit_id for fruit_id, count in most if count >= min(_SOME, most[0][1]))


def _match_of(fruit_id: int, ledger: Ledger) -> str:
    true_idx = ledger.true_of_fruit(fruit_id)
    if true_idx is None:
        return "whose detections show several true fruits"
    most = "no true fruit" if true_idx < 0 else f"true fruit {ledger.true_id(true_idx)}"
    return f"whose detections mostly show {most}"


def _nearest(true_idx: int, ledger: Ledger) -> int | None:
    fruits = ledger.evidence.fruits
    if not len(fruits):
        return None
    apart_m = np.linalg.norm(fruits.centers_in_world - ledger.truth.centers_in_world[true_idx], axis=1)
    return int(fruits.ids[int(np.nanargmin(apart_m))])


def _facts(story: _Story) -> str:
    if not story.px_of:
        return ""
    if math.isnan(story.best_px):
        return f"in the picture of {_photos(len(story.px_of))}"
    return f"shown by {_photos(len(story.px_of))}, at best {story.best_px:.0f} pixels"


def _view(photo_idx: int, story: _Story, ledger: Ledger) -> View:
    cameras, pixels = ledger.evidence.cameras, story.px_of[photo_idx]
    rows = [row for row in story.rows if ledger.photo(row) == photo_idx]
    away = cameras.centers_in_world[photo_idx] - ledger.truth.centers_in_world[story.true_idx]
    note = _said(rows, story.covering.get(photo_idx), ledger)
    return View(
        cameras.photos[photo_idx],
        f"{pixels:.0f} pixels: {note}" if math.isfinite(pixels) else note,
        pixels if math.isfinite(pixels) else -float(np.linalg.norm(away)),
        tuple(int(ledger.shown.detection_ids[row]) for row in rows),
        ledger.side(photo_idx),
    )


def _said(rows: Sequence[int], covering: int | None, ledger: Ledger) -> str:
    """What a photo has of a fruit, in words."""
    usable = [row for row in rows if ledger.usable(row)]
    if usable:
        best = max(usable, key=lambda row: float(ledger.shown.scores[row]))
        holder = ledger.fruit_of_row.get(best)
        to = "not joined" if holder is None else f"in {ledger.called(holder)}"
        return f"detected ({ledger.shown.scores[best]:.2f}), {to}"
    if rows:
        return f"only weakly detected ({max(float(ledger.shown.scores[row]) for row in rows):.2f})"
    if covering is not None:
        return f"inside a detection of true fruit {ledger.true_id(int(ledger.shown.true_idx[covering]))}"
    return "not detected"
