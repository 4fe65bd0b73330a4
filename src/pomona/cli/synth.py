"""`pomona synth`: a rendered row with truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pomona.cli.failures import Stopped
from pomona.cli.progress import TerminalProgress
from pomona.errors import MissingExtraError


def synth(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="ROW", help="Folder to write.")],
    seed: Annotated[int, typer.Option(help="Random seed: another seed gives other trees.")] = 0,
    trees: Annotated[int, typer.Option(help="Number of trees in the row.")] = 3,
    fruits_per_tree: Annotated[int, typer.Option(help="Fruits per tree.")] = 50,
    bunch_share: Annotated[
        float, typer.Option(metavar="SHARE", help="Share of spurs with two to five fruits that touch, from 0 to 1.")
    ] = 0.0,
    variety: Annotated[str, typer.Option(help="Look of the fruits: red, bicolour, green, …")] = "red",
    light: Annotated[str, typer.Option(help="Light: noon, sun, low-sun, hazy or overcast.")] = "sun",
    photos_per_side: Annotated[int, typer.Option(help="Photos per side.")] = 17,
    photos_round_end: Annotated[
        int,
        typer.Option(
            metavar="N", help="Photos around the end of the row, between its sides; above 0, the row is one walk."
        ),
    ] = 0,
    step: Annotated[float, typer.Option(metavar="METRES", help="Distance from photo to photo.")] = 0.22,
    distance: Annotated[float, typer.Option(metavar="METRES", help="Distance from the camera to the trunks.")] = 2.8,
    rough: Annotated[
        bool, typer.Option("--rough", help="Draw with OpenGL: seconds per photo instead of a minute.")
    ] = False,
    wind: Annotated[
        float, typer.Option(metavar="METRES", help="Movement of leaves between photos (standard deviation). [--rough]")
    ] = 0.0,
    days_later: Annotated[
        int, typer.Option(metavar="DAYS", help="Render the row of this seed DAYS later, on another walk along it.")
    ] = 0,
    grow_mm: Annotated[
        float, typer.Option(metavar="MM", help="Mean growth of the fruits since then. [--days-later]")
    ] = 0.0,
    grow_sd_mm: Annotated[
        float, typer.Option(metavar="MM", help="Standard deviation of the growth. [--days-later]")
    ] = 0.0,
    drop_share: Annotated[
        float,
        typer.Option(metavar="SHARE", help="Share of fruits that are gone since then, from 0 to 1. [--days-later]"),
    ] = 0.0,
) -> None:
    """Render a row of apple trees from both sides, with every fruit and camera known (needs the extra `synth`)."""
    from pomona.learning.synth import RowOptions, render_row

    options = RowOptions(
        seed=seed,
        trees=trees,
        fruits_per_tree=fruits_per_tree,
        bunch_share=bunch_share,
        variety=variety,
        light=light,
        photos_per_side=photos_per_side,
        photos_round_end=photos_round_end,
        step_m=step,
        distance_m=distance,
        rough=rough,
        wind_m=wind,
        days_later=days_later,
        grow_m=grow_mm / 1000,
        grow_sd_m=grow_sd_mm / 1000,
        drop_share=drop_share,
    )
    try:
        with TerminalProgress() as progress:
            render_row(options, out, progress=progress)
    except MissingExtraError:
        raise
    except ImportError as error:  # of what the extra needs itself
        raise MissingExtraError(f"{error}: install it with pip install 'pomona[synth]' (Python 3.11)") from None
    except KeyboardInterrupt:
        raise Stopped("the same command goes on with the photos that are missing.") from None
    typer.echo(str(out))
