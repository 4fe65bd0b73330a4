"""All datasets of `pomona benchmark`. A new one is a module, and its line here.

Each `run` imports its module only when it is called, so that the list can be shown without an engine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pomona.datasets.values import BenchmarkOptions, BenchmarkResult
from pomona.progress import Progress

Run = Callable[[Path, Path, BenchmarkOptions, Progress], BenchmarkResult]


@dataclass(frozen=True)
class Dataset:
    """One dataset: `name` is its command, `title` says what it is of and what comes out.

    `options` are the fields of `BenchmarkOptions` that count. `run` takes the folder of the unpacked dataset, the
    folder where results and surveys are kept, the options and who hears of progress; it raises `MissingFileError`,
    `InputError` where nothing of the dataset is there, and `FormatError` for files that are broken.
    """

    name: str
    title: str
    run: Run
    options: tuple[str, ...] = ()


def _fuji_sfm(root: Path, out: Path, options: BenchmarkOptions, progress: Progress) -> BenchmarkResult:
    from pomona.datasets.fuji_sfm import benchmark_fuji_sfm

    return benchmark_fuji_sfm(root, out, options, progress)


def _pfuji_size(root: Path, out: Path, options: BenchmarkOptions, progress: Progress) -> BenchmarkResult:
    from pomona.datasets.pfuji_size import benchmark_pfuji_size

    return benchmark_pfuji_size(root, progress)


def _fruitnerf(root: Path, out: Path, options: BenchmarkOptions, progress: Progress) -> BenchmarkResult:
    from pomona.datasets.fruitnerf import benchmark_fruitnerf

    return benchmark_fruitnerf(
        root, out, model=options.model, fruit_diameter_m=options.fruit_diameter_m, progress=progress
    )


def _minneapple(root: Path, out: Path, options: BenchmarkOptions, progress: Progress) -> BenchmarkResult:
    from pomona.datasets.minneapple import benchmark_minneapple

    return benchmark_minneapple(root, model=options.model, progress=progress)


def _wgisd(root: Path, out: Path, options: BenchmarkOptions, progress: Progress) -> BenchmarkResult:
    from pomona.datasets.wgisd import benchmark_wgisd

    return benchmark_wgisd(root, model=options.model, progress=progress)


DATASETS: tuple[Dataset, ...] = (
    Dataset(
        "fuji-sfm",
        "Fuji-SfM, the paper's own: Tables 2 and 3 and Figure 8, from what of photos, masks, cameras, clouds is there.",
        _fuji_sfm,
        ("model", "trees", "fruit_diameter_m"),
    ),
    Dataset("pfuji-size", "PFuji-Size: diameters of apples, from clouds of single ones.", _pfuji_size),
    Dataset(
        "fruitnerf",
        "FruitNeRF: rendered and real trees, with cameras in transforms.json, and masks.",
        _fruitnerf,
        ("model", "fruit_diameter_m"),
    ),
    Dataset("minneapple", "MinneApple: detection and segmentation in photos of orchards.", _minneapple, ("model",)),
    Dataset(
        "wgisd",
        "WGISD: detection and segmentation of clusters of grapes; give --model, as the shipped one knows apples.",
        _wgisd,
        ("model",),
    ),
)
