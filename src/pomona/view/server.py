"""The page of `pomona view`, served to this computer alone, with Python's own HTTP server."""

from __future__ import annotations

import dataclasses
import json
from email.message import Message
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BufferedIOBase
from socketserver import TCPServer
from typing import Any

from pomona.errors import PomonaError
from pomona.report.contract import TruthData
from pomona.report.data import ReportData
from pomona.report.page import policy
from pomona.view import posts
from pomona.view.correct import Corrector
from pomona.view.site import JSON, Answer, Site

HOST = "127.0.0.1"


class ViewServer(ThreadingHTTPServer):
    """Serves one survey on 127.0.0.1. `port` 0 takes a free one; raises `OSError` where a port is taken.

    With `corrector`, whose data and truth are given then, its page can correct fruits.
    """

    daemon_threads = True

    def __init__(
        self,
        data: ReportData,
        *,
        port: int = 0,
        truth: TruthData | None = None,
        corrector: Corrector | None = None,
    ) -> None:
        super().__init__((HOST, port), _Handler)
        self.corrector = corrector
        self.site = Site(data, truth, corrector)
        self._before: Site | None = None

    @property
    def changed(self) -> bool:
        """Whether fruits were corrected since it was started."""
        return self.corrector is not None and self.corrector.changed

    def server_bind(self) -> None:
        """Take the port, without asking name servers what this computer is called, which may take seconds."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = HOST, self.server_address[1]

    def answer(self, path: str) -> Answer | None:
        """Return what an address stands for; None where there is no such thing; raises for a lost photo."""
        # A page that corrects may still be loading what was there before.
        return self.site.answer(path) or (self._before.answer(path) if self._before else None)

    def correct(self, path: str, headers: Message, body: BufferedIOBase) -> Answer:
        """Do what a page asks to be changed, and show it from then on; raises `RefusedError`."""
        answer = posts.correct(self.corrector, path, headers, body)
        if self.corrector is not None and answer.changed:
            self._before = self.site
            self.site = Site(self.corrector.data, self.corrector.truth, self.corrector)
        return Answer(json.dumps(dataclasses.asdict(answer)).encode("utf-8"), JSON)

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self.server_port}/"


class _Handler(BaseHTTPRequestHandler):
    server: ViewServer
    protocol_version = "HTTP/1.1"
    server_version = "pomona"
    sys_version = ""

    def do_GET(self) -> None:
        self._answer(body=True)

    def do_HEAD(self) -> None:
        self._answer(body=False)

    def do_POST(self) -> None:
        # What was not read of a body that is refused must not be taken for the next request.
        self.close_connection = True
        if not self._is_ours():
            self.send_error(HTTPStatus.FORBIDDEN, "Only pages of this computer")
            return
        try:
            answer = self.server.correct(self.path, self.headers, self.rfile)
        except posts.RefusedError as error:
            self.send_error(error.status, str(error))
            return
        self._send(answer, body=True)

    def _answer(self, *, body: bool) -> None:
        if not self._is_ours():
            # Pages of others could reach this server under a name of theirs.
            self.send_error(HTTPStatus.FORBIDDEN, "Only pages of this computer")
            return
        try:
            answer = self.server.answer(self.path.split("?", 1)[0])
        except (PomonaError, OSError) as error:
            self.send_error(HTTPStatus.NOT_FOUND, explain=str(error))
            return
        if answer is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        self._send(answer, body=body)

    def _is_ours(self) -> bool:
        host = self.headers.get("Host", "")
        return host in (f"{HOST}:{self.server.server_port}", f"localhost:{self.server.server_port}")

    def _send(self, answer: Answer, *, body: bool) -> None:
        content = answer.body
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", answer.kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Content-Security-Policy", policy("server") + "; frame-ancestors 'none'")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        # A survey may be made again behind the same port, and corrected masks have new crops.
        self.send_header("Cache-Control", "private, max-age=600" if answer.lasting else "no-store")
        self.end_headers()
        if body:
            self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing of each request."""

    def handle(self) -> None:
        """Serve a connection; one that the browser drops is no error."""
        try:
            super().handle()
        except (ConnectionError, TimeoutError):
            return
