"""`pomona app`: surveys made, watched and looked at in a page, without a terminal."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pomona.cli.page import NoBrowser, Port, serve_page
from pomona.errors import InputError

_SURVEYS = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Folder for new surveys. Default: Pomona in your documents.")
]
_PHOTOS = Annotated[
    list[Path] | None,
    typer.Option(metavar="FOLDER", help="A further folder to choose photos from, besides your own and memory cards."),
]


def app(port: Port = 0, no_browser: NoBrowser = False, surveys: _SURVEYS = None, photos: _PHOTOS = None) -> None:
    """Make surveys in the browser: choose or drop photos, watch the run, view the fruits, correct them.

    The page is served to this computer only. Ctrl-C, or the page's button, ends it; a run in progress is then stopped,
    and can be continued later.
    """
    from pomona.browser.app.folders import Folders
    from pomona.browser.app.pages import AppServer
    from pomona.browser.app.service import Homes

    try:
        server = AppServer(Homes.usual(surveys), Folders.usual(photos or ()), port=port)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"`port` {port}: {reason}: choose another, or none for a free one") from None
    serve_page(server, no_browser=no_browser)
