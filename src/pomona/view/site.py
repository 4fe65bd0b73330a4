"""What there is to be asked for of a survey's page, by address.

Addresses hold indices and ids, never names of files, so that nothing but the survey's own photos can be asked for.
"""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from pomona.errors import PomonaError
from pomona.report.columns import as_bytes
from pomona.report.contract import U16, PackedCloud, PhotoMark, PointPiece, SeenFruit, SurveyData, TruthData
from pomona.report.data import ReportData
from pomona.report.page import note_of, page_html
from pomona.report.scene import SceneOptions, survey_data
from pomona.report.seen import detection_columns, sightings_of
from pomona.view.correct import Corrector
from pomona.view.pictures import SIDES_PX, Pictures

PIECE_POINTS = 125_000
"""So many points of a cloud are sent at once; the first ones with the survey's other data."""
JSON = "application/json; charset=utf-8"
_DATA_URL = "data/survey.bin"
_COLUMNS, _HTML, _JPEG = "application/octet-stream", "text/html; charset=utf-8", "image/jpeg"
_ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16"><circle cx="8" cy="9" r="6" fill="#b8322a"/>'
    '<path d="M8 4q0-3 3-3" fill="none" stroke="#4f7d5a" stroke-width="1.6"/></svg>'
)


@dataclass(frozen=True)
class Answer:
    """What is sent back: a body and its type, and whether it stays the same."""

    body: bytes
    kind: str
    lasting: bool = False


class Site:
    """What there is to be asked for, by address."""

    def __init__(self, data: ReportData, truth: TruthData | None = None, corrector: Corrector | None = None) -> None:
        self._data = data
        self._truth = truth
        self._corrector = corrector
        self._corrections = corrector.state if corrector else None
        self._pictures = Pictures(data)
        self._routes: tuple[tuple[re.Pattern[str], Callable[..., Answer | None]], ...] = (
            (re.compile(r"/"), self._page),
            (re.compile(rf"/{re.escape(_DATA_URL)}"), self._survey),
            (re.compile(r"/data/photos/(\d{1,7})\.bin"), self._photo_detections),
            (re.compile(r"/data/fruits/(\d{1,9})\.bin"), self._fruit),
            (re.compile(r"/data/points/scene/(\d{1,5})\.bin"), lambda k: self._points(self._whole.scene, k)),
            (re.compile(r"/data/points/fruit/(\d{1,5})\.bin"), lambda k: self._points(self._whole.fruit_points, k)),
            (re.compile(r"/photos/(\d{1,7})/(\d{1,5})\.jpg"), self._photo),
            (re.compile(r"/straight/(\d{1,7})/(\d{1,5})\.jpg"), partial(self._photo, straight=True)),
            (re.compile(r"/data/lines/(\d{1,7})/(\d{1,5})/(\d{1,5})\.json"), self._lines),
            (re.compile(r"/crops/(\d{1,7})/(\d{1,9})\.jpg"), self._crop),
            (re.compile(r"/favicon\.ico"), lambda: Answer(_ICON.encode("ascii"), "image/svg+xml")),
        )

    def answer(self, path: str) -> Answer | None:
        """Return what an address stands for; None where there is no such thing; raises for a lost photo."""
        for pattern, make in self._routes:
            found = pattern.fullmatch(path)
            if found:
                try:
                    return make(*(int(part) for part in found.groups()))
                except (KeyError, IndexError):
                    return None
        return None

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

    def _page(self) -> Answer:
        return Answer(self._page_body, _HTML)

    def _survey(self) -> Answer:
        # The first click on a fruit is not to wait for the file of detections.
        threading.Thread(target=self._read_masks, daemon=True).start()
        return Answer(self._survey_body, _COLUMNS)

    def _read_masks(self) -> None:
        # A damaged file is an error where a photo is asked for.
        with suppress(PomonaError):
            len(self._data.masks or ())

    def _points(self, cloud: PackedCloud, piece: int) -> Answer | None:
        points = cloud.points[piece * PIECE_POINTS : (piece + 1) * PIECE_POINTS]
        return Answer(as_bytes(PointPiece(U16(points))), _COLUMNS) if len(points) else None

    def _photo_detections(self, index: int) -> Answer:
        name = self._data.cameras.photos[index]
        return Answer(as_bytes(detection_columns(self._data, photos=[name])), _COLUMNS)

    def _fruit(self, fruit_id: int) -> Answer | None:
        if fruit_id not in self._data.fruits.ids:
            return None
        seen = self._data.observations
        mine = np.flatnonzero(seen.fruit_id == fruit_id)
        photos = {seen.photo[i] for i in mine}
        detections = detection_columns(self._data, only=seen.detection_id[mine].tolist(), photos=photos)
        return Answer(as_bytes(SeenFruit(sightings_of(self._data, fruit_id), detections)), _COLUMNS)

    def _photo(self, index: int, side_px: int, *, straight: bool = False) -> Answer | None:
        if side_px not in SIDES_PX:
            return None
        return Answer(self._pictures.photo(index, side_px, straight=straight), _JPEG, lasting=True)

    def _lines(self, photo: int, x: int, y: int) -> Answer | None:
        if self._corrector is None:
            return None
        found = self._corrector.lines(PhotoMark(photo, x, y))
        return Answer(json.dumps({"photos": found.photos, "lines": found.lines}).encode("utf-8"), JSON)

    def _crop(self, index: int, detection_id: int) -> Answer:
        return Answer(self._pictures.crop(index, detection_id), _JPEG)


def _first(cloud: PackedCloud) -> PackedCloud:
    return replace(cloud, points=U16(cloud.points[:PIECE_POINTS]))
