"""Circles of whole fruits that a network sees in crops of all photos, as evidence of where fruits are and how wide.

Outlines of masks are wrong where these hold parts of two fruits or miss what lies in the shade. The network sees the
pixels themselves; it is trained on rendered fruits, so what all its widths have in common counts for less than what
outlines say, and only differences from fruit to fruit are taken as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.fruit.crops.cutting import crops_by_photo
from pomona.fruit.crops.likeness import SeenFruits
from pomona.fruit.crops.sights import sights_of, well_spread
from pomona.fruit.geometry.spheres import Spheres
from pomona.progress import Progress
from pomona.stages.measure.circle_network import CirclesNetwork
from pomona.stages.measure.circle_options import CircleOptions
from pomona.stages.measure.spheroids import Spheroids
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import Observations
from pomona.values.photos import Photos

# Standard deviations are larger by this power of how much a crop enlarges its photo.
_ENLARGED = 2
_FEWEST_CLEAR = 6  # fruits tell nothing of all of them if they are fewer
_MEDIAN_OF_BELL = 0.6745  # standard deviations: the median distance from the mean


@dataclass(frozen=True, eq=False)
class SeenCircles:
    """k circles of n fruits: which fruit's (k,), seen from where, and what was seen.

    Crops were about `centers` (n, 3) in the world, where spheres of `radius_m` would be. `rotations` (k, 3, 3) lead
    from the world to the photo's camera, `eyes` (k, 3) are where it was; `offsets` (k, 2) are right and down, in radii,
    `log_ratios` (k,) of the radius; `sds` (k, 3) of these.
    """

    of: IntArray
    centers: FloatArray
    radius_m: float
    rotations: FloatArray
    eyes: FloatArray
    offsets: FloatArray
    log_ratios: FloatArray
    sds: FloatArray

    def __post_init__(self) -> None:
        k = len(self.of)
        set_checked(self, "of", (k,), np.int64)
        set_checked(self, "centers", (None, 3), np.float64)
        set_checked(self, "rotations", (k, 3, 3), np.float64)
        set_checked(self, "eyes", (k, 3), np.float64)
        set_checked(self, "offsets", (k, 2), np.float64)
        set_checked(self, "log_ratios", (k,), np.float64)
        set_checked(self, "sds", (k, 3), np.float64)


@dataclass(frozen=True, eq=False)
class CircleTerms:
    """What circles say of n fruits, as normal equations of centre and log radius about `starts` (n, 4).

    `precisions` (n, 4, 4) are the matrices, zeros where nothing is said, `pulls` (n, 4) what they are equal to.
    """

    starts: FloatArray
    precisions: FloatArray
    pulls: FloatArray

    def __post_init__(self) -> None:
        n = len(self.starts)
        set_checked(self, "starts", (n, 4), np.float64)
        set_checked(self, "precisions", (n, 4, 4), np.float64)
        set_checked(self, "pulls", (n, 4), np.float64)

    def __getitem__(self, selection: BoolArray | slice) -> CircleTerms:
        return CircleTerms(self.starts[selection], self.precisions[selection], self.pulls[selection])

    @classmethod
    def none(cls, fruits: int) -> CircleTerms:
        """Return what says nothing of so many fruits."""
        return cls(np.zeros((fruits, 4)), np.zeros((fruits, 4, 4)), np.zeros((fruits, 4)))

    def at(self, spheroids: Spheroids) -> FloatArray:
        """Return the gradients (n, 4) at spheroids."""
        off = np.column_stack([spheroids.centers, np.log(spheroids.radii)]) - self.starts
        return np.asarray((self.precisions @ off[:, :, None])[:, :, 0] - self.pulls)

    def log_radii(self, centers_in_world: FloatArray) -> FloatArray:
        """Return the logarithms (n,) of the radii that circles say of fruits at centres (n, 3); NaN where nothing."""
        off = centers_in_world - self.starts[:, :3]
        rest = self.pulls[:, 3] - (self.precisions[:, 3, :3] * off).sum(axis=1)
        known = self.precisions[:, 3, 3]
        return np.where(known > 0, self.starts[:, 3] + rest / np.where(known > 0, known, 1), np.nan)

    def lower_by(self, log_radius: float) -> CircleTerms:
        """Return the same of radii that are lower, by a logarithm."""
        return replace(self, pulls=self.pulls - log_radius * self.precisions[:, :, 3])

    def doubted(self, times: float) -> CircleTerms:
        """Return the same with variances so many times as large."""
        return replace(self, precisions=self.precisions / times, pulls=self.pulls / times)

    def as_outlines_have_it(
        self, spheroids: Spheroids, variances: FloatArray, clear: BoolArray, options: CircleOptions
    ) -> CircleTerms:
        """Return the same on the level of outlines, and counting for as much as both agree on single fruits.

        `spheroids` (n) are the fruits as outlines alone have them, `variances` (n,) of the logarithms of their radii;
        those that are `clear` (n,) tell how much circles are too wide or narrow, and how noisy they are.
        """
        off = self.log_radii(spheroids.centers) - np.log(spheroids.radii)
        clear = clear & np.isfinite(off)
        if clear.sum() < _FEWEST_CLEAR:
            return self
        level = float(np.median(off[clear]))
        expected = 1 / self.precisions[clear, 3, 3] + variances[clear]
        noise2 = float(np.median((off[clear] - level) ** 2 / expected)) / _MEDIAN_OF_BELL**2
        return self.lower_by(options.level_of_outlines * level).doubted(max(noise2, 1.0))


def see_circles(
    centers_in_world: FloatArray,
    radius_m: float,
    fruit_idx: IntArray,
    observations: Observations,
    detections: SurveyDetections,
    photos: Photos,
    cameras: Cameras,
    network: CirclesNetwork,
    options: CircleOptions,
    progress: Progress,
) -> SeenCircles:
    """Return the circles of fruits at centres (n, 3) in the photos that saw them.

    `fruit_idx` (m,) says of which fruit each observation is, −1 for none; `radius_m` is the usual one.
    """
    spheres = Spheres(centers_in_world, np.full(len(centers_in_world), radius_m))
    photo_of = {name: k for k, name in enumerate(cameras.photos)}
    photo_idx = np.array([photo_of.get(photo, -1) for photo in observations.photo], np.int64)
    pairs = np.unique(np.column_stack([photo_idx, fruit_idx])[(photo_idx >= 0) & (fruit_idx >= 0)], axis=0)
    sights = sights_of(spheres, pairs[:, 1], pairs[:, 0], cameras)
    sights = well_spread(sights, spheres, cameras, options.most_photos)
    scales = network.radius_px / np.maximum(sights.radii_px, 1e-9)
    circles, looked = np.zeros((len(sights), 6)), np.zeros(len(sights), bool)
    seen = SeenFruits(detections, observations.detection_id)
    progress.start("measure", len(np.unique(sights.photo_idx)))
    for mine, crops in crops_by_photo(
        sights, scales, network.side_px, seen, photos, cameras, progress, left_out="measures no fruit"
    ):
        circles[mine], looked[mine] = network.circles(crops), True
    sights, circles, scales = sights[looked], circles[looked], scales[looked]
    enlarged = np.maximum(scales, 1.0)[:, None] ** _ENLARGED
    return SeenCircles(
        sights.sphere_idx,
        centers_in_world,
        radius_m,
        cameras.cam_from_world[sights.photo_idx, :, :3],
        cameras.centers_in_world[sights.photo_idx],
        circles[:, :2],
        circles[:, 2],
        enlarged * np.exp(circles[:, 3:]),
    )


def circle_terms(seen: SeenCircles, options: CircleOptions) -> CircleTerms:
    """Return what circles say of the n fruits, each photo's three numbers a residual of centre and log radius.

    A fruit that is farther away than was thought looks smaller: the radius is tied to the place along the sight.
    """
    n, k = len(seen.centers), len(seen.of)
    sight = np.einsum("kij,kj->ki", seen.rotations, seen.centers[seen.of] - seen.eyes)
    depths = sight[:, 2]
    rows = np.zeros((k, 3, 4))
    for axis in (0, 1):
        # By how much a place moves aside of the sight, at the fruit's depth.
        rows[:, axis, :3] = seen.rotations[:, axis] - seen.rotations[:, 2] * (sight[:, axis] / depths)[:, None]
    rows[:, :2] /= seen.radius_m
    rows[:, 2, :3] = -seen.rotations[:, 2] / depths[:, None]
    rows[:, 2, 3] = 1.0
    said = np.column_stack([seen.offsets, seen.log_ratios])
    counts = np.bincount(seen.of, minlength=n)[seen.of]
    weights = 1 / np.hypot(seen.sds, options.least_sd) ** 2 / (1 + (counts - 1) * options.together)[:, None]
    weighted = rows * weights[:, :, None]
    precisions, pulls = np.zeros((n, 4, 4)), np.zeros((n, 4))
    np.add.at(precisions, seen.of, np.swapaxes(weighted, 1, 2) @ rows)
    np.add.at(pulls, seen.of, (weighted * said[:, :, None]).sum(axis=1))
    starts = np.column_stack([seen.centers, np.full(n, np.log(seen.radius_m))])
    return CircleTerms(starts, precisions, pulls)
