"""`pomona demo`: the whole job on the bundled sample."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pomona.cli import options as shared
from pomona.cli.action import with_progress
from pomona.cli.summary import show
from pomona.errors import MissingFileError
from pomona.pipeline import RunOptions
from pomona.pipeline import run as run_pipeline


def demo(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="SURVEY", help="Folder to write.")] = Path("pomona-demo"),
    overwrite: shared.Overwrite = False,
) -> None:
    """Run Pomona on the bundled sample, and print where the report is."""
    import pomona

    sample = pomona.sample_folder()
    sides = [sample / "east", sample / "west"]
    markers = sample / "markers.csv"
    missing = [path.name for path in (*sides, markers) if not path.exists()]
    if missing:
        raise MissingFileError(f"The sample in {sample} lacks {', '.join(missing)}: install Pomona again")
    options = RunOptions(markers=markers)
    typer.echo(f"Two rendered apple trees, photographed from both sides; the result goes to {out}", err=True)
    summary = with_progress(
        lambda progress: run_pipeline(sides, out, options, progress, overwrite=overwrite, on_stage=progress.stage), out
    )
    show(summary)
    _compare(out, sample / "truth" / "fruits.csv")
    typer.echo(f"\nOpen {summary.report} in a browser: turn the trees, click a fruit.")


def _compare(out: Path, truth: Path) -> None:
    """Say how many of the true fruits were found."""
    if not truth.is_file():
        return
    import pomona
    from pomona.cli.evaluate import show_scores

    typer.echo("")
    show_scores(pomona.open(out).evaluate(truth))
