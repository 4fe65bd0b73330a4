"""How far the survey can be trusted, in one place: photos, metres, sides, coverage, and what to do about each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from pomona.basics.arrays import counted
from pomona.basics.row_line import usual_step
from pomona.errors import few
from pomona.stages.report.axes import along_bend, walk_direction
from pomona.stages.report.data import ReportData
from pomona.stages.report.html import Html, about, amount, as_html
from pomona.stages.report.tables import plain_table
from pomona.stages.report.totals import exactness, scale_source

# A step along a side so many times the usual one is a gap.
_GAP = 2.5
# Fruits that fewer photos saw are placed and measured badly.
_FEW_VIEWS = 3


def quality(data: ReportData) -> str:
    """Return the section with a line for each thing that a survey's quality hangs on, and advice that names photos."""
    rows = [*_photos(data), *_metres(data), *_sides(data), *_views(data), *_gaps(data)]
    table = plain_table(("what", "found", "what to do"), rows, numbers=0)
    return f'<section class="sheet" id="quality"><h2>Quality of the survey</h2>{table}</section>'


def _photos(data: ReportData) -> Iterator[tuple[str, str, str]]:
    advice = ""
    if data.lost:
        advice = f"{few([photo.photo for photo in data.lost])}: {data.lost[0].advice}"
    elif data.photos.skipped:
        advice = f"{few([file.name for file in data.photos.skipped])}: {data.photos.skipped[0].reason}"
    yield "photos with a place", f"{len(data.cameras)} of {data.usable_photos}", advice
    if data.problems is not None:
        for names, what, advice in (
            (data.problems.blurred, "blurred photos", "hold still, walk more slowly or expose shorter"),
            (data.problems.dark, "dark photos", "expose longer, or wait for light"),
            (data.problems.bright, "photos that are too bright", "expose shorter, or keep the sky out of them"),
        ):
            if names:
                yield what, str(len(names)), f"{few(names)}: {advice}"


def _metres(data: ReportData) -> Iterator[tuple[str, str, str]]:
    frame, scale = data.cameras.frame, data.scale
    if not frame.metric:
        yield "metres", "not known", "put up markers, or give the width of an average fruit"
        return
    found = [as_html(scale_source(data)), *(exactness(scale) if scale is not None else [])]
    advice = "markers or a scale bar would give exact metres" if frame.approximate else ""
    if scale is not None and scale.contradictions:
        advice = scale.contradictions[0]
    elif scale is not None and scale.unseen_markers:
        advice = f"markers {', '.join(map(str, scale.unseen_markers))} were not seen: are they sharp and in the open?"
    yield "metres", Html(", ".join(found)), advice


def _sides(data: ReportData) -> Iterator[tuple[str, str, str]]:
    if data.scale is None or len(data.photos.sides) < 2:
        return
    for tie in data.scale.ties:
        yield f"{tie.side} and {tie.other}", f"agree to {tie.median_mm:.0f} mm, {counted(tie.fruits, 'fruit')}", ""
    if not data.scale.sides_are_tied:
        yield "sides", "not tied to each other", "photos round the row's end, or markers that both sides see, tie them"


def _views(data: ReportData) -> Iterator[tuple[str, str, str]]:
    if not len(data.fruits):
        return
    views = data.fruits.views
    rarely = int((views < _FEW_VIEWS).sum())
    found = Html(f"{np.median(views):.0f}")
    if len(views) > 1:
        of_all = f"{amount(rarely)} of {amount(len(views))} {as_html(data.fruit_words)}"
        found = Html(f"{found} (median); {of_all} in fewer than {_FEW_VIEWS}")
    advice = "photos closer to each other see more of each fruit" if 4 * rarely > len(views) else ""
    yield "photos that saw each fruit", found, advice
    seeing = set(data.observations.photo)
    blind = [name for name in data.cameras.photos if name not in seeing]
    if blind:
        advice = f"look at {few(blind)}: do they show the row, sharp and well lit?"
        yield "photos in which no fruit was found", f"{len(blind)} of {len(data.cameras)}", advice


def _gaps(data: ReportData) -> Iterator[tuple[str, str, str]]:
    side_of = {photo.name: photo.side for photo in data.photos}
    unit = "m" if data.cameras.frame.metric else "units"
    for side in data.photos.sides:
        names = [name for name in data.cameras.photos if side_of.get(name) == side]
        if len(names) < _FEW_VIEWS:
            continue
        before, after, largest, usual = _largest_step(data, names)
        called = f"steps of the walk, {side}" if len(data.photos.sides) > 1 else "steps of the walk"
        wide = largest > _GAP * usual
        advice = f"nothing lies between {before} and {after}: photos there would close the gap" if wide else ""
        yield called, Html(f"{about(usual)} {unit} as a rule, {about(largest)} {unit} at most"), advice


def _largest_step(data: ReportData, names: Sequence[str]) -> tuple[str, str, float, float]:
    """Return the photos before and after the largest step along a side, its length, and that of the usual one.

    Steps are those along the row, as it bends, in whatever order photos were taken.
    """
    places = dict(zip(data.cameras.photos, data.cameras.centers_in_world, strict=True))
    centers = np.array([places[name] for name in names])
    along = along_bend(centers, walk_direction([centers]))
    order = np.argsort(along, kind="stable")
    steps = np.diff(along[order])
    k = int(steps.argmax())
    return names[order[k]], names[order[k + 1]], float(steps[k]), usual_step(steps)
