"""What pages send: JSON, and little of it."""

from __future__ import annotations

import json
from http import HTTPStatus
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request

_MOST_BYTES = 64 * 1024  # what a person does takes some hundred bytes: what is longer is none


async def json_of(request: Request, *, most_bytes: int = _MOST_BYTES) -> Any:
    """Return what a request brings as JSON; raises `HTTPException` for anything else.

    A page of another site can have its reader's browser send text and forms here, but no JSON.
    """
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise HTTPException(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "Expected application/json")
    length = request.headers.get("content-length", "")
    if not length.isascii() or not length.isdigit():
        raise HTTPException(HTTPStatus.LENGTH_REQUIRED, "Expected a Content-Length")
    if len(length) > len(str(most_bytes)) or int(length) > most_bytes:
        raise HTTPException(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"Expected at most {most_bytes} bytes")
    try:
        values = json.loads(await request.body())
        # JSON can hold half a character, which is no text.
        json.dumps(values, ensure_ascii=False).encode("utf-8")
        return values
    except (ValueError, RecursionError) as error:
        raise HTTPException(HTTPStatus.BAD_REQUEST, f"Expected JSON: {error}") from None
