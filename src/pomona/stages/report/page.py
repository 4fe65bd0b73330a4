"""The page: `report.html`, one file that opens from disk and fetches nothing; and the same page for `pomona view`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING

import numpy as np

from pomona.stages.report.axes import sightings_idx
from pomona.stages.report.columns import as_base64
from pomona.stages.report.contract import Source, SurveyData
from pomona.stages.report.crops import embedded_crops
from pomona.stages.report.data import ReportData
from pomona.stages.report.html import about, amount, amount_of, script_digest
from pomona.stages.report.options import ReportOptions
from pomona.stages.report.plots import plots
from pomona.stages.report.quality import quality
from pomona.stages.report.scene import SceneOptions, survey_data
from pomona.stages.report.seen import detection_columns
from pomona.stages.report.tables import how_made, photos_table, trees_table
from pomona.stages.report.totals import notices, stage_times, totals

if TYPE_CHECKING:
    from pomona.evaluate.fruits import Truth

_ROOM = files("pomona.stages.report")
# Nothing is fetched from anywhere but where the page itself came from.
_IMAGES: dict[Source, str] = {"report": "data:", "folder": "data: 'self' file:", "server": "data: 'self'"}
_NOTES: dict[Source, str] = {
    "report": "The photos themselves are not in this file: the command pomona view SURVEY shows them.",
    "folder": "This photo is not in the folder.",
    "server": "This photo was not found; pomona view SURVEY --photos FOLDER says where photos are.",
}
_FOOTERS: dict[Source, str] = {
    "report": "This file needs no network; share it as it is.",
    "folder": "This folder needs no network; share it as a whole.",
    "server": "Shown by pomona view on this computer alone.",
}


def write_report(
    data: ReportData, path: Path, *, options: ReportOptions | None = None, truth: Truth | None = None
) -> None:
    """Write the report of one survey as a self-contained page: totals, plots, table, and a 3D view that can be turned.

    The page opens from disk without a network: script and style are in it, and its content security policy lets the
    browser fetch nothing and run no other script, whatever names files have. Where `data.masks` is given, crops of
    photos of each fruit are in it. With the options by default, all of it stays below some 35 MB.
    `truth` are the true fruits, where they are known.
    """
    path.write_text(report_html(data, options, truth), encoding="utf-8")


def report_html(data: ReportData, options: ReportOptions | None = None, truth: Truth | None = None) -> str:
    """Return the page that `write_report` writes."""
    options = options or ReportOptions()
    crops = embedded_crops(data, options)
    scene = SceneOptions(
        source="report",
        max_points=options.max_points,
        max_sightings=options.max_sightings,
        crops=crops,
        detections=detection_columns(data, only=crops),
        photos_note=_NOTES["report"],
    )
    return page_html(data, survey_data(data, scene), sections=Sections.of(data, truth))


@dataclass(frozen=True, kw_only=True)
class Sections:
    """The parts of the page that are made here, as HTML."""

    subtitle: str
    totals: str
    notices: str
    colour_choices: str
    plots: str
    tables: str
    photos: str = ""

    @classmethod
    def of(cls, data: ReportData, truth: Truth | None = None) -> Sections:
        """Return those of a survey's report; with the true fruits, the paper's Table 3 and Figure 8, too."""
        from pomona.stages.report.truth import figure_8, table_3

        against = (figure_8(data, truth), table_3(data, truth)) if truth is not None else ("", "")
        return cls(
            subtitle=_subtitle(data),
            totals=totals(data),
            notices=notices(data.warnings),
            colour_choices=_colour_choices(data),
            plots=against[0] + plots(data),
            tables=against[1] + trees_table(data) + stage_times(data) + how_made(data),
            photos=quality(data) + photos_table(data),
        )


def page_html(data: ReportData, values: SurveyData, *, data_url: str = "", sections: Sections | None = None) -> str:
    """Return the page of one survey with `values` in it, or with the address where its script finds them.

    `sections` are those of its report, if no others are given.
    """
    sections = sections or Sections.of(data)
    script = _static("viewer.js").replace("</script", "<\\/script")
    source = values.source
    footer = "An answer so far, shown while pomona watch runs." if data.provisional else _FOOTERS[source]
    return Template(_ROOM.joinpath("template.html").read_text(encoding="utf-8")).substitute(
        source=source,
        policy=policy(source),
        title=escape(data.title),
        version=escape(data.version),
        style=_static("viewer.css"),
        script=script,
        view_note=_view_note(data, values),
        left_out=_left_out(data, values),
        **vars(sections),
        data_url=f' data-url="{escape(data_url)}"' if data_url else "",
        payload="" if data_url else as_base64(values),
        footer=escape(f"Made by Pomona {data.version}".strip() + ". " + footer),
    )


def policy(source: Source) -> str:
    """Return the content security policy of the page: no script but its own, nothing from outside."""
    rules = [
        "default-src 'none'",
        "style-src 'unsafe-inline'",
        f"script-src {script_source()}",
        f"img-src {_IMAGES[source]}",
        "base-uri 'none'",
        "form-action 'none'",
    ]
    return "; ".join([*rules, "connect-src 'self'"] if source == "server" else rules)


def script_source() -> str:
    """Return what the content security policy of a server's page has to allow, so that the page's script runs."""
    script = _static("viewer.js").replace("</script", "<\\/script")
    return f"'{script_digest(script)}'"


def note_of(source: Source) -> str:
    """Return the page's note in place of a photo that is not there."""
    return _NOTES[source]


def _static(name: str) -> str:
    return _ROOM.joinpath("static", name).read_text(encoding="utf-8").strip()


def _subtitle(data: ReportData) -> str:
    """The line below the title, as HTML."""
    parts: list[str] = [amount_of(len(data.photos), "photo")]
    named = [side for side in data.photos.sides if side]
    if len(named) > 1:
        parts.append(escape("sides " + " and ".join([", ".join(named[:-1]), named[-1]])))
    taken = _taken([photo.taken_at for photo in data.photos])
    if taken:
        parts.append(taken)
    return " · ".join(parts)


def _taken(times: Sequence[datetime | None]) -> str:
    days = sorted({time.date() for time in times if time is not None})
    if not days:
        return ""
    written = [f'<time datetime="{day}">{day}</time>' for day in (days[0], days[-1])]
    return f"taken {written[0]}" + (f" to {written[1]}" if len(days) > 1 else "")


def _colour_choices(data: ReportData) -> str:
    """The measurements by which fruits can be coloured: those that tell fruits apart."""
    fruits = data.fruits
    choices = [("fruit", "one for all"), ("diameter", "diameter"), ("views", "number of photos"), ("score", "score")]
    if len(set(fruits.sides)) > 1:
        choices.append(("side", "side"))
    if fruits.tree_ids.any():
        choices.append(("tree", "tree"))
    return "".join(f'<option value="{value}">{label}</option>' for value, label in choices)


def _view_note(data: ReportData, values: SurveyData) -> str:
    """How many points there are, how many of them are shown, and how large the grid's cells are, as HTML."""
    shown, total = values.scene.count + values.fruit_points.count, len(data.cloud)
    points = f"{amount(shown)} of {amount(total)} points" if shown < total else f"{amount(total)} points"
    return f"{points} · grid {about(values.view.grid)} {values.unit}"


def _left_out(data: ReportData, values: SurveyData) -> str:
    """What a page that carries its data has less than there is, as HTML; nothing where it has all, or asks a server."""
    seen = values.sightings
    if seen is None:
        return ""
    parts = []
    shown, total = values.scene.count + values.fruit_points.count, len(data.cloud)
    if shown < 0.99 * total:  # the others lie far outside
        parts.append(f"{amount(shown)} of {amount(total)} points")
    counts = np.diff(seen.starts.astype(np.int64))
    known = len(sightings_idx(data)[0])
    if counts.sum() < known:
        parts.append(f"at most {counts.max()} of the photos that saw each fruit")
    of_fruit = np.repeat(np.arange(len(counts)), counts)
    with_crop = len(np.unique(of_fruit[np.diff(seen.crop_starts.astype(np.int64)) > 0]))
    if values.source == "report" and 0 < with_crop < len(counts):
        parts.append(f"crops of photos of {amount(with_crop)} of {amount(len(counts))} fruits")
    if not parts:
        return ""
    return f"This file is kept small: it has {', '.join(parts)}. The command pomona view SURVEY shows all."
