"""`pomona reconstruct`, `fuse`, `measure`, `report`: the later stages of a survey one by one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pomona.cli import options as shared
from pomona.cli.action import with_progress
from pomona.cli.summary import show
from pomona.pipeline import Summary, go_on
from pomona.pipeline.options import parse_scale_bar

if TYPE_CHECKING:
    from pomona.evaluate.fruits import Truth

_DIAMETER = Annotated[float | None, typer.Option(metavar="METRES", help="Diameter of an average fruit.")]
_DICTIONARY = Annotated[str | None, typer.Option(metavar="NAME", help="ArUco dictionary of the markers.")]
_METHOD = Annotated[str | None, typer.Option(metavar="object|paper", help="Method that turns masks into fruits.")]


def reconstruct(
    survey: shared.SurveyArgument,
    markers: shared.Markers = None,
    markers_crs: shared.MarkersCrs = None,
    gcp: shared.Gcp = None,
    scale_bar: shared.ScaleBar = None,
    marker_dictionary: _DICTIONARY = None,
    fruit_diameter: _DIAMETER = None,
    cameras: shared.Cameras = None,
    as_json: shared.Json = False,
) -> None:
    """Find the cameras of a survey, in metres: writes SURVEY/cameras.

    Options that are not given keep their earlier values; --markers and --gcp replace each other.
    """
    changed = {
        "markers": markers,
        "markers_crs": markers_crs,
        "gcp": gcp,
        "scale_bar": parse_scale_bar(scale_bar),
        "marker_dictionary": marker_dictionary,
        "fruit_diameter_m": fruit_diameter,
        "cameras": cameras,
    }
    replaced: dict[str, Any] = {}
    if gcp is not None and markers is None:
        replaced = {"markers": None, "markers_crs": None}
    elif markers is not None and gcp is None:
        replaced = {"gcp": None}
    show(_go_on(survey, "scale", _given(changed) | replaced), as_json=as_json)


def fuse(
    survey: shared.SurveyArgument,
    method: _METHOD = None,
    variant: shared.Variant = None,
    as_json: shared.Json = False,
) -> None:
    """Join the detections of a survey's photos into fruits. --method without --variant resets the variant."""
    changed: dict[str, Any] = _given({"method": method, "variant": variant})
    if method is not None:
        changed["variant"] = variant
    show(_go_on(survey, "filter", changed), as_json=as_json)


def measure(
    survey: shared.SurveyArgument,
    fruit: shared.Fruit = None,
    weights: shared.Weights = None,
    trees: shared.Trees = None,
    tree_spacing: shared.TreeSpacing = None,
    as_json: shared.Json = False,
) -> None:
    """Measure and weigh the fruits of a survey, assign them to trees, and write tables, map and cloud.

    Options that are not given keep their earlier values; --trees and --tree-spacing replace each other.
    """
    changed: dict[str, Any] = _given({"fruit": fruit, "weights": weights})
    if trees is not None or tree_spacing is not None:
        changed |= {"trees": trees, "tree_spacing": tree_spacing}
    show(_go_on(survey, "results", changed), as_json=as_json)


def report(
    survey: shared.SurveyArgument,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Also print to report.pdf; needs Chromium, Chrome or Edge.")
    ] = False,
    truth: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="True fruits: also write report-truth.html with the paper's scores."),
    ] = None,
    truth_crs: shared.TruthCrs = None,
    packing: shared.Packing = None,
    as_json: shared.Json = False,
) -> None:
    """Write the report of a survey again; missing stages are run first."""
    from pomona.evaluate.fruits import read_truth
    from pomona.stages.report.pdf import write_pdf
    from pomona.survey import SurveyFolder

    true_fruits = None if truth is None else read_truth(truth)  # a mistake in it is said before any stage is run
    summary = _go_on(survey, "report", _given({"packing": packing}))
    files = SurveyFolder.open(survey)
    page, made = files.report, []
    try:
        if true_fruits is not None:
            page = files.truth_report
            _write_truth_report(survey, true_fruits, truth_crs, page)
            made.append(page)
        if pdf:
            write_pdf(page, files.pdf)
            made.append(files.pdf)
    finally:  # the report itself is written, even where these could not be
        show(summary, as_json=as_json, files=made)


def _write_truth_report(survey: Path, true_fruits: Truth, truth_crs: str | None, path: Path) -> None:
    from pomona.browser.view.reading import read_survey
    from pomona.stages.report import write_report
    from pomona.survey.files import write_file

    data = read_survey(survey)
    placed = true_fruits.brought_from(truth_crs, data.cameras.frame)
    write_file(path, lambda part: write_report(data, part, truth=placed))


def _go_on(survey: Path, until: str, changed: dict[str, Any]) -> Summary:
    return with_progress(
        lambda progress: go_on(survey, progress, until=until, changed=changed, on_stage=progress.stage), survey
    )


def _given(options: dict[str, Any]) -> dict[str, Any]:
    """Return what was given: options left out stay as they were."""
    return {name: value for name, value in options.items() if value is not None}
