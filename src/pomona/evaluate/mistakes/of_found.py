"""Why a found fruit is false, or the second of a true one."""

from __future__ import annotations

import math

import numpy as np

from pomona.evaluate.mistakes.ledger import Ledger
from pomona.evaluate.mistakes.stages import Kind, Stage
from pomona.evaluate.mistakes.values import Mistake, View

_MOST_NAMED = 4


def explain_found(kind: Kind, fruit_id: int, ledger: Ledger, doubled: tuple[int, int] | None) -> Mistake:
    """Return why a found fruit is false or double. `doubled`: the true fruit beside it, and the fruit that is it."""
    fruits = ledger.evidence.fruits
    i = int(np.flatnonzero(fruits.ids == fruit_id)[0])
    stage, reason, true_idx = _stage(fruit_id, ledger, doubled)
    x, y, z = (float(v) for v in fruits.centers_in_world[i])
    score = float(fruits.scores[i])
    views = int(fruits.views[i])
    told = [] if math.isnan(score) else [f"score {score:.2f}"]
    told.append(f"seen in {views} photo{'s' * (views != 1)}")
    concerned = (fruit_id,) if doubled is None else (fruit_id, doubled[1])
    return Mistake(
        kind=kind,
        stage=stage,
        reason=reason,
        fruit_id=fruit_id,
        truth_id=None if true_idx is None else ledger.true_id(true_idx),
        center_in_world=(x, y, z),
        diameter_m=float(fruits.diameters_m[i]),
        facts=", ".join(told),
        fruit_ids=concerned,
        weight=float(views) if math.isnan(score) else score,
        views=tuple(view for one in concerned for view in _views(one, ledger, several=len(concerned) > 1)),
    )


def _stage(fruit_id: int, ledger: Ledger, doubled: tuple[int, int] | None) -> tuple[Stage, str, int | None]:
    """Return the stage, the reason in words, and the true fruit concerned."""
    counts = ledger.trues_of_fruit(fruit_id)
    total, shows = counts.total(), ledger.true_of_fruit(fruit_id)
    beside = None if doubled is None else doubled[0]
    if total == 0:
        return "unknown", "Which detections made it is not known.", beside
    if shows is None:
        named = [f"{count} true fruit {ledger.true_id(true)}" for true, count in counts.most_common() if true >= 0]
        none = [f"{counts[-1]} none"] * (counts[-1] > 0)
        listed = ", ".join([*named[:_MOST_NAMED], *none])
        return "mixed", f"Its {total} detections show several true fruits: {listed}.", beside
    if shows < 0:
        return "nothing", f"{counts[-1]} of its {total} detections show no true fruit.", beside
    if doubled is not None and shows == beside:
        return _twice(fruit_id, ledger, doubled)
    mm = ledger.apart_mm(fruit_id, shows)
    reason = f"{counts[shows]} of its {total} detections show true fruit {ledger.true_id(shows)}, {mm:.0f} mm away"
    if doubled is not None:
        reason += f"; it lies on true fruit {ledger.true_id(doubled[0])}, which fruit {doubled[1]} is"
    return "misplaced", f"{reason}.", shows


def _twice(fruit_id: int, ledger: Ledger, doubled: tuple[int, int]) -> tuple[Stage, str, int]:
    true_idx, other = doubled
    mine, its = (
        {ledger.side(ledger.photo(row)) for row in ledger.rows_of_fruit.get(one, ())} for one in (fruit_id, other)
    )
    start = f"It and fruit {other} both are true fruit {ledger.true_id(true_idx)}"
    if mine and its and not mine & its:
        sides = f"seen from {' and '.join(sorted(mine))}, the other from {' and '.join(sorted(its))}"
        return "sides", f"{start}; this one was {sides}.", true_idx
    sides = " and ".join(sorted(side for side in mine & its if side)) or "one side"
    return "twice", f"{start}, and photos of {sides} saw both.", true_idx


def _views(fruit_id: int, ledger: Ledger, *, several: bool) -> list[View]:
    """Return the photos that saw a fruit, with what its detection there shows."""
    shown, cameras = ledger.shown, ledger.evidence.cameras
    views = []
    for row in ledger.rows_of_fruit.get(fruit_id, ()):
        photo = cameras.photos[ledger.photo(row)]
        true_idx = int(shown.true_idx[row])
        shows = "no true fruit" if true_idx < 0 else f"true fruit {ledger.true_id(true_idx)}"
        name = f"detection of fruit {fruit_id}" if several else "detection"
        note = f"{name} ({shown.scores[row]:.2f}) shows {shows}"
        side = ledger.side(ledger.photo(row))
        group = f"{fruit_id} {side}" if several else side
        detection_id = int(shown.detection_ids[row])
        views.append(View(photo, note, _area_px(photo, detection_id, ledger), (detection_id,), group))
    return views


def _area_px(photo: str, detection_id: int, ledger: Ledger) -> float:
    found = ledger.evidence.detections[photo]
    return float(found.masks[int(np.flatnonzero(found.ids == detection_id)[0])].area_px)
