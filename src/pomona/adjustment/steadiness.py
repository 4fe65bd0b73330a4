"""Whether the middle of the picture stays where it is: in digitally stabilised videos it does not.

Phones steady a video by cutting each frame out of another part of the sensor. To first order that looks like a turn of
the camera, which an adjustment gladly takes it for; what is left grows with the square of the distance from the middle,
and bends the row. By each photo's own points, a shift of its middle can be told from a turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.adjustment.bundle import feature_noise_px
from pomona.adjustment.normal_equations import TAIL, derivatives
from pomona.basics.arrays import SD_OF_MAD, BoolArray, FloatArray, IntArray
from pomona.values.cameras import Cameras

# A photo's pose, middle and focal length are nine numbers: with so many points, seen by three photos or more each, a
# few wrong ones do not matter. Fewer photos than this say nothing of a scatter.
_LEAST_POINTS, _LEAST_PHOTOS = 30, 8
# Steps of the robust fit, which is linear but for its weights.
_STEPS = 6
# Middles scatter by 0.6 to 1.1 of their standard deviations where lenses stay as they are, by 2.2 and more where they
# do not; below this share of the picture's width it does not matter.
_WANDERS, _NOTABLE = 1.8, 0.005


@dataclass(frozen=True, eq=False)
class Middles:
    """How far (n, 2), in pixels, the middle of each of n photos is from its lens's, and how well that is known.

    NaN for photos with too few points.
    """

    offsets_px: FloatArray
    sds_px: FloatArray


def middles(cameras: Cameras) -> Middles:
    """Return where each photo by itself has the middle of its picture, with its pose and focal length free, too.

    Points stay where all photos together have them, so that shifts are found somewhat too small.
    """
    noise_px = feature_noise_px(cameras)
    views = np.bincount(cameras.track_point_idx, minlength=len(cameras.points_in_world))
    order = np.argsort(cameras.track_photo_idx, kind="stable")
    of_photos = np.split(order, np.searchsorted(cameras.track_photo_idx[order], np.arange(1, len(cameras))))
    offsets_px, sds_px = np.full((len(cameras), 2), np.nan), np.full((len(cameras), 2), np.nan)
    for i, mine in enumerate(of_photos):
        here = mine[views[cameras.track_point_idx[mine]] > 2]
        if len(here) >= _LEAST_POINTS:
            offsets_px[i], sds_px[i] = _middle(cameras, int(cameras.intrinsics_idx[i]), here, noise_px)
    return Middles(offsets_px, sds_px)


def _middle(cameras: Cameras, lens_idx: int, here: IntArray, noise_px: float) -> tuple[FloatArray, FloatArray]:
    of_photo, of_lens, _, off_px = derivatives(cameras, lens_idx, here)
    of_middle = np.broadcast_to(np.eye(2), (len(here), 2, 2))
    design = np.concatenate([of_middle, of_photo, of_lens[:, :, :1]], axis=2) / noise_px
    wanted, change = -off_px / noise_px, np.zeros(design.shape[2])
    sizes = np.sqrt((design**2).sum((0, 1)))
    inverse = np.zeros((len(sizes), len(sizes)))
    for _ in range(_STEPS):
        weights = 1 / (1 + ((wanted - design @ change) ** 2).sum(1) / TAIL**2)
        normal = np.einsum("k,kij,kil->jl", weights, design, design) / np.outer(sizes, sizes)
        inverse = np.linalg.pinv(normal, hermitian=True) / np.outer(sizes, sizes)
        change = inverse @ np.einsum("k,kij,ki->j", weights, design, wanted)
    return change[:2], np.sqrt(np.diag(inverse)[:2])


def wandering_middles(cameras: Cameras) -> list[str]:
    """Return a sentence where the middles of photos scatter by more than they are uncertain, for a person."""
    found = middles(cameras)
    widths_px = np.array([lens.width_px for lens in cameras.intrinsics])[cameras.intrinsics_idx]
    known: BoolArray = np.isfinite(found.offsets_px).all(1)
    apart, shares = [], []
    for lens_idx in np.unique(cameras.intrinsics_idx):
        here = known & (cameras.intrinsics_idx == lens_idx)
        if here.sum() < 2:
            continue
        offsets_px = found.offsets_px[here] - np.median(found.offsets_px[here], axis=0)
        apart.append(offsets_px / found.sds_px[here])
        shares.append(offsets_px / widths_px[here, None])
    if sum(map(len, apart)) < _LEAST_PHOTOS:
        return []
    in_sds, share = (SD_OF_MAD * float(np.median(np.abs(np.concatenate(part)))) for part in (apart, shares))
    if in_sds < _WANDERS or share < _NOTABLE:
        return []
    first, last = cameras.photos[0], cameras.photos[-1]
    return [
        f"The middle of the picture wanders from photo to photo ({first} to {last}), by about {100 * share:.1f} % of "
        f"its width, {in_sds:.1f} times as far as it is uncertain: the photos were stabilised digitally, as videos of "
        "phones are, or taken with a rolling shutter in motion, or each was cropped in its own way. Places and sizes "
        "may be off by more than is said. Switch stabilisation off, or take photos instead of a video"
    ]
