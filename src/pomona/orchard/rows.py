"""A survey as a line of the orchard's table of rows, with its trees and fruits, all of them placed on the map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.formats.layers import Kind, Layer, fruit_layer, kinds_of, on_ground, tree_layer
from pomona.formats.tables import FRUIT_COLUMNS, TREE_COLUMNS, read_fruits, read_segments, read_trees
from pomona.orchard.jobs import JobOutcome
from pomona.orchard.plan import PlannedSurvey
from pomona.survey import SurveyFolder
from pomona.survey.facts import frame_from
from pomona.values.cameras import WorldFrame
from pomona.values.crop import Crop, RowSegments
from pomona.values.fruits import TotalWeight
from pomona.values.trees import Trees

_WHICH: dict[str, Kind] = {"row": "text", "date": "text"}
ROW_COLUMNS: Mapping[str, Kind] = {
    **_WHICH, "survey": "text", "state": "text", "reason": "text", "newest": "whole", "photos": "whole",
    "photos_used": "whole", "fruits": "whole", "all_fruits": "real", "all_low": "real", "all_high": "real",
    "trees": "whole", "fruits_on_trees": "whole", "length_m": "real", "all_per_metre": "real", "weight_kg": "real",
    "diameter_mm": "real", "scale": "text", "crs": "text", "warnings": "whole",
}  # fmt: skip
TREES: Mapping[str, Kind] = {**_WHICH, **kinds_of(TREE_COLUMNS)}
FRUITS: Mapping[str, Kind] = {**_WHICH, **kinds_of(FRUIT_COLUMNS)}
CHANGE_COLUMNS: Mapping[str, Kind] = {
    "row": "text", "before": "text", "after": "text", "state": "text", "reason": "text", "days": "real",
    "fruits_before": "whole", "fruits_after": "whole", "same": "whole", "gone": "whole", "out_of_view": "whole",
    "new": "whole", "really_gone": "real", "really_gone_low": "real", "really_gone_high": "real", "growth_mm": "real",
    "growth_low_mm": "real", "growth_high_mm": "real", "growth_mm_per_day": "real",
}  # fmt: skip

EMPTY_LAYERS = (
    Layer("rows", ROW_COLUMNS, [], np.zeros((0, 2, 2)), "all_per_metre"),
    Layer("trees", TREES, [], np.zeros((0, 1, 2)), "fruits"),
    Layer("fruits", FRUITS, [], np.zeros((0, 1, 3)), "diameter_m"),
    Layer("changes", CHANGE_COLUMNS, [], np.zeros((0, 2, 2)), "growth_mm"),
)
"""The tables without a line: an orchard has all of them, whatever was found."""

_NOWHERE = np.full((1, 2, 2), np.nan)


@dataclass(frozen=True, eq=False)
class RowTables:
    """What one survey adds to the orchard's tables."""

    row: Layer
    trees: Layer
    fruits: Layer


def tables_of(survey: SurveyFolder, planned: PlannedSurvey) -> RowTables:
    """Return what a finished survey adds.

    Places are WGS 84 where the survey has a place on Earth, and otherwise not known. Raises `MissingFileError` and
    `FormatError` for tables that are not there or damaged.
    """
    survey.need(survey.fruits, survey.trees, survey.segments)
    fruits, segments = read_fruits(survey.fruits), read_segments(survey.segments)
    trees = _of_this_row(read_trees(survey.trees))
    records = survey.records
    frame = frame_from(records["scale"].info["frame"])
    results = records["results"].info
    crop, weight = Crop.from_json(results.get("crop")), TotalWeight.from_json(results.get("weight"))
    ends, length = _ends(segments)
    # Without a scale, sizes are in no unit.
    known = fruits.diameters_m[np.isfinite(fruits.diameters_m) & frame.metric]
    cells = {
        **_head(planned),
        "state": "done",
        "reason": "",
        "photos": len(survey.get("photos", ())),
        "photos_used": int(records["scale"].info["photos"]),
        "fruits": len(fruits),
        "all_fruits": round(crop.fruits.value, 1) if crop else None,
        "all_low": round(crop.fruits.low, 1) if crop else None,
        "all_high": round(crop.fruits.high, 1) if crop else None,
        "trees": len(trees),
        "fruits_on_trees": int(np.isin(fruits.tree_ids, trees.ids).sum()),
        "length_m": round(length, 2) if length else None,
        "all_per_metre": round(crop.per_metre.value, 2) if crop and crop.per_metre else None,
        "weight_kg": round(weight.kg, 3) if weight else None,
        "diameter_mm": round(1000 * float(np.median(known)), 1) if len(known) else None,
        "scale": frame.scale_source,
        "crs": frame.crs or "",
        "warnings": len(survey.get("warnings", ())),
    }
    which = {"row": planned.row, "date": _day(planned)}
    places = _NOWHERE if ends is None else on_ground(ends, frame)[None]
    return RowTables(
        row=_on_map(Layer("rows", ROW_COLUMNS, [cells], places, "all_per_metre"), frame),
        trees=_on_map(_of_row(tree_layer(trees, frame), TREES, which), frame),
        fruits=_on_map(_of_row(fruit_layer(fruits, frame), FRUITS, which), frame),
    )


def row_without_survey(planned: PlannedSurvey, outcome: JobOutcome | None) -> Layer:
    """Return the line of a row whose survey failed or was not made, with the reason."""
    cells: dict[str, Any] = dict.fromkeys(ROW_COLUMNS)
    cells |= _head(planned)
    cells |= {"state": outcome.state if outcome else "missing", "reason": outcome.reason if outcome else ""}
    return Layer("rows", ROW_COLUMNS, [cells], _NOWHERE, "all_per_metre")


def change_layer(pair: tuple[PlannedSurvey, PlannedSurvey], outcome: JobOutcome, places: FloatArray) -> Layer:
    """Return the line of a comparison; `places` (2, 2) are those of the row, NaN where it has none."""
    before, after = pair
    figures, cells = outcome.figures, dict.fromkeys(CHANGE_COLUMNS)
    cells |= {name: figures[name] for name in CHANGE_COLUMNS if isinstance(figures.get(name), int | float)}
    growth, gone = figures.get("growth_mm") or {}, figures.get("gone_estimate") or {}
    cells |= {"row": after.row, "before": _day(before), "after": _day(after)}
    cells |= {"state": outcome.state, "reason": outcome.reason or " ".join(figures.get("warnings", ()))}
    cells |= {
        "growth_mm": growth.get("value"),
        "growth_low_mm": growth.get("low"),
        "growth_high_mm": growth.get("high"),
    }
    cells |= {f"really_gone{end}": gone.get(key) for end, key in (("", "value"), ("_low", "low"), ("_high", "high"))}
    return Layer("changes", CHANGE_COLUMNS, [cells], places[None], "growth_mm")


def _head(planned: PlannedSurvey) -> dict[str, Any]:
    # Which is the newest can be said once all surveys of the row have been read.
    return {"row": planned.row, "date": _day(planned), "survey": planned.name, "newest": 0}


def _day(planned: PlannedSurvey) -> str:
    return "" if planned.day is None else planned.day.isoformat()


def _of_row(layer: Layer, columns: Mapping[str, Kind], which: Mapping[str, str]) -> Layer:
    return replace(layer, columns=columns, rows=[{**which, **row} for row in layer.rows])


def _of_this_row(trees: Trees) -> Trees:
    """The trees that the survey's photos look at: of a table of the whole orchard, each survey has all trees."""
    estimated = np.isfinite(trees.all_fruits)
    if not estimated.any():  # too little was found to say which they are
        return trees
    here = estimated | (trees.fruits > 0)
    return Trees(**{each.name: getattr(trees, each.name)[here] for each in fields(Trees)})


def _on_map(layer: Layer, frame: WorldFrame) -> Layer:
    """The layer, with places where these are on Earth: rows in frames of their own would lie over each other."""
    return layer if frame.crs is not None else replace(layer, geometries=np.full_like(layer.geometries, np.nan))


def _ends(segments: RowSegments) -> tuple[FloatArray | None, float]:
    """Both ends (2, 2) of a row, and its length; None and 0 where its parts are not known."""
    if not len(segments):
        return None, 0.0
    lengths = np.linalg.norm(segments.ends_in_world - segments.starts_in_world, axis=1)
    return np.stack([segments.starts_in_world[0], segments.ends_in_world[-1]]), float(lengths.sum())
