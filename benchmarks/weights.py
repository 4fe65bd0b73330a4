"""Fit weights of apples to their diameters, and draw the fit and its residuals.

python benchmarks/weights.py [PAIRS.csv] [--plot OUT.svg]

Prints the figures that `pomona.stages.measure.allometry.STORY_APPLES` has. PAIRS.csv: `../shared/data/fruit-measures`.
"""

import csv
from pathlib import Path

import numpy as np

from command_line import DATA, parser_of
from pomona.stages.measure import fit_allometry

TABLE = DATA / "fruit-measures" / "story-apples-caliper-weight.csv"
WIDTH, HEIGHT, MARGIN = 360, 260, 44


def pairs_of(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Diameters in mm and weights in g, without the two balls that the table has for calibration."""
    with path.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file, delimiter=";") if not row["lab.fruit_label"].startswith("BALL")]
    diameters, weights = np.array([[float(r["lab.o_caliber_mm"]), float(r["lab.weight_gr"])] for r in rows]).T
    return diameters, weights


class Axes:
    """One plot of the drawing: from data to SVG."""

    def __init__(self, left: float, x: tuple[float, float], y: tuple[float, float], labels: tuple[str, str]) -> None:
        self.left, self.x, self.y, self.labels = left, x, y, labels

    def at(self, x: float, y: float) -> tuple[float, float]:
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        up = (y - self.y[0]) / (self.y[1] - self.y[0])
        return self.left + MARGIN + across * (WIDTH - MARGIN - 12), HEIGHT - MARGIN - up * (HEIGHT - MARGIN - 12)

    def frame(self) -> list[str]:
        (x0, y0), (x1, y1) = self.at(self.x[0], self.y[0]), self.at(self.x[1], self.y[1])
        parts = [f'<path d="M{x0:.0f} {y1:.0f}V{y0:.0f}H{x1:.0f}" fill="none" stroke="#777"/>']
        for value in np.linspace(*self.x, 6):
            x, y = self.at(value, self.y[0])
            parts.append(f'<text x="{x:.0f}" y="{y + 15:.0f}" text-anchor="middle">{value:.0f}</text>')
        for value in np.linspace(*self.y, 5):
            x, y = self.at(self.x[0], value)
            parts.append(f'<text x="{x - 5:.0f}" y="{y + 4:.0f}" text-anchor="end">{value:.0f}</text>')
        parts.append(f'<text x="{(x0 + x1) / 2:.0f}" y="{HEIGHT - 8}" text-anchor="middle">{self.labels[0]}</text>')
        return [*parts, f'<text x="{x0 + 6:.0f}" y="{y1 + 10:.0f}">{self.labels[1]}</text>']

    def points(self, x: np.ndarray, y: np.ndarray) -> list[str]:
        places = [self.at(a, b) for a, b in zip(x, y, strict=True)]
        return [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3" fill="#c0392b"/>' for a, b in places]

    def line(self, x: np.ndarray, y: np.ndarray) -> str:
        path = " ".join("{:.1f},{:.1f}".format(*self.at(a, b)) for a, b in zip(x, y, strict=True))
        return f'<polyline points="{path}" fill="none" stroke="#2c6e49" stroke-width="1.5"/>'


def drawing(diameters: np.ndarray, weights: np.ndarray, expected: np.ndarray) -> str:
    order = np.argsort(diameters)
    fit = Axes(0, (55, 85), (60, 300), ("calliper diameter, mm", "weight, g"))
    residuals = Axes(WIDTH, (55, 85), (-80, 80), ("calliper diameter, mm", "weight − expected, g"))
    parts = [*fit.frame(), *fit.points(diameters, weights), fit.line(diameters[order], expected[order])]
    parts += [*residuals.frame(), *residuals.points(diameters, weights - expected)]
    parts.append(residuals.line(np.array(residuals.x), np.zeros(2)))
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{2 * WIDTH}" height="{HEIGHT}"'
    return f'{head} font-family="sans-serif" font-size="11" fill="#777">{"".join(parts)}</svg>\n'


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("pairs", type=Path, nargs="?", default=TABLE)
    parser.add_argument("--plot", type=Path)
    arguments = parser.parse_args()
    diameters, weights = pairs_of(arguments.pairs)
    fitted = fit_allometry(diameters, weights, source=arguments.pairs.name)
    expected = fitted.weights_g(diameters / 1000)
    off = weights - expected
    explained = 1 - (off**2).sum() / ((weights - weights.mean()) ** 2).sum()
    print(fitted)
    print(f"{len(weights)} fruits, mean absolute error {np.abs(off).mean():.1f} g, R² {explained:.2f}")
    if arguments.plot:
        arguments.plot.write_text(drawing(diameters, weights, expected))


if __name__ == "__main__":
    main()
