"""One camera, one focal length: which photos share a lens, and what is known of it before anything is placed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pomona.adjustment.bundle import feature_noise_px
from pomona.adjustment.covariance import focal_sds
from pomona.adjustment.weights import weighted
from pomona.basics.arrays import FloatArray, IntArray, set_checked
from pomona.values.cameras import Cameras
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo

# Focal lengths differ, a zoom was changed or a file contradicts its photos, beyond so many standard deviations ...
_CONTRADICTION = 4.0
# ... and by more than this share: lenses also breathe with focus, and their stabilisation moves them.
_ALIKE_FOCAL = 0.03
# Nobody knows a focal length better than this, whatever formal precision says.
_LEAST_SD = 1e-4


@dataclass(frozen=True, eq=False)
class LensVotes:
    """What the photos of l lenses themselves say of their focal lengths: `focals_px` (l,) ± `sds` (l,), as shares."""

    focals_px: FloatArray
    sds: FloatArray

    def __post_init__(self) -> None:
        set_checked(self, "focals_px", (len(self.focals_px),), np.float64)
        set_checked(self, "sds", (len(self.focals_px),), np.float64)


def frames_of(cameras: Cameras) -> IntArray:
    """Return a number (n,) for each photo: photos that points connect have the same."""
    n, m = len(cameras), len(cameras.points_in_world)
    edges = np.ones(len(cameras.track_point_idx)), (cameras.track_photo_idx, n + cameras.track_point_idx)
    labels = connected_components(coo_array(edges, shape=(n + m, n + m)), directed=False)[1][:n]
    return np.asarray(np.unique(labels, return_inverse=True)[1], np.int64)


def lens_votes(cameras: Cameras) -> LensVotes:
    """Return what photos say of each lens by their own points, without EXIF and markers."""
    _, weights = weighted(cameras, noise_px=feature_noise_px(cameras), free_frames=frames_of(cameras))
    return LensVotes(np.array([lens.focal_px for lens in cameras.intrinsics]), focal_sds(cameras, weights))


def share_lenses(cameras: Cameras, photos: Mapping[str, Photo], *, trust_exif: bool = False) -> Cameras:
    """Return the cameras with one lens for all photos of one `camera_key`, model and size, where theirs are alike.

    Sides and pieces are mapped one by one, and each estimates the lens anew: they vote, weighted by what each knows.
    Lenses that contradict each other are left apart: there was another zoom, or a piece is placed wrongly. With
    `trust_exif` they are one lens all the same where EXIF gives their focal length, and EXIF votes, too.
    """
    votes = lens_votes(cameras)
    known = known_focals(cameras, photos) if trust_exif else [None] * len(cameras.intrinsics)
    groups: dict[tuple[str, str, int, int], list[list[int]]] = {}
    for i in np.argsort(votes.sds, kind="stable").tolist():
        lens = cameras.intrinsics[i]
        users = {_key(photos, name) for name in _users(cameras, i)}
        key = " and ".join(sorted(users)), lens.model, lens.width_px, lens.height_px
        same = groups.setdefault(key, [])
        alike = [group for group in same if known[i] is not None or not contradict(votes, group[0], i)]
        if alike:
            alike[0].append(i)
        else:
            groups[key].append([i])
    members = sorted(group for of_key in groups.values() for group in of_key)
    shared = {i: k for k, group in enumerate(members) for i in group}
    return replace(
        cameras,
        intrinsics=tuple(_elected(cameras, votes, group, known[group[0]]) for group in members),
        intrinsics_idx=np.array([shared[int(i)] for i in cameras.intrinsics_idx], np.int64),
    )


def contradict(votes: LensVotes, one: int, other: int) -> bool:
    """Say whether two lenses have focal lengths that cannot be one."""
    apart = abs(float(np.log(votes.focals_px[one] / votes.focals_px[other])))
    return apart > max(_ALIKE_FOCAL, _CONTRADICTION * float(np.hypot(votes.sds[one], votes.sds[other])))


def known_focals(cameras: Cameras, photos: Mapping[str, Photo]) -> list[tuple[float, float] | None]:
    """Return for each lens the focal length that EXIF gives (px) and its standard deviation as a share, or None."""
    found: list[tuple[float, float] | None] = []
    for lens_idx in range(len(cameras.intrinsics)):
        users = [photos[name] for name in _users(cameras, lens_idx) if name in photos]
        known = [photo.focal for photo in users if photo.focal is not None]
        focal_px, sd_px = np.median(np.array(known), axis=0) if known else (0.0, 0.0)
        found.append((float(focal_px), float(sd_px / focal_px)) if known else None)
    return found


def credible_focals(cameras: Cameras, photos: Mapping[str, Photo]) -> list[tuple[float, float] | None]:
    """Return `known_focals` without those that contradict the lens that a photo has."""
    return [
        None if known is not None and _is_contradicted(lens.focal_px, known) else known
        for lens, known in zip(cameras.intrinsics, known_focals(cameras, photos), strict=True)
    ]


def _is_contradicted(focal_px: float, known: tuple[float, float]) -> bool:
    return abs(float(np.log(focal_px / known[0]))) > max(_ALIKE_FOCAL, _CONTRADICTION * known[1])


def lenses_apart(shared: Cameras, photos: Mapping[str, Photo]) -> list[str]:
    """Return a sentence for each camera to which `share_lenses` had to leave more than one lens."""
    lenses: dict[tuple[str, int, int], list[int]] = {}
    for lens_idx, lens in enumerate(shared.intrinsics):
        key = _key(photos, _users(shared, lens_idx)[0])
        lenses.setdefault((key, lens.width_px, lens.height_px), []).append(lens_idx)
    sentences = []
    for (key, _, _), several in lenses.items():
        if len(several) > 1:
            each = "; ".join(
                f"{shared.intrinsics[i].focal_px:.0f} pixels in {_listed(_users(shared, i))}" for i in several
            )
            sentences.append(
                f"Photos of {key or 'one camera'} have different focal lengths: {each}. Either the zoom was changed, "
                "or photos were cropped, or one of these groups of photos is placed wrongly: check their places"
            )
    return sentences


def wrong_focals(cameras: Cameras, photos: Mapping[str, Photo]) -> list[str]:
    """Return a sentence for each lens whose EXIF contradicts what its photos show."""
    sentences = []
    for lens_idx, known in enumerate(known_focals(cameras, photos)):
        focal_px = cameras.intrinsics[lens_idx].focal_px
        if known is not None and _is_contradicted(focal_px, known):
            sentences.append(
                f"EXIF of {_listed(_users(cameras, lens_idx))} gives a focal length of {known[0]:.0f} pixels, but the "
                f"photos show {focal_px:.0f}: they were cropped, edited or zoomed digitally after EXIF was written. "
                "The photos are believed; give them as they come from the camera"
            )
    return sentences


def _elected(cameras: Cameras, votes: LensVotes, group: list[int], known: tuple[float, float] | None) -> Intrinsics:
    """The lens of most weight, with the focal length that the lenses of a group, and EXIF if it is known, elect."""
    best = cameras.intrinsics[group[0]]
    focals_px, sds = [*votes.focals_px[group]], [*votes.sds[group]]
    if known is not None:
        focals_px.append(known[0])
        sds.append(known[1])
    weights = 1 / np.maximum(sds, _LEAST_SD) ** 2
    focal_px = float(np.exp((weights * np.log(focals_px)).sum() / weights.sum()))
    params = best.params.copy()
    params[list(best.focal_idx)] *= focal_px / best.focal_px
    return replace(best, params=params)


def _users(cameras: Cameras, lens_idx: int) -> list[str]:
    return [name for name, j in zip(cameras.photos, cameras.intrinsics_idx, strict=True) if j == lens_idx]


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{names[0]} to {names[-1]} ({len(names)} photos)"


def _key(photos: Mapping[str, Photo], name: str) -> str:
    return photos[name].camera_key if name in photos else ""
