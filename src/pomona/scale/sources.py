"""The sources of metres, each tried on every piece that has no better one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import WorldFrame
from pomona.detections import SurveyDetections
from pomona.photos import Photo, Photos
from pomona.scale.aruco import Sighting, find_markers
from pomona.scale.beside import median_distance
from pomona.scale.by_bar import bar_scale
from pomona.scale.by_markers import MarkerFit, fit_markers, refine, residuals_of
from pomona.scale.fruit_size import fruit_size
from pomona.scale.gnss import fit_gnss, local_frame, positions_in_local
from pomona.scale.markers import Markers
from pomona.scale.values import ScaleOptions
from pomona.scale.work import Work

_PLAUSIBLE_DISTANCE_M = (0.2, 200.0)


def look_for_markers(work: Work, photos: Photos, markers: Markers | None, options: ScaleOptions) -> list[Sighting]:
    """Return where the markers of the table and of the scale bar are seen in the photos that have a place."""
    wanted = set(map(int, markers.ids)) if markers is not None else set()
    wanted |= set(options.scale_bar[:2]) if options.scale_bar is not None else set()
    if not wanted:
        return []
    placed = {name for piece in work.pieces for name in piece.cameras.photos}
    looked_at = [photo for photo in photos if photo.name in placed]
    sightings = find_markers(looked_at, wanted, options.marker_dictionary, work.progress)
    work.unseen = tuple(sorted(wanted - {s.marker_id for s in sightings}))
    if work.unseen:
        named = ", ".join(map(str, work.unseen))
        where = "--scale-bar" if markers is None else str(options.markers)
        work.tell(
            f"{len(work.unseen)} of {len(wanted)} markers named in {where} were not seen in any photo: {named}. "
            f"Check that they are {options.marker_dictionary} plates (--marker-dictionary), sharp, unobstructed, with "
            "a white margin"
        )
    return sightings


def tie_by_markers(
    work: Work, photos: Photos, markers: Markers, sightings: Sequence[Sighting], options: ScaleOptions
) -> WorldFrame | None:
    """Put every piece that sees enough markers into their frame, and refine those together."""
    places = markers.places()
    fits: dict[int, MarkerFit] = {}
    for idx, piece in enumerate(work.pieces):
        fit = fit_markers(piece.cameras, sightings, places)
        if isinstance(fit, str):
            work.fail(idx, fit)
            if work.is_main(idx):
                work.tell(f"{work.name(idx)} has no place from the markers: {fit}")
            continue
        fits[idx] = fit
        work.scale(idx, "markers", fit.world_from_piece.scale, 1000 * fit.rms_m)
        _tell_of_fit(work, idx, fit)
    if not fits:
        return None
    tied = [work.pieces[idx].cameras.transformed(fit.world_from_piece) for idx, fit in fits.items()]
    if options.refine and all(fit.up_is_known for fit in fits.values()):
        keys = {photo.name: photo.camera_key for photo in photos}
        work.progress.start("Refining cameras on the markers")
        tied = refine(tied, list(fits.values()), places, keys)
    for (idx, fit), cameras in zip(fits.items(), tied, strict=True):
        work.tied[idx] = cameras
        work.markers += residuals_of(cameras, work.pieces[idx].side, fit, places)
        _check_units(work, idx, places, cameras.centers_in_world)
    return WorldFrame("markers", approximate=False, up_is_known=any(fit.up_is_known for fit in fits.values()))


def _tell_of_fit(work: Work, idx: int, fit: MarkerFit) -> None:
    if not fit.up_is_known:
        work.tell(
            f"{work.name(idx)} sees {len(fit.used)} markers, which are on one line: its tilt about that line was taken "
            "from how the camera was held. Three markers that are not on one line make it exact"
        )
    for marker_id, reason in fit.unused.items():
        work.tell(f"{work.name(idx)}: marker {marker_id} was left out: {reason}")


def _check_units(work: Work, idx: int, places: dict[int, FloatArray], centers: FloatArray) -> None:
    middle = np.mean(list(places.values()), axis=0)
    distance = float(np.median(np.linalg.norm(centers - middle, axis=1)))
    low, high = _PLAUSIBLE_DISTANCE_M
    if not low < distance < high:
        work.tell(
            f"{work.name(idx)}: by the markers' places the camera stood {distance:.3g} m from them; are the places in "
            "metres?"
        )


def scale_by_bar(work: Work, sightings: Sequence[Sighting], options: ScaleOptions) -> None:
    """Give metres from the scale bar to every piece that sees both of its markers."""
    if options.scale_bar is None:
        return
    for idx in work.unscaled():
        piece = work.pieces[idx]
        found = bar_scale(piece.cameras, sightings, options.scale_bar, piece.side)
        if isinstance(found, str):
            work.fail(idx, found)
            if work.is_main(idx):
                work.tell(f"{work.name(idx)} has no scale from the scale bar: {found}")
            continue
        work.scale(idx, "scale-bar", found[0])
        work.markers += found[1]


def tie_by_gnss(work: Work, photos: Photos) -> WorldFrame | None:
    """Put every piece with good enough positions into a local east-north-up frame, keeping a scale it has."""
    frame = local_frame(photos.items)
    if frame is None:
        return None
    by_name = photos.by_name()
    up_is_known = False
    for idx, piece in enumerate(work.pieces):
        of_piece: list[Photo] = [by_name[name] for name in piece.cameras.photos]
        scale = work.metres_per_unit.get(idx)
        fit = fit_gnss(piece.cameras, positions_in_local(of_piece, frame), scale=scale)
        if isinstance(fit, str):
            work.fail(idx, fit)
            if work.is_main(idx):
                work.tell(f"{work.name(idx)} has no place from GNSS: {fit}")
            continue
        work.tied[idx] = piece.cameras.transformed(fit.local_from_piece)
        if scale is None:
            work.scale(idx, "gnss", fit.local_from_piece.scale, 1000 * fit.rms_m)
        up_is_known = up_is_known or fit.up_is_known
    if not work.tied:
        return None
    source = work.scales[min(work.tied)].source
    return WorldFrame(source, approximate=False, up_is_known=up_is_known, crs=frame.crs, origin=frame.origin)


def scale_by_fruit(work: Work, detections: SurveyDetections | None, options: ScaleOptions) -> None:
    """Give approximate metres from the fruits' diameter to every piece without better ones."""
    for idx in work.unscaled():
        found = "no fruit was looked for" if detections is None else fruit_size(work.pieces[idx].cameras, detections)
        if isinstance(found, str):
            work.fail(idx, found)
            continue
        work.scale(idx, "fruit-diameter", options.fruit_diameter_m / found.diameter)
        if work.is_main(idx):
            work.tell(
                f"{work.name(idx)}: metres are approximate. They come from {found.count} fruits taken to be "
                f"{1000 * options.fruit_diameter_m:.0f} mm in diameter (--fruit-diameter); use markers or a scale bar "
                "for exact ones"
            )


def scale_by_distance(work: Work) -> None:
    """Give the main pieces that still have no scale one by which they were photographed from as far as the others."""
    known = [
        work.metres_per_unit[i] * median_distance(work.pieces[i].cameras)
        for i in work.metres_per_unit
        if np.isfinite(median_distance(work.pieces[i].cameras))
    ]
    for idx in work.unscaled():
        own = median_distance(work.pieces[idx].cameras)
        if not work.is_main(idx) or not np.isfinite(own):
            continue
        if known:
            work.scale(idx, "none", float(np.median(known)) / own)
            work.tell(
                f"{work.name(idx)} has no scale of its own ({'; '.join(work.failures.get(idx, []))}): it was taken to "
                "be photographed from as far as the other side"
            )
        else:
            work.scale(idx, "none", 1.0)
            work.tell(
                f"{work.name(idx)} has no scale ({'; '.join(work.failures.get(idx, []))}): its lengths are in units of "
                "its own, not metres. Use markers, a scale bar, or photos with fruits"
            )
