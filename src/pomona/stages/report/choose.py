"""Which photos stand for a survey: those that show most fruits, of every side, not the same fruits again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pomona.values.cameras import Cameras
from pomona.values.fruits import Observations
from pomona.values.photos import Photos


def choose_photos(photos: Photos, cameras: Cameras, observations: Observations, count: int) -> tuple[str, ...]:
    """Return names of up to `count` photos that have a place, in the survey's order, from every side.

    In each side the photo that shows most fruits not yet shown comes first; where nothing is left to show, photos
    are taken evenly from the side's.
    """
    placed = set(cameras.photos)
    by_side = {side: [p.name for p in photos if p.side == side and p.name in placed] for side in photos.sides}
    shown: dict[str, set[int]] = {}
    for fruit_id, photo in zip(observations.fruit_id, observations.photo, strict=True):
        shown.setdefault(photo, set()).add(int(fruit_id))
    chosen: list[str] = []
    for side, share in _shares({side: len(names) for side, names in by_side.items()}, count).items():
        chosen += _best(by_side[side], shown, share)
    order = {name: i for i, name in enumerate(photos.names)}
    return tuple(sorted(chosen, key=order.__getitem__))


def _shares(available: Mapping[str, int], count: int) -> dict[str, int]:
    """Deal `count` places out to the sides in turn, none getting more than it has photos."""
    shares = dict.fromkeys(available, 0)
    while sum(shares.values()) < min(count, sum(available.values())):
        for side in shares:
            if shares[side] < available[side] and sum(shares.values()) < count:
                shares[side] += 1
    return shares


def _best(names: Sequence[str], shown: Mapping[str, set[int]], count: int) -> list[str]:
    chosen: list[str] = []
    covered: set[int] = set()
    while len(chosen) < count:
        rest = [name for name in names if name not in chosen]
        best = max(rest, key=lambda name: len(shown.get(name, set()) - covered))
        gain = shown.get(best, set()) - covered
        if not gain:
            missing = count - len(chosen)
            evenly = (np.arange(missing) + 0.5) / missing * len(rest)
            return chosen + [rest[i] for i in evenly.astype(int)]
        chosen.append(best)
        covered |= gain
    return chosen
