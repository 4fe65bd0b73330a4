"""Weights of fruits: allometry fitted to pairs, presets of kinds, totals with intervals."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pomona.errors import FormatError, InputError, MissingFileError
from pomona.fruit.traits.kinds import FRUIT_KINDS
from pomona.stages.measure.allometry import (
    STORY_APPLES,
    Allometry,
    allometry_of_kind,
    fit_allometry,
    total_weight,
    weigh,
)
from pomona.stages.measure.weight_table import read_allometry
from pomona.values.cameras import WorldFrame
from pomona.values.fruits import Fruits

METRES = WorldFrame("markers")
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data" / "fruit-measures"


def fruits_of(diameters_m: list[float], sd_m: float = 0.002) -> Fruits:
    n = len(diameters_m)
    return Fruits(
        np.arange(1, n + 1),
        np.zeros((n, 3)),
        np.array(diameters_m),
        np.ones(n),
        np.full(n, 3),
        np.where(np.isfinite(diameters_m), sd_m, np.nan),
    )


def drawn(n: int, seed: int, *, exponent: float = 2.9, scatter: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Diameters in mm, and weights of a known law: 180 g at 75 mm."""
    rng = np.random.default_rng(seed)
    diameters = rng.uniform(55, 90, n)
    return diameters, 180 * (diameters / 75) ** exponent * np.exp(rng.normal(0, scatter, n))


def test_a_known_law_is_found_again_with_its_errors() -> None:
    fitted = fit_allometry(*drawn(2000, 1), source="drawn")
    assert fitted.exponent == pytest.approx(2.9, abs=3 * fitted.exponent_sd)
    assert 0.005 < fitted.exponent_sd < 0.03
    assert fitted.scatter == pytest.approx(0.1, rel=0.05)
    # The mean of what is scattered by a share of 0.1 on logarithms is half a percent above the law.
    assert fitted.weights_g(np.array([0.075]))[0] == pytest.approx(180 * np.exp(0.1**2 / 2), rel=0.01)


def test_few_pairs_say_how_little_they_know() -> None:
    few, many = fit_allometry(*drawn(6, 2), source=""), fit_allometry(*drawn(600, 2), source="")
    at = np.array([0.06])
    assert few.shared_sds(at)[0] > 4 * many.shared_sds(at)[0]


def test_apples_are_those_that_were_weighed() -> None:
    table = SHARED / "story-apples-caliper-weight.csv"
    if not table.is_file():
        pytest.skip("the table of weighed apples is not here")
    with table.open() as file:
        rows = [row for row in csv.DictReader(file, delimiter=";") if not row["lab.fruit_label"].startswith("BALL")]
    pairs = np.array([[float(row["lab.o_caliber_mm"]), float(row["lab.weight_gr"])] for row in rows])
    fitted = fit_allometry(*pairs.T, source=STORY_APPLES.source)
    for name in ("diameter_mm", "weight_g", "exponent", "scatter", "weight_sd", "exponent_sd"):
        assert getattr(STORY_APPLES, name) == pytest.approx(getattr(fitted, name), rel=3e-3), name


@pytest.mark.parametrize(
    ("kind", "diameter_m", "least_g", "most_g"),
    [("apple", 0.08, 210, 280), ("orange", 0.075, 170, 240), ("cherry", 0.025, 6, 11), ("tomato", 0.065, 100, 160),
     ("mango", 0.085, 330, 480), ("pear", 0.065, 140, 210), ("plum", 0.042, 30, 50)],
)  # fmt: skip
def test_kinds_weigh_what_such_fruits_weigh(kind: str, diameter_m: float, least_g: float, most_g: float) -> None:
    weight = allometry_of_kind(FRUIT_KINDS[kind]).weights_g(np.array([diameter_m]))[0]
    assert least_g < weight < most_g


def test_a_pair_with_a_slip_of_the_pen_is_named(tmp_path: Path) -> None:
    pairs = "61.5,106\n74,188\n65,120\n70,150\n80,230\n"
    (tmp_path / "pairs.csv").write_text("Diameter (mm),Weight [g]\n" + pairs)
    assert 150 < read_allometry(tmp_path / "pairs.csv").weights_g(np.array([0.072]))[0] < 190
    for slip, said in (
        ("74,18.8", "74 mm and 18.8 g"),
        ("7.4,188", "7.4 mm and 188 g"),
        ("61.5,1060", "61.5 mm and 1060 g"),
    ):
        (tmp_path / "pairs.csv").write_text("diameter_mm,weight_g\n" + pairs + slip + "\n")
        with pytest.raises(FormatError, match=f"{said} are not of a fruit like the others: .*point wrong"):
            read_allometry(tmp_path / "pairs.csv")


@pytest.mark.parametrize(
    ("pairs", "said"),
    [("6.15,106\n7.4,188\n6.5,120\n7,150\n8,230\n", r"millimetres \(these look like centimetres\)"),
     ("61.5,0.106\n74,0.188\n65,0.12\n70,0.15\n80,0.23\n", r"grams \(these look like kilograms\)"),
     ("61.5,2.1\n74,3.8\n65,2.4\n70,3\n80,4.6\n", "diameters in millimetres and weights in grams")],
)  # fmt: skip
def test_pairs_in_other_units_say_which_column_is_wrong(pairs: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "pairs.csv").write_text("diameter_mm,weight_g\n" + pairs)
    with pytest.raises(FormatError, match=f"expected {said}|expected (diameters|weights) in {said}"):
        read_allometry(tmp_path / "pairs.csv")


def test_a_fruit_that_was_not_measured_has_no_weight() -> None:
    weighed = weigh(fruits_of([0.07, np.nan]), STORY_APPLES, METRES)
    assert 140 < weighed.weights_g[0] < 190
    assert 15 < weighed.weight_sds_g[0] < 35
    assert np.isnan(weighed.weights_g[1])
    assert np.isnan(weighed.weight_sds_g[1])


def test_a_worse_diameter_gives_a_worse_weight() -> None:
    good, bad = (weigh(fruits_of([0.07], sd), STORY_APPLES, METRES).weight_sds_g[0] for sd in (0.001, 0.006))
    assert bad > 1.5 * good


def test_without_metres_nothing_is_weighed() -> None:
    assert np.isnan(weigh(fruits_of([0.07]), STORY_APPLES, WorldFrame()).weights_g).all()


def test_the_interval_of_the_total_covers_the_truth_as_often_as_it_says() -> None:
    """Orchards drawn by a law, weighed by pairs of the same law, of which a fifth of the fruits were not measured."""
    hits, widths = 0, []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        allometry = fit_allometry(*drawn(25, seed + 1000), source="drawn")
        true_mm, true_g = drawn(120, seed + 5000)
        measured_m = (true_mm + rng.normal(0, 2, 120)) / 1000
        measured_m[rng.random(120) < 0.2] = np.nan
        fruits = weigh(fruits_of(measured_m.tolist()), allometry, METRES)
        total = total_weight(fruits, allometry)
        assert total is not None
        hits += total.low_kg <= true_g.sum() / 1000 <= total.high_kg
        widths.append((total.high_kg - total.low_kg) / total.kg)
    assert 180 <= hits <= 199, hits
    assert 0.04 < np.median(widths) < 0.2


@pytest.mark.parametrize("pairs", [5, 8, 100])
def test_the_interval_covers_the_truth_however_few_pairs_there_are(pairs: int) -> None:
    """So many fruits were measured exactly that the curve's error is nearly all there is."""
    hits = 0
    for seed in range(400):
        allometry = fit_allometry(*drawn(pairs, seed + 1000), source="drawn")
        true_mm, true_g = drawn(2000, seed + 5000)
        total = total_weight(weigh(fruits_of((true_mm / 1000).tolist(), 0.0), allometry, METRES), allometry)
        assert total is not None
        hits += total.low_kg <= true_g.sum() / 1000 <= total.high_kg
    assert 0.925 <= hits / 400 <= 0.975, hits


@pytest.mark.parametrize("diameters_mm", [(62, 66, 70, 74, 78), (56, 58, 60), (80, 85, 90)])
def test_a_wrong_slope_makes_small_fruits_too_light_where_it_makes_large_ones_too_heavy(
    diameters_mm: tuple[int, ...],
) -> None:
    fruits = fruits_of([mm / 1000 for mm in diameters_mm], 0.0)
    curve = replace(STORY_APPLES, scatter=0.0, weight_sd=0.0)
    steeper = replace(curve, exponent=curve.exponent + 0.1 * curve.exponent_sd)
    total, other = (total_weight(weigh(fruits, each, METRES), each) for each in (curve, steeper))
    assert total is not None
    assert other is not None
    assert total.high_kg - total.kg == pytest.approx(1.96 * 10 * abs(other.kg - total.kg), rel=0.05)


def test_fruits_that_were_not_measured_scatter_as_others_do() -> None:
    """All are as large as each other, and the curve is exact: what differs is how heavy fruits of one size are."""
    curve, hits = replace(STORY_APPLES, weight_sd=0.0, exponent_sd=0.0), 0
    for seed in range(400):
        true_g = curve.weights_g(np.full(60, 0.07)) * (1 + np.random.default_rng(seed).normal(0, curve.scatter, 60))
        total = total_weight(weigh(fruits_of([0.07] * 6 + [np.nan] * 54, 0.0), curve, METRES), curve)
        assert total is not None
        hits += total.low_kg <= true_g.sum() / 1000 <= total.high_kg
    assert 0.925 <= hits / 400 <= 0.975, hits


def test_nothing_measured_weighs_nothing_known() -> None:
    assert total_weight(weigh(fruits_of([np.nan]), STORY_APPLES, METRES), STORY_APPLES) is None
    assert total_weight(Fruits.empty(), STORY_APPLES) is None


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ("70,150\n72,160\n", "at least 5 pairs"),
        ("70,200\n72,180\n74,170\n76,150\n78,140\n", "rise with the diameter"),
        ("0.070,150\n0.072,160\n0.074,170\n0.076,190\n0.078,200\n", "in millimetres"),
        ("70,0.15\n72,0.16\n74,0.17\n76,0.19\n78,0.2\n", "in grams"),
        ("70,150\n70,160\n70,170\n70,190\n70,200\n", "that differ"),
        ("70,150\n72,-160\n74,170\n76,190\n78,200\n", "above 0"),
        ("70,150\n72,heavy\n", "line 3, column weight_g: expected a number, found 'heavy'"),
    ],
)
def test_pairs_that_no_fruit_can_have_are_refused(tmp_path: Path, rows: str, expected: str) -> None:
    path = tmp_path / "pairs.csv"
    path.write_text("diameter_mm,weight_g\n" + rows)
    with pytest.raises(FormatError, match=expected) as caught:
        read_allometry(path)
    assert "pairs.csv" in str(caught.value)


def test_pairs_of_another_program_are_read(tmp_path: Path) -> None:
    path = tmp_path / "pairs.csv"
    lines = [f"{w:.1f};{d:.2f};east" for d, w in zip(*drawn(20, 3), strict=True)]
    path.write_text("\n".join(["# weighed by hand", "Weight_g;Diameter_mm;row", *lines]))
    assert 2 < read_allometry(path).exponent < 4


def test_a_missing_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"`weights` .*pairs.csv: no such file; expected .*diameter_mm,weight_g"):
        read_allometry(tmp_path / "pairs.csv")


def test_an_allometry_of_nothing_is_refused() -> None:
    with pytest.raises(InputError, match=r"Allometry.weight_g: expected a number above 0"):
        Allometry(
            diameter_mm=70, weight_g=0, exponent=3, scatter=0.1, weight_sd=0.01, exponent_sd=0.1, source=""
        )  # fmt: skip
