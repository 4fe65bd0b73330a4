"""The page of mistakes: `index.html`, which opens from disk and fetches nothing but the crops beside it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence, Set
from html import escape
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from string import Template

from pomona import __version__
from pomona.basics.arrays import counted
from pomona.errors import few
from pomona.evaluate.diagnosis.crops import CropCutter, CropFiles
from pomona.evaluate.diagnosis.mistakes import (
    KINDS,
    STAGES,
    Kind,
    Mistake,
    MistakeOptions,
    Mistakes,
    Stage,
    SurveyResult,
)
from pomona.evaluate.diagnosis.spheres import DrawnSpheres
from pomona.evaluate.fruits.scores import Scores, Tally
from pomona.evaluate.fruits.truth import Truth
from pomona.progress import Progress, Silent
from pomona.values.drawing import DOUBLE, DROPPED, FALSE, MISSED, OTHER, OWN, RIGHT, UNUSED, Rgb

_LEGEND: dict[str, tuple[Rgb, str]] = {
    "true": (MISSED, "true fruit (thin: what shows of it; others not found)"),
    "right": (RIGHT, "found, right"),
    "false": (FALSE, "found, false"),
    "double": (DOUBLE, "found, double"),
    "dropped": (DROPPED, "found, dropped by the filter or removed by a correction"),
    "own": (OWN, "detection of this fruit"),
    "other": (OTHER, "other detection"),
    "weak": (UNUSED, "detection too weak to be used"),
}
_CROPS = "crops"
_PAGE = files("pomona.evaluate.diagnosis") / "page.html"
# The crops of an earlier page, which are deleted; other files in that folder are kept.
_OURS = re.compile(rf"({'|'.join(KINDS)})-\d+-\d+(-drawn)?\.jpg")


def write_mistakes(
    folder: Path,
    survey: SurveyResult,
    truth: Truth,
    scores: Scores,
    mistakes: Mistakes,
    *,
    masks: Mapping[str, Path] | None = None,
    options: MistakeOptions | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write `folder/index.html` and its crops in `folder/crops/`, and return the page. Crops of an earlier page go.

    `masks` are images of true fruit ids, by photo: what they show of a fruit is drawn. Each photo is read once. Photos
    that are missing or cannot be read are warned about and left out.
    """
    options, progress = options or MistakeOptions(), progress or Silent()
    tally = scores.visible if mistakes.label == "visible" and scores.visible else scores.all
    if missing := [name for name in survey.cameras.photos if name not in survey.photos]:
        progress.warn(f"Photos that were not found have no crops: {few(missing)}")
    crops_folder = folder / _CROPS
    crops_folder.mkdir(parents=True, exist_ok=True)
    for path in crops_folder.iterdir():
        if _OURS.fullmatch(path.name):
            path.unlink()
    shown = _worst(mistakes, options.worst)
    cutter = CropCutter(survey, DrawnSpheres(survey, truth, tally), masks or {}, crops_folder, options)
    crops = cutter.cut(shown, progress)
    page = folder / "index.html"
    page.write_text(page_html(survey.title, tally, mistakes, crops, folder=_CROPS), encoding="utf-8")
    return page


def _worst(mistakes: Mistakes, count: int | None) -> list[Mistake]:
    """The worst `count` of each kind, whatever the stage."""
    return [mistake for kind in KINDS for mistake in sorted(mistakes.of_kind(kind), key=lambda m: -m.weight)[:count]]


def page_html(
    title: str, tally: Tally, mistakes: Mistakes, crops: Mapping[str, Sequence[CropFiles]], *, folder: str
) -> str:
    """Return the page. Of `mistakes` those are shown that `crops` (in `folder` beside the page) has, by key.

    It needs no script: what hides a kind, or the drawings, is style alone.
    """
    counts = mistakes.counts()
    return Template(_PAGE.read_text(encoding="utf-8")).substitute(
        title=escape(title),
        version=escape(__version__),
        subtitle=escape(_subtitle(tally, mistakes)),
        scores=_scores(tally),
        summary=_summary(counts, {(m.kind, m.stage) for m in mistakes.items if m.key in crops}) + _looked(mistakes),
        chips="".join(_chip(kind, sum(counts[kind].values())) for kind in KINDS),
        legend="".join(_swatch(name, colour, words) for name, (colour, words) in _LEGEND.items()),
        sections="\n".join(_section(kind, mistakes.of_kind(kind), crops, folder) for kind in KINDS if counts[kind]),
        folder=escape(folder),
    )


def _subtitle(tally: Tally, mistakes: Mistakes) -> str:
    of = "visible" if mistakes.label == "visible" else "true"
    if not len(mistakes):
        return f"Nothing is wrong: all {tally.true_fruits} {of} fruits were found, once each, and no other."
    wrong = f"{counted(len(mistakes), 'fruit')} went wrong"
    return f"{wrong}; {tally.true_positives} of {tally.true_fruits} {of} fruits were found"


def _scores(tally: Tally) -> str:
    fruits = "visible fruits" if tally.label == "visible" else "true fruits"
    rows = [
        (fruits, str(tally.true_fruits)),
        ("found", str(tally.detections)),
        ("right", str(tally.true_positives)),
        ("F1", _share(tally.f1)),
        ("recall", _share(tally.recall)),
        ("precision", _share(tally.precision)),
        ("centre error, median", _mm(tally.center_median_m)),
    ]
    lines = "".join(f'<tr><th scope="row">{name}</th><td class="number">{value}</td></tr>' for name, value in rows)
    return f"<table><caption>Scores</caption><tbody>{lines}</tbody></table>"


def _summary(counts: Mapping[Kind, Mapping[Stage, int]], shown: Set[tuple[Kind, Stage]]) -> str:
    most = max((number for of in counts.values() for number in of.values()), default=0)
    if not most:
        return '<p class="none">No fruit was missed, merged, false or double.</p>'
    groups = []
    for kind, of in counts.items():
        rows = []
        for stage, number in of.items():
            words = escape(STAGES[stage])
            label = f'<a href="#{kind}-{stage}">{words}</a>' if (kind, stage) in shown else words
            rows.append(
                f"<td>{label}</td>"
                f'<td class="number">{number}</td>'
                f'<td class="track kind-{kind}"><i style="width:{100 * number / most:.0f}%"></i></td>'
            )
        head = f'<th class="kind kind-{kind}" scope="rowgroup" rowspan="{len(of)}">{kind}: {sum(of.values())}</th>'
        groups += [f"<tbody><tr>{head}{'</tr><tr>'.join(rows)}</tr></tbody>"] * bool(rows)
    head = '<tr><th scope="col">Kind</th><th scope="col">Likely stage</th><th class="number" scope="col">Fruits</th>'
    caption = "<caption>What went wrong, and where</caption>"
    return f'<table class="groups">{caption}<thead>{head}<td></td></tr></thead>{"".join(groups)}</table>'


def _looked(mistakes: Mistakes) -> str:
    return "" if mistakes.second_look is None else f'<p class="note">{escape(mistakes.second_look.in_words)}</p>'


def _chip(kind: Kind, number: int) -> str:
    off = "" if number else " disabled"
    return (
        f'<label class="chip kind-{kind}"><input type="checkbox" id="show-{kind}" checked{off}>{kind} '
        f"<b>{number}</b></label>"
    )


def _swatch(name: str, colour: Rgb, words: str) -> str:
    tone = "#{:02x}{:02x}{:02x}".format(*colour)
    shape = '<circle cx="11" cy="11" r="7" fill="none"'
    if name in ("own", "other", "weak"):
        shape = '<path d="M5 12q0-7 6-7t6 5q0 7-7 7t-5-5z" fill="none"'
    width = 2.5 if name in ("true", "own") else 1.5
    drawn = f'<svg viewBox="0 0 22 22" aria-hidden="true">{shape} stroke="{tone}" stroke-width="{width}"/></svg>'
    return f"<li>{drawn}{words}</li>"


def _section(kind: Kind, mistakes: Sequence[Mistake], crops: Mapping[str, Sequence[CropFiles]], folder: str) -> str:
    shown = sum(mistake.key in crops for mistake in mistakes)
    number = f"{len(mistakes)}" if shown == len(mistakes) else f"the worst {shown} of {len(mistakes)}"
    parts = [
        f'<section class="{kind}"><h2 class="kind-{kind}">{kind.capitalize()} <small>{number}</small></h2>'
        f'<p class="note">{KINDS[kind].capitalize()}.</p>'
    ]
    for stage, of in groupby(mistakes, key=lambda mistake: mistake.stage):
        whole = list(of)
        some = [mistake for mistake in whole if mistake.key in crops]
        if not some:
            continue
        count = f"{len(whole)}" if len(some) == len(whole) else f"{len(some)} of {len(whole)}"
        label = STAGES[stage]
        parts.append(f'<h3 id="{kind}-{stage}">{escape(label[0].upper() + label[1:])} <small>{count}</small></h3>')
        parts += [_article(mistake, crops[mistake.key], folder) for mistake in some]
    return "\n".join([*parts, "</section>"])


def _article(mistake: Mistake, crops: Sequence[CropFiles], folder: str) -> str:
    x, y, z = mistake.center_in_world
    name = mistake.name[0].upper() + mistake.name[1:]
    facts = [mistake.facts, f"diameter {_mm(mistake.diameter_m)}", f"at x {x:.3f}, y {y:.3f}, z {z:.3f} m"]
    figures = "".join(_figure(mistake, crop, folder) for crop in crops)
    pictures = f'<div class="crops">{figures}</div>' if crops else '<p class="none">No photo to show.</p>'
    return (
        f'<article class="kind-{mistake.kind}" id="{mistake.key}"><h4>{name} <span>{mistake.kind}</span></h4>'
        f'<p class="reason">{escape(mistake.reason)}</p>'
        f'<p class="facts">{escape(" · ".join(fact for fact in facts if fact))}</p>{pictures}</article>'
    )


def _figure(mistake: Mistake, crop: CropFiles, folder: str) -> str:
    plain, drawn = (escape(f"{folder}/{name}") for name in (crop.plain, crop.drawn))
    alt = escape(f"{mistake.name}, {mistake.kind}, in {crop.photo}: {crop.note}")
    return (
        f'<figure><a href="{drawn}"><img src="{plain}" alt="" loading="lazy">'
        f'<img class="drawn" src="{drawn}" alt="{alt}" loading="lazy"></a>'
        f"<figcaption><b>{escape(crop.photo)}</b>{escape(crop.note)}</figcaption></figure>"
    )


def _share(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.3f}"


def _mm(value_m: float) -> str:
    return "not measured" if math.isnan(value_m) else f"{1000 * value_m:.1f} mm"
