"""The page of `pomona watch` in a browser: it follows by itself, disturbs nobody, and stops the watch."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from chromium import PATIENCE_MS
from pomona.browser.live import WatchServer
from pomona.browser.view import read_survey
from pomona.stages.report.contract import WatchHint, WatchState
from serving import running
from view_scenes import write_view_survey


def state(**changed: Any) -> WatchState:
    usual = {"photos": 3, "placed": 0, "fruits": None, "length": None, "step": None, "well_seen": None, "hints": []}
    return WatchState(**{"phase": "looking", "doing": "Looking at IMG_0003.JPG", "revision": 0, **usual, **changed})


def test_the_page_follows_the_watch(browser: Any, tmp_path: Path) -> None:
    data, stopped = read_survey(write_view_survey(tmp_path)), threading.Event()
    hint = WatchHint("IMG_0003.JPG", "blurred", "is blurred: <b>hold</b> still")

    with running(WatchServer("row")) as server:
        server.on_stop_wanted = stopped.set
        server.tell(state())
        page = browser.new_page()
        said: list[str] = []
        page.on("pageerror", lambda error: said.append(str(error)))
        page.set_default_timeout(PATIENCE_MS)
        page.goto(server.url)
        page.wait_for_selector("text=0 of 3 photos have a place")
        assert page.url.endswith("/at/0/")
        server.tell(state(hints=[hint]))
        page.wait_for_selector(".watch li")
        assert page.inner_text(".watch li") == "IMG_0003.JPG is blurred: <b>hold</b> still."
        # An answer: the page goes to it, and shows its fruits.
        server.show(data, 1)
        known = {"fruits": 24, "length": 7.71, "step": 0.183, "well_seen": 0.84, "placed": 3, "revision": 1}
        server.tell(state(hints=[hint], **known))
        page.wait_for_url("**/at/1/")
        page.wait_for_selector("text=24 fruits so far")
        assert "7.7 m of row, a photo each 18 cm" in page.inner_text(".watch .figures")
        assert page.locator("#fruits tbody tr[data-id]").count() > 5
        assert page.is_hidden(".totals")
        page.click("text=Stop and make the survey")
        assert stopped.wait(60)
        server.tell(state(**{**known, "phase": "finished", "doing": "/surveys/row", "fruits": 23}))
        page.wait_for_selector("text=The survey is in /surveys/row")
        assert "23 fruits" in page.inner_text(".watch .figures")
        assert page.is_hidden(".watch button")
        assert said == []
        page.close()


def test_the_fruit_that_was_selected_stays_it_though_numbers_change(browser: Any, tmp_path: Path) -> None:
    data = read_survey(write_view_survey(tmp_path))
    numbers = dict(zip(data.fruits.ids.tolist(), np.roll(data.fruits.ids, 1).tolist(), strict=True))
    later = replace(
        data,
        fruits=replace(data.fruits, ids=np.array([numbers[id_] for id_ in data.fruits.ids.tolist()])),
        observations=replace(
            data.observations, fruit_id=np.array([numbers[id_] for id_ in data.observations.fruit_id.tolist()])
        ),
    )
    chosen = int(data.observations.fruit_id[0])
    with running(WatchServer("row")) as server:
        server.show(data, 1)
        server.tell(state(revision=1))
        page = browser.new_page(reduced_motion="reduce")
        page.set_default_timeout(PATIENCE_MS)
        page.goto(server.url)
        page.wait_for_selector("html.has-webgl, html.no-webgl")
        page.fill("#find-id", str(chosen))
        page.press("#find-id", "Enter")
        page.wait_for_selector("#card .crop")
        before = page.inner_text("#card dl")
        server.show(later, 2)
        server.tell(state(revision=2))
        page.wait_for_url("**/at/2/")
        page.wait_for_selector("#card h3")
        assert page.inner_text("#card h3") == f"Fruit {numbers[chosen]}"
        assert page.inner_text("#card dl") == before
        page.close()


def test_the_page_goes_on_with_a_watch_that_was_begun_anew(browser: Any, tmp_path: Path) -> None:
    data = read_survey(write_view_survey(tmp_path))
    with running(WatchServer("row")) as server:
        port = server.port
        server.show(data, 5)
        server.tell(state(revision=5))
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(server.url)
        page.wait_for_selector("text=0 of 3 photos have a place")
        assert page.url.endswith("/at/5/")
    page.wait_for_selector("text=The watch does not answer")
    with running(WatchServer("row", port=port)) as server:
        server.show(data, 1)
        server.tell(state(revision=1, placed=2))
        page.wait_for_url("**/at/1/")
        page.wait_for_selector("text=2 of 3 photos have a place")
        page.close()
