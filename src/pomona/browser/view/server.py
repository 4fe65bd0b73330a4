"""The page of `pomona view`, served to this computer alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from http import HTTPStatus
from types import TracebackType
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from pomona.browser.server import PageServer, json_of
from pomona.browser.view.correct import Corrector, StaleError, request_from
from pomona.browser.view.site import ADDRESSES, Site
from pomona.errors import InputError, PomonaError
from pomona.stages.report.contract import CorrectionAnswer, TruthData
from pomona.stages.report.data import ReportData
from pomona.stages.report.page import policy


class SurveyPages:
    """The page of one survey and all that it asks for, as an ASGI application `app`, below whatever address.

    With `corrector`, whose data and truth are given then, its page can correct fruits.
    """

    def __init__(self, data: ReportData, truth: TruthData | None = None, corrector: Corrector | None = None) -> None:
        self.corrector = corrector
        self.site = Site(data, truth, corrector)
        self._before: Site | None = None
        routes: list[BaseRoute] = [Route(path, self._endpoint(make)) for path, make in ADDRESSES.items()]
        if corrector is not None:
            routes.append(Route("/corrections", self._correct, methods=["POST"]))
        self.app = Starlette(routes=routes, exception_handlers={PomonaError: _not_there, OSError: _not_there})
        self.app.router.redirect_slashes = False

    def _endpoint(self, make: Callable[..., Response | None]) -> Callable[[Request], Response]:
        def answer(request: Request) -> Response:
            # A page that corrects may still be loading what was there before.
            for site in filter(None, (self.site, self._before)):
                try:
                    found = make(site, **request.path_params)
                except (KeyError, IndexError):
                    continue
                if found is not None:
                    return found
            raise HTTPException(HTTPStatus.NOT_FOUND)

        return answer

    async def _correct(self, request: Request) -> Response:
        values = await json_of(request)
        answer = await run_in_threadpool(self._corrected, values)
        return JSONResponse(dataclasses.asdict(answer))

    def _corrected(self, values: Any) -> CorrectionAnswer:
        """Do what the page asks to be changed, and show it from then on."""
        assert self.corrector is not None
        try:
            wanted = request_from(values)
        except InputError as error:
            raise HTTPException(HTTPStatus.BAD_REQUEST, str(error)) from None
        try:
            answer = self.corrector.do(wanted)
        except StaleError as error:
            answer = CorrectionAnswer(True, str(error), 0)
        except PomonaError as error:
            answer = CorrectionAnswer(False, str(error), 0)
        if answer.changed:
            self._before = self.site
            self.site = Site(self.corrector.data, self.corrector.truth, self.corrector)
        return answer


class ViewServer(PageServer):
    """Serves one survey on 127.0.0.1. `port` 0 takes a free one; raises `OSError` where a port is taken.

    `truth` and `corrector` are those of `SurveyPages`. `on_changed` is called at the end of the context where fruits
    were corrected.
    """

    def __init__(
        self,
        data: ReportData,
        *,
        port: int = 0,
        truth: TruthData | None = None,
        corrector: Corrector | None = None,
        on_changed: Callable[[], None] = lambda: None,
    ) -> None:
        self.corrector, self._on_changed = corrector, on_changed
        self.pages = SurveyPages(data, truth, corrector)
        super().__init__(self.pages.app, policy=policy("server"), port=port)

    @property
    def changed(self) -> bool:
        """Whether fruits were corrected since it was started."""
        return self.corrector is not None and self.corrector.changed

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the port back, and say that fruits were corrected."""
        super().__exit__(kind, error, trace)
        if self.changed:
            self._on_changed()


def _not_there(request: Request, error: Exception) -> Response:
    return PlainTextResponse(str(error), HTTPStatus.NOT_FOUND)
