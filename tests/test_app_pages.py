"""The page of `pomona app` over HTTP: who is answered, what it takes, and nothing outside of what it may show."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from pipeline_fakes import Fakes, make_photos
from pomona.browser.app.folders import Folders
from pomona.browser.app.pages import AppServer
from pomona.browser.app.service import Homes
from pomona.cli.app import app
from pomona.pipeline import RunOptions, run
from serving import get, running


class Page:
    """The page's own requests: with the token and the origin, unless a test leaves them out."""

    def __init__(self, server: AppServer) -> None:
        self.server = server
        _, headers, _ = get(server, server.url.partition(str(server.port))[2])
        self.cookie = headers["Set-Cookie"].partition(";")[0]
        self.origin = f"http://127.0.0.1:{server.port}"

    def get(self, path: str) -> tuple[int, http.client.HTTPMessage, bytes]:
        return get(self.server, path, Cookie=self.cookie)

    def send(self, path: str, body: bytes, method: str = "POST", **changes: str | None) -> tuple[int, bytes]:
        headers = {
            "Cookie": self.cookie, "Origin": self.origin, "Content-Type": "application/json",
            **{name.replace("_", "-"): value for name, value in changes.items()},
        }  # fmt: skip
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=60)
        connection.request(method, path, body, {name: value for name, value in headers.items() if value is not None})
        answer = connection.getresponse()
        found = answer.status, answer.read()
        connection.close()
        return found

    def do(self, path: str, values: Any = None) -> tuple[int, Any]:
        status, body = self.send(path, json.dumps(values or {}).encode())
        return status, json.loads(body)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("home")


@pytest.fixture(scope="module")
def page(folder: Path) -> Iterator[Page]:
    with pytest.MonkeyPatch.context() as patched:
        Fakes().install(patched)
        run([make_photos(folder / "photos")], folder / "row", RunOptions())
    homes = Homes(folder / "data" / "surveys.json", folder / "surveys", folder / "surveys" / "photos")
    with running(AppServer(homes, Folders([folder]))) as server:
        yield Page(server)


@pytest.fixture(scope="module")
def row(page: Page, folder: Path) -> str:
    status, survey_id = page.do("/api/surveys/add", {"folder": str(folder / "row")})
    assert status == 200
    return str(survey_id)


def test_the_page_and_its_policy(page: Page) -> None:
    status, headers, body = page.get("/")
    assert status == 200
    assert b"static/app.js" in body
    policy = dict(rule.strip().partition(" ")[::2] for rule in headers["Content-Security-Policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert policy["script-src"].startswith("'self' 'sha256-")
    assert "unsafe" not in policy["script-src"]
    assert (policy["connect-src"], policy["frame-src"], policy["frame-ancestors"]) == ("'self'",) * 3
    for name, kind in (("app.js", "text/javascript"), ("app.css", "text/css")):
        status, headers, body = page.get(f"/static/{name}")
        assert (status, headers["Content-Type"].partition(";")[0]) == (200, kind)
        assert len(body) > 1000
    assert page.get("/favicon.ico")[0] == 200
    assert page.get("/static/../page.html")[0] == 404


@pytest.mark.parametrize("path", ["/", "/static/app.js", "/api/events", "/api/folders", "/surveys/x/view/"])
def test_without_the_token_nothing_is_said(page: Page, path: str) -> None:
    assert get(page.server, path)[0] == 403
    assert get(page.server, path, Cookie=f"pomona-{page.server.port}=wrong")[0] == 403
    assert get(page.server, path, Cookie=page.cookie, Host="evil.example")[0] == 403


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": None}, 403),
        ({"Sec_Fetch_Site": "cross-site"}, 403),
        ({"Cookie": None}, 403),
        ({"Host": "evil.example"}, 403),
        ({"Content_Type": "text/plain"}, 415),
    ],
)
@pytest.mark.parametrize("path", ["/api/surveys", "/api/surveys/sample", "/api/close", "/api/surveys/x/stop"])
def test_other_pages_change_nothing(page: Page, path: str, changes: dict[str, str | None], status: int) -> None:
    assert page.send(path, b"{}", **changes)[0] == status
    assert page.send("/api/drops/20260812-101500-ab12/a.jpg", b"x", "PUT", Origin="http://evil.example")[0] == 403


def test_folders_outside_are_not_listed(page: Page, folder: Path) -> None:
    status, _, body = page.get(f"/api/folders?path={folder}")
    assert status == 200
    assert [place["name"] for place in json.loads(body)["places"]][-2:] == ["photos", "row"]
    for path in ("/etc", f"{folder}/../..", "/proc/self"):
        status, _, body = page.get(f"/api/folders?path={path}")
        assert status == 422
        assert "outside" in json.loads(body)["message"]
    assert page.do("/api/surveys/add", {"folder": "/etc"})[0] == 422
    assert page.do("/api/surveys/add", {"folder": str(folder / "photos")})[0] == 404
    assert page.do("/api/check", {"photos": ["/etc"], "oneSide": False})[0] == 422


def test_dropped_photos_stay_in_their_folder(page: Page, folder: Path) -> None:
    status, drop = page.do("/api/drops")
    assert status == 200
    status, body = page.send(f"/api/drops/{drop}/east/IMG%201.jpg", b"four", "PUT", Content_Type="image/jpeg")
    place = folder / "surveys" / "photos" / drop
    assert (status, json.loads(body)) == (200, str(place))
    assert (place / "east" / "IMG 1.jpg").read_bytes() == b"four"
    for name in ("../a.jpg", "..%2fa.jpg", "%2e%2e/%2e%2e/a.jpg", "a.sh", ".a.jpg", "a%00.jpg", "..%5ca.jpg"):
        assert page.send(f"/api/drops/{drop}/{name}", b"x", "PUT")[0] in (404, 405, 422)
    assert page.send("/api/drops/..%2f..%2fdata/a.jpg", b"x", "PUT")[0] in (404, 422)
    assert [path.name for path in (folder / "surveys").rglob("*") if path.is_file()] == ["IMG 1.jpg"]


@pytest.mark.parametrize("values", [[], {"name": "x"}, {"photos": 1}, "text", {"folder": 5}])
def test_what_is_no_request_is_refused_in_words(page: Page, values: Any) -> None:
    for path in ("/api/surveys", "/api/surveys/add", "/api/check", "/api/equal"):
        status, body = page.send(path, json.dumps(values).encode())
        assert status == 422, (path, body)
        assert json.loads(body)["message"]


def test_a_survey_is_looked_at_and_taken_away(page: Page, row: str) -> None:
    status, headers, body = page.get(f"/surveys/{row}/view/")
    assert status == 200
    assert b'data-url="data/survey.bin"' in body
    assert page.get(f"/surveys/{row}/view/data/survey.bin")[0] == 200
    assert page.get("/surveys/none/view/")[0] == 404
    for name, begin in (("fruits.csv", b"id,"), ("ply", b"ply"), ("colmap", b"PK")):
        status, headers, body = page.get(f"/api/surveys/{row}/files/{name}")
        assert (status, body[: len(begin)]) == (200, begin)
        assert headers["Content-Disposition"].startswith("attachment")
    for name in ("survey.json", "..%2frow%2fsurvey.json", "passwd", "work"):
        assert page.get(f"/api/surveys/{row}/files/{name}")[0] in (404, 422)
    assert len(json.loads(page.get(f"/api/surveys/{row}/photos")[2])) == 4
    assert page.get(f"/api/surveys/{row}/photos/0/320.jpg")[2][:2] == b"\xff\xd8"
    assert page.get(f"/api/surveys/{row}/photos/7/320.jpg")[0] == 404
    assert json.loads(page.get(f"/api/surveys/{row}/trees")[2]) == []
    assert "pomona run" in json.loads(page.get(f"/api/surveys/{row}/equal")[2])["command"]


def test_fruits_are_marked_in_a_photo_and_counted(page: Page, row: str, folder: Path) -> None:
    status, headers, whole = page.get(f"/api/surveys/{row}/photos/0/whole.jpg")
    assert (status, headers["Content-Type"], whole[:2]) == (200, "image/jpeg", b"\xff\xd8")
    before = json.loads(page.get(f"/api/surveys/{row}/photos/0/marks")[2])
    assert (before["marks"], before["complete"]) == ([], False)
    marks = {"complete": True, "marks": [{"box": [1.0, 2.0, 21.0, 32.0], "circle": None}]}

    assert page.send(f"/api/surveys/{row}/photos/0/marks", json.dumps(marks).encode())[0] == 204

    kept = json.loads(page.get(f"/api/surveys/{row}/photos/0/marks")[2])
    assert {name: kept[name] for name in marks} == marks
    teaching = json.loads(page.get(f"/api/surveys/{row}/teaching")[2])
    assert teaching["marks"] == [{"photo": before["name"], "marks": 1, "complete": True}]
    assert "--adapt" in teaching["equal"]["command"]
    assert teaching["learnt"] is None
    assert page.get(f"/api/surveys/{row}/before/0/320.jpg")[0] == 404
    for wrong in ({}, {"complete": True, "marks": [1]}, {"complete": True, "marks": [{"box": [0], "circle": None}]}):
        assert page.do(f"/api/surveys/{row}/photos/0/marks", wrong)[0] == 422
    assert page.send(f"/api/surveys/{row}/photos/0/marks", b"{}", Origin="http://evil.example")[0] == 403
    assert page.get(f"/api/surveys/{row}/photos/999/marks")[0] == 404


def test_pages_are_told_the_list(page: Page, row: str) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", page.server.port, timeout=60)
    connection.request("GET", "/api/events", headers={"Cookie": page.cookie})
    line = connection.getresponse().readline()
    connection.close()
    told = json.loads(line.decode().removeprefix("data: "))
    assert [survey["id"] for survey in told["surveys"]] == [row]
    assert told["surveys"][0]["state"] == "finished"
    assert told["facts"]["fruits"][0] == {"name": "apple", "diameterMm": 75.0}


def test_a_taken_port_is_said(page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    options = ["app", "--no-browser", "--port", str(page.server.port), "--surveys", str(tmp_path / "surveys")]
    said = CliRunner().invoke(app, options)
    assert said.exit_code == 1
    assert f"--port {page.server.port}" in said.stderr
    assert "choose another" in said.stderr


def test_the_page_ends_its_server(tmp_path: Path) -> None:
    homes = Homes(tmp_path / "surveys.json", tmp_path / "surveys", tmp_path / "surveys" / "photos")
    with running(AppServer(homes, Folders([tmp_path]))) as server:
        assert Page(server).send("/api/close", b"{}")[0] == 204
        server.shutdown()
    with pytest.raises(ConnectionError):
        get(server, "/")
