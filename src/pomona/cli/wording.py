"""Messages of the library name parameters in backticks; a person at the command line knows options."""

from __future__ import annotations

import re
from typing import Any

from pomona.pipeline.options import COMMAND_NAMES

# Parameters whose option has another name.
OTHER_NAMES = {
    **{field: f"--{said.replace('_', '-')}" for said, field in COMMAND_NAMES.items()},
    "crop_px": "--crop",
    "distance_m": "--distance",
    "min_size_px": "--min-size",
    "min_visible_px": "--min-visible",
    "step_m": "--step",
    "wind_m": "--wind",
    "grow_m": "--grow-mm",
    "grow_sd_m": "--grow-sd-mm",
}
# Parameters whose option has the same name, with hyphens.
SAME_NAMES = frozenset(
    (
        "sides", "method", "fruit", "tree_spacing", "variant", "model", "score_threshold", "detections", "classes",
        "cameras", "markers", "scale_bar", "marker_dictionary", "engine", "filter_model", "overwrite", "out", "photos",
        "truth", "truth_crs", "match", "worst", "to", "port", "arch", "weights", "preset", "steps", "epochs", "batch",
        "learning_rate", "copy_paste", "check_every", "patience", "held_out", "split_by", "workers", "seed", "trees",
        "fruits_per_tree", "bunch_share", "variety", "light", "photos_per_side", "photos_round_end", "rough",
        "second_look", "scene", "packing",
        "markers_crs", "gcp", "positions", "days_later", "drop_share", "dates",
        "hand_counts", "scheduler", "host", "until", "idle",
    )
)  # fmt: skip


def with_options(message: str) -> str:
    """Return a message in which parameters in backticks, such as `score_threshold`, are options: --score-threshold."""
    return re.sub(r"`(\w+)`", lambda found: _option(found[1]) or found[0], message)


def all_with_options(value: Any) -> Any:
    """Return a value made for JSON, each text in its lists and objects (not their keys) as `with_options` gives it."""
    if isinstance(value, str):
        return with_options(value)
    if isinstance(value, list):
        return [all_with_options(entry) for entry in value]
    return {key: all_with_options(entry) for key, entry in value.items()} if isinstance(value, dict) else value


def _option(parameter: str) -> str | None:
    if parameter in SAME_NAMES:
        return "--" + parameter.replace("_", "-")
    return OTHER_NAMES.get(parameter)
