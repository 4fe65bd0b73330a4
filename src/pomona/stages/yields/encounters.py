"""How often each fruit was seen from each side of the row, of how many photos that could have shown it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.basics.row_line import row_line, walk_of
from pomona.fruit.geometry.near_photos import in_view, places_in_pictures
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.stages.yields.options import YieldOptions
from pomona.values.cameras import Cameras
from pomona.values.fruits import Fruits, Observations
from pomona.values.trees import Trees

DEPTH_UNIT_M = 0.3
"""The unit of depths, for fruits of any size: leaves hide what is behind them, and are no smaller for cherries."""
_FEWEST_PHOTOS = 3  # of a side: of fewer, those at a row's end, no fruit is seen often enough to learn from
_FARTHER = 1.5  # times the usual distance: beyond, a photo is not expected to show a fruit
_FEWEST = 2  # photos that place a fruit
_NEARLY_ALL = 0.95
# Of true fruits that 0, 1, … photos show in masks, the share that masks are joined for: others take theirs.
_JOINED = np.array([0.0, 0.0, 0.52, 0.82, 0.97])
_SIZE_STEP, _MOST_STEPS = 0.1, 3.0  # sizes are in tenths above the median, on a logarithmic scale


@dataclass(frozen=True, eq=False)
class Encounters:
    """n fruits and s sides: how often each fruit was `seen` (n, s) in `photos` (n, s) that could have shown it.

    `depths` (n, s) is how far behind the middle of the row it hangs as seen from each side, and `sizes` (n,) how much
    larger than the median it is, in the units above; 0 where that is not known. Of fruits seen by 0, 1, … k − 1
    photos in all, the share `kept` (k,) was found; of those seen by more, all were.
    """

    seen: IntArray
    photos: IntArray
    depths: FloatArray
    sizes: FloatArray
    kept: FloatArray

    def __post_init__(self) -> None:
        n, s = np.shape(self.seen)
        for name in ("seen", "photos"):
            set_checked(self, name, (n, s), np.int64)
        set_checked(self, "depths", (n, s), np.float64)
        set_checked(self, "sizes", (n,), np.float64)
        set_checked(self, "kept", (None,), np.float64)

    def __len__(self) -> int:
        return len(self.seen)

    def __getitem__(self, selection: BoolArray | IntArray) -> Encounters:
        return Encounters(
            self.seen[selection], self.photos[selection], self.depths[selection], self.sizes[selection], self.kept
        )

    @property
    def sides(self) -> int:
        """How many sides of the row were photographed."""
        return self.seen.shape[1]


def encounters_of(
    fruits: Fruits,
    observations: Observations,
    cameras: Cameras,
    candidate_views: IntArray | None = None,
    options: YieldOptions | None = None,
) -> Encounters:
    """Return what photos show of n fruits, by side of the row; cameras (p) stand on one side or on both.

    `candidate_views` (m,) are the numbers of photos of all that masks were joined to; None: nothing was lost then.

    Sides are those of the row's middle line, whatever photos are called.
    """
    options = options or YieldOptions()
    line = row_line(fruits.centers_in_world, walk_of(cameras.centers_in_world))
    seen = _seen(fruits, observations, cameras)
    could = seen.with_all_of(_in_picture(fruits, cameras, seen))
    _, stands = line.along_across(cameras.centers_in_world)
    sides = [stands < 0, stands >= 0]
    photos = np.unique(could.photo_idx)
    sides = [side for side in sides if side[photos].sum() >= _FEWEST_PHOTOS] or [stands == stands]
    size = size_of_fruits(fruits.diameters_m, FruitSize())
    offsets = line.along_across(fruits.centers_in_world)[1] / DEPTH_UNIT_M
    depths = np.stack([-np.sign(stands[side].mean()) * offsets for side in sides], axis=1)
    steps = np.nan_to_num(np.log(fruits.diameters_m / size.diameter_m) / _SIZE_STEP)
    in_all = [(seen.counts(side, len(fruits)), could.counts(side, len(fruits))) for side in sides]
    usual = max(float(np.median(could_here)) for _, could_here in in_all)
    share = min(1.0, options.most_photos / max(usual, 1.0))
    counts = [_thinned(seen_here, could_here, share) for seen_here, could_here in in_all]
    return Encounters(
        np.stack([seen_here for seen_here, _ in counts], axis=1),
        np.stack([could_here for _, could_here in counts], axis=1),
        depths,
        np.clip(steps, -_MOST_STEPS, _MOST_STEPS),
        kept_shares(fruits.views, candidate_views, share),
    )


def trees_in_view(trees: Trees, fruits: Fruits, observations: Observations, cameras: Cameras) -> BoolArray:
    """Say of trees (t,) whether photos look at them: tables may have those of the rest of the row, and of other rows.

    They do where fruits hang, and where they show the place of the trunk as high as the fruits nearest to it hang.
    """
    result = np.isin(trees.ids, fruits.tree_ids) | np.isin(trees.ids, fruits.other_tree_ids)
    bare = np.flatnonzero(~result & np.isfinite(trees.xy_in_world).all(axis=1))
    if len(bare):
        seen = _seen(fruits, observations, cameras)
        sights = fruits.centers_in_world[seen.fruit_idx] - cameras.centers_in_world[seen.photo_idx]
        xy = trees.xy_in_world[bare]
        nearest = cKDTree(fruits.centers_in_world[:, :2]).query(xy)[1]
        places = np.column_stack([xy, fruits.centers_in_world[nearest, 2]])
        result[bare] = in_view(places, cameras, np.linalg.norm(sights, axis=1))
    return result


def kept_shares(views: IntArray, candidate_views: IntArray | None, share: float = 1.0) -> FloatArray:
    """Return the share (k,) of fruits seen by 0, 1, … k − 1 photos that were kept; of those seen by more, all were.

    `views` (n,) are the photos of those found, `candidate_views` (m,) of all that masks were joined to; None: all that
    two photos saw were found. Of fruits that few photos show, masks are joined for some only, and of these the filter
    drops many: true ones, too. Shares rise with the number of photos; `share` of these are counted.
    """
    joined = np.ones(len(_JOINED)) if candidate_views is None else _JOINED
    candidate_views = views if candidate_views is None else candidate_views
    most = int(candidate_views.max(initial=_FEWEST))
    found, candidates = (np.bincount(each, minlength=most + 1)[: most + 1] for each in (views, candidate_views))
    many = np.arange(most + 1) >= np.median(candidate_views)
    usual = found[many].sum() / max(candidates[many].sum(), 1)
    shares = np.where(candidates > 0, found / np.maximum(candidates, 1) / max(usual, 1e-9), np.nan)
    known = np.flatnonzero(candidates > 0)
    shares = np.interp(np.arange(most + 1), known, shares[known]) if len(known) else np.zeros(most + 1)
    shares[:_FEWEST] = 0  # where no candidate has so few photos, nothing was dropped; of fewer, there are none
    # Noise apart they rise: the mean of the least and the greatest line that does.
    rising = (np.maximum.accumulate(shares) + np.minimum.accumulate(shares[::-1])[::-1]) / 2
    rising[: len(joined)] *= joined[: len(rising)]
    thinned = rising[np.minimum(np.round(np.arange(most + 1) / share).astype(int), most)]
    enough = np.flatnonzero(thinned >= _NEARLY_ALL)
    return np.asarray(thinned[: enough[0]] if len(enough) else thinned)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """k pairs of a fruit and a photo, each once, in order: of a long row few photos are near a fruit."""

    fruit_idx: IntArray
    photo_idx: IntArray

    @classmethod
    def of(cls, fruit_idx: IntArray, photo_idx: IntArray) -> _Pairs:
        """Return pairs that come in any order, and more than once."""
        order = np.lexsort((photo_idx, fruit_idx))
        fruit_idx, photo_idx = fruit_idx[order], photo_idx[order]
        first = np.ones(len(order), bool)
        first[1:] = (np.diff(fruit_idx) > 0) | (np.diff(photo_idx) > 0)
        return cls(fruit_idx[first], photo_idx[first])

    def with_all_of(self, other: _Pairs) -> _Pairs:
        """Return the pairs of both."""
        return _Pairs.of(
            np.concatenate([self.fruit_idx, other.fruit_idx]), np.concatenate([self.photo_idx, other.photo_idx])
        )

    def counts(self, photos: BoolArray, fruits: int) -> IntArray:
        """Return how many of some photos (p,) each fruit (n,) is paired with."""
        return np.bincount(self.fruit_idx[photos[self.photo_idx]], minlength=fruits)


def _seen(fruits: Fruits, observations: Observations, cameras: Cameras) -> _Pairs:
    """Return which photo saw which fruit."""
    fruit_of = {fruit_id: i for i, fruit_id in enumerate(fruits.ids.tolist())}
    photo_of = {photo: j for j, photo in enumerate(cameras.photos)}
    pairs = [
        (fruit_of[fruit_id], photo_of[photo])
        for fruit_id, photo in zip(observations.fruit_id.tolist(), observations.photo, strict=True)
        if fruit_id in fruit_of and photo in photo_of
    ]
    fruit_idx, photo_idx = np.array(pairs, np.int64).reshape(-1, 2).T
    return _Pairs.of(fruit_idx, photo_idx)


def _in_picture(fruits: Fruits, cameras: Cameras, seen: _Pairs) -> _Pairs:
    """Return in which photos the middle of each fruit lies, unless these were taken from much farther away."""
    places, eyes = fruits.centers_in_world, cameras.centers_in_world
    away = np.linalg.norm(places[seen.fruit_idx] - eyes[seen.photo_idx], axis=1)
    reach_m = _FARTHER * float(np.median(away)) if len(away) else np.inf
    found = [(np.zeros(0, np.int64), np.zeros(0, np.int64))]
    found += [(idx, np.full(len(idx), j)) for j, idx in places_in_pictures(places, cameras, reach_m)]
    fruit_idx, photo_idx = (np.concatenate(column) for column in zip(*found, strict=True))
    return _Pairs.of(fruit_idx, photo_idx)


def _thinned(seen: IntArray, photos: IntArray, share: float) -> tuple[IntArray, IntArray]:
    """Return counts (n,) of a share of the photos: those beside each other show the same.

    What a photo saw stays seen: fruits of none were put there by a person, and are sure.
    """
    kept = np.ceil(photos * share).astype(np.int64)
    rounded = np.maximum(np.round(seen * share).astype(np.int64), seen > 0)
    return np.minimum(rounded, kept), kept
