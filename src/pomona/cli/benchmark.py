"""`pomona benchmark`: public datasets, our figures beside the printed ones; one command a dataset."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from pomona.cli import options as shared
from pomona.cli.failures import Stopped, told
from pomona.cli.progress import TerminalProgress
from pomona.fruit_size import DEFAULT_DIAMETER_M

if TYPE_CHECKING:
    from pomona.datasets.values import BenchmarkResult

_Root = Annotated[Path, typer.Option("--root", metavar="DIR", help="The folder of the unpacked dataset.")]
_Out = Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Where results and surveys are kept.")]
_Trees = Annotated[int, typer.Option(metavar="N", help="Trees of the row, where the boxes' files do not tell them.")]

benchmark = typer.Typer(
    help="Run Pomona on a public dataset that you have, and set its figures beside the printed ones.",
    no_args_is_help=True,
)


def fuji_sfm(
    root: _Root,
    out: _Out = Path("pomona-fuji-sfm"),
    model: shared.Model = None,
    trees: _Trees = 11,
    fruit_diameter: shared.FruitDiameter = DEFAULT_DIAMETER_M,
    as_json: shared.Json = False,
) -> None:
    """Fuji-SfM, the paper's own: Tables 2 and 3 and Figure 8, from what of photos, masks, cameras, clouds is there."""

    def work(progress: TerminalProgress) -> BenchmarkResult:
        from pomona.datasets.fuji_sfm import FujiOptions, benchmark_fuji_sfm

        options = FujiOptions(model=model, trees=trees, fruit_diameter_m=fruit_diameter)
        return benchmark_fuji_sfm(root, out, options, progress)

    _show(work, out, as_json=as_json)


def pfuji_size(root: _Root, out: _Out = Path("pomona-pfuji-size"), as_json: shared.Json = False) -> None:
    """PFuji-Size: diameters of apples, from clouds of single ones."""

    def work(progress: TerminalProgress) -> BenchmarkResult:
        from pomona.datasets.pfuji_size import benchmark_pfuji_size

        return benchmark_pfuji_size(root, progress)

    _show(work, out, as_json=as_json)


def fruitnerf(
    root: _Root,
    out: _Out = Path("pomona-fruitnerf"),
    model: shared.Model = None,
    fruit_diameter: shared.FruitDiameter = DEFAULT_DIAMETER_M,
    as_json: shared.Json = False,
) -> None:
    """FruitNeRF: rendered and real trees, with cameras in transforms.json, and masks."""

    def work(progress: TerminalProgress) -> BenchmarkResult:
        from pomona.datasets.fruitnerf import benchmark_fruitnerf

        return benchmark_fruitnerf(root, out, model=model, fruit_diameter_m=fruit_diameter, progress=progress)

    _show(work, out, as_json=as_json)


def minneapple(
    root: _Root, out: _Out = Path("pomona-minneapple"), model: shared.Model = None, as_json: shared.Json = False
) -> None:
    """MinneApple: detection and segmentation in photos of orchards."""

    def work(progress: TerminalProgress) -> BenchmarkResult:
        from pomona.datasets.minneapple import benchmark_minneapple

        return benchmark_minneapple(root, model=model, progress=progress)

    _show(work, out, as_json=as_json)


def wgisd(
    root: _Root, out: _Out = Path("pomona-wgisd"), model: shared.Model = None, as_json: shared.Json = False
) -> None:
    """WGISD: detection and segmentation of clusters of grapes; give --model, as the shipped one knows apples."""

    def work(progress: TerminalProgress) -> BenchmarkResult:
        from pomona.datasets.wgisd import benchmark_wgisd

        return benchmark_wgisd(root, model=model, progress=progress)

    _show(work, out, as_json=as_json)


def _show(work: Callable[[TerminalProgress], BenchmarkResult], out: Path, *, as_json: bool) -> None:
    """Print what `work` returns, and keep it in FOLDER/benchmark.json."""
    try:
        with TerminalProgress() as progress:
            result = work(progress)
    except KeyboardInterrupt:
        raise Stopped(f"what was finished is kept in {out}; the same command goes on where it was.") from None
    text = json.dumps(result.to_json(), indent=1, ensure_ascii=False)
    out.mkdir(parents=True, exist_ok=True)
    (out / "benchmark.json").write_text(text + "\n", encoding="utf-8")
    if as_json:
        typer.echo(text)
        return
    from pomona.datasets.tables import result_tables

    Console(highlight=False).print(result_tables(result))


for command in (fuji_sfm, pfuji_size, fruitnerf, minneapple, wgisd):
    benchmark.command(command.__name__.replace("_", "-"))(told(command))
