"""What a person says of a row in the page, as options of a run, as a command, and as lines of Python."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import is_dataclass
from pathlib import Path

from pomona.browser.app.contract import Equal, NewSurvey
from pomona.browser.app.folders import Folders
from pomona.errors import InputError, PomonaError, SurveyError
from pomona.pipeline import RunOptions
from pomona.pipeline.options import COMMAND_NAMES
from pomona.survey import SurveyFolder
from pomona.survey.commands import command_line

# Options whose name is not that of the parameter.
_OTHER_NAMES = {field: said.replace("_", "-") for said, field in COMMAND_NAMES.items()}
_UNFIT = re.compile(r"[\x00-\x1f/\\:*?\"<>|]+")


def folder_name(name: str) -> str:
    """Return a name as a folder can have it; raises `InputError` where nothing is left of it."""
    fit = _UNFIT.sub("-", name.strip()).strip(" .-")[:100]
    if not fit:
        raise InputError("The survey needs a name: that of the row, for example")
    return fit


def options_of(asked: NewSurvey, folders: Folders) -> tuple[list[Path], RunOptions]:
    """Return the photos and options that a person means.

    Raises errors of `pomona.errors` for what cannot be used: folders outside of those shown, files that cannot be read.
    """
    if not 1 <= len(asked.photos) <= 2:
        raise InputError("Choose the folder of the photos, two folders (one for each side of the row), or a video")
    photos = [folders.allowed(Path(photo)) for photo in asked.photos]
    if asked.metres == "markers" and not asked.markers:
        raise InputError("Choose the table that says where the markers are: a CSV with the columns id, x, y, z")
    bar = asked.scale_bar
    fits = len(bar) == 3 and bar[2] > 0 and bar[0] != bar[1] and all(end.is_integer() for end in map(float, bar[:2]))
    if asked.metres == "scale-bar" and not fits:
        raise InputError("The scale bar needs the numbers of its two markers, and the metres between their centres")
    if asked.diameter_mm is not None and not 2 <= asked.diameter_mm <= 500:
        raise InputError(f"The usual diameter of a fruit is {asked.diameter_mm:g} mm: expected 2 to 500 mm")
    if asked.tree_spacing_m is not None and not 0.1 <= asked.tree_spacing_m <= 50:
        raise InputError(f"Trees stand {asked.tree_spacing_m:g} m apart: expected 0.1 to 50 m")
    options = RunOptions(
        sides="none" if asked.one_side else "auto",
        fruit=asked.fruit or None,
        fruit_diameter_m=None if asked.diameter_mm is None else round(asked.diameter_mm / 1000, 6),
        markers=folders.allowed(Path(asked.markers)) if asked.metres == "markers" else None,
        scale_bar=(int(bar[0]), int(bar[1]), float(bar[2])) if asked.metres == "scale-bar" else None,
        use_gnss=asked.metres != "nothing",
        tree_spacing=asked.tree_spacing_m,
    )
    options.check_files()
    return photos, options


def run_arguments(photos: Sequence[Path], out: Path, options: RunOptions, *, adapt: bool = False) -> tuple[str, ...]:
    """Return the arguments of `pomona` that make a survey with these options.

    Raises `InputError` where they have options of single stages, which the command line does not know.
    """
    arguments = ["run", *map(str, photos), "--out", str(out)]
    for name, value in _said(options).items():
        if is_dataclass(value):
            raise InputError(f"`{name}` was set in Python: go on with the survey there")
        option = _OTHER_NAMES.get(name, name.replace("_", "-"))
        if isinstance(value, bool):
            arguments.append(f"--{option}" if value else f"--no-{option}")
        else:
            arguments += [f"--{option}", _text(value)]
    return (*arguments, *(["--adapt"] if adapt else []))


def equal_to(photos: Sequence[Path], out: Path, options: RunOptions, *, adapt: bool = False) -> Equal:
    """Return the command, and the lines of Python, that do the same; raises as `run_arguments` does."""
    said = {name: str(value) if isinstance(value, Path) else value for name, value in _said(options).items()}
    given = str(photos[0]) if len(photos) == 1 else [str(photo) for photo in photos]
    values = [repr(given), repr(str(out)), *(f"{name}={value!r}" for name, value in said.items())]
    call = f"pomona.run({', '.join([*values, *(['adapt=True'] if adapt else [])])})"
    command = command_line(["pomona", *run_arguments(photos, out, options, adapt=adapt)])
    return Equal(command, f"import pomona\n\nsurvey = {call}\nsurvey.fruits.to_pandas()")


def equal_of_survey(survey: SurveyFolder) -> Equal:
    """Return what makes a survey that a run began, wherever that was; without options, what opens it."""
    try:
        return equal_to(*begun_with(survey))
    except PomonaError:
        folder = str(survey.folder)
        python = f"import pomona\n\nsurvey = pomona.open({folder!r})\nsurvey.fruits.to_pandas()"
        return Equal(command_line(["pomona", "report", folder]), python)


def begun_with(survey: SurveyFolder) -> tuple[list[Path], Path, RunOptions]:
    """Return the photos, the folder and the options of a survey; raises `SurveyError` where it does not say them."""
    sources, options = survey.get("sources"), survey.options
    if not sources or options is None:
        raise SurveyError(f"{survey.folder} does not say of which photos it is: begin a new survey with them")
    return [Path(source) for source in sources], survey.folder, RunOptions.from_json(options)


def _said(options: RunOptions) -> dict[str, object]:
    """The options that are not as they are by themselves."""
    usual = vars(RunOptions())
    return {name: value for name, value in vars(options).items() if value != usual[name]}


def _text(value: object) -> str:
    return ",".join(map(_text, value)) if isinstance(value, tuple) else str(value)
