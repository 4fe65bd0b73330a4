"""A page in the browser, as long as a command serves it."""

from __future__ import annotations

import webbrowser
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from pomona.browser.server import PageServer

Port = Annotated[int, typer.Option(metavar="N", min=0, max=65535, help="Port of the page; 0 chooses a free one.")]
NoBrowser = Annotated[bool, typer.Option("--no-browser", help="Print the address of the page, but do not open it.")]


def open_page(url: str, *, no_browser: bool) -> None:
    """Open a page in the browser, unless that is not wanted; say so where it cannot be done."""
    if not no_browser and not webbrowser.open(url):
        typer.echo("No browser could be opened; the page is at the address above.", err=True)


def serve_page(server: PageServer, *, no_browser: bool) -> None:
    """Say where a page is, open it, and serve it until Ctrl-C or its own end."""
    with server:
        typer.echo(server.url)
        typer.echo("Ctrl-C ends it.", err=True)
        open_page(server.url, no_browser=no_browser)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            typer.echo("", err=True)
