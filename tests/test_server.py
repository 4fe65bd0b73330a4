"""The server of pages: who is answered, what comes with the answers, what pages are told by themselves."""

from __future__ import annotations

import http.client
import threading
from collections.abc import Iterator

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from pomona.browser.server import PageServer, Updates, json_of
from pomona.browser.server.guard import Access
from serving import get, running

POLICY = "default-src 'none'"


def _page(request: Request) -> Response:
    return PlainTextResponse("the page")


async def _sent(request: Request) -> Response:
    return JSONResponse(await json_of(request))


def _server(token: str = "", updates: Updates | None = None) -> PageServer:
    updates = updates or Updates()
    routes = [Route("/", _page), Route("/events", updates.endpoint), Route("/send", _sent, methods=["POST"])]
    return PageServer(Starlette(routes=routes), policy=POLICY, token=token, on_stop=updates.close)


@pytest.fixture(scope="module")
def locked() -> Iterator[PageServer]:
    with running(_server("secret")) as server:
        yield server


def test_all_answers_say_what_browsers_may_do() -> None:
    with running(_server()) as server:
        for path, status in (("/", 200), ("/none", 404)):
            found, headers, _ = get(server, path)
            assert found == status
            assert headers["Content-Security-Policy"] == f"{POLICY}; frame-ancestors 'none'"
            assert headers["X-Content-Type-Options"] == "nosniff"
            assert headers["Referrer-Policy"] == "no-referrer"
            assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
            assert headers["Cache-Control"] == "no-store"
            assert "Server" not in headers
        assert get(server, "/", Host="evil.example")[1]["X-Content-Type-Options"] == "nosniff"


def test_every_server_has_the_icon_that_browsers_ask_for(locked: PageServer) -> None:
    with running(_server()) as server:
        status, headers, body = get(server, "/favicon.ico")
        assert (status, headers["Content-Type"]) == (200, "image/svg+xml")
        assert body.startswith(b"<svg")
        assert get(server, "/favicon.ico/")[0] == 404
    assert get(locked, "/favicon.ico")[0] == 403


def test_the_token_comes_in_the_address_once_and_as_a_cookie_then(locked: PageServer) -> None:
    assert locked.url == f"http://127.0.0.1:{locked.port}/?token=secret"
    status, headers, _ = get(locked, "/?token=secret")
    assert (status, headers["Location"]) == (303, "/")
    cookie = headers["Set-Cookie"]
    assert "httponly" in cookie.lower()
    status, _, body = get(locked, "/", Cookie=cookie.partition(";")[0])
    assert (status, body) == (200, b"the page")


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", {}), ("/?token=", {}), ("/?token=secre", {}), ("/?token=s%C3%A9cret", {}), ("/events", {}),
        ("/", {"Cookie": "pomona-1=secret"}), ("/?token=secret", {"Host": "evil.example"}),
    ],
)  # fmt: skip
def test_without_the_token_nothing_is_answered(locked: PageServer, path: str, headers: dict[str, str]) -> None:
    status, answered, body = get(locked, path, **headers)
    assert status == 403
    assert "Set-Cookie" not in answered
    assert b"page" not in body or b"Only pages" in body


def test_what_changes_something_comes_from_the_own_page() -> None:
    with running(_server()) as server:

        def sent(**headers: str) -> int:
            connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
            named = {name.replace("_", "-"): value for name, value in headers.items()}
            connection.request("POST", "/send", b"{}", {"Content-Type": "application/json", **named})
            status = connection.getresponse().status
            connection.close()
            return status

        own = f"http://127.0.0.1:{server.port}"
        assert sent(Origin=own) == 200
        assert sent(Origin=own, Sec_Fetch_Site="same-origin") == 200
        assert sent() == sent(Origin="null") == sent(Origin="http://evil.example") == 403
        assert sent(Origin=own, Sec_Fetch_Site="cross-site") == 403
        assert sent(Origin=own, Content_Type="text/plain") == 415


@pytest.mark.parametrize(
    ("listens", "host", "ours"),
    [
        ("127.0.0.1", "127.0.0.1:80", True), ("127.0.0.1", "localhost:80", True), ("127.0.0.1", "127.0.0.1:81", False),
        ("127.0.0.1", "192.168.0.7:80", False), ("127.0.0.1", "127.0.0.1", True), ("127.0.0.1", "", False),
        ("192.168.0.7", "192.168.0.7:80", True), ("192.168.0.7", "localhost:80", False),
        ("0.0.0.0", "192.168.0.7:80", True), ("0.0.0.0", "localhost:80", True), ("0.0.0.0", "evil.example:80", False),
        ("0.0.0.0", "7.evil.example:80", False), ("::", "[fe80::1]:80", True), ("::1", "[::1]:80", True),
        ("::1", "[::1]", True), ("127.0.0.1", "evil.example", False),
    ],
)  # fmt: skip
def test_names_of_others_are_not_ours(listens: str, host: str, ours: bool) -> None:
    assert Access(listens, 80).is_ours(host) == ours
    if ":80" not in host:  # browsers leave out this port, and no other
        assert not Access(listens, 8080).is_ours(host)


def test_pages_are_told_the_present_state_and_each_new_one() -> None:
    updates = Updates()
    updates.publish("1")
    with running(_server(updates=updates)) as server:
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
        connection.request("GET", "/events")
        answer = connection.getresponse()
        assert answer.headers["Content-Type"].startswith("text/event-stream")
        assert answer.readline() + answer.readline() == b"data: 1\n\n"
        updates.publish("2")
        assert answer.readline() + answer.readline() == b"data: 2\n\n"
        # A page that listens does not keep the server from ending.
        ending = threading.Thread(target=server.shutdown)
        ending.start()
        assert answer.read() == b""
        ending.join(60)
        connection.close()


def test_a_port_that_is_taken_is_told_of() -> None:
    with _server() as server, pytest.raises(OSError, match="in use"):
        PageServer(Starlette(), policy=POLICY, port=server.port)
