"""Who may ask a server of pages, and what browsers are told to do with its answers: middleware around all of it."""

from __future__ import annotations

import ipaddress
import secrets
from dataclasses import dataclass
from http import HTTPStatus
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

TOKEN = "token"
_READING = ("GET", "HEAD")


@dataclass(frozen=True)
class Access:
    """Where a server listens, and the token that it asks for; "" where it asks for none."""

    host: str
    port: int
    token: str = ""

    @property
    def cookie(self) -> str:
        """The cookie with the token. Browsers send cookies to all ports of a computer: the port is in its name."""
        return f"pomona-{self.port}"

    def is_ours(self, host: str) -> bool:
        """Whether a request's `Host` is this server, not a name that somebody else made to lead here."""
        name, port = _parted(host)
        if port != str(self.port):
            return False
        if self.host in _EVERYWHERE:
            return name == "localhost" or _is_address(name)
        return name in (_bracketed(self.host), "localhost" if ipaddress.ip_address(self.host).is_loopback else "")

    def knows(self, token: str) -> bool:
        """Whether this is the token."""
        return secrets.compare_digest(token.encode("utf-8"), self.token.encode("utf-8"))


class Guard:
    """Answers only requests of the server's own pages, by its own name and with its token.

    Pages of others could reach the server under a name of theirs (so its name is checked), and have their reader's
    browser send forms and simple requests here, but not without saying where they come from (so is the origin, of all
    that may change something). The token comes once in the address, and is kept as a cookie from then on.
    """

    def __init__(self, app: ASGIApp, access: Access, policy: str, framed_by: str) -> None:
        self._app, self._access = app, access
        self._headers = {
            "Content-Security-Policy": f"{policy}; frame-ancestors {framed_by}",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on (ASGI)."""
        assert scope["type"] == "http"

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(self._headers)
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        answer = self._refusal(scope) or self._arrival(scope)
        await (answer or self._app)(scope, receive, send_guarded)

    def _refusal(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not self._access.is_ours(host):
            return _forbidden("Only pages of this computer")
        if scope["method"] not in _READING and (
            headers.get("origin") != f"http://{host}" or headers.get("sec-fetch-site", "same-origin") != "same-origin"
        ):
            return _forbidden("Only this server's own page can change something")
        return None

    def _arrival(self, scope: Scope) -> Response | None:
        """What is answered to one who brings the token in the address, or none at all."""
        if not self._access.token:
            return None
        given = parse_qs(scope["query_string"].decode("latin-1")).get(TOKEN, [""])[0]
        if given and self._access.knows(given) and scope["method"] in _READING:
            answer = RedirectResponse("/", HTTPStatus.SEE_OTHER)
            answer.set_cookie(self._access.cookie, given, httponly=True, samesite="lax")
            return answer
        cookies = cookie_parser(Headers(scope=scope).get("cookie", ""))
        if not self._access.knows(cookies.get(self._access.cookie, "")):
            return _forbidden("Open the whole address that the command said: the token at its end is missing")
        return None


_EVERYWHERE = ("0.0.0.0", "::")
_USUAL_PORT = "80"


def _parted(host: str) -> tuple[str, str]:
    """The name, or address, and the port of a `Host`: browsers leave the usual port out."""
    name, colon, port = host.rpartition(":")
    return (name, port) if colon and not port.endswith("]") else (host, _USUAL_PORT)


def _forbidden(reason: str) -> Response:
    return PlainTextResponse(reason, HTTPStatus.FORBIDDEN)


def _is_address(name: str) -> bool:
    # Whoever makes a name of theirs lead here cannot make an address do so.
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host
