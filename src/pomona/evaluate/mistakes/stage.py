"""Writing the page of mistakes with its crops."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from pomona.errors import few
from pomona.evaluate.mistakes.crops import CropCutter
from pomona.evaluate.mistakes.options import MistakeOptions
from pomona.evaluate.mistakes.page import page_html
from pomona.evaluate.mistakes.spheres import Spheres
from pomona.evaluate.mistakes.stages import KINDS
from pomona.evaluate.mistakes.values import Evidence, Mistake, Mistakes
from pomona.evaluate.scores import Scores
from pomona.evaluate.truth import Truth
from pomona.progress import Progress, Silent

_CROPS = "crops"
_OURS = re.compile(rf"({'|'.join(KINDS)})-\d+-\d+(-drawn)?\.jpg")


def write_mistakes(
    folder: Path,
    evidence: Evidence,
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
    if missing := [name for name in evidence.cameras.photos if name not in evidence.photos]:
        progress.warn(f"Photos that were not found have no crops: {few(missing)}")
    crops_folder = folder / _CROPS
    crops_folder.mkdir(parents=True, exist_ok=True)
    for path in crops_folder.iterdir():
        if _OURS.fullmatch(path.name):
            path.unlink()
    shown = _worst(mistakes, options.worst)
    cutter = CropCutter(evidence, Spheres(evidence, truth, tally), masks or {}, crops_folder, options)
    crops = cutter.cut(shown, progress)
    page = folder / "index.html"
    page.write_text(page_html(evidence.title, tally, mistakes, crops, folder=_CROPS), encoding="utf-8")
    return page


def _worst(mistakes: Mistakes, count: int | None) -> list[Mistake]:
    """The worst `count` of each kind, whatever the stage."""
    return [mistake for kind in KINDS for mistake in sorted(mistakes.of_kind(kind), key=lambda m: -m.weight)[:count]]
