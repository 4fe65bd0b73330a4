"""What is known of a row beforehand: its fruits, and in which photos they can be seen."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pomona.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.errors import InputError


@dataclass(frozen=True, eq=False)
class Truth:
    """n true fruits: `ids` (n,), `centers_in_world` (n, 3) and `diameters_m` (n,), `tree_ids` (n,; 0: not known).

    `boxes_in_world` (n, 6) holds x, y, z of the lowest and of the highest corner where fruits were annotated as boxes,
    else None. Of k sightings `seen_id[i]` shows `seen_px[i]` pixels in photo `seen_photo[i]`; `seen_photo` is None
    where nobody knows what can be seen.
    """

    ids: IntArray
    centers_in_world: FloatArray
    diameters_m: FloatArray
    tree_ids: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    boxes_in_world: FloatArray | None = None
    seen_photo: tuple[str, ...] | None = None
    seen_id: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    seen_px: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        n, k = len(self.ids), len(self.seen_photo or ())
        if len(self.tree_ids) == 0:
            object.__setattr__(self, "tree_ids", np.zeros(n, np.int64))
        for name in ("ids", "tree_ids"):
            set_checked(self, name, (n,), np.int64)
        set_checked(self, "centers_in_world", (n, 3), np.float64)
        set_checked(self, "diameters_m", (n,), np.float64)
        if self.boxes_in_world is not None:
            set_checked(self, "boxes_in_world", (n, 6), np.float64)
        set_checked(self, "seen_id", (k,), np.int64)
        set_checked(self, "seen_px", (k,), np.int64)
        if len(np.unique(self.ids)) != n:
            raise InputError("Truth.ids: expected unique ids")
        if not (np.isfinite(self.centers_in_world).all() and (self.diameters_m > 0).all()):
            raise InputError("Truth: expected finite centres and positive diameters of all fruits")

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def from_boxes(cls, boxes_in_world: FloatArray, ids: IntArray | None = None) -> Truth:
        """Return fruits from boxes (n, 6): the centre is the box's, the diameter the mean of its three sides."""
        boxes = np.asarray(boxes_in_world, float).reshape(-1, 6)
        low, high = boxes[:, :3], boxes[:, 3:]
        if not (high > low).all():
            raise InputError("Truth.boxes_in_world: expected each highest corner above its lowest corner")
        ids = np.arange(1, len(boxes) + 1) if ids is None else ids
        return cls(ids, (low + high) / 2, (high - low).mean(1), boxes_in_world=boxes)

    def visible(self, min_px: int = 120, min_photos: int = 2) -> BoolArray | None:
        """Say of each fruit (n,) whether `min_photos` photos show `min_px` pixels of it; None where it is not known."""
        if self.seen_photo is None:
            return None
        seen_ids, photos = np.unique(self.seen_id[self.seen_px >= min_px], return_counts=True)
        return np.isin(self.ids, seen_ids[photos >= min_photos])
