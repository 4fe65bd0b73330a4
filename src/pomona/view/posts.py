"""What a page may send to the server: corrections, from the server's own page and from no other."""

from __future__ import annotations

import json
from email.message import Message
from http import HTTPStatus
from io import BufferedIOBase
from typing import Any

from pomona.errors import InputError, PomonaError
from pomona.report.contract import CorrectionAnswer
from pomona.view.correct import Corrector, StaleError, request_from

PATH = "/corrections"
_MOST_BYTES = 64 * 1024  # a correction takes some hundred bytes: what is longer is none


class RefusedError(Exception):
    """A request that is not answered: its status, and why in words."""

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        super().__init__(reason)
        self.status = status


def correct(corrector: Corrector | None, path: str, headers: Message, body: BufferedIOBase) -> CorrectionAnswer:
    """Do what a request wants to be changed, or say why not.

    Raises `RefusedError` for what does not come from the server's own page. A page of another site can have its
    reader's browser send forms and simple requests here, but no JSON, and not without saying where it comes from.
    """
    if corrector is None or path != PATH:
        raise RefusedError(HTTPStatus.NOT_FOUND, "There is nothing to send to")
    if (
        headers.get("Origin") != f"http://{headers.get('Host')}"
        or headers.get("Sec-Fetch-Site", "same-origin") != "same-origin"
    ):
        raise RefusedError(HTTPStatus.FORBIDDEN, "Only this server's own page can correct")
    if headers.get_content_type() != "application/json":
        raise RefusedError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "Expected application/json")
    try:
        request = request_from(_json(headers, body))
    except InputError as error:
        raise RefusedError(HTTPStatus.BAD_REQUEST, str(error)) from None
    try:
        answer = corrector.do(request)
    except StaleError as error:
        answer = CorrectionAnswer(True, str(error), 0)
    except PomonaError as error:
        answer = CorrectionAnswer(False, str(error), 0)
    return answer


def _json(headers: Message, body: BufferedIOBase) -> Any:
    length = headers.get("Content-Length", "")
    if not length.isascii() or not length.isdigit():
        raise RefusedError(HTTPStatus.LENGTH_REQUIRED, "Expected a Content-Length")
    if int(length) > _MOST_BYTES:
        raise RefusedError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"Expected at most {_MOST_BYTES} bytes")
    try:
        return json.loads(body.read(int(length)))
    except (ValueError, RecursionError) as error:
        raise RefusedError(HTTPStatus.BAD_REQUEST, f"Expected JSON: {error}") from None
