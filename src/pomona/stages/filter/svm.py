"""The paper's linear support vector machine, kept as readable JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import expit

from pomona.basics.arrays import BoolArray, FloatArray, set_checked
from pomona.errors import FormatError, InputError
from pomona.formats.json_file import load_json
from pomona.stages.filter.point_features import FEATURE_NAMES

_FORMAT = "pomona linear svm 1"
_FOLDS = 5
_WEIGHTS = Path(__file__).parent / "weights"


def shipped(method: str, variant: str | None = None) -> Path:
    """Return the machine that is shipped for fruits found by `method`, "paper" or "object".

    The variant "published-code" of the paper's method has one of its own, on that program's six features, and so have
    fruits of the other that were looked at again, the variant "second-look".
    """
    name = {"published-code": "published_code", "second-look": "second_look"}.get(variant or "", method)
    return _WEIGHTS / f"{name}_svm.json"


@dataclass(frozen=True, eq=False)
class LinearSvm:
    """A linear decision on k standardised features, and the sigmoid that makes a probability of it.

    `decision(x) = weights · (x − means) / sds + bias`, `probability = 1 / (1 + exp(sigmoid[0] decision + sigmoid[1]))`
    (Platt 1999). `fruit_diameter_m` is the median diameter, as fusion first estimates it, of the fruits it was
    trained on (NaN: not known);
    `trained_on` says in words what these were.
    """

    names: tuple[str, ...]
    means: FloatArray
    sds: FloatArray
    weights: FloatArray
    bias: float
    sigmoid: tuple[float, float]
    box_constraint: float
    fruit_diameter_m: float
    trained_on: str

    def __post_init__(self) -> None:
        for name in ("means", "sds", "weights"):
            set_checked(self, name, (len(self.names),), np.float64)
            if not np.isfinite(getattr(self, name)).all():
                raise InputError(f"LinearSvm.{name}: expected finite numbers")
        if not (self.sds > 0).all():
            raise InputError("LinearSvm.sds: expected positive numbers")

    @classmethod
    def train(
        cls,
        values: FloatArray,
        is_fruit: BoolArray,
        *,
        names: tuple[str, ...] = FEATURE_NAMES,
        box_constraint: float = 0.35,
        fruit_diameter_m: float = float("nan"),
        trained_on: str = "",
    ) -> LinearSvm:
        """Return the machine that separates `is_fruit` (n,) from features (n, k); the box constraint is the authors'.

        The sigmoid is fitted to decisions on folds that were not trained on.

        Raises `InputError` where one of the two classes has fewer than five examples.
        """
        from sklearn.calibration import CalibratedClassifierCV
        from sklearn.svm import SVC

        values, is_fruit = np.asarray(values, float), np.asarray(is_fruit, bool)
        fewest = int(min(is_fruit.sum(), (~is_fruit).sum()))
        if fewest < _FOLDS:
            raise InputError(
                f"Training needs at least {_FOLDS} fruits and {_FOLDS} false positives, found {is_fruit.sum()} and "
                f"{(~is_fruit).sum()}: give more surveys"
            )
        means, sds = values.mean(0), values.std(0)
        sds = np.where(sds > 0, sds, 1.0)
        machine = SVC(kernel="linear", C=box_constraint)
        fitted = CalibratedClassifierCV(machine, method="sigmoid", cv=_FOLDS, ensemble=False)
        fitted = fitted.fit((values - means) / sds, is_fruit).calibrated_classifiers_[0]
        sigmoid = fitted.calibrators[0]
        return cls(
            names, means, sds, fitted.estimator.coef_[0], float(fitted.estimator.intercept_[0]),
            (float(sigmoid.a_), float(sigmoid.b_)), box_constraint, fruit_diameter_m, trained_on,
        )  # fmt: skip

    def decision(self, values: FloatArray) -> FloatArray:
        """Return the signed distances (n,) from the deciding plane: above 0 on the fruits' side."""
        values = np.asarray(values, float)
        if values.ndim != 2 or values.shape[1] != len(self.names):
            raise InputError(
                f"Features: expected (n, {len(self.names)}): {', '.join(self.names)}; found {values.shape}"
            )
        result: FloatArray = (values - self.means) / self.sds @ self.weights + self.bias
        return result

    def probability(self, values: FloatArray) -> FloatArray:
        """Return for features (n, k) the probabilities (n,) of being a fruit."""
        result: FloatArray = expit(-(self.sigmoid[0] * self.decision(values) + self.sigmoid[1]))
        return result

    def save(self, path: Path) -> None:
        """Write JSON; numbers are kept exactly."""
        values = {field.name: _plain(getattr(self, field.name)) for field in fields(self)}
        path.write_text(json.dumps({"format": _FORMAT, **values}, indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> LinearSvm:
        """Read what `save` wrote.

        Raises `MissingFileError`, and `FormatError` where the file holds something else.
        """
        table = load_json(Path(path), "a support vector machine saved by Pomona")
        try:
            if table.pop("format") != _FORMAT:
                raise ValueError(f'"format" is not "{_FORMAT}"')
            diameter_m = table.pop("fruit_diameter_m")
            names, sigmoid = tuple(map(str, table.pop("names"))), tuple(map(float, table.pop("sigmoid")))
            return cls(
                names=names, sigmoid=(sigmoid[0], sigmoid[1]),
                fruit_diameter_m=float("nan") if diameter_m is None else float(diameter_m), **table,
            )  # fmt: skip
        except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
            raise FormatError(f"{path}: expected a support vector machine saved by Pomona, but {error}") from error


def _plain(value: Any) -> Any:
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value.tolist() if isinstance(value, np.ndarray) else value
