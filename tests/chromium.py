"""Debian's Chromium, which draws in 3D without a graphics card, driven by Playwright."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from waiting import until

_SOFTWARE_3D = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_QUIET = (
    "--no-sandbox",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
PATIENCE_MS = 120_000
"""How long a page may take where other programs keep the machine busy; only what fails takes so long."""


@dataclass
class Opened:
    """A page, and what it said and asked for."""

    page: Any
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)


def open_page(browser: Any, path: Path | str, before: str = "") -> Opened:
    """Open a file or an address, after a script of ours, and wait until 3D is there or refused."""
    opened = Opened(browser.new_page(viewport={"width": 900, "height": 600}, reduced_motion="reduce"))
    opened.page.set_default_timeout(PATIENCE_MS)
    opened.page.on("console", lambda message: opened.said.append(f"{message.type}: {message.text}"))
    opened.page.on("pageerror", lambda error: opened.said.append(str(error)))
    opened.page.on("request", lambda request: opened.asked.append(request.url))
    opened.page.add_init_script(before)
    opened.page.goto(path if isinstance(path, str) else path.as_uri())
    opened.page.wait_for_selector("html.has-webgl, html.no-webgl")
    return opened


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser that runs. Skips the test where Chromium or Playwright is not there."""
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("no Chromium found: install Debian's package chromium to test pages in a browser")
    driver = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra `dev`)")
    with driver.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=program, args=[*_QUIET, *_SOFTWARE_3D])
        yield browser
        browser.close()


def page_until(page: Any, condition: str, arg: Any = None) -> None:
    """Wait until an expression, or a function of the argument, is true in the page.

    What Playwright itself waits for is a string that the page evaluates again and again, which our content security
    policy forbids it: only what is true at once would pass.
    """
    until(lambda: page.evaluate(condition, arg), PATIENCE_MS / 1000, condition)


def drawn(page: Any, *, still: bool = True) -> None:
    """Wait until the picture is of what was last asked for and, where it stands still, lacks nothing."""
    frames = "new Promise(r => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(r, 50))))"
    page.evaluate(frames)
    if still:
        page.wait_for_selector("#view[data-picture=whole]")
    page.evaluate(frames)


def red_px(page: Any) -> int:
    """How many pixels of the view are red, as fruits are drawn."""
    drawn(page)
    encoded = np.frombuffer(page.locator("#view canvas").screenshot(), np.uint8)
    pixels = cv2.imdecode(encoded, cv2.IMREAD_COLOR).astype(int)
    return int(((pixels[:, :, 2] > 110) & (pixels[:, :, 2] > 2 * pixels[:, :, 1])).sum())
