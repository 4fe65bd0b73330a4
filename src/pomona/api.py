"""Pomona in Python: `pomona.run`, `pomona.open`, and the survey that both return."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import date
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pomona.basics.option_values import expect_kind
from pomona.errors import InputError, SurveyError
from pomona.export.survey import SurveySource, export_survey
from pomona.pipeline.options import RunOptions, named_options
from pomona.progress import Progress, Silent, words_of
from pomona.survey import SurveyFolder
from pomona.survey.photos import RUN_AGAIN, SAY_WHERE
from pomona.survey.unfinished import unfinished_in_words

if TYPE_CHECKING:
    from collections.abc import Callable

    from pomona.browser.view import FolderOptions, ViewServer
    from pomona.change import Comparison
    from pomona.evaluate.fruits import Scores
    from pomona.learning.self_training.learn import Adapted
    from pomona.learning.self_training.options import AdaptOptions

AnyPath = str | PathLike[str]
_HIGHEST_PORT = 65535


class Survey(SurveySource):
    """A survey: its results as values, each read from its folder when it is first asked for.

    `fruits`, `observations`, `detections`, `cameras`, `photos` and `cloud` are frozen dataclasses of arrays, with units
    in their names, metres and z up; `frame` says what the coordinates mean. Make it with `pomona.run` or `pomona.open`.

    Whatever is asked for and not there raises `MissingFileError`, which names the command that writes it; damaged files
    raise `FormatError`. Photos that are not found are no error: `progress` is warned.
    """

    def __repr__(self) -> str:
        return f"Survey({str(self.folder)!r})"

    def evaluate(self, truth: AnyPath, *, match: str = "auto", truth_crs: str | None = None) -> Scores:
        """Return the paper's scores against true fruits in a table of centres and diameters, or of boxes.

        `match`: what makes a found fruit a true one ("auto", "centers", "boxes", "inside"). `truth_crs`: the coordinate
        system of the table's places, such as "EPSG:25831", with heights in metres (None: they are in the survey's
        frame). Warns where hardly any fruit matches. Raises `MissingFileError`, `FormatError` for a table that cannot
        be read, and `InputError` for sizes in another unit, and for a system where the survey has no place on Earth.
        """
        from pomona.evaluate.fruits import EvaluateOptions, evaluate_fruits, frame_doubt, read_truth

        options = EvaluateOptions(match=match)  # type: ignore[arg-type]
        true_fruits = read_truth(_path("truth", truth)).brought_from(truth_crs, self.frame)
        scores = evaluate_fruits(self.fruits, true_fruits, options=options)
        if doubt := frame_doubt(self.fruits, true_fruits, scores):
            self.progress.warn(doubt)
        return scores

    def export(self, to: str, path: AnyPath | None = None) -> Path:
        """Write the survey in the format `to` ("gpkg", "colmap", …), by default in its folder `export/`; return where.

        Raises `InputError` for a format that does not exist, `SurveyError` where `path` exists, `MissingFileError`
        where the survey has not got so far.
        """
        target = _path_or_none("path", path)
        if target is not None and target.exists():
            raise SurveyError(f"{target} exists already: name another file")
        return export_survey(to, self, target)

    def viewer(self, *, port: int = 0, truth: AnyPath | None = None, truth_crs: str | None = None) -> ViewServer:
        """Return the server of the page of this survey, on this computer alone.

        `url` says where the page is, `serve_forever` serves it; it is a context manager, too. `port` 0 takes a free
        one. `truth` and `truth_crs` are those of `evaluate`. Corrections are made in the page; tables and values have
        them when the context ends. Raises `InputError` where the port is taken or is none.
        """
        from pomona.browser.view import Corrector, ViewServer

        if not 0 <= expect_kind("`port`", int, port) <= _HIGHEST_PORT:
            raise InputError(f"`port`: expected 0 to {_HIGHEST_PORT}, found {port}")
        corrector = Corrector.of(self, _path_or_none("truth", truth), truth_crs)
        if corrector.note and self.files.corrections.is_file():
            self.progress.warn(corrector.note)
        try:
            return ViewServer(
                corrector.data,
                port=port,
                truth=corrector.truth,
                corrector=corrector,
                on_changed=self.bring_up_to_date,
            )
        except OSError as error:
            reason = error.strerror or error
            raise InputError(f"`port` {port}: {reason}: choose another, or none for a free one") from None

    def export_view(
        self,
        folder: AnyPath,
        *,
        truth: AnyPath | None = None,
        truth_crs: str | None = None,
        options: FolderOptions | None = None,
    ) -> Path:
        """Write the page of this survey as a folder that opens from disk, with its photos; return the page's path.

        `options` say how large photos and page are. Raises `SurveyError` where the folder holds something else.
        """
        from pomona.browser.view import Corrector, export_folder

        corrector = Corrector.of(self, _path_or_none("truth", truth), truth_crs)
        return export_folder(
            corrector.data, _path("folder", folder), truth=corrector.truth, options=options, progress=self.progress
        )

    def view(self, *, port: int = 0, truth: AnyPath | None = None, truth_crs: str | None = None) -> None:
        """Show the survey in the browser until Ctrl-C, then bring its tables up to date with what was corrected."""
        import webbrowser

        with self.viewer(port=port, truth=truth, truth_crs=truth_crs) as server:
            webbrowser.open(server.url)
            with contextlib.suppress(KeyboardInterrupt):
                server.serve_forever()


def run(
    photos: AnyPath | Sequence[AnyPath],
    out: AnyPath,
    *,
    progress: Progress | None = None,
    on_stage: Callable[[str], None] = lambda name: None,
    overwrite: bool = False,
    adapt: bool = False,
    **options: Any,
) -> Survey:
    """Find every fruit in photos of a row, as `pomona run` does; return the survey in the folder `out`.

    `photos`: a folder, two folders (the sides of the row), or a video. `options` are those of `RunOptions`: `markers`,
    `cameras`, `detections`, `method`, `tree_spacing`, …, and options of single stages such as
    `object=ObjectOptions(min_views=3)`; `fruit_diameter`, `gnss` and `filter` (true or false) are names of
    `fruit_diameter_m`, `use_gnss` and `filter_false_positives`, as the command has them. A run that was stopped goes on
    where it was; a changed option redoes just what depends on it; `overwrite` begins anew. `adapt`: the segmenter
    learns from the survey, which is then made again (as `pomona.adapt`). `progress` is informed of steps and warned
    (None: nobody is); `on_stage` is called with the name of each stage that is computed, first of all with "photos".

    Raises `InputError` for options and photos that cannot be used, `MissingFileError` and `FormatError` for files
    named, `MissingExtraError` for a detector whose packages are not installed, `ReconstructionError` where no photo can
    be placed, and `SurveyError` where `out` holds something else or the disk is full.
    """
    from pomona.pipeline import run as run_pipeline

    paths, target, chosen = _paths("photos", photos), _path("out", out), RunOptions(**named_options(options))
    if adapt:
        from pomona.learning.self_training.rerun import run_adapted

        run_adapted(paths, target, chosen, progress or Silent(), overwrite=overwrite, on_stage=on_stage)
    else:
        run_pipeline(paths, target, chosen, progress, overwrite=overwrite, on_stage=on_stage)
    return open(out, progress=progress)


def open(folder: AnyPath, *, photos: AnyPath | None = None, progress: Progress | None = None) -> Survey:
    """Open the survey in a folder that `pomona run` or `pomona.run` wrote.

    Its tables are first brought up to date with its corrections. `photos` is where its photos are, if they are not
    where they were; `progress` is warned where the last run was not finished, so that results are of different runs.

    Raises `MissingFileError` where there is none, and `SurveyError` where the folder holds something else.
    """
    return _opened(folder, progress, photos=_path_or_none("photos", photos))


def _opened(
    folder: AnyPath, progress: Progress | None, *, photos: Path | None = None, if_moved: str = SAY_WHERE
) -> Survey:
    """Open a survey; `if_moved` is what to do where its photos are not found, in words."""
    from pomona.pipeline.reopen import bring_up_to_date

    progress = progress or Silent()
    survey = SurveyFolder.open(_path("folder", folder))
    if survey.record_of("results") is not None:
        bring_up_to_date(survey, progress)
    if said := unfinished_in_words(survey):
        progress.warn(said)
    return Survey(survey, photos_folder=photos, progress=progress, if_moved=if_moved)


def compare(
    before: AnyPath | Survey,
    after: AnyPath | Survey,
    *,
    out: AnyPath | None = None,
    dates: tuple[date, date] | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Find the fruits of one survey of a row in a later one: growth, and which are gone; return the `Comparison`.

    The surveys may be in any frames. `dates` are those of the two, where their photos do not say them. `out` is a
    folder for tables, plot and page. `progress` hears of warnings (None: that of the second survey). Raises
    `InputError` where they have nothing in common, `MissingFileError` for a survey that has no fruits yet, and
    `SurveyError` where `out` holds something else.
    """
    from pomona.browser.view.reading import page_data
    from pomona.change import compare_surveys
    from pomona.change.page import write_comparison

    expect_kind("`dates`", tuple[date, date] | None, dates)
    target = _path_or_none("out", out)
    surveys = [s if isinstance(s, Survey) else _opened(s, progress, if_moved=RUN_AGAIN) for s in (before, after)]
    listener = progress or surveys[1].progress
    found = compare_surveys(surveys[0], surveys[1], dates=dates)
    found = replace(found, warnings=tuple(map(words_of(listener), found.warnings)))
    for warning in found.warnings:
        listener.warn(warning)
    if target is not None:
        names = surveys[0].folder.name, surveys[1].folder.name
        write_comparison(found, page_data(surveys[1]), names, target)
    return found


def adapt(
    surveys: AnyPath | Sequence[AnyPath],
    out: AnyPath,
    *,
    model: AnyPath | None = None,
    options: AdaptOptions | None = None,
    progress: Progress | None = None,
) -> Adapted:
    """Let a segmenter learn from fruits of surveys that many photos confirm, or a person marked; write it to `out`.

    `model` is the model file to begin with, by default the one that the first survey was made with. What comes back
    says how well fruits in photos held out were found before and after; its `path` is None, and no file was written,
    where that was worse.

    Raises `MissingExtraError` without the extra `train`, `InputError` for surveys that confirm too few fruits, a file
    name that does not end in .onnx or detections that no model of Pomona's made, and what `open` raises.
    """
    from pomona.learning.self_training.rerun import found_fruits, learning, model_of

    given, target = _paths("surveys", surveys), _path("out", out)
    learn, opened = learning(), [_opened(each, progress, if_moved=RUN_AGAIN) for each in given]
    begun = model_of(opened[0]) if model is None else _path("model", model)
    found = [found_fruits(survey) for survey in opened]
    return learn(found, target, model=begun, options=options, progress=progress)


def sample_folder() -> Path:
    """Return the folder of the bundled sample: photos of two rendered trees from both sides, markers, true fruits."""
    return Path(str(files("pomona"))) / "demo"


def _path(name: str, given: Any) -> Path:
    """A path that a parameter names; anything else would fail far from here, and not as a `PomonaError`."""
    return Path(expect_kind(f"`{name}`", Path, given))


def _path_or_none(name: str, given: Any) -> Path | None:
    return None if given is None else _path(name, given)


def _paths(name: str, given: Any) -> list[Path]:
    each = given if isinstance(given, Iterable) and not isinstance(given, str | bytes | PathLike) else [given]
    return [_path(name, path) for path in each]
