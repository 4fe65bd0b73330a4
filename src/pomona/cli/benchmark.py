"""`pomona benchmark`: public datasets, our figures beside the printed ones; one command a dataset."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from pomona.cli import options as shared
from pomona.cli.failures import Stopped, reporting_errors
from pomona.cli.progress import TerminalProgress
from pomona.datasets.registry import DATASETS, Dataset
from pomona.datasets.values import BenchmarkOptions

_Root = Annotated[Path, typer.Option("--root", metavar="DIR", help="Folder of the unpacked dataset.")]
_Out = Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder for results and surveys.")]
_Trees = Annotated[int, typer.Option(metavar="N", help="Number of trees in the row, if the boxes' files do not say.")]
_Diameter = Annotated[float, typer.Option(metavar="METRES", help="Diameter of an average fruit.")]
# How each field of `BenchmarkOptions` is called on the command line, and what it is there.
_OPTIONS = {
    "model": ("model", shared.Model),
    "trees": ("trees", _Trees),
    "fruit_diameter_m": ("fruit_diameter", _Diameter),
}

benchmark = typer.Typer(
    help="Run Pomona on a public dataset that you have, and compare its figures with the printed ones.",
    no_args_is_help=True,
)


def _command(dataset: Dataset) -> Callable[..., None]:
    """The command of a dataset, with those options that count for it."""

    def command(root: Path, out: Path, as_json: bool, **given: Any) -> None:
        chosen = {field: given[_OPTIONS[field][0]] for field in dataset.options}
        _run(dataset, root, out, BenchmarkOptions(**chosen), as_json=as_json)

    defaults = {field.name: field.default for field in fields(BenchmarkOptions)}
    types: list[tuple[str, Any, Any]] = [
        ("root", _Root, Parameter.empty),
        ("out", _Out, Path(f"pomona-{dataset.name}")),
    ]
    types += [(*_OPTIONS[field], defaults[field]) for field in dataset.options]
    types += [("as_json", shared.Json, False)]
    # typer makes the options of the signature.
    command.__doc__ = dataset.title
    command.__annotations__ = {name: type_ for name, type_, _ in types}
    command.__signature__ = Signature(  # type: ignore[attr-defined]
        [Parameter(n, Parameter.KEYWORD_ONLY, default=default, annotation=type_) for n, type_, default in types]
    )
    return command


def _run(dataset: Dataset, root: Path, out: Path, options: BenchmarkOptions, *, as_json: bool) -> None:
    """Print what comes of a dataset, and keep it in FOLDER/benchmark.json."""
    try:
        with TerminalProgress() as progress:
            result = dataset.run(root, out, options, progress)
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


for each in DATASETS:
    benchmark.command(each.name)(reporting_errors(_command(each)))
