"""What there is to be asked for of a survey's page, by address.

Addresses hold indices and ids, never names of files, so that nothing but the survey's own photos can be asked for.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from starlette.convertors import IntegerConvertor, register_url_convertor
from starlette.responses import JSONResponse, Response

from pomona.browser.view.correct import Corrector
from pomona.browser.view.pictures import SIDES_PX, Pictures
from pomona.errors import PomonaError
from pomona.stages.report.columns import as_bytes
from pomona.stages.report.contract import U16, PackedCloud, PhotoMark, PointPiece, SeenFruit, SurveyData, TruthData
from pomona.stages.report.data import ReportData
from pomona.stages.report.page import note_of, page_html
from pomona.stages.report.scene import SceneOptions, survey_data
from pomona.stages.report.seen import detection_columns, sightings_of

PIECE_POINTS = 125_000
"""So many points of a cloud are sent at once; the first ones with the survey's other data."""
_DATA_URL = "data/survey.bin"
_COLUMNS, _HTML, _JPEG = "application/octet-stream", "text/html", "image/jpeg"


class _Index(IntegerConvertor):
    """Whole numbers that an index or an id may be."""

    regex = "[0-9]{1,9}"


register_url_convertor("index", _Index())


class Site:
    """What there is to be asked for, by address."""

    def __init__(self, data: ReportData, truth: TruthData | None = None, corrector: Corrector | None = None) -> None:
        self._data = data
        self._truth = truth
        self._corrector = corrector
        self._corrections = corrector.state if corrector else None
        self._pictures = Pictures(data)

    @cached_property
    def _whole(self) -> SurveyData:
        """The survey's data with all points."""
        names = self._data.cameras.photos
        files = {name: f"photos/{i}" for i, name in enumerate(names) if self._pictures.has_photo(i)}
        note = note_of("server")
        options = SceneOptions(
            source="server",
            max_points=None,
            files=files,
            truth=self._truth,
            corrections=self._corrections,
            photos_note=note,
            photos_version=self._pictures.version,
        )
        return survey_data(self._data, options)

    @cached_property
    def values(self) -> SurveyData:
        """The survey's data with the first points; the others, and what photos saw, are asked for when needed."""
        whole = self._whole
        return replace(whole, scene=_first(whole.scene), fruit_points=_first(whole.fruit_points))

    @cached_property
    def _page_body(self) -> bytes:
        return page_html(self._data, self.values, data_url=_DATA_URL).encode("utf-8")

    @cached_property
    def _survey_body(self) -> bytes:
        return as_bytes(self.values)

    def page(self) -> Response:
        """The page."""
        return Response(self._page_body, media_type=_HTML)

    def survey(self) -> Response:
        """The survey's data."""
        # The first click on a fruit is not to wait for the file of detections.
        threading.Thread(target=self._read_masks, daemon=True).start()
        return Response(self._survey_body, media_type=_COLUMNS)

    def _read_masks(self) -> None:
        # A damaged file is an error where a photo is asked for.
        with suppress(PomonaError):
            len(self._data.masks or ())

    def scene_points(self, piece: int) -> Response | None:
        """Points of the scene."""
        return _points(self._whole.scene, piece)

    def fruit_points(self, piece: int) -> Response | None:
        """Points on fruits."""
        return _points(self._whole.fruit_points, piece)

    def photo_detections(self, photo: int) -> Response:
        """Detections of a photo, with outlines."""
        name = self._data.cameras.photos[photo]
        return _columns(detection_columns(self._data, photos=[name]))

    def fruit(self, fruit: int) -> Response | None:
        """Sightings and detections of a fruit."""
        if fruit not in self._data.fruits.ids:
            return None
        seen = self._data.observations
        mine = np.flatnonzero(seen.fruit_id == fruit)
        photos = {seen.photo[i] for i in mine}
        detections = detection_columns(self._data, only=seen.detection_id[mine].tolist(), photos=photos)
        return _columns(SeenFruit(sightings_of(self._data, fruit), detections))

    def photo(self, photo: int, side_px: int) -> Response | None:
        """A photo."""
        return self._photo(photo, side_px, straight=False)

    def straight(self, photo: int, side_px: int) -> Response | None:
        """A photo without the lens's distortion."""
        return self._photo(photo, side_px, straight=True)

    def _photo(self, photo: int, side_px: int, *, straight: bool) -> Response | None:
        if side_px not in SIDES_PX:
            return None
        body = self._pictures.photo(photo, side_px, straight=straight)
        # The page asks for it with the photos' version.
        return Response(body, media_type=_JPEG, headers={"Cache-Control": "private, max-age=600"})

    def lines(self, photo: int, x: int, y: int) -> Response | None:
        """Where other photos may show what is there in one."""
        if self._corrector is None:
            return None
        found = self._corrector.lines(PhotoMark(photo, x, y))
        return JSONResponse({"photos": found.photos, "lines": found.lines})

    def crop(self, photo: int, detection: int) -> Response:
        """The crop of a detection; corrected masks have new ones."""
        return Response(self._pictures.crop(photo, detection), media_type=_JPEG)


ADDRESSES: dict[str, Callable[..., Response | None]] = {
    "/": Site.page,
    f"/{_DATA_URL}": Site.survey,
    "/data/photos/{photo:index}.bin": Site.photo_detections,
    "/data/fruits/{fruit:index}.bin": Site.fruit,
    "/data/points/scene/{piece:index}.bin": Site.scene_points,
    "/data/points/fruit/{piece:index}.bin": Site.fruit_points,
    "/photos/{photo:index}/{side_px:index}.jpg": Site.photo,
    "/straight/{photo:index}/{side_px:index}.jpg": Site.straight,
    "/data/lines/{photo:index}/{x:index}/{y:index}.json": Site.lines,
    "/crops/{photo:index}/{detection:index}.jpg": Site.crop,
}
"""What answers an address: a response, None or a `KeyError` or `IndexError` where there is no such thing, an error of
files for a lost photo."""


def _points(cloud: PackedCloud, piece: int) -> Response | None:
    points = cloud.points[piece * PIECE_POINTS : (piece + 1) * PIECE_POINTS]
    return _columns(PointPiece(U16(points))) if len(points) else None


def _columns(values: Any) -> Response:
    return Response(as_bytes(values), media_type=_COLUMNS)


def _first(cloud: PackedCloud) -> PackedCloud:
    return replace(cloud, points=U16(cloud.points[:PIECE_POINTS]))
