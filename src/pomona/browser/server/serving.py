"""An application served to browsers: by uvicorn, on a port that is taken before anything is answered."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self

import uvicorn
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, Router
from starlette.types import ASGIApp

from pomona.browser.server.guard import TOKEN, Access, Guard

LOOPBACK = "127.0.0.1"
_ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16"><circle cx="8" cy="9" r="6" fill="#b8322a"/>'
    '<path d="M8 4q0-3 3-3" fill="none" stroke="#4f7d5a" stroke-width="1.6"/></svg>'
)
# Answers that are under way when a server ends get so long.
_GRACE_S = 3


class PageServer:
    """Serves an application, and the icon of its pages, on one address of this computer, behind a `Guard`.

    `port` 0 takes a free one; raises `OSError` where a port is taken, or the address is none of this computer's.
    `policy` is the content security policy of all that is served, `framed_by` says in whose pages it may be shown
    ("'self'": the server's own). With a `token`, only those are answered who know it.
    `application` is what answers, the guard included.
    `on_stop` is called before connections are closed: streams that would not end by themselves are ended there.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        policy: str,
        framed_by: str = "'none'",
        host: str = LOOPBACK,
        port: int = 0,
        token: str = "",
        on_stop: Callable[[], None] = lambda: None,
    ) -> None:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.create_server((host, port), family=family)
        listens = self._socket.getsockname()
        self._access = Access(listens[0], listens[1], token)
        self.application: ASGIApp = Guard(_with_icon(app), self._access, policy, framed_by)
        config = uvicorn.Config(
            self.application,
            http="h11",
            ws="none",
            loop="asyncio",
            lifespan="off",
            interface="asgi3",
            log_config=None,
            log_level="error",
            access_log=False,
            server_header=False,
            proxy_headers=False,
            timeout_graceful_shutdown=_GRACE_S,
        )
        self._uvicorn = _Uvicorn(config, on_stop)
        self._serving = threading.Lock()

    @property
    def host(self) -> str:
        """The address that it listens on."""
        return self._access.host

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return self._access.port

    @property
    def url(self) -> str:
        """Where the page is: with the token, where one is asked for."""
        host = _address_in_network() if self.host in ("0.0.0.0", "::") else self.host
        query = f"?{TOKEN}={self._access.token}" if self._access.token else ""
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/{query}"

    def serve_forever(self) -> None:
        """Answer requests until `shutdown`, or Ctrl-C, which raises `KeyboardInterrupt` in the main thread."""
        with self._serving:
            if not self._uvicorn.should_exit:
                self._uvicorn.run(sockets=[self._socket])

    def shutdown(self) -> None:
        """End `serve_forever` in another thread, and wait for it."""
        self._uvicorn.should_exit = True
        with self._serving:
            pass

    def __enter__(self) -> Self:
        """Return the server."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the port back."""
        self._socket.close()


class _Uvicorn(uvicorn.Server):
    def __init__(self, config: uvicorn.Config, on_stop: Callable[[], None]) -> None:
        super().__init__(config)
        self._on_stop = on_stop

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._on_stop()
        await super().shutdown(sockets)


def _with_icon(app: ASGIApp) -> ASGIApp:
    """Have the icon answered that browsers ask for beside every page."""
    return Router([Route("/favicon.ico", _icon)], redirect_slashes=False, default=app)


def _icon(request: Request) -> Response:
    return Response(_ICON, media_type="image/svg+xml")


def _address_in_network() -> str:
    """This computer's address in its network; no packet is sent to learn it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        try:
            asked.connect(("192.0.2.1", 9))  # an address of documentation, RFC 5737
        except OSError:  # no network
            return LOOPBACK
        return str(asked.getsockname()[0])
