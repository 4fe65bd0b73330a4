"""The page of `pomona watch`: that of `pomona view`, which follows what the photos so far show."""

from __future__ import annotations

import dataclasses
import json
import secrets
from collections.abc import Callable
from http import HTTPStatus

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.types import ASGIApp, Receive, Scope, Send

from pomona.browser.server import LOOPBACK, PageServer, Updates
from pomona.browser.view import SurveyPages
from pomona.stages.report import ReportData
from pomona.stages.report.contract import WatchState, camel_case
from pomona.stages.report.page import policy
from pomona.values.cameras import Cameras
from pomona.values.fruits import Fruits
from pomona.values.photos import Photos

# Pages that are still loading may ask for what was there before.
_KEPT = 3


class WatchServer(PageServer):
    """Serves what a watch says: to this computer alone, or on `host` to those who know the token in its address.

    Each answer has addresses of its own, `/at/REVISION/…`, so that photos of one are never taken for those of another.
    `on_stop_wanted` is called when a page asks for the end.
    """

    def __init__(
        self,
        title: str,
        *,
        host: str = LOOPBACK,
        port: int = 0,
    ) -> None:
        self._updates = Updates()
        self._pages: dict[int, ASGIApp] = {}
        self.on_stop_wanted: Callable[[], None] = lambda: None
        nothing_yet = ReportData(title=title, photos=Photos(()), cameras=Cameras.empty(), fruits=Fruits.empty())
        self.show(nothing_yet, 0)
        app = Starlette(
            routes=[
                Route("/", self._latest),
                Route("/events", self._updates.endpoint),
                Route("/stop", self._stop, methods=["POST"]),
                Mount("/at/{revision:int}", app=self._answer),
            ]
        )
        token = "" if host == LOOPBACK else secrets.token_urlsafe(16)
        super().__init__(app, policy=policy("server"), host=host, port=port, token=token, on_stop=self._updates.close)

    def show(self, data: ReportData, revision: int) -> None:
        """Serve an answer so far, from any thread."""
        kept = dict(list(self._pages.items())[1 - _KEPT :])
        self._pages = {**kept, revision: SurveyPages(dataclasses.replace(data, provisional=True)).app}

    def tell(self, state: WatchState) -> None:
        """Tell all pages how far it is, from any thread."""
        values = {camel_case(name): value for name, value in dataclasses.asdict(state).items()}
        self._updates.publish(json.dumps(values))

    def _latest(self, request: Request) -> Response:
        return RedirectResponse(f"/at/{max(self._pages)}/", HTTPStatus.SEE_OTHER)

    def _stop(self, request: Request) -> Response:
        self.on_stop_wanted()
        return Response(status_code=HTTPStatus.NO_CONTENT)

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        revision = scope["path_params"]["revision"]
        page = self._pages.get(revision)
        if page is not None:
            await page({**scope, "path_params": {}}, receive, send)
        elif scope["path"].endswith(f"/at/{revision}/"):
            # A phone loads its page again when it is taken out of the pocket, where it may have been for long.
            await RedirectResponse("/", HTTPStatus.SEE_OTHER)(scope, receive, send)
        else:
            raise HTTPException(HTTPStatus.NOT_FOUND, "There is a later answer: load the page again")
