"""The servers of pages, each with what its own page asks for: what random requests are made from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from fuzz.requests import SECRET, Known, RequestTally, campaign
from pipeline_fakes import Fakes, make_photos
from pomona import api
from pomona.browser.app.folders import Folders
from pomona.browser.app.jobs import Jobs
from pomona.browser.app.pages import AppServer
from pomona.browser.app.service import Homes
from pomona.browser.live.pages import WatchServer
from pomona.browser.server import PageServer
from pomona.browser.server.guard import Access
from pomona.browser.view import Corrector, ViewServer
from pomona.browser.view.reading import page_data
from pomona.pipeline import run
from pomona.stages.report.contract import WatchState
from pomona.survey.reader import SurveyReader

_CORRECTION = {
    "kind": "delete", "revision": "", "fruits": [1], "marks": [{"photo": 0, "x": 3.0, "y": 4.0}],
    "size": [{"photo": 1, "x": 3.0, "y": 4.0}], "tree": 0,
}  # fmt: skip
_OF_SURVEY = (
    "", "data/survey.bin", "data/photos/0.bin", "data/fruits/1.bin", "data/points/scene/0.bin",
    "data/points/fruit/0.bin",
    "photos/0/1024.jpg", "straight/1/1024.jpg", "data/lines/0/10/12.json", "crops/0/1.jpg", "favicon.ico",
)  # fmt: skip


@dataclass(frozen=True)
class Target:
    """A server, the requests that it knows, its own page's headers, and the folders that it may write to."""

    name: str
    server: PageServer
    known: Sequence[Known]
    own: Sequence[tuple[bytes, bytes]]
    around: Path
    may_change: Sequence[Path] = field(default_factory=tuple)
    takes_files: str = ""

    def try_requests(self, cases: Sequence[int]) -> RequestTally:
        """Send it random requests."""
        return campaign(
            self.name,
            self.server,
            self.known,
            self.own,
            cases,
            around=self.around,
            may_change=self.may_change,
            takes_files=self.takes_files,
        )


@contextmanager
def targets(folder: Path) -> Iterator[list[Target]]:
    """Give the three servers, of a survey that stages that answer at once have made in `folder`."""
    with ExitStack() as stack:
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        Fakes().install(patch)
        patch.setattr(Jobs, "put", lambda self, survey_id, arguments: None)  # no runs are begun
        for name in ("secret.jpg", "secret.csv", "secret.txt"):
            (folder / name).write_text(SECRET)
        home = folder / "home"
        run([make_photos(home / "photos")], home / "row")
        run([home / "photos"], home / "later")
        yield [_view(home, stack), _watch(home, stack), _app(home, stack)]


def _own(server: PageServer, token: str = "") -> list[tuple[bytes, bytes]]:
    address = f"127.0.0.1:{server.port}"
    cookie = Access(server.host, server.port, token).cookie
    headers = {
        "host": address, "origin": f"http://{address}", "content-type": "application/json",
        "cookie": f"{cookie}={token}",
    }  # fmt: skip
    return [(name.encode(), value.encode()) for name, value in headers.items()]


def _view(home: Path, stack: ExitStack) -> Target:
    survey = api.open(home / "row")
    corrector = Corrector.of(survey)
    server = stack.enter_context(ViewServer(corrector.data, truth=corrector.truth, corrector=corrector))
    known = [Known("GET", f"/{path}") for path in _OF_SURVEY]
    known += [
        Known("POST", "/corrections", {**_CORRECTION, "kind": kind}) for kind in ("delete", "add", "undo", "move")
    ]
    return Target("pomona view", server, known, _own(server), home.parent, [home / "row"])


def _watch(home: Path, stack: ExitStack) -> Target:
    server = stack.enter_context(WatchServer("row", host="0.0.0.0"))
    server.show(page_data(SurveyReader(api.open(home / "row").files)), 1)
    usual = {"photos": 3, "placed": 2, "fruits": 5, "length": 1.5, "step": 0.2, "well_seen": 0.5, "hints": []}
    server.tell(WatchState(phase="waiting", doing="Waiting", revision=1, **usual))
    known = [Known("GET", f"/at/1/{path}") for path in _OF_SURVEY]
    known += [Known("GET", "/"), Known("GET", "/events"), Known("POST", "/stop", {}), Known("GET", "/?token=x")]
    return Target("pomona watch", server, known, _own(server, _token(server)), home.parent, [home / "row" / "work"])


def _app(home: Path, stack: ExitStack) -> Target:
    homes = Homes(home / "data" / "surveys.json", home / "surveys", home / "surveys" / "photos")
    server = stack.enter_context(AppServer(homes, Folders([home])))
    row, later = (server.service.add(str(home / name)) for name in ("row", "later"))
    new = {
        "name": "Row 1", "photos": [str(home / "photos")], "oneSide": True, "fruit": "apple", "diameterMm": 75.0,
        "metres": "markers", "markers": "", "scaleBar": [1.0, 2.0, 0.85], "treeSpacingM": 1.0, "learn": False,
    }  # fmt: skip
    drop = server.service.new_drop()
    known = [
        Known("GET", "/"), Known("GET", "/static/app.js"), Known("GET", "/static/app.css"), Known("GET", "/api/events"),
        Known("POST", "/api/surveys", new), Known("POST", "/api/surveys", {**new, "metres": "scale-bar"}),
        Known("POST", "/api/equal", new), Known("POST", "/api/check", {"photos": [str(home / "photos")],
        "oneSide": True}),
        Known("POST", "/api/surveys/add", {"folder": str(home / "row")}), Known("POST", "/api/surveys/sample", {}),
        Known("POST", f"/api/surveys/{row}/compare", {"before": later}), Known("POST", f"/api/surveys/{row}/stop", {}),
        Known("POST", f"/api/surveys/{row}/go-on", {}), Known("POST", f"/api/surveys/{row}x/forget", {}),
        Known("POST", "/api/drops", {}), Known("PUT", f"/api/drops/{drop}/east/IMG_1.jpg", "four"),
        Known("GET", f"/api/folders?path={home}"), Known("GET", "/api/folders?files=1"),
        *(Known("GET", f"/api/surveys/{row}/{what}") for what in ("equal", "photos", "scene", "trees")),
        Known("GET", f"/api/surveys/{row}/photos/0/320.jpg"), Known("GET", f"/api/surveys/{row}/since/{later}/"),
        *(Known("GET", f"/api/surveys/{row}/files/{kind}") for kind in ("fruits.csv", "report.html", "geojson", "kml")),
        *(Known("GET", f"/surveys/{row}/view/{path}") for path in _OF_SURVEY),
        Known("POST", f"/surveys/{row}/view/corrections", _CORRECTION),
    ]  # fmt: skip
    may_change = [home / "row", home / "later", home / "data", home / "surveys"]
    return Target("pomona app", server, known, _own(server, _token(server)), home.parent, may_change, "/api/drops/")


def _token(server: PageServer) -> str:
    return server.url.partition("?token=")[2]
