"""Work shared out among threads: NumPy, OpenCV and the networks let go of the interpreter's lock while they work."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_order(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    threads: int,
    *,
    left: Callable[[Result], None] = lambda result: None,
) -> Generator[Result, None, None]:
    """Yield `work(item)` of each item, in the items' order, while `threads` of them work on those that follow.

    Unlike `Executor.map` it begins no more than are soon asked for, so that memory is bounded. What `work` raises is
    raised when its turn comes. What was begun when it ends early, for that or because nobody asks any more, is finished
    and handed to `left`, in the thread that asked.
    """
    with ThreadPoolExecutor(threads) as pool:
        begun: deque[Future[Result]] = deque()
        try:
            for item in items:
                begun.append(pool.submit(work, item))
                if len(begun) > threads:
                    yield begun.popleft().result()
            while begun:
                yield begun.popleft().result()
        finally:
            for ahead in begun:
                if not ahead.cancel() and ahead.exception() is None:
                    left(ahead.result())
