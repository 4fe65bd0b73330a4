"""`pomona watch`: count and coverage while photos arrive."""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pomona.cli import options as shared
from pomona.cli.action import with_progress
from pomona.cli.failures import say
from pomona.cli.page import NoBrowser, Port, open_page
from pomona.cli.summary import show
from pomona.cli.wording import with_options
from pomona.errors import InputError
from pomona.pipeline import RunOptions, Summary
from pomona.pipeline.options import parse_scale_bar

if TYPE_CHECKING:
    from pomona.browser.live import Watch
    from pomona.browser.live.checks import Hint

_FOLDER = Annotated[
    Path, typer.Argument(metavar="PHOTOS", help="Folder in which photos arrive; two folders in it are the two sides.")
]
_UNTIL = Annotated[int | None, typer.Option(metavar="N", help="Stop after N photos.")]
_IDLE = Annotated[float | None, typer.Option(metavar="MINUTES", help="Stop after MINUTES without a new photo.")]
_HOST = Annotated[
    str,
    typer.Option(
        metavar="ADDRESS",
        help="Show the page to other devices in the network, such as a phone: 0.0.0.0, or an address of this computer. "
        "Only those who know the address with its token can see it.",
    ),
]


def watch(
    photos: _FOLDER,
    out: shared.Out,
    until: _UNTIL = None,
    idle: _IDLE = None,
    host: _HOST = "127.0.0.1",
    port: Port = 0,
    no_browser: NoBrowser = False,
    markers: shared.Markers = None,
    markers_crs: shared.MarkersCrs = None,
    gcp: shared.Gcp = None,
    positions: shared.Positions = None,
    scale_bar: shared.ScaleBar = None,
    marker_dictionary: shared.MarkerDictionary = "DICT_4X4_50",
    fruit: shared.Fruit = None,
    fruit_diameter: shared.FruitDiameter = None,
    weights: shared.Weights = None,
    trees: shared.Trees = None,
    tree_spacing: shared.TreeSpacing = None,
    hand_counts: shared.HandCounts = None,
    packing: shared.Packing = None,
    model: shared.Model = None,
    score_threshold: shared.ScoreThreshold = None,
    sides: shared.Sides = "auto",
    gnss: shared.Gnss = True,
    second_look: shared.SecondLook = True,
    scene: shared.Scene = True,
    filter: shared.Filter = True,
    filter_model: shared.FilterModel = None,
    as_json: shared.Json = False,
) -> None:
    """Count while photos arrive in a folder, and say at once what is wrong with a photo; then make the survey.

    The page in the browser updates itself. Ctrl-C, its button, --until or --idle end the watch; then the survey is made
    as by `pomona run`, with most of the work already done.
    """
    from pomona.browser.live import Watch, WatchOptions, WatchServer

    chosen = RunOptions(
        sides=sides,
        model=model,
        score_threshold=score_threshold,
        markers=markers,
        markers_crs=markers_crs,
        gcp=gcp,
        positions=positions,
        scale_bar=parse_scale_bar(scale_bar),
        marker_dictionary=marker_dictionary,
        fruit=fruit,
        fruit_diameter_m=fruit_diameter,
        weights=weights,
        trees=trees,
        tree_spacing=tree_spacing,
        hand_counts=hand_counts,
        packing=packing,
        use_gnss=gnss,
        second_look=second_look,
        scene=scene,
        filter_false_positives=filter,
        filter_model=filter_model,
    )
    watching = WatchOptions(until=until, idle_s=None if idle is None else 60 * idle)
    try:
        server = WatchServer(out.name, host=host, port=port)
    except OSError as error:
        raise InputError(f"`host` {host}, `port` {port}: {error.strerror or error}: choose another") from None
    with server:
        session = Watch(photos, out, chosen, watching, on_state=server.tell, on_answer=server.show, on_hint=_say)
        server.on_stop_wanted = session.stop
        threading.Thread(target=server.serve_forever, daemon=True).start()
        typer.echo(server.url, err=as_json)
        open_page(server.url, no_browser=no_browser)
        try:
            summary = _watched(session, out)
        finally:
            server.shutdown()
    show(summary, as_json=as_json)


def _watched(session: Watch, out: Path) -> Summary:
    """Follow what arrives until the watch is ended, and make the survey."""
    typer.echo("Ctrl-C ends the watch, and the survey is made.", err=True)
    with contextlib.suppress(KeyboardInterrupt):
        session.follow()
    typer.echo("Making the survey. Ctrl-C stops that, too.", err=True)
    return with_progress(lambda progress: session.finish(progress, progress.stage), out)


def _say(hint: Hint) -> None:
    say("Look", "bold yellow", f"{hint.photo} {with_options(hint.text)}.")
