"""Messages of the library name parameters in backticks; a person at the command line knows options."""

from __future__ import annotations

import re

# Parameters whose option is not called as they are.
_OPTIONS = {
    "fruit_diameter_m": "--fruit-diameter",
    "use_gnss": "--gnss",
    "filter_false_positives": "--filter",
}
_SAME = (
    "sides", "method", "variant", "model", "score_threshold", "detections", "classes", "cameras", "markers",
    "scale_bar", "marker_dictionary", "engine", "filter_model", "overwrite", "out", "photos", "truth", "to", "arch",
    "weights", "match", "port",
)  # fmt: skip


def with_options(message: str) -> str:
    """Return a message in which parameters in backticks, such as `score_threshold`, are options: --score-threshold."""
    return re.sub(r"`(\w+)`", lambda found: _option(found[1]) or found[0], message)


def _option(parameter: str) -> str | None:
    if parameter in _SAME:
        return "--" + parameter.replace("_", "-")
    return _OPTIONS.get(parameter)
