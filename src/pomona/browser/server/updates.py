"""What pages are told by themselves: the present state of something, again whenever it changed."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator

from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

# Proxies and browsers drop connections over which nothing comes.
_QUIET_S = 15.0


class Updates:
    """The latest state, as one line of text, told to all pages that listen (server-sent events)."""

    def __init__(self) -> None:
        self._state: str | None = None
        self._closed = False
        self._lock = threading.Lock()
        self._listeners: dict[asyncio.Event, asyncio.AbstractEventLoop] = {}

    def publish(self, state: str) -> None:
        """Tell a new state; from any thread. Pages that are slow miss states, but never the last one."""
        assert "\n" not in state
        with self._lock:
            self._state = state
        self._wake()

    def close(self) -> None:
        """End what pages listen to, once they were told the last state."""
        with self._lock:
            self._closed = True
        self._wake()

    async def endpoint(self, request: Request) -> Response:
        """Answer a page's request for the states (Starlette)."""
        return StreamingResponse(self._told(), media_type="text/event-stream")

    async def _told(self) -> AsyncIterator[str]:
        news = asyncio.Event()
        news.set()
        with self._lock:
            self._listeners[news] = asyncio.get_running_loop()
        told: str | None = None
        try:
            while True:
                try:
                    await asyncio.wait_for(news.wait(), _QUIET_S)
                except TimeoutError:
                    yield ": still here\n\n"
                    continue
                news.clear()
                with self._lock:
                    state, closed = self._state, self._closed
                if state is not None and state is not told:
                    told = state
                    yield f"data: {state}\n\n"
                if closed:
                    return
        finally:
            with self._lock:
                del self._listeners[news]

    def _wake(self) -> None:
        with self._lock:
            for news, loop in self._listeners.items():
                loop.call_soon_threadsafe(news.set)
