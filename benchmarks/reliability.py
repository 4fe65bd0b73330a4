"""Is the `score` of fruits.csv a probability? Fruits of rows with truth, by score: a table and a plot for the docs.

python benchmarks/reliability.py ROW[=FILTER.json] [...] [--no-second-look] [--plot docs/images/reliability.png]

A ROW is a rendered row's folder with its truth, with the true cameras and the shipped segmenter's detections; a row
that the filter was trained on needs a FILTER trained on the others (`train_filter.py --left-out`). All photos, the even
and the odd, and each third of them are surveys of their own. Of all fruits before the cut, the share is told that are
true: at most half a diameter from a true fruit's centre, visible or not, one to one.
"""

from pathlib import Path

import numpy as np

from command_line import parser_of
from pomona.evaluate.fruits import EvaluateOptions
from pomona.evaluate.fruits.matching import assign, candidates_by_center
from pomona.stages import filter as filters
from row_cases import row_case
from tables import table_head, table_row

EDGES = np.linspace(0, 1, 11)
THINNED = ((1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2))
_KEEP_ALL = filters.FilterOptions(threshold=0.0)


def judged(row: Path, svm: filters.LinearSvm | None, second_look: bool) -> tuple[np.ndarray, np.ndarray]:
    """Scores (n,), and whether each is true (n,), of all fruits that the photos and their parts give."""
    case, scores, true = row_case(row), [], []
    for step, first in THINNED:
        part = case.every(step, first)
        fused = part.looked_again(part.associated()) if second_look else part.associated()
        fruits = part.measured(fused, svm=svm, options=_KEEP_ALL).fruits
        pairs = assign(candidates_by_center(fruits, case.truth, EvaluateOptions()), len(fruits), len(case.truth))
        scores.append(fruits.scores)
        true.append(np.isin(np.arange(len(fruits)), pairs[:, 0]))
    return np.concatenate(scores), np.concatenate(true)


def bins(scores: np.ndarray, true: np.ndarray) -> list[tuple[float, float, int, float, float]]:
    """Of each bin that has fruits: from, to, how many, mean score, share that are true."""
    place = np.clip(np.searchsorted(EDGES, scores, side="right") - 1, 0, len(EDGES) - 2)
    return [
        (EDGES[k], EDGES[k + 1], int(mine.sum()), float(scores[mine].mean()), float(true[mine].mean()))
        for k in range(len(EDGES) - 1)
        if (mine := place == k).any()
    ]


def summary(scores: np.ndarray, true: np.ndarray) -> str:
    error = sum(n * abs(mean - share) for _, _, n, mean, share in bins(scores, true)) / len(scores)
    known = (true.mean() - true) ** 2
    return f"{len(scores)} | {true.mean():.3f} | {((scores - true) ** 2).mean():.3f} ({known.mean():.3f}) | {error:.3f}"


def plot(path: Path, scores: np.ndarray, true: np.ndarray) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5, 6), constrained_layout=True)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    found = bins(scores, true)
    means, shares, counts = (np.array([b[k] for b in found]) for k in (3, 4, 2))
    sds = np.sqrt(np.maximum(shares * (1 - shares), 1e-9) / counts)
    above.plot([0, 1], [0, 1], "--", color="0.6", label="a probability")
    above.errorbar(means, shares, yerr=sds, fmt="o-", color="tab:red", capsize=3, label="fruits, ± one sd")
    above.set(ylabel="share that are true", xlim=(0, 1), ylim=(0, 1))
    above.legend(loc="upper left")
    below.hist([scores[true], scores[~true]], EDGES, stacked=True, color=["tab:red", "0.7"], label=["true", "false"])
    below.set(xlabel="score", ylabel="fruits")
    below.legend(loc="upper center")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("rows", nargs="+")
    parser.add_argument("--no-second-look", action="store_true")
    parser.add_argument("--plot", type=Path)
    arguments = parser.parse_args()
    scores, true = [], []
    print(table_head("row | fruits | true | Brier score (of the mean alone) | expected calibration error"))
    for each in arguments.rows:
        folder, _, machine = each.partition("=")
        svm = filters.load(Path(machine)) if machine else None
        found = judged(Path(folder), svm, not arguments.no_second_look)
        scores.append(found[0])
        true.append(found[1])
        print(table_row([Path(folder).name, summary(*found)]), flush=True)
    together = np.concatenate(scores), np.concatenate(true)
    print(table_row(["together", summary(*together)]) + "\n")
    print(table_head("score | fruits | mean score | share that are true"))
    for low, high, count, mean, share in bins(*together):
        print(table_row([f"{low:.1f} to {high:.1f}", count, f"{mean:.2f}", f"{share:.2f}"]))
    if arguments.plot:
        plot(arguments.plot, *together)


if __name__ == "__main__":
    main()
