"""Fruits, their observations and their points between stages: a `.npz` file in `work/` for each stage."""

from __future__ import annotations

from pathlib import Path

from pomona.fruits import FruitCloud, Fruits, Observations
from pomona.fuse.fused import Fused
from pomona.survey.folder import SurveyFolder
from pomona.survey.values import arrays_of, columns_from, read_arrays, write_arrays


def fused_path(survey: SurveyFolder, stage: str) -> Path:
    """Return where the fruits of a stage are kept."""
    return survey.work(f"{stage}.npz")


def write_fused(survey: SurveyFolder, stage: str, fused: Fused) -> None:
    """Keep the fruits of a stage."""
    arrays = {
        **arrays_of(fused.fruits, "fruits/"),
        **arrays_of(fused.observations, "observations/"),
        **arrays_of(fused.cloud, "cloud/"),
    }
    write_arrays(fused_path(survey, stage), arrays)


def read_fused(survey: SurveyFolder, stage: str) -> Fused:
    """Return the fruits that `write_fused` kept.

    Raises `MissingFileError`, and `FormatError` when the file is damaged or another version wrote it.
    """
    arrays = read_arrays(fused_path(survey, stage))
    return Fused(
        columns_from(Fruits, arrays, "fruits/"),
        columns_from(Observations, arrays, "observations/"),
        columns_from(FruitCloud, arrays, "cloud/"),
    )
