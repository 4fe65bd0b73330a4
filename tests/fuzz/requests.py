"""Requests at random to the servers of pages, within the process: what is answered, and what a request may not do.

A request is what a server of HTTP would hand on of one: any method, target, headers and body. None may raise or be
answered with a status from 500 on, show a file from outside, have much read of a body that is too long, or change
anything outside of the folders of the server.
"""

from __future__ import annotations

import asyncio
import json
import os
import time
import traceback
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from pomona.browser.server import PageServer

SECRET = "what nobody asked for"
"""Stands in files beside those that are served."""
MOST_BODY_BYTES = 64 * 1024
_PIECE = 16 * 1024
_MOST_PIECES = 64  # of a body that does not end

_METHODS = ("GET", "POST", "PUT", "HEAD", "DELETE", "OPTIONS", "PATCH", "TRACE", "PROPFIND", "get", "", "A" * 500)
_PARTS = (
    "..", ".", "", "%2e%2e", "%2e%2e%2f", "..%2f..%2fsecret.jpg", "%252e%252e", "..%5c..%5csecret.jpg", "%00",
    "a%00.jpg",
    "%ff%fe", "%ed%a0%80", "%", "%zz", "C:%5csecret.jpg", "%5c%5chost%5cshare", "CON", "con.jpg", "~root", "~nobody9",
    "0", "1", "-1", "00000000000000000001", "99999999999999999999", "1e9", "nan", "%F0%9F%8D%8E", "a" * 300, "a" * 9000,
    "%2Fetc%2Fpasswd", "file:%2f%2f%2fetc%2fpasswd", ";", "a;b", "?", "%3Fa", "%0d%0aSet-Cookie:%20a", "{id}",
    "secret.jpg",
)  # fmt: skip
_TEXTS = (
    "", "x", "..", "../secret.jpg", "/etc/passwd", "/etc", "~", "~nobody9", "\0", "a\0b", "\ud800", "C:\\",
    "\\\\host\\share",
    "a" * 5000, "/" + "a/" * 2000, "=HYPERLINK(1)", "<script>", "🍎", "\n", "-o", "--out", "file:///etc/passwd",
    "%2e%2e",
)  # fmt: skip
_VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 10**30, 10**400, 0.5, -1e308, [], {}, [[]], [None], [[[[]]]], {"a": {"b": []}},
)  # fmt: skip
_RAW = (
    b"", b"{", b"[" * 30_000, b"nul", b"\xff\xfe{}", b"\0", b'"' + b"a" * 60_000 + b'"', b"1" * 5000, b"NaN",
    b"Infinity",
    b'{"a": NaN}', b'{"a":1,"a":2}', b"[" + b"1," * 20_000 + b"1]", b'{"' + b"a" * 60_000 + b'":1}', b'"\\ud800"',
)  # fmt: skip


@dataclass(frozen=True)
class Known:
    """A request that the server answers: what others are made from. `body` as JSON; None: there is none."""

    method: str
    target: str
    body: Any = None


@dataclass(frozen=True)
class Asked:
    """A request: `length` is what it says of its body, which may go on without end (`endless`)."""

    method: str
    target: bytes
    headers: tuple[tuple[bytes, bytes], ...]
    body: bytes
    endless: bool = False


@dataclass
class RequestTally:
    """What became of the requests to one server: answers by status, and what should not have been."""

    name: str
    requests: int = 0
    statuses: Counter[int] = field(default_factory=Counter)
    findings: list[str] = field(default_factory=list)
    slowest_s: float = 0.0
    most_read: int = 0
    wall_s: float = 0.0


def random_request(known: Sequence[Known], own: Sequence[tuple[bytes, bytes]], rng: np.random.Generator) -> Asked:
    """Make a request from one that is known, with the headers `own` of the server's own page, some of it changed."""
    one = known[rng.integers(len(known))]
    method = one.method if rng.random() < 0.8 else _METHODS[rng.integers(len(_METHODS))]
    target = one.target if rng.random() < 0.4 else _other_target(one.target, rng)
    body = b"" if one.body is None else _some_body(one.body, rng)
    headers = dict(own)
    headers[b"content-length"] = str(len(body)).encode()
    endless = False
    if rng.random() < 0.35:
        # What comes with a request that is not to have any is dropped piece by piece.
        endless = _other_headers(headers, rng) and one.body is not None
    return Asked(method, target.encode("utf-8", "replace")[:60_000], tuple(headers.items()), body, endless)


def _other_target(target: str, rng: np.random.Generator) -> str:
    path, _, query = target.partition("?")
    parts = path.split("/")[1:]
    for _ in range(rng.integers(1, 4)):
        part, k = _PARTS[rng.integers(len(_PARTS))], int(rng.integers(len(parts) + 1))
        how = rng.integers(3)
        if how == 0 and k < len(parts):
            parts[k] = part
        elif how == 1:
            parts.insert(k, part)
        elif k < len(parts):
            parts[k] += part
    if rng.random() < 0.3:
        query = f"{('path', 'token', 'files', '')[rng.integers(4)]}={_PARTS[rng.integers(len(_PARTS))]}&{query}"
    return "/" + "/".join(parts) + (f"?{query}" if query else "")


def _some_body(values: Any, rng: np.random.Generator) -> bytes:
    how = rng.random()
    if how < 0.15:
        return _RAW[rng.integers(len(_RAW))]
    if how < 0.8:
        values = _other_value(values, rng)
    return json.dumps(values).encode()


def _other_value(value: Any, rng: np.random.Generator) -> Any:
    """A JSON value with one place in it changed."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = list(value)[rng.integers(len(value))]
        if rng.random() < 0.1:
            return {name: item for name, item in value.items() if name != key}
        return {**value, key: _other_value(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.7:
        k = int(rng.integers(len(value)))
        return [*value[:k], _other_value(value[k], rng), *value[k + 1 :]] * int(rng.choice([1, 1, 1, 2, 200]))
    if rng.random() < 0.5:
        return _TEXTS[rng.integers(len(_TEXTS))]
    return _VALUES[rng.integers(len(_VALUES))]


def _other_headers(headers: dict[bytes, bytes], rng: np.random.Generator) -> bool:
    """Change some headers; return whether the body goes on without end."""
    others: tuple[tuple[bytes, tuple[bytes, ...]], ...] = (
        (b"host", (b"", b"evil.example", b"127.0.0.1", b"127.0.0.1:1", b"localhost:99999", b"[::1]",
            b"a" * 9000, b"\xff")),
        (b"origin", (b"", b"null", b"http://evil.example", b"\xff", b"http://127.0.0.1")),
        (b"cookie", (b"", b"=", b";;;=\xff", b"pomona=" + b"a" * 9000, b'a="')),
        (b"content-type", (b"", b"text/plain", b"application/json; charset=\xff", b"multipart/form-data",
            b"application/")),
        (b"content-length", (b"", b"-1", b"1e9", b"\xb2", b"99999999999999999999", b"65537", b"0x10", b" 5", b"+5")),
        (b"range", (b"bytes=0-", b"bytes=-1", b"bytes=5-2", b"bytes=0-0,1-1,2-2", b"bytes=99999999999999-",
            b"x", b"bytes=")),
        (b"if-range", (b"x", b'"a"', b"\xff")),
        (b"accept-encoding", (b"gzip", b"\xff")),
    )  # fmt: skip
    for _ in range(rng.integers(1, 3)):
        name, values = others[rng.integers(len(others))]
        headers[name] = values[rng.integers(len(values))]
    if rng.random() < 0.2:
        headers.pop(list(headers)[rng.integers(len(headers))], None)
    if rng.random() < 0.2:
        headers[b"content-length"] = (b"65537", b"1000000000", b"99999999999999999999")[rng.integers(3)]
        return True
    if rng.random() < 0.1:
        headers.pop(b"content-length", None)
        headers[b"transfer-encoding"] = b"chunked"
        return True
    return False


@dataclass
class Answer:
    """What was answered, and how many bytes of the body were read before anything was."""

    status: int = 0
    headers: tuple[tuple[bytes, bytes], ...] = ()
    body: bytes = b""
    read: int = 0


async def ask(server: PageServer, asked: Asked) -> Answer:
    """Return what a server answers; streams are left after their first piece. Errors come through."""
    answer, sent, left = Answer(), 0, asyncio.Event()
    path, _, query = asked.target.partition(b"?")
    scope = {
        "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": asked.method, "scheme": "http",
        "path": unquote(path.decode("ascii", "replace")), "raw_path": path, "query_string": query, "root_path": "",
        "headers": list(asked.headers), "client": ("127.0.0.1", 1), "server": (server.host, server.port),
    }  # fmt: skip

    async def receive() -> dict[str, Any]:
        nonlocal sent
        if asked.endless and sent < _MOST_PIECES:
            sent += 1
            answer.read += _PIECE * (not answer.status)
            return {"type": "http.request", "body": b" " * _PIECE, "more_body": sent < _MOST_PIECES}
        if not sent:
            sent += 1
            answer.read += len(asked.body)
            return {"type": "http.request", "body": asked.body, "more_body": False}
        await left.wait()
        return {"type": "http.disconnect"}

    async def send(message: Any) -> None:
        if message["type"] == "http.response.start":
            answer.status, answer.headers = message["status"], tuple(message.get("headers", ()))
        else:
            answer.body += message.get("body", b"")
            if message.get("body") or not message.get("more_body"):
                left.set()

    await asyncio.wait_for(server.application(scope, receive, send), 60)
    return answer


def campaign(
    name: str,
    server: PageServer,
    known: Sequence[Known],
    own: Sequence[tuple[bytes, bytes]],
    cases: Sequence[int],
    *,
    around: Path,
    may_change: Sequence[Path] = (),
    takes_files: str = "",
) -> RequestTally:
    """Send random requests to a server, and say what should not have been.

    `around` is a folder with all that the server has and a secret, in which only `may_change` may change. Bodies of
    requests to addresses that begin with `takes_files` may be long.
    """
    tally, begun = RequestTally(name), time.monotonic()
    before = _state(around, may_change)
    for case in cases:
        rng = np.random.default_rng([zlib.crc32(name.encode()), case])
        asked = random_request(known, own, rng)
        start = time.process_time()
        try:
            answer = asyncio.run(ask(server, asked))
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            tally.findings.append(f"{case}: {error!r:.200} at {where.filename}:{where.lineno} {_shown(asked)}")
            continue
        finally:
            tally.requests += 1
        tally.slowest_s = max(tally.slowest_s, time.process_time() - start)
        tally.statuses[answer.status] += 1
        if not takes_files or takes_files not in asked.target.decode("latin-1"):
            tally.most_read = max(tally.most_read, answer.read)
        for wrong in _wrong(answer):
            tally.findings.append(f"{case}: {wrong} {_shown(asked)}")
        if tally.most_read > MOST_BODY_BYTES + _PIECE:
            tally.findings.append(f"{case}: {answer.read} bytes were read {_shown(asked)}")
            tally.most_read = 0
    if (after := _state(around, may_change)) != before:
        changed = {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}
        tally.findings.append(f"changed outside: {sorted(changed)[:5]}")
    tally.wall_s = time.monotonic() - begun
    return tally


def _wrong(answer: Answer) -> list[str]:
    found = []
    if not 200 <= answer.status < 500:
        found.append(f"status {answer.status}: {answer.body[:200]!r}")
    if SECRET.encode() in answer.body or b"root:x:0" in answer.body:
        found.append("a file from outside")
    if b"Traceback (most recent call last)" in answer.body:
        found.append("a traceback")
    if any(b"\n" in value or b"\r" in value for pair in answer.headers for value in pair):
        found.append("a line break in a header")
    if b"nosniff" not in dict(answer.headers).get(b"x-content-type-options", b""):
        found.append("an answer without the server's headers")
    return found


def _state(folder: Path, but: Sequence[Path]) -> dict[str, tuple[int, int]]:
    found = {}
    for here, _, names in os.walk(folder):
        for name in names:
            path = Path(here) / name
            if not any(other == path or other in path.parents for other in but):
                stat = path.stat()
                found[str(path)] = stat.st_size, stat.st_mtime_ns
    return found


def _shown(asked: Asked) -> str:
    return f"by {asked.method:.20} {asked.target[:200]!r} {asked.body[:200]!r} {list(asked.headers)!r:.400}"
