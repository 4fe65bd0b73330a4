"""What counts of right and wrong come to: recall, precision and F1, of fruits in space as of detections in photos."""

from __future__ import annotations

import math


class Rates:
    """Recall, precision and F1 of whatever counts T `true_fruits`, D `detections` and TP `true_positives`."""

    true_fruits: int
    detections: int
    true_positives: int

    @property
    def recall(self) -> float:
        """R = TP / T, equation 4 of Gené-Mola et al. 2020."""
        return ratio(self.true_positives, self.true_fruits)

    @property
    def precision(self) -> float:
        """P = TP / D, equation 5."""
        return ratio(self.true_positives, self.detections)

    @property
    def f1(self) -> float:
        """F1 = 2 R P / (R + P), equation 8, written 2 TP / (T + D), which is also right where R or P is undefined."""
        return ratio(2 * self.true_positives, self.true_fruits + self.detections)


def ratio(part: int, whole: int) -> float:
    """Return a share; NaN of nothing."""
    return part / whole if whole else math.nan


def known(value: float) -> float | None:
    """Return a score as JSON has it: rounded, None where it is undefined."""
    return None if math.isnan(value) else round(value, 6)


def written(value: float, *, digits: int = 3) -> str:
    """Return a score as people read it; a dash where it is undefined."""
    return "–" if math.isnan(value) else f"{value:.{digits}f}"
