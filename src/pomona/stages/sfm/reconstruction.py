"""Structure from motion of a survey, side by side."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pomona.basics.arrays import FloatArray, batches, counted
from pomona.basics.threads import cores
from pomona.errors import DamagedPhotoError, InputError, MissingFileError, ReconstructionError
from pomona.progress import Progress, Silent
from pomona.stages.sfm.colmap.database import CAMERA_MODEL, missing_features, read_keypoints
from pomona.stages.sfm.colmap.mapping import seed_cameras
from pomona.stages.sfm.colmap.two_views import Overlap, read_overlaps
from pomona.stages.sfm.features import Features, extract
from pomona.stages.sfm.joining import Group, MatchedPhotos, join_groups
from pomona.stages.sfm.kept_features import KeptFeatures
from pomona.stages.sfm.mapping_process import MappingProcess
from pomona.stages.sfm.matching import match_photos
from pomona.stages.sfm.models import Model, read_models
from pomona.stages.sfm.one_lens import with_one_lens
from pomona.stages.sfm.options import SfmOptions
from pomona.stages.sfm.pieces import Piece, Reconstruction, Unregistered
from pomona.stages.sfm.seams import held_parts, parted
from pomona.stages.sfm.selection import credible, distinct, explained, explicable, mean_error_px, support, well_held
from pomona.stages.sfm.thinning import thinned
from pomona.stages.sfm.unregistered import RegistrationEvidence, explain_unregistered
from pomona.stages.sfm.workspace import Workspace
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import ONE_SIDE, Photo, Photos, side_in_words


def reconstruct(
    photos: Photos,
    *,
    options: SfmOptions | None = None,
    work_dir: Path | None = None,
    code_key: str = "",
    progress: Progress | None = None,
) -> Reconstruction:
    """Find where the photos of each side were taken from, each piece in a frame of its own.

    `work_dir` keeps features, matches and models: a second call with the same photos, options and `code_key` (which
    names the code and the engines' versions) goes on where the first one was stopped. Without it, nothing is kept.
    Sides never share photos or points; joining them is the scale stage's work.

    Raises `InputError` for fewer than three photos and `ReconstructionError` when no photo of any side can be placed.
    """
    options, progress = options or SfmOptions(), progress or Silent()
    if len(photos) < options.min_piece_photos:
        raise InputError(
            f"{options.min_piece_photos} photos that overlap are the least to find places in space from, found "
            f"{len(photos)}: give a folder with photos taken at short steps along the row, or a video"
        )
    pieces: list[Piece] = []
    lost: list[Unregistered] = []
    with ExitStack() as stack:
        if work_dir is None:
            work_dir = Path(stack.enter_context(TemporaryDirectory(prefix="pomona-sfm-")))
        for side in photos.sides:
            of_side = photos.of_side(side)
            if len(of_side) < options.min_piece_photos:
                lost += _too_few(of_side, side, options)
                continue
            workspace = Workspace(work_dir / _folder_name(side), of_side.items, options, code_key)
            kept = kept_features(work_dir, options, code_key)
            side_pieces, side_lost = _reconstruct_side(workspace, kept, side, progress)
            pieces += side_pieces
            lost += side_lost
    if not pieces:
        raise ReconstructionError(_nothing_placed(lost))
    return Reconstruction(tuple(with_one_lens(pieces, photos, progress)), tuple(lost))


def kept_features(work_dir: Path, options: SfmOptions, code_key: str) -> KeptFeatures:
    """Return the features that `reconstruct` with this `work_dir` and `code_key` need not find any more."""
    return KeptFeatures(work_dir / "kept-features", options, code_key)


def _too_few(photos: Photos, side: str, options: SfmOptions) -> list[Unregistered]:
    reason = f"{side_in_words(side)} has {counted(len(photos), 'photo')}, fewer than {options.min_piece_photos}"
    advice = "Take more photos of this side, or check how the photos were divided into sides (`sides`)."
    return [Unregistered(photo.name, side, reason, advice) for photo in photos]


def _reconstruct_side(
    workspace: Workspace, kept: KeptFeatures, side: str, progress: Progress
) -> tuple[list[Piece], list[Unregistered]]:
    label = "" if side in ("", ONE_SIDE) else f" ({side_in_words(side)})"
    _warn_of_cameras(workspace, label, progress)
    unreadable = _find_features(workspace, kept, label, progress)
    match_photos(workspace, label, progress)
    models, evidence = _map(workspace, unreadable, label, progress)
    pieces = [Piece(side, model.cameras, mean_error_px(model.cameras)) for model in models]
    return pieces, explain_unregistered(evidence)


def _find_features(workspace: Workspace, kept: KeptFeatures, label: str, progress: Progress) -> dict[int, str]:
    """Find the features of the photos that have none yet; return which photos could not be read, and why.

    Nobody is warned of these here: who looks for fruits in them is, and they are among the photos without a place.
    """
    photos, unreadable = workspace.photos, {}
    missing = missing_features(workspace.database, len(photos))
    progress.start(f"Features{label}", len(photos))
    progress.advance(len(photos) - len(missing))
    threads = workspace.options.threads or cores()
    for batch in batches(missing, 2 * threads):
        with ThreadPoolExecutor(threads) as pool:
            found = list(pool.map(lambda i: _try_extract(photos[i], workspace.options, kept), batch))
        good = {i: features for i, features in zip(batch, found, strict=True) if isinstance(features, Features)}
        unreadable.update({i: reason for i, reason in zip(batch, found, strict=True) if isinstance(reason, str)})
        workspace.save_features(good)
        progress.advance(len(batch))
    return unreadable


def _try_extract(photo: Photo, options: SfmOptions, kept: KeptFeatures) -> Features | str:
    try:
        return kept.get(photo) or extract(photo, options)
    except DamagedPhotoError as error:
        return error.reason
    except (InputError, MissingFileError) as error:
        return str(error)


def _map(
    workspace: Workspace, unreadable: dict[int, str], label: str, progress: Progress
) -> tuple[list[Model], RegistrationEvidence]:
    """Run the mappers, and keep the result whose cameras explain most; see `selection.explained`."""
    count = len(workspace.photos)
    overlaps = read_overlaps(workspace.database)
    scale = [workspace.cameras[image.camera_idx].scale for image in workspace.images]
    in_working_px = read_keypoints(workspace.database, count)
    keypoints = [xy / s for xy, s in zip(in_working_px, scale, strict=True)]
    enough = workspace.options.good_enough * support(explicable(overlaps, in_working_px), overlaps)
    best: list[Model] = []
    most, mapped = -1.0, set[int]()
    fewer = thinned(overlaps, [len(xy) for xy in keypoints], workspace.options.enough_tracks, workspace.options.seed)
    for folder in _run_mappers(workspace, fewer, label, progress):
        models = read_models(folder, workspace.cameras, workspace.colours)
        mapped |= {int(photo) for model in models for photo in model.photo_idx}
        models = distinct(models, workspace.options.min_piece_photos)
        models = well_held(models, workspace.options.least_points, workspace.options.min_piece_photos)
        models = [part for model in models for part in held_parts(model)]
        models = _held_together(models, overlaps, keypoints, workspace.options)
        shares = explained(models, overlaps, keypoints)
        models = credible(models, overlaps, shares, workspace.options.least_explained)
        supported = support(explained(models, overlaps, keypoints), overlaps)
        if models and supported > most:
            best, most = models, supported
        if most >= enough:
            break
    best = _joined(workspace, best, overlaps, keypoints, label, progress)
    placed = frozenset(int(photo) for model in best for photo in model.photo_idx)
    sharpness = [np.nan if i in unreadable else workspace.sharpness(i) for i in range(count)]
    features = np.array([len(xy) for xy in keypoints])
    evidence = RegistrationEvidence(
        workspace.photos, features, np.array(sharpness), unreadable, overlaps, placed, frozenset(mapped - placed)
    )
    return best, evidence


def _held_together(
    models: Sequence[Model], overlaps: Sequence[Overlap], keypoints: Sequence[FloatArray], options: SfmOptions
) -> list[Model]:
    """Return the models without the seams that matches contradict; parts that are too small are left out."""
    shares = explained(models, overlaps, keypoints)
    parts = [part for model in models for part in parted(model, overlaps, shares, options.min_matches)]
    return sorted(
        (part for part in parts if len(part.photo_idx) >= options.min_piece_photos), key=lambda m: -len(m.photo_idx)
    )


def _joined(
    workspace: Workspace,
    models: list[Model],
    overlaps: Sequence[Overlap],
    keypoints: Sequence[FloatArray],
    label: str,
    progress: Progress,
) -> list[Model]:
    """Bring pieces, and photos without a place, together by the matches between them; adjust what was joined.

    What was joined is kept where its cameras explain more of the matches than the pieces did.
    """
    if not models or sum(len(model.photo_idx) for model in models[:1]) == len(workspace.photos):
        return models
    lenses = _lenses(workspace, models)
    camera_of = [image.camera_idx for image in workspace.images]
    rays = [lenses[camera_of[i]].cam_from_px(xy) for i, xy in enumerate(keypoints)]
    focals_px = np.array([lenses[c].focal_px * workspace.cameras[c].scale for c in camera_of])
    placed = {int(photo) for model in models for photo in model.photo_idx}
    groups = [Group.of_model(model) for model in models]
    groups += [Group.of_photo(i) for i in range(len(workspace.photos)) if i not in placed]
    found = [g for g in join_groups(groups, MatchedPhotos(overlaps, rays, focals_px)) if len(g.poses) > 1]
    if len(found) == len(models) and sum(len(g.poses) for g in found) == len(placed):
        return models
    adjusted: list[Model] = []
    for number, group in enumerate(found):
        same = [model for model in models if set(model.photo_idx.tolist()) == group.poses.keys()]
        adjusted += same or _adjusted(workspace, group, lenses, number, label, progress)
    adjusted = _held_together(adjusted, overlaps, keypoints, workspace.options)
    before, after = (support(explained(each, overlaps, keypoints), overlaps) for each in (models, adjusted))
    return adjusted if after > before else models


def _lenses(workspace: Workspace, models: Sequence[Model]) -> dict[int, Intrinsics]:
    """The lens of each camera as the largest model has it; as EXIF has it where none has."""
    lenses = {}
    for i, camera in enumerate(workspace.cameras):
        params = np.array([camera.focal_px, camera.width_px / 2, camera.height_px / 2, 0.0])
        lenses[i] = Intrinsics(CAMERA_MODEL, camera.width_px, camera.height_px, params)
    for model in reversed(models):
        for i, photo in enumerate(model.photo_idx):
            lenses[workspace.images[photo].camera_idx] = model.cameras.intrinsics_of(i)
    return lenses


def _adjusted(
    workspace: Workspace, group: Group, lenses: Mapping[int, Intrinsics], number: int, label: str, progress: Progress
) -> list[Model]:
    """Adjust a group that was joined; no model where that fails."""
    used = sorted({workspace.images[photo].camera_idx for photo in group.poses})
    scales = {i: np.array([workspace.cameras[i].scale] * 3 + [1.0]) for i in used}
    details = {
        "poses": [[photo, pose.tolist()] for photo, pose in sorted(group.poses.items())],
        "params": [[i, (lenses[i].params * scales[i]).tolist()] for i in used],
    }
    progress.start(f"Joining pieces{label}")
    out = workspace.folder / f"joined-{number}"
    process = MappingProcess("joining", workspace.database, out, workspace.options, details)
    with ExitStack() as stack:
        stack.callback(process.stop)
        failure = process.wait()
    if failure is not None:
        progress.warn(f"Pieces were not joined{label}: {failure}")
        return []
    return read_models(out, workspace.cameras, workspace.colours)


def _run_mappers(workspace: Workspace, overlaps: Sequence[Overlap], label: str, progress: Progress) -> Iterator[Path]:
    """Run the mappers one after the other; yield the folders with their models.

    Global mapping comes first: it finds focal lengths that are not known better than incremental mapping does, which
    then begins with them.
    """
    if not overlaps:
        return
    database, fixed = workspace.mapping_database(overlaps), list[int]()
    for mapper in sorted(workspace.options.mappers):
        progress.start(f"Placing photos, {mapper}{label}", len(workspace.photos))
        process = MappingProcess(mapper, database, workspace.folder / mapper, workspace.options, fixed)
        with ExitStack() as stack:
            stack.callback(process.stop)
            process.listen(progress.advance)
            failure = process.wait()
        if failure is not None:
            progress.warn(f"The {mapper} mapper failed{label}: {failure}")
            continue
        if mapper == "global":
            fixed = seed_cameras(database, process.out, workspace.cameras)
        yield process.out


def _warn_of_cameras(workspace: Workspace, label: str, progress: Progress) -> None:
    keys = [f"{p.camera_key or 'unknown camera'}, {p.width_px} × {p.height_px}" for p in workspace.photos]
    kinds = {key: keys.count(key) for key in dict.fromkeys(keys)}
    if len(kinds) > 1:
        listing = "; ".join(f"{count} × {key}" for key, count in kinds.items())
        progress.warn(
            f"The photos{label} were taken with {len(kinds)} cameras, lenses or zooms ({listing}). Each gets "
            "intrinsics of its own; one camera at one zoom gives better places."
        )


def _nothing_placed(lost: Sequence[Unregistered]) -> str:
    examples = "; ".join(f"{photo.photo}: {photo.reason}" for photo in lost[:3])
    advice = " ".join(dict.fromkeys(photo.advice for photo in lost[:3]))
    more = f"; and {len(lost) - 3} more" if len(lost) > 3 else ""
    return f"None of the {len(lost)} photos could be placed. {examples}{more}. {advice}"


def _folder_name(side: str) -> str:
    return "side-" + re.sub(r"[^A-Za-z0-9_-]", lambda match: f"%{ord(match[0]):x}", side) if side else "all"
