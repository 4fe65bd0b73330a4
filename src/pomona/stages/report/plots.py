"""The report's plots: sizes, along the row, heights, fruits in each photo."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from html import escape

import numpy as np

from pomona.basics.arrays import FloatArray, counted
from pomona.fruit.traits.packing import PACKING_PRESETS, packing_classes
from pomona.stages.report.axes import places_along, row_axes
from pomona.stages.report.data import ReportData
from pomona.stages.report.html import Html, amount, as_html
from pomona.stages.report.svg import Axis, Bar, Dot, column_chart, dot_chart, nice_step, number, row_chart
from pomona.values.crop import SizeDistribution

_MOST_BINS = 28  # more columns are too narrow to be told apart
_TAIL = 0.5  # percent of the crop: where so few are smaller or larger, its histogram ends
_MOST_ON_MAP = 6000  # fruits: more make the file large, and hide each other
_SMALL_MM = 35  # fruits smaller than that are packed like cherries
_TREE_COLOURS = ("", "sky")
_SIDE_COLOURS = ("sky", "leaf", "")


def plots(data: ReportData) -> str:
    """Return the plots as HTML figures; none where there are no fruits."""
    figures = []
    if len(data.fruits):
        figures += [row_map(data), packing(data), diameters(data), by_tree(data), along_row(data), heights(data)]
    if len(data.observations):
        figures.append(photos(data))
    return framed(figures)


def framed(figures: Sequence[str]) -> str:
    """Return figures, each in a sheet of its own; empty ones are left out."""
    return "".join(f'<figure class="sheet">{figure}</figure>' for figure in figures if figure)


def diameters(data: ReportData) -> str:
    """Return the histogram of diameters, in millimetres where the survey is metric, with that of the whole crop."""
    factor, unit = (1000.0, "mm") if data.cameras.frame.metric else (1.0, "units")
    values = data.fruits.diameters_m[np.isfinite(data.fruits.diameters_m)] * factor
    if not len(values):
        return f"{caption('Diameters')}<p class='note'>No diameter could be measured.</p>"
    sizes = data.sizes
    edges = bin_edges(values if sizes is None else np.append(values, factor * np.array(sizes.ends_m(_TAIL))))
    middle = float(np.median(values) if sizes is None else factor * sizes.crop[1])
    mark = ((middle - edges[0]) / (edges[1] - edges[0]), f"median {middle:.3g} {unit}")
    bars = bars_of(values, edges, unit)
    unmeasured = len(data.fruits) - len(values)
    notes = [f"{amount(unmeasured)} not measured"] if unmeasured else []
    outline: Sequence[float] = ()
    if sizes is not None:
        outline = np.diff(np.interp(edges / factor, sizes.edges_m, sizes.below)).tolist()
        notes.append("line: the whole crop, hidden fruits too")
    chart = column_chart(bars, Axis(name=f"diameter, {unit}", ticks=ticks_at(edges)), mark=mark, outline=outline)
    return caption("Diameters", Html("; ".join(notes))) + chart


def packing(data: ReportData) -> str:
    """Return the frame of the histogram in packing classes, which the page's script fills: classes can be changed.

    Those chosen for the survey, or usual for its kind of fruit, come first; else those of the fruits' size. The frame
    holds how many fruits of the crop are smaller than each of many sizes, and their weight, where that is known.
    """
    if not data.cameras.frame.metric or not np.isfinite(data.fruits.diameters_m).any():
        return ""
    sizes_mm = 1000 * data.fruits.diameters_m
    usual = "cherries" if np.nanmedian(sizes_mm) < _SMALL_MM else "apples"
    chosen = packing_classes(data.packing or usual)
    choices = [chosen, *(preset for preset in PACKING_PRESETS.values() if preset != chosen)]
    options = "".join(
        f'<option data-edges="{" ".join(map(number, each.edges_mm))}">{escape(each.title)}</option>' for each in choices
    )
    return (
        caption("Packing classes", "" if data.sizes is None else "share and kg: of the whole crop")
        + f'<div id="packing"{_crop_attribute(data.sizes)} hidden><p class="choice">'
        f'<label>Classes <select id="packing-preset">{options}</select></label>'
        '<label>mm <input id="packing-edges" size="30" aria-label="Edges of the classes in mm"></label></p>'
        '<table id="packing-table"></table></div><noscript>Packing classes need JavaScript.</noscript>'
    )


def _crop_attribute(sizes: SizeDistribution | None) -> str:
    if sizes is None:
        return ""
    columns = {
        "edges": [round(1000 * edge, 1) for edge in sizes.edges_m],
        "fruits": [round(count, 2) for count in sizes.below],
        "kg": [round(weight, 3) for weight in sizes.weights_below_kg],
    }
    return f' data-crop="{escape(json.dumps(columns, separators=(",", ":")))}"'


def row_map(data: ReportData) -> str:
    """Return the fruits seen from the side: along the row and by height, as large as they are, by tree."""
    centers, places = data.fruits.centers_in_world, places_along(data)
    order = np.argsort(-np.abs(centers @ row_axes(data).toward), kind="stable")[:_MOST_ON_MAP]
    sizes = np.where(np.isfinite(data.fruits.diameters_m), data.fruits.diameters_m, np.nan)
    usual = float(np.nanmedian(sizes)) if np.isfinite(sizes).any() else 0.07
    dots = [
        Dot(
            float(places[i]),
            float(centers[i, 2]),
            float(sizes[i] if np.isfinite(sizes[i]) else usual) / 2,
            f"fruit {data.fruits.ids[i]}",
            _TREE_COLOURS[int(data.fruits.tree_ids[i]) % 2],
        )
        for i in order
    ]
    left_out = Html(f"{amount(len(order))} of {amount(len(centers))} fruits") if len(order) < len(centers) else ""
    unit = _length_unit(data)
    chart = dot_chart(dots, Axis(name=f"{unit} from the first fruit"), Axis(name=f"z, {unit}"))
    return caption("The row from the side", left_out) + chart


def by_tree(data: ReportData) -> str:
    """Return how many fruits each tree has; nothing where trees are not known."""
    trees = data.trees
    if not len(trees):
        return ""
    bars = [
        Bar(float(n), f"tree {tree}: {n} ({low} to {high}, 95 %)", "leaf")
        for tree, n, low, high in zip(trees.ids, trees.fruits, trees.fruits_low, trees.fruits_high, strict=True)
    ]
    step = max(1, round(nice_step(len(bars), 10)))
    ticks = [(i + 0.5, str(trees.ids[i])) for i in range(0, len(bars), step)]
    return caption(f"{data.fruit_words.capitalize()} on each tree") + column_chart(bars, Axis(name="tree", ticks=ticks))


def along_row(data: ReportData) -> str:
    """Return how many fruits hang along the row, from its first fruit on; nothing of one alone."""
    if len(data.fruits) < 2:
        return ""
    places, unit = places_along(data), _length_unit(data)
    edges = bin_edges(places, _MOST_BINS)
    chart = column_chart(
        bars_of(places, edges, unit, "leaf"), Axis(name=f"{unit} from the first fruit", ticks=ticks_at(edges))
    )
    return caption("Fruits along the row") + chart


def heights(data: ReportData) -> str:
    """Return how many fruits hang at which height (z of the world frame); nothing of one alone."""
    if len(data.fruits) < 2:
        return ""
    values, unit = data.fruits.centers_in_world[:, 2], _length_unit(data)
    edges = bin_edges(values, 14)
    axis = Axis(name=f"z, {unit}", ticks=ticks_at(edges))
    note = "" if data.cameras.frame.up_is_known else "which way is up is a guess"
    return caption("Fruits by height", note) + row_chart(bars_of(values, edges, unit, "leaf"), axis)


def photos(data: ReportData) -> str:
    """Return how many fruits each photo saw, photos in order, a colour for each side; many photos share bars."""
    seen = data.observations
    # Once each: of a fruit that a leaf cuts in two, a photo has two masks.
    counts = Counter(photo for _, photo in {*zip(seen.fruit_id.tolist(), seen.photo, strict=True)})
    items = list(data.photos)
    if not items:
        return ""
    per_bar = -(-len(items) // 200)
    sides = list(data.photos.sides)
    bars = []
    for i in range(0, len(items), per_bar):
        group = items[i : i + per_bar]
        value = float(np.mean([counts[photo.name] for photo in group]))
        name = group[0].name if per_bar == 1 else f"{group[0].name} to {group[-1].name}"
        bars.append(Bar(value, f"{name}: {number(value)}", _SIDE_COLOURS[sides.index(group[0].side) % 3]))
    named = ", ".join(side for side in sides if side)
    step = max(1, round(nice_step(len(items), 8)))
    numbers = sorted({max(1, i) for i in range(0, len(items) + 1, step)})
    ticks = [((i - 0.5) / per_bar, str(i)) for i in numbers]
    axis = Axis(name="photo, in order" + (f" ({named})" if len(sides) > 1 else ""), ticks=ticks)
    return caption("Fruits seen in each photo") + column_chart(bars, axis)


def bin_edges(values: FloatArray, bins: int | None = None) -> FloatArray:
    """Return at least two equally spaced round edges which hold all values, about `bins` of them."""
    low, high = float(values.min()), float(values.max())
    if bins is None:
        # Freedman and Diaconis' width, but never more bins than can be told apart.
        spread = float(np.subtract(*np.percentile(values, [75, 25])))
        wish = 2 * spread / len(values) ** (1 / 3)
        bins = _MOST_BINS if wish <= 0 else min(_MOST_BINS, max(8, round((high - low) / wish)))
    step = nice_step(high - low, bins) if high > low else max(abs(high) / 10, 1e-3)
    first = np.floor(low / step + 1e-9)
    count = max(1, int(np.floor(high / step - first + 1e-9)) + 1)
    edges: FloatArray = (first + np.arange(count + 1)) * step
    edges[0] = min(edges[0], low)  # 3 × 0.1 is more than 0.3
    return edges


def bars_of(values: FloatArray, edges: FloatArray, unit: str, colour: str = "") -> list[Bar]:
    """Return a bar for each class between edges: how many of the values are in it."""
    counts, _ = np.histogram(values, edges)
    spans = zip(counts, edges[:-1], edges[1:], strict=True)
    return [
        Bar(float(n), f"{number(a)} to {number(b)} {unit}: {counted(int(n), 'fruit')}", colour) for n, a, b in spans
    ]


def ticks_at(edges: FloatArray) -> Sequence[tuple[float, str]]:
    """Labels at round numbers, at most about eight."""
    width = float(edges[1] - edges[0])
    step = nice_step(float(edges[-1] - edges[0]), 8)
    # Whole numbers of steps: a sum of steps would write 0 as 5e-16.
    places = np.arange(np.ceil(edges[0] / step - 1e-6), edges[-1] / step + 1e-6) * step
    return [(float(place - edges[0]) / width, number(float(place))) for place in places]


def _length_unit(data: ReportData) -> str:
    return "m" if data.cameras.frame.metric else "units"


def caption(title: str, note: str = "") -> str:
    """Return a figure's caption, with a note in small letters, escaped unless it is `Html`."""
    small = f" <small>{as_html(note)}</small>" if note else ""
    return f"<figcaption>{escape(title)}{small}</figcaption>"
