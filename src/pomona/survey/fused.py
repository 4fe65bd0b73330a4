"""Fruits, their observations and their points between stages: a `.npz` file in `work/` for each stage."""

from __future__ import annotations

from pathlib import Path

from pomona.errors import FormatError, InputError
from pomona.stages.fuse import Fused, Shown
from pomona.survey.folder import SurveyFolder
from pomona.survey.values import arrays_of, columns_from, read_arrays, write_arrays
from pomona.values.fruits import FruitCloud, Fruits, Observations

_SHOWN = "shown/"  # of fruits that were looked at again


def fused_path(survey: SurveyFolder, stage: str) -> Path:
    """Return where the fruits of a stage are kept."""
    return survey.work(f"{stage}.npz")


def write_fused(survey: SurveyFolder, stage: str, fused: Fused) -> None:
    """Keep the fruits of a stage."""
    arrays = {
        **arrays_of(fused.fruits, "fruits/"),
        **arrays_of(fused.observations, "observations/"),
        **arrays_of(fused.cloud, "cloud/"),
        **({} if fused.shown is None else arrays_of(fused.shown, _SHOWN)),
    }
    write_arrays(fused_path(survey, stage), arrays)


def read_fused(survey: SurveyFolder, stage: str) -> Fused:
    """Return the fruits that `write_fused` kept.

    Raises `MissingFileError`, and `FormatError` when the file is damaged or another version wrote it.
    """
    arrays = read_arrays(fused_path(survey, stage))
    shown = columns_from(Shown, arrays, _SHOWN) if any(name.startswith(_SHOWN) for name in arrays) else None
    columns = (
        columns_from(Fruits, arrays, "fruits/"),
        columns_from(Observations, arrays, "observations/"),
        columns_from(FruitCloud, arrays, "cloud/"),
    )
    try:
        return Fused(*columns, shown)
    except InputError as error:
        raise FormatError(f"{fused_path(survey, stage)}: {error}: run again") from None
