"""`report.html`: one file that opens from disk and fetches nothing."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping, Sequence
from datetime import datetime
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from pomona.report.data import ReportData
from pomona.report.plots import plots
from pomona.report.scene import as_script, payload
from pomona.report.tables import fruits_table, photos_table, trees_table
from pomona.report.totals import notices, stage_times, totals

_ROOM = files("pomona.report")


def write_report(data: ReportData, path: Path) -> None:
    """Write the report of one survey as a self-contained page: totals, plots, table, and a 3D view that can be turned.

    The page opens from disk without a network: script and style are in it, and its content security policy lets the
    browser fetch nothing and run no other script, whatever names files have. It stays below some 15 MB.
    """
    path.write_text(report_html(data), encoding="utf-8")


def report_html(data: ReportData) -> str:
    """Return the page that `write_report` writes."""
    values = payload(data)
    script = _static("viewer.js").replace("</script", "<\\/script")
    return Template(_ROOM.joinpath("template.html").read_text(encoding="utf-8")).substitute(
        title=escape(data.title),
        subtitle=escape(_subtitle(data)),
        version=escape(data.version),
        style=_static("viewer.css"),
        script=script,
        script_digest=_digest(script),
        totals=totals(data),
        notices=notices(data),
        colour_choices=_colour_choices(data),
        view_note=escape(_view_note(data, values)),
        table=fruits_table(data),
        plots=plots(data),
        trees=trees_table(data),
        stages=stage_times(data),
        photos=photos_table(data),
        payload=as_script(values),
        footer=escape(f"Made by Pomona {data.version}".strip() + ". This file needs no network; share it as it is."),
    )


def _static(name: str) -> str:
    return _ROOM.joinpath("static", name).read_text(encoding="utf-8").strip()


def _digest(script: str) -> str:
    """What the content security policy knows the script by."""
    return "sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")


def _subtitle(data: ReportData) -> str:
    parts = [f"{len(data.photos):,} photos"]
    named = [side for side in data.photos.sides if side]
    if len(named) > 1:
        parts.append("sides " + " and ".join([", ".join(named[:-1]), named[-1]]))
    taken = _taken([photo.taken_at for photo in data.photos])
    if taken:
        parts.append(taken)
    return " · ".join(parts)


def _taken(times: Sequence[datetime | None]) -> str:
    days = sorted({time.date() for time in times if time is not None})
    if not days:
        return ""
    return f"taken {days[0]}" + (f" to {days[-1]}" if len(days) > 1 else "")


def _colour_choices(data: ReportData) -> str:
    """The measurements by which fruits can be coloured: those that tell fruits apart."""
    fruits = data.fruits
    choices = [("fruit", "one for all"), ("diameter", "diameter"), ("views", "photos"), ("score", "score")]
    if len(set(fruits.sides)) > 1:
        choices.append(("side", "side"))
    if fruits.tree_ids.any():
        choices.append(("tree", "tree"))
    return "".join(f'<option value="{value}">{label}</option>' for value, label in choices)


def _view_note(data: ReportData, values: Mapping[str, Any]) -> str:
    """How many points there are, how many of them are shown, and how large the grid's cells are."""
    shown, total = values["scene"]["count"] + values["fruitPoints"]["count"], len(data.cloud)
    points = f"{shown:,} of {total:,} points" if shown < total else f"{total:,} points"
    return f"{points} · grid {values['view']['grid']:g} {values['unit']}"
