"""One adjustment of all sides and pieces at the end of mapping: photos of one camera and zoom share their lens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from pomona.adjustment.bundle import adjust, feature_noise_px, is_no_worse
from pomona.adjustment.lenses import credible_focals, known_focals, lenses_apart, share_lenses, wrong_focals
from pomona.adjustment.steadiness import wandering_middles
from pomona.progress import Progress
from pomona.stages.sfm.pieces import Piece
from pomona.stages.sfm.selection import mean_error_px
from pomona.values.cameras import Cameras, WorldFrame, concatenate, split
from pomona.values.photos import Photo, Photos

# Where EXIF makes lenses one that photos have apart, matches agree as well with it as with these, but for so much,
# which is chance: beyond, it was another zoom, and the photos are believed.
_MORE_NOISE = 1.05


def with_one_lens(pieces: Sequence[Piece], photos: Photos, progress: Progress) -> list[Piece]:
    """Return the pieces, each in its own frame, after an adjustment in which lenses are shared and EXIF is heard.

    On a flat scene seen head-on, focal length trades against distance, and each piece makes up its own; here all
    pieces say together what it is, and where they cannot tell, EXIF decides. Warns of EXIF that the photos contradict,
    of one camera that must have zoomed, and of stabilised videos. The pieces are returned unchanged where
    nothing is gained.
    """
    joined = concatenate([piece.cameras for piece in pieces], WorldFrame())
    known = photos.by_name()
    progress.start("Adjusting cameras together")
    adjusted = _adjusted(joined, known, trust_exif=True)
    if adjusted is None or wrong_focals(adjusted, known):
        adjusted = _adjusted(joined, known, trust_exif=False)
    elif len(adjusted.intrinsics) < len(share_lenses(joined, known).intrinsics):
        apart = _adjusted(joined, known, trust_exif=False)
        if apart is not None and feature_noise_px(adjusted) > _MORE_NOISE * feature_noise_px(apart):
            adjusted = apart
    cameras = adjusted or joined
    for sentence in wrong_focals(cameras, known) + lenses_apart(cameras, known) + wandering_middles(cameras):
        progress.warn(sentence)
    if adjusted is None:
        return list(pieces)
    parts = split(adjusted, [len(piece.cameras) for piece in pieces])
    return [_with(piece, part) for piece, part in zip(pieces, parts, strict=True)]


def _adjusted(joined: Cameras, photos: Mapping[str, Photo], *, trust_exif: bool) -> Cameras | None:
    """The cameras with shared lenses, adjusted; None where the scene does not look as it did before."""
    shared = share_lenses(joined, photos, trust_exif=trust_exif)
    focals = known_focals(shared, photos) if trust_exif else credible_focals(shared, photos)
    adjusted = adjust(shared, noise_px=feature_noise_px(joined), focals=focals)
    return adjusted if is_no_worse(adjusted, joined) else None


def _with(piece: Piece, cameras: Cameras) -> Piece:
    cameras = replace(cameras, frame=piece.cameras.frame)
    return replace(piece, cameras=cameras, mean_reprojection_error_px=mean_error_px(cameras))
