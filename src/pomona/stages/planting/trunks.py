"""Where trunks stand: as given, or where the fruits of a row gather at equal distances.

Fruits of a tree hang about its trunk. Along the row, their positions modulo the planting distance are angles; how far
these are from even is the length R of their mean vector (Rayleigh's test, Mardia & Jupp 2000, section 6.3.1), and its
angle says where the trunks are. A distance that is not known is that of the largest R. The test is of fruits that hang
independently, and those of a bunch do not: n is made smaller by the design effect of bunches (Kish 1965, section 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.fft import fft
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray
from pomona.basics.row_line import RowLine, row_line
from pomona.errors import FormatError
from pomona.formats.coordinate_systems import given_xy_between
from pomona.formats.gcp_list import read_gcp_list
from pomona.progress import Progress, Silent
from pomona.stages.planting.options import PlantingOptions
from pomona.stages.planting.trunk_table import are_apart, check_apart, read_trunks
from pomona.values.fruits import Fruits
from pomona.values.trees import Trunks

_TRIED_A_PERIOD = 16  # so many distances are tried between two which differ by one tree over the row's length
_ALIKE = 5.7  # of those, so many say no more than one does, as the largest R of even rows shows
_TOUCHING = 1.2  # usual diameters: nearer fruits hang in one bunch
_BINS_A_PERIOD = 64  # of the shortest distance
_FEWEST_TREES = 3  # of fewer, no distance can be read off
_STRAY = 0.15  # of the fruits that trees usually have: fewer are no tree
_CLEARLY = 1.25  # by so much another distance must fit better than a given one to be said


def find_trunks(
    fruits: Fruits,
    options: PlantingOptions | None = None,
    progress: Progress | None = None,
    *,
    crs: str | None = None,
) -> Trunks:
    """Return the trunks of the row on which n fruits hang, in metres; none where trees are not known.

    `crs` is that of the fruits' frame, where this has a place on Earth: the table may then be in a system of `options`.
    Raises what `read_trunks` raises, and `FormatError` where the table's trunks are nowhere near the fruits.
    """
    options, progress = options or PlantingOptions(), progress or Silent()
    if options.trees is not None:
        return _given(options.trees, fruits, options, crs)
    if len(fruits) < 2:
        return Trunks.unknown()
    row = _Row.of(fruits)
    if row.length_m == 0:
        return Trunks.unknown()
    if options.spacing_m is not None:
        _compare(row, options.spacing_m, options, progress)
        return row.trunks(options.spacing_m, "spacing")
    best = row.best_spacing(options)
    return Trunks.unknown() if best is None else row.trunks(best, "fruits")


def _given(path: Path, fruits: Fruits, options: PlantingOptions, crs: str | None) -> Trunks:
    """The trunks of the table in the fruits' frame, as they are or from their CRS: where they stand near the fruits."""
    trunks = read_trunks(path, in_metres=False)  # perhaps they are, which their places beside the fruits say
    if not len(fruits):
        return trunks
    away_m = _nearest_m(trunks, fruits)
    if away_m <= options.longest_m and are_apart(trunks):  # degrees taken for metres are all at one place
        return trunks
    trees_crs = options.trees_crs
    if trees_crs is None and options.trees_gcp is not None:
        trees_crs = read_gcp_list(options.trees_gcp).crs
    if trees_crs is not None and crs is not None:
        xy = given_xy_between(trunks.xy_in_world, trees_crs, crs, str(path))
        local = replace(trunks, xy_in_world=xy)
        if _nearest_m(local, fruits) <= options.longest_m:
            check_apart(local, path)
            return local
    check_apart(trunks, path)
    either = "" if trees_crs is None else f" or in {trees_crs}"
    raise FormatError(
        f"{path}: expected trunks in the survey's frame{either}, near its fruits; found the nearest "
        f"{away_m:.0f} m from any fruit"
    )


def _bunch(fruits: Fruits) -> float:
    """Return how many fruits of a bunch count as one: the mean size of the bunch that a fruit hangs in."""
    diameters_m = fruits.diameters_m[np.isfinite(fruits.diameters_m)]
    if not len(diameters_m):
        return 1.0
    reach_m = _TOUCHING * float(np.median(diameters_m))
    pairs = cKDTree(fruits.centers_in_world).query_pairs(reach_m, output_type="ndarray")
    n = len(fruits)
    touching = sparse.coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(n, n))
    sizes = np.bincount(connected_components(touching, directed=False)[1])
    return float((sizes**2).sum() / n)


def _nearest_m(trunks: Trunks, fruits: Fruits) -> float:
    away_m = cKDTree(trunks.xy_in_world).query(fruits.centers_in_world[:, :2])[0]
    return float(np.min(away_m))


def _compare(row: _Row, spacing_m: float, options: PlantingOptions, progress: Progress) -> None:
    """Warn where fruits contradict the distance that was given."""
    best = row.best_spacing(options)
    if best is None:
        return
    off_in_all = abs(row.length_m / best - row.length_m / spacing_m)
    if off_in_all > 0.5 and row.gathered(best) > _CLEARLY * row.gathered(spacing_m):
        progress.warn(
            f"Trees {spacing_m:g} m apart (`tree_spacing`) do not fit the fruits, which gather every {best:.2f} m: "
            "check the distance, or give the trunks' positions (`trees`)"
        )


@dataclass(frozen=True, eq=False)
class _Row:
    """A row's fruits along its middle `line`: `along_m` (n,). So many of a bunch hang as one: `bunch`."""

    along_m: FloatArray
    line: RowLine
    bunch: float

    @classmethod
    def of(cls, fruits: Fruits) -> _Row:
        line = row_line(fruits.centers_in_world)
        return cls(line.along_across(fruits.centers_in_world)[0], line, _bunch(fruits))

    @property
    def length_m(self) -> float:
        """From the first fruit to the last."""
        return float(np.ptp(self.along_m))

    def mean_vector(self, spacing_m: float) -> complex:
        """Return the mean of exp(2πi x / spacing), less that of fruits spread evenly from the first to the last.

        Where the row's length is no whole number of spacings, even fruits have one, too.
        """
        first, last = 2j * np.pi * np.array([self.along_m.min(), self.along_m.max()]) / spacing_m
        even = (np.exp(last) - np.exp(first)) / (last - first)
        return complex(np.exp(2j * np.pi * self.along_m / spacing_m).mean() - even)

    def gathered(self, spacing_m: float) -> float:
        """Return how much fruits gather at this distance: 0 (not at all) to 1 (at points)."""
        return abs(self.mean_vector(spacing_m))

    def chance(self, spacing_m: float) -> float:
        """Return the probability that bunches hanging anywhere gather as much, by Rayleigh's test."""
        return float(np.exp(-len(self.along_m) / self.bunch * self.gathered(spacing_m) ** 2))

    def spacings(self, options: PlantingOptions) -> FloatArray:
        """Return the distances to try, evenly by the number of trees in the row."""
        longest_m = min(options.longest_m, self.length_m / (_FEWEST_TREES - 0.5))
        if longest_m <= options.shortest_m:
            return np.zeros(0)
        fewest, most = self.length_m / longest_m, self.length_m / options.shortest_m
        return self.length_m / np.arange(fewest, most, 1 / _TRIED_A_PERIOD)

    def best_spacing(self, options: PlantingOptions) -> float | None:
        """Return the distance at which fruits gather most; None where that may be chance, or in too short a row."""
        tried = self.spacings(options)
        if not len(tried):
            return None
        best = float(tried[np.argmax(self._gathered_all(tried))])
        return best if self.chance(best) * len(tried) / _ALIKE <= options.chance else None

    def _gathered_all(self, tried_m: FloatArray) -> FloatArray:
        """Return `gathered` of all distances (m,) of `spacings`.

        Each needs all fruits, and the longer the row, the more there are of both: the mean vectors of all are one
        Fourier transform of the fruits, counted in bins much shorter than any distance.
        """
        trees = self.length_m / tried_m
        share = (self.along_m - self.along_m.min()) / self.length_m
        bins = _TRIED_A_PERIOD * _BINS_A_PERIOD * int(np.ceil(trees.max()))
        bin_idx = (share / _TRIED_A_PERIOD * bins).astype(np.int64)
        # Distances begin with one of which no whole number makes up the row: what it turns fruits by is taken first.
        turned = np.exp(-2j * np.pi * trees[0] * share) / len(share)
        counts = np.bincount(bin_idx, turned.real, bins) + 1j * np.bincount(bin_idx, turned.imag, bins)
        steps = np.arange(len(tried_m))
        vectors = fft(counts)[steps] * np.exp(-1j * np.pi * steps / bins)  # from the bins' edges to their middles
        even = (np.exp(-2j * np.pi * trees) - 1) / (-2j * np.pi * trees)
        gathered: FloatArray = np.abs(vectors - even)
        return gathered

    def trunks(self, spacing_m: float, source: str) -> Trunks:
        """Return trunks at this distance along the whole row, numbered from 1; in a shorter row, one in its middle.

        Fruits of less than a whole distance do not say where in it they gather.
        """
        if self.length_m <= spacing_m:
            middle_m = np.array([np.median(self.along_m)])
            return Trunks(np.ones(1, np.int64), self.line.places(middle_m), source)  # type: ignore[arg-type]
        phase_m = np.angle(self.mean_vector(spacing_m)) / (2 * np.pi) * spacing_m
        numbers, counts = np.unique(np.round((self.along_m - phase_m) / spacing_m), return_counts=True)
        # A few fruits beyond the row's last tree hang on its longest branches.
        trees = numbers[counts >= _STRAY * np.median(counts)]
        steps = np.arange(trees.min(), trees.max() + 1)
        xy = self.line.places(phase_m + steps * spacing_m)
        return Trunks(np.arange(1, len(steps) + 1), xy, source)  # type: ignore[arg-type]
