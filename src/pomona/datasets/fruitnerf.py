"""FruitNeRF's rendered and real trees: counts, and for rendered ones instance scores, from given cameras and masks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from pomona.basics.geometry import Similarity
from pomona.datasets.fruitnerf_scene import (
    FruitNerfScene,
    find_scenes,
    load_scene_photos,
    read_objects,
    read_scene_masks,
)
from pomona.datasets.methods import OBJECT, Given, found_by_methods
from pomona.datasets.published import FRUITNERF_COUNTS, FRUITNERF_RENDERED
from pomona.datasets.values import BenchmarkResult, ComparedTable, Figure
from pomona.errors import InputError, ReconstructionError
from pomona.evaluate.fruits import EvaluateOptions, Truth, evaluate_fruits
from pomona.formats.cameras.nerfstudio import read_nerfstudio
from pomona.formats.cameras.onto_photos import onto_photos
from pomona.formats.tables import read_fruits, write_fruits
from pomona.pipeline import RunOptions
from pomona.pipeline import run as run_pipeline
from pomona.progress import Progress
from pomona.survey import SurveyFolder
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import SurveyDetections
from pomona.values.photos import Photos

NAME = "FruitNeRF"
_FRAME = WorldFrame("given", approximate=True, up_is_known=False)
# Blender writes objects with y up unless asked otherwise; cameras have z up.
_Z_UP_FROM_Y_UP = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
_LEAST_SHOWN = 0.25  # of the true middles in masks: leaves hide some, and in a wrong frame next to none lie there


def benchmark_fruitnerf(
    root: Path, out: Path, *, model: str | None, fruit_diameter_m: float, progress: Progress
) -> BenchmarkResult:
    """Return counts, and for trees whose fruits are known the scores, of all trees below `root`.

    Raises `MissingFileError`, `InputError` where there is no tree, and `FormatError` for files that are broken.
    """
    scenes = find_scenes(root)
    tables: list[ComparedTable] = []
    missing: dict[str, str] = {}
    out.mkdir(parents=True, exist_ok=True)
    for scene in scenes:
        if scene.objects is not None and scene.masks:
            tables.append(_rendered(scene, out, fruit_diameter_m, progress))
        elif scene.objects is not None:
            missing[scene.name] = "the true fruits are known, but there are no masks"
        else:
            try:
                tables.append(_real(scene, out, model, fruit_diameter_m, progress))
            except (ReconstructionError, InputError) as error:  # the other trees may do better
                missing[scene.name] = str(error)
    return BenchmarkResult(NAME, tuple(scene.described for scene in scenes), tuple(tables), missing)


def _rendered(scene: FruitNerfScene, out: Path, fruit_diameter_m: float, progress: Progress) -> ComparedTable:
    """Scores with given cameras and masks. The scene has no metres: it is brought to the true fruits' usual size."""
    assert scene.objects is not None
    photos = load_scene_photos(scene, progress)
    detections = read_scene_masks(scene, photos, progress)
    cameras = _cameras(scene, photos)
    truth, placed = _in_frame_of(cameras, read_objects(scene.objects), detections)
    metres = Similarity(fruit_diameter_m / float(np.median(truth.diameters_m)), np.eye(3), np.zeros(3))
    cameras, truth = cameras.transformed(metres, _FRAME), _moved(truth, metres)
    found, _ = found_by_methods(Given(cameras, detections, photos), None, fruit_diameter_m, progress)
    fruits = found[OBJECT]
    write_fruits(out / f"fruits-{scene.name}.csv", fruits)
    tally = evaluate_fruits(fruits, truth, options=EvaluateOptions(match="centers")).all
    figures = (
        Figure("fruits", {"Pomona": len(fruits), "true": len(truth)}),
        Figure("P", {"Pomona": tally.precision}),
        Figure("R", {"Pomona": tally.recall}),
        Figure("F1", {"Pomona": tally.f1}, FRUITNERF_RENDERED.figures["F1"]),
    )
    notes = (
        placed,
        "right is a centre at most half a diameter off; the metres are those of the assumed fruit diameter",
    )
    return ComparedTable(f"{scene.name}, given cameras and masks", figures, FRUITNERF_RENDERED.source, notes)


def _real(
    scene: FruitNerfScene, out: Path, model: str | None, fruit_diameter_m: float, progress: Progress
) -> ComparedTable:
    """The count of a tree by Pomona's own cameras: those given have no metres, which its fruits give."""
    survey = out / f"survey-{scene.name}"
    options = RunOptions(model=model, fruit_diameter_m=fruit_diameter_m, sides="none")
    run_pipeline(list(scene.photos), survey, options, progress)
    fruits = read_fruits(SurveyFolder.open(survey).fruits)
    known = [count for name, count in FRUITNERF_COUNTS.items() if name in scene.name.lower()]
    true = {"counted by hand": known[0]} if known else {}
    figure = Figure("fruits", {"Pomona": len(fruits), **true})
    return ComparedTable(f"{scene.name}, from photos alone", (figure,))


def _cameras(scene: FruitNerfScene, photos: Photos) -> Cameras:
    given = onto_photos(read_nerfstudio(scene.transforms, photos), photos, str(scene.transforms))
    return replace(given.cameras, frame=_FRAME)


def _in_frame_of(cameras: Cameras, truth: Truth, detections: SurveyDetections) -> tuple[Truth, str]:
    """The true fruits in the cameras' frame: as they are, with y up, or in the scale that training gives a scene.

    Nothing written says which; most of them have to lie in masks. Raises `InputError` where nothing fits.
    """
    best: tuple[float, Truth, str] | None = None
    for how, cameras_from_truth in _frames(cameras):
        moved = _moved(truth, cameras_from_truth)
        share = _shown(cameras, moved, detections)
        if best is None or share > best[0]:
            best = share, moved, f"true fruits {how}: {share:.0%} of their middles that photos show lie in masks"
    assert best is not None
    if best[0] < _LEAST_SHOWN:
        raise InputError(
            f"The true fruits do not lie where the masks are: at best {best[0]:.0%} of their middles, {best[2]}; "
            "is fruits.obj of this tree?"
        )
    return best[1], best[2]


def _frames(cameras: Cameras) -> Iterator[tuple[str, Similarity]]:
    largest = float(np.abs(cameras.centers_in_world).max())
    for scaled, scale in (("", 1.0), (", in units of the largest camera coordinate", largest)):
        for turned, rotation in (("as they are", np.eye(3)), ("with y up", _Z_UP_FROM_Y_UP)):
            yield turned + scaled, Similarity(scale, rotation, np.zeros(3))


def _shown(cameras: Cameras, truth: Truth, detections: SurveyDetections) -> float:
    """Of the true middles that lie in photos, the share that lies in masks."""
    in_photos = in_masks = 0
    for i, name in enumerate(cameras.photos):
        xy_px, _ = cameras.project(i, truth.centers_in_world)
        found = detections[name]
        with np.errstate(invalid="ignore"):
            inside = (xy_px >= 0).all(1) & (xy_px < [found.width_px, found.height_px]).all(1)
        in_photos += int(inside.sum())
        shown = np.zeros(int(inside.sum()), dtype=bool)
        for mask in found.masks:
            shown |= mask.contains(xy_px[inside])
        in_masks += int(shown.sum())
    return in_masks / in_photos if in_photos else 0.0


def _moved(truth: Truth, target_from_source: Similarity) -> Truth:
    return Truth(
        truth.ids,
        target_from_source.apply(truth.centers_in_world),
        truth.diameters_m * target_from_source.scale,
        truth.tree_ids,
    )
