"""Orchards for the tests: rows of which everything is known beforehand, and surveys that are finished already."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pomona.formats.tables import write_fruits, write_segments, write_trees
from pomona.orchard.folder import OrchardFolder
from pomona.orchard.jobs import Attempt, JobOutcome
from pomona.orchard.places import Place
from pomona.orchard.plan import Orchard
from pomona.values.cameras import local_crs
from pomona.values.crop import RowSegments
from pomona.values.fruits import Fruits
from pomona.values.trees import Trees
from view_scenes import write_view_survey

# What a run makes of the same photos, whoever runs it; `survey.json` and `report.html` have times in them.
RESULTS = (
    "detections.json", "cameras/cameras.txt", "cameras/images.txt", "cameras/points3D.txt", "fruits.csv", "trees.csv",
    "segments.csv", "fruits.geojson", "observations.csv", "cloud.laz", "contact_sheet.jpg",
)  # fmt: skip


def write_rows(folder: Path, rows: Sequence[Mapping[str, Any]], *, head: str = "") -> Path:
    """Write photos, masks and cameras of rows, and an `orchard.toml` of them; each is of so many fruits (`count`)."""
    text = f'title = "Test orchard"\n{head}\n[defaults]\nsides = "none"\n'
    for k, row in enumerate(rows):
        write_view_survey(folder / f"row-{k}", count=row.get("count", 16), per_side=3)
        text += f'[[survey]]\nrow = "{row["row"]}"\n'
        text += f"date = {row['date']}\n" if "date" in row else ""
        text += f'photos = ["row-{k}/photos"]\ndetections = "row-{k}/survey/detections.json"\n'
        text += f'cameras = "row-{k}/survey/cameras"\n'
    path = folder / "orchard.toml"
    path.write_text(text)
    return path


def digests(survey: Path) -> dict[str, str]:
    """The bytes of a survey's results."""
    return {name: hashlib.sha256((survey / name).read_bytes()).hexdigest() for name in RESULTS}


def write_finished(orchard: Orchard, *, fruits: int = 30) -> None:
    """Write finished surveys of all rows, 40 m long and 4 m apart; the first has `fruits`, each next one more."""
    folder = OrchardFolder(Place(orchard.out))
    for k, planned in enumerate(orchard.surveys):
        survey = folder.survey(planned.name).path
        survey.mkdir(parents=True)
        _write_survey(survey, fruits + k, seed=k, north_m=4.0 * k)
        attempt = Attempt("here 1", "2026-07-01T08:00:00+00:00", 1.0)
        folder.keep("surveys", JobOutcome(name=planned.name, state="done", attempts=(attempt,), plan=planned.key))


def _write_survey(survey: Path, count: int, *, seed: int, north_m: float) -> None:
    rng = np.random.default_rng(seed)
    centers = np.column_stack([rng.uniform(0, 40, count), rng.normal(0, 0.2, count), rng.uniform(0.5, 2.5, count)])
    diameters = rng.normal(0.075, 0.004, count)
    ids = np.arange(1, count + 1)
    trees = 1 + (centers[:, 0] // 10).astype(np.int64)
    write_fruits(
        survey / "fruits.csv",
        Fruits(ids, centers, diameters, np.full(count, 0.9), np.full(count, 4), tree_ids=trees),
    )
    on_each = np.bincount(trees, minlength=5)[1:]
    nothing = np.full(4, np.nan)
    places = np.column_stack([np.arange(4) * 10.0 + 5, np.zeros(4)])
    write_trees(
        survey / "trees.csv",
        Trees(np.arange(1, 5), places, on_each, on_each, on_each, nothing, nothing, nothing, nothing),
    )
    ends = np.column_stack([np.arange(1, 41.0), np.zeros(40)])
    in_part = np.histogram(centers[:, 0], np.arange(41))[0]
    every = in_part * 1.25
    segments = RowSegments(ends - [1, 0], ends, in_part, every, every - 1, every + 1, np.full(40, np.nan))
    write_segments(survey / "segments.csv", segments)
    interval = {"value": 1.25 * count, "low": 1.2 * count, "high": 1.4 * count, "covers": "all"}
    metre = {**interval, "value": 1.25 * count / 40, "low": 1.2 * count / 40, "high": 1.4 * count / 40}
    crop = {"seen": interval, "fruits": interval, "per_metre": metre, "weight_kg": None, "sides": 2,
            "calibration": None, "sizes": None}  # fmt: skip
    weight = {"kg": 0.18 * count, "low_kg": 0.17 * count, "high_kg": 0.19 * count, "mean_g": 180.0, "weighed": count,
              "source": "test"}  # fmt: skip
    crs = local_crs(41.62 + north_m / 111_195, 0.87)
    frame = {
        "scale_source": "gnss",
        "approximate": False,
        "up_is_known": True,
        "crs": crs,
        "origin": [41.62, 0.87, 2.0],
    }
    done = {"fingerprint": "x", "finished": True, "outputs": {}}
    manifest = {
        "format": "pomona-survey",
        "photos": [{"name": f"IMG_{k}.JPG", "side": "row"} for k in range(10)],
        "stages": {
            "scale": {**done, "info": {"frame": frame, "photos": 9}},
            "results": {**done, "info": {"fruits": count, "crop": crop, "weight": weight}},
            "report": {**done, "info": {}},
        },
    }
    (survey / "survey.json").write_text(json.dumps(manifest))
