"""PFuji-Size: diameters of real apples from photogrammetric clouds of single ones, against callipers.

The published layout (github.com/GRAP-UdL-AT/apple_size_estimation_in_3D_point_clouds reads it): a table
`4-apples_GT_diameter.txt` of `cloud's file,diameter in mm`, and `3-apple_point_clouds/YEAR_TREE_APPLE.txt` with
`x y z r g b` in metres, perhaps with more columns. Where there are more than 8, the eighth says how sure a point is,
and the authors leave out those of 1 and less; so does this.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.datasets.values import BenchmarkResult, ComparedTable, Figure
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.files import read_text
from pomona.formats.xyz import first_lines, read_numbers
from pomona.progress import Progress, track
from pomona.stages.fuse.cloud import fruits_of_cloud
from pomona.values.fruits import FruitCloud

NAME = "PFuji-Size"
_TABLE = "a table of apples: the cloud's file and the diameter in mm, parted by a comma"
_CLOUD = "an apple's cloud as text: x y z r g b, perhaps more"
_SURE_COLUMNS, _SURE_COLUMN = 8, 7  # tables wider than this have how sure a point is, in this column from 0


@dataclass(frozen=True)
class Apple:
    """One apple: its cloud's file and its true diameter."""

    path: Path
    diameter_m: float


def benchmark_pfuji_size(root: Path, progress: Progress) -> BenchmarkResult:
    """Return how far the diameters of apples' clouds are off, over all apples and those of each year.

    Raises `MissingFileError`, `InputError` where there is no table, and `FormatError` naming file and line.
    """
    table, apples = read_apples(root)
    measured = np.array([measured_diameter_m(a.path) for a in track(apples, progress, "measuring apples", len(apples))])
    true = np.array([apple.diameter_m for apple in apples])
    years = np.array([apple.path.stem.split("_")[0] for apple in apples])
    groups = {"all apples": np.ones(len(apples), bool)}
    groups |= {f"apples of {year}": years == year for year in dict.fromkeys(years.tolist())}
    figures = [figure for name, own in groups.items() for figure in _figures(name, measured[own], true[own])]
    found = (f"{len(apples)} apples with diameters in {table.relative_to(root).as_posix()}",)
    return BenchmarkResult(NAME, found, (ComparedTable("Diameters from single apples' clouds", tuple(figures)),))


def read_apples(root: Path) -> tuple[Path, list[Apple]]:
    """Return the table of diameters below `root` and its apples."""
    if not root.is_dir():
        raise MissingFileError(f"{root}: expected the folder of the unpacked PFuji-Size dataset, but there is none")
    tables = [path for path in sorted(root.rglob("*")) if path.suffix in (".txt", ".csv") and _is_table(path)]
    if len(tables) != 1:
        named = ", ".join(path.relative_to(root).as_posix() for path in tables) or "none"
        raise InputError(f"{root}: expected {_TABLE} (4-apples_GT_diameter.txt), found {named}")
    clouds: dict[str, Path] = {path.name: path for path in sorted(root.rglob("*.txt"))}
    return tables[0], [_apple(tables[0], number, line, clouds) for number, line in _lines(tables[0])]


def measured_diameter_m(path: Path) -> float:
    """Return the diameter of the fruit that has most of a cloud's points; NaN where no sphere explains them."""
    table = read_numbers(path, _CLOUD)
    if table.shape[1] < 3 or not np.isfinite(table[:, :3]).all():
        raise FormatError(f"{path}: expected {_CLOUD}, all finite; the file begins:\n{first_lines(path)}")
    points = table[table[:, _SURE_COLUMN] > 1, :3] if table.shape[1] > _SURE_COLUMNS else table[:, :3]
    n = len(points)
    fused = fruits_of_cloud(FruitCloud(points, np.zeros((n, 3), np.uint8), np.zeros(n, np.int64)))
    if len(fused.fruits) == 0:
        return float("nan")
    counts = [int((fused.cloud.fruit_id == fruit_id).sum()) for fruit_id in fused.fruits.ids]
    return float(fused.fruits.diameters_m[int(np.argmax(counts))])


def _is_table(path: Path) -> bool:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        head = file.readline()
    return head.partition(",")[0].strip().lower().endswith(".txt")


def _lines(table: Path) -> list[tuple[int, str]]:
    lines = enumerate(read_text(table, _TABLE).splitlines(), start=1)
    return [(number, line) for number, line in lines if line.strip()]


def _apple(table: Path, number: int, line: str, clouds: dict[str, Path]) -> Apple:
    name, _, rest = line.partition(",")
    try:
        diameter_mm = float(rest.split(",")[0])
    except ValueError:
        raise FormatError(f"{table}, line {number}: expected {_TABLE}, found '{line[:60]}'") from None
    if not 10 < diameter_mm < 300:
        raise FormatError(f"{table}, line {number}: expected a diameter in mm, found {diameter_mm:g}")
    if name.strip() not in clouds:
        raise MissingFileError(f"{table}, line {number}: the cloud '{name.strip()}' is nowhere below {table.parent}")
    return Apple(clouds[name.strip()], diameter_mm / 1000)


def _figures(name: str, measured_m: FloatArray, true_m: FloatArray) -> list[Figure]:
    known = np.isfinite(measured_m)
    off_mm = 1000 * (measured_m - true_m)[known]
    spread = np.sum((true_m[known] - true_m[known].mean()) ** 2) if known.any() else 0.0
    values = {
        "apples": len(true_m),
        "measured": int(known.sum()),
        "MAE, mm": float(np.abs(off_mm).mean()) if known.any() else np.nan,
        "mean error, mm": float(off_mm.mean()) if known.any() else np.nan,
        "RMSE, mm": float(np.sqrt((off_mm**2).mean())) if known.any() else np.nan,
        "R²": 1 - float(np.sum((off_mm / 1000) ** 2) / spread) if spread > 0 else np.nan,
    }
    return [Figure(f"{name}: {what}", {"Pomona": value}) for what, value in values.items()]
