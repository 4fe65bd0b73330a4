"""The page of `pomona app` and what it asks for, over HTTP: to this computer alone, to whoever has the token."""

from __future__ import annotations

import secrets
import threading
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from contextlib import suppress
from html import escape
from http import HTTPStatus
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.types import Receive, Scope, Send

from pomona import __version__
from pomona.browser.app import dropped
from pomona.browser.app.contract import GivenMarks, NewSurvey, Refusal
from pomona.browser.app.folders import Folders
from pomona.browser.app.service import Homes, Service, comparison_page
from pomona.browser.app.teaching import keep_marks, marked_view
from pomona.browser.app.wire import as_json, from_json
from pomona.browser.server import PageServer, Updates, json_of
from pomona.browser.view import Corrector, SurveyPages
from pomona.errors import InputError, MissingFileError, PomonaError, SurveyError
from pomona.pipeline.reopen import bring_up_to_date
from pomona.stages.report.page import script_source
from pomona.survey.reader import SurveyReader

Endpoint = Callable[[Request], Awaitable[Response]]

_ROOM = files("pomona.browser.app")
_JSON, _JPEG = "application/json", "image/jpeg"
_KEPT = 2  # surveys that are looked at, in memory: two tabs
_MOST_DROPPED = 64 << 30  # bytes of one file: a long video
_MOST_MARKS = 512 * 1024  # bytes of what is marked in a photo
_EXPORTS = ("report.html", "fruits.csv", "trees.csv", "fruits.geojson")  # that a survey has as they are


class AppServer(PageServer):
    """Serves the page on 127.0.0.1. `port` 0 takes a free one; raises `OSError` where a port is taken.

    Use it as a context manager: at its end the run that is at work is stopped.
    """

    def __init__(self, homes: Homes, folders: Folders, *, port: int = 0) -> None:
        self._updates = Updates()
        self.service = Service(homes, folders, self._updates.publish)
        self._looked_at: OrderedDict[tuple[str, str], SurveyPages] = OrderedDict()
        self._looking = threading.Lock()
        app = Starlette(routes=self._routes(), exception_handlers={PomonaError: _refused, OSError: _failed})
        policy = "; ".join([
            "default-src 'none'", f"script-src 'self' {script_source()}", "style-src 'self' 'unsafe-inline'",
            "img-src 'self' data: blob:", "connect-src 'self'", "frame-src 'self'", "base-uri 'none'",
            "form-action 'none'",
        ])  # fmt: skip
        try:
            super().__init__(
                app,
                policy=policy,
                framed_by="'self'",
                port=port,
                token=secrets.token_urlsafe(18),
                on_stop=self._updates.close,
            )
        except OSError:
            self.service.close()
            raise

    def __exit__(self, *error: Any) -> None:
        """Stop the run that is at work, and give the port back."""
        self.service.close()
        super().__exit__(*error)

    def _routes(self) -> list[Route | Mount]:
        service = self.service
        return [
            Route("/", _page),
            Route("/static/{name}", _static),
            Route("/api/events", self._updates.endpoint),
            Route("/api/surveys", _doing(self._begin), methods=["POST"]),
            Route("/api/surveys/add", _doing(lambda v, i: service.add(_text(v, "folder"))), methods=["POST"]),
            Route("/api/surveys/sample", _doing(lambda v, i: service.sample()), methods=["POST"]),
            Route("/api/surveys/{id}/go-on", _doing(lambda v, i: service.go_on(i)), methods=["POST"]),
            Route("/api/surveys/{id}/learn", _doing(lambda v, i: service.go_on(i, learn=True)), methods=["POST"]),
            Route("/api/surveys/{id}/stop", _doing(lambda v, i: service.stop(i)), methods=["POST"]),
            Route("/api/surveys/{id}/forget", _doing(lambda v, i: service.forget(i)), methods=["POST"]),
            Route("/api/surveys/{id}/compare", _doing(self._compare), methods=["POST"]),
            Route("/api/check", _doing(self._check), methods=["POST"]),
            Route("/api/equal", _doing(lambda v, i: service.equal(from_json(NewSurvey, v))), methods=["POST"]),
            Route("/api/close", self._close, methods=["POST"]),
            Route("/api/drops", _doing(lambda v, i: service.new_drop()), methods=["POST"]),
            Route("/api/drops/{drop}/{name:path}", self._drop, methods=["PUT"]),
            Route("/api/folders", self._folders),
            Route("/api/surveys/{id}/equal", _asking(lambda r, i: service.equal_of(i))),
            Route("/api/surveys/{id}/photos", _asking(lambda r, i: service.first_results(i).photos())),
            Route("/api/surveys/{id}/scene", _asking(lambda r, i: service.first_results(i).scene())),
            Route("/api/surveys/{id}/trees", _asking(lambda r, i: service.trees(i))),
            Route("/api/surveys/{id}/photos/{index:int}/{side:int}.jpg", self._picture),
            Route("/api/surveys/{id}/photos/{index:int}/whole.jpg", self._whole),
            Route("/api/surveys/{id}/before/{index:int}/{side:int}.jpg", self._picture_before),
            Route("/api/surveys/{id}/photos/{index:int}/marks", self._keep_marks, methods=["POST"]),
            Route("/api/surveys/{id}/photos/{index:int}/marks", self._marks),
            Route("/api/surveys/{id}/teaching", _asking(lambda r, i: service.teaching(i))),
            Route("/api/surveys/{id}/files/{kind}", self._file),
            Route("/api/surveys/{id}/since/{other}/", self._comparison),
            Mount("/surveys/{id}/view", app=self._view),
        ]

    def _begin(self, values: Any, _: str) -> str:
        return self.service.begin(from_json(NewSurvey, values))

    def _check(self, values: Any, _: str) -> Any:
        photos = values.get("photos") if isinstance(values, dict) else None
        if not isinstance(photos, list) or not all(isinstance(photo, str) for photo in photos):
            raise InputError("Expected photos as a list of folders")
        return self.service.check(photos, one_side=bool(values.get("oneSide")))

    def _compare(self, values: Any, survey_id: str) -> str:
        other = _text(values, "before")
        self.service.compare(other, survey_id)
        return f"/api/surveys/{survey_id}/since/{other}/"

    def _comparison(self, request: Request) -> Response:
        ids = request.path_params
        after, before = self.service.survey(ids["id"]), self.service.survey(ids["other"])
        return _file_of(comparison_page(before, after))

    async def _close(self, request: Request) -> Response:
        await json_of(request)
        threading.Thread(target=self.shutdown, daemon=True).start()
        return Response(status_code=HTTPStatus.NO_CONTENT)

    async def _drop(self, request: Request) -> Response:
        size = request.headers.get("content-length", "")
        if not size.isdigit() or len(size) > 12 or int(size) > _MOST_DROPPED:
            raise HTTPException(HTTPStatus.LENGTH_REQUIRED, "Expected a Content-Length")
        folder = dropped.folder_of(self.service.homes.dropped, request.path_params["drop"])
        await dropped.keep(folder, request.path_params["name"], request.stream(), int(size))
        return Response(as_json(str(folder)), media_type=_JSON)

    def _folders(self, request: Request) -> Response:
        path = request.query_params.get("path") or str(self.service.folders.roots[0])
        files = frozenset({".csv", ".txt"}) if request.query_params.get("files") else frozenset[str]()
        listing = self.service.folders.listing(Path(path), suffixes=files)
        return Response(as_json(listing), media_type=_JSON)

    def _picture(self, request: Request) -> Response:
        params = request.path_params
        return _jpeg(self.service.first_results(params["id"]).picture(params["index"], params["side"]))

    def _picture_before(self, request: Request) -> Response:
        params = request.path_params
        return _jpeg(self.service.results_before(params["id"]).picture(params["index"], params["side"]))

    def _whole(self, request: Request) -> Response:
        return _jpeg(self.service.first_results(request.path_params["id"]).whole(request.path_params["index"]))

    def _marks(self, request: Request) -> Response:
        view = marked_view(self.service.survey(request.path_params["id"]), request.path_params["index"])
        return Response(as_json(view), media_type=_JSON)

    async def _keep_marks(self, request: Request) -> Response:
        given = from_json(GivenMarks, await json_of(request, most_bytes=_MOST_MARKS))
        survey = self.service.survey(request.path_params["id"])
        await run_in_threadpool(keep_marks, survey, request.path_params["index"], given)
        return Response(status_code=HTTPStatus.NO_CONTENT)

    def _file(self, request: Request) -> Response:
        survey_id, kind = request.path_params["id"], request.path_params["kind"]
        if kind in _EXPORTS:
            survey = self.service.survey(survey_id)
            if kind != "report.html":
                with suppress(SurveyError):  # a run is at work: it brings them up to date itself
                    bring_up_to_date(survey)
            return _file_of(survey.folder / kind, download=f"{survey.folder.name}-{kind}")
        path = self.service.export(survey_id, kind)
        return _file_of(path, download=f"{path.parent.parent.name}-{path.name}")

    async def _view(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The page of a survey, as `pomona view` has it."""
        survey_id = scope["path_params"]["id"]
        try:
            pages = await run_in_threadpool(self._pages_of, survey_id)
        except (PomonaError, OSError) as error:
            await _view_failed(error)(scope, receive, send)
            return
        await pages.app({**scope, "path_params": {}}, receive, send)

    def _pages_of(self, survey_id: str) -> SurveyPages:
        survey = self.service.survey(survey_id)
        record = survey.record_of("report")
        key = survey_id, record.finished_at if record else ""
        with self._looking:
            if key not in self._looked_at:
                corrector = Corrector.of(SurveyReader(survey))
                self._looked_at[key] = SurveyPages(corrector.data, corrector.truth, corrector)
                while len(self._looked_at) > _KEPT:
                    self._looked_at.popitem(last=False)
            self._looked_at.move_to_end(key)
            return self._looked_at[key]


def _asking(answer: Callable[[Request, str], Any]) -> Callable[[Request], Response]:
    def endpoint(request: Request) -> Response:
        return Response(as_json(answer(request, request.path_params["id"])), media_type=_JSON)

    return endpoint


def _doing(do: Callable[[Any, str], Any]) -> Endpoint:
    """Return an endpoint that does something with the JSON that the page sends, and answers what comes of it."""

    async def endpoint(request: Request) -> Response:
        values = await json_of(request)
        answer = await run_in_threadpool(do, values, request.path_params.get("id", ""))
        return Response(as_json(answer), media_type=_JSON)

    return endpoint


def _page(request: Request) -> Response:
    page = Template(_ROOM.joinpath("page.html").read_text(encoding="utf-8"))
    return Response(page.substitute(version=escape(__version__)), media_type="text/html")


def _static(request: Request) -> Response:
    kinds = {"app.js": "text/javascript", "app.css": "text/css"}
    name = request.path_params["name"]
    if name not in kinds:
        raise HTTPException(HTTPStatus.NOT_FOUND)
    return Response(_ROOM.joinpath("static", name).read_bytes(), media_type=kinds[name])


def _jpeg(picture: bytes) -> Response:
    return Response(picture, media_type=_JPEG, headers={"Cache-Control": "private, max-age=600"})


def _file_of(path: Path, *, download: str = "") -> Response:
    if not path.is_file():
        raise MissingFileError(f"{path.name} is not there yet: the run has to come to its end first")
    return FileResponse(path, filename=download or None)


def _text(values: Any, name: str) -> str:
    value = values.get(name) if isinstance(values, dict) else None
    if not isinstance(value, str):
        raise InputError(f"Expected '{name}' as text")
    return value


def _refused(request: Request, error: Exception) -> Response:
    status = HTTPStatus.NOT_FOUND if isinstance(error, MissingFileError) else HTTPStatus.UNPROCESSABLE_ENTITY
    status = HTTPStatus.CONFLICT if isinstance(error, SurveyError) else status
    return Response(as_json(Refusal(str(error))), status, media_type=_JSON)


def _failed(request: Request, error: Exception) -> Response:
    return Response(as_json(Refusal(str(error))), HTTPStatus.INTERNAL_SERVER_ERROR, media_type=_JSON)


def _view_failed(error: Exception) -> Response:
    return PlainTextResponse(str(error), HTTPStatus.NOT_FOUND)
