"""The paper's Table 2, Table 3 and Figure 8 from the Fuji-SfM dataset, from whatever of it is there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pomona.datasets.fuji_files import FujiFiles, find_fuji_files
from pomona.datasets.fuji_row import FujiRow, TrueTrees, photo_names, read_fuji_row, read_true_trees
from pomona.datasets.methods import OBJECT, Given, found_by_methods
from pomona.datasets.pictures import read_labels, score_pictures
from pomona.datasets.published import FUJI_TABLE_2, FUJI_TABLE_3, FUJI_TILES
from pomona.datasets.row_scores import figure_8, table_3
from pomona.datasets.values import BenchmarkOptions, BenchmarkResult, ComparedTable, Figure
from pomona.errors import InputError, ReconstructionError
from pomona.evaluate.detections import DetectionScores
from pomona.evaluate.fruits import Truth
from pomona.formats.detections.coco import read_coco
from pomona.formats.detections.label_sets import LabelSet
from pomona.formats.detections.labelled import LabelledPhoto
from pomona.formats.tables import read_fruits, write_fruits
from pomona.pipeline import RunOptions
from pomona.pipeline import run as run_pipeline
from pomona.progress import Progress
from pomona.stages.capture import load_photos
from pomona.stages.scale.registration import register
from pomona.survey import SurveyFolder
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import Fruits
from pomona.values.photos import Photos

NAME = "Fuji-SfM"
_TABLE_2, _TABLE_3, _FIGURE_8 = "Table 2", "Table 3", "Figure 8"


def benchmark_fuji_sfm(root: Path, out: Path, options: BenchmarkOptions, progress: Progress) -> BenchmarkResult:
    """Return the tables that can be made from what is below `root`; fruits and detections are written to `out`.

    Raises `MissingFileError`, `InputError` where nothing of the dataset is found, and `FormatError` for files that are
    broken.
    """
    files = find_fuji_files(root)
    if not (files.tiles or files.sides or files.boxes):
        raise InputError(
            f"{root}: expected the Fuji-SfM dataset: tiles with labels of the VGG Image Annotator, photos, *.mat masks "
            "or *_cameras.out of an east and a west side, boxes as text; found none of them"
        )
    tables: list[ComparedTable] = []
    missing: dict[str, str] = {}
    if files.tiles.get("validation"):
        tables.append(_table_2(files, options, progress))
    else:
        missing[_TABLE_2] = "there are no validation tiles with labels of the VGG Image Annotator (JSON or CSV)"
    known = read_true_trees(files, options.trees) if files.boxes else None
    found, notes, why_not = _fruits(files, known, out, options, progress)
    for name, fruits in found.items():
        write_fruits(out / f"fruits-{name.replace(', ', '-').replace(' ', '-')}.csv", fruits)
    if found and known is not None:
        first, *others = table_3(found, known)
        tables += [replace(first, notes=notes), *others]
        tables.append(figure_8(found, known))
    elif found:
        tables.append(_totals(found, notes))
    if not found or known is None:
        reason = why_not or "no boxes of true fruits were found (text: 6, 24 or 8 × 3 numbers a fruit)"
        missing |= {_TABLE_3: reason, _FIGURE_8: reason}
    return BenchmarkResult(NAME, files.described(), tuple(tables), missing)


def tiles_of(files: FujiFiles, part: str) -> list[LabelledPhoto]:
    """Return the labelled tiles of "training" or "validation"; raises `FormatError` and `MissingFileError`."""
    kinds = {".json": "via", ".csv": "via-csv"}
    sets = [LabelSet(kinds[file.suffix.lower()], file.parent, (file,), part) for file in files.tiles[part]]
    return [photo for one in sets for photo in read_labels(one)]


def _table_2(files: FujiFiles, options: BenchmarkOptions, progress: Progress) -> ComparedTable:
    tiles = tiles_of(files, "validation")
    scores = score_pictures(tiles, model=options.model, progress=progress)
    column = "Pomona" if options.model is None else Path(options.model).name
    notes = [f"{scores.true_fruits} apples on {len(tiles)} validation tiles (the paper: {FUJI_TILES['validation']})"]
    if "training" in files.tiles:
        count = len(tiles_of(files, "training"))
        notes.append(f"{count} training tiles (the paper: {FUJI_TILES['training']}); the shipped segmenter saw none")
    return ComparedTable(_TABLE_2, tuple(_levels(scores, column)), FUJI_TABLE_2.source, tuple(notes))


def _levels(scores: DetectionScores, column: str) -> list[Figure]:
    printed = FUJI_TABLE_2.figures
    figures = []
    for level in scores.levels:
        for name, value in (("R", level.recall), ("P", level.precision), ("F1", level.f1)):
            line = f"{name} at {level.confidence:g}"
            figures.append(Figure(line, {column: value}, printed.get(line)))
    line = "AP (IoU > 0.5)"
    return [*figures, Figure(line, {column: scores.ap50}, printed[line])]


def _fruits(
    files: FujiFiles, known: TrueTrees | None, out: Path, options: BenchmarkOptions, progress: Progress
) -> tuple[dict[str, Fruits], tuple[str, ...], str]:
    """Return fruits by method in the frame of the true ones, notes on them, and where there are none, why."""
    out.mkdir(parents=True, exist_ok=True)
    row = read_fuji_row(files, progress)
    if row.cameras is None:
        return _from_photos(files, known, out, options, progress)
    given = _given(files, row, out, options, progress)
    if given is None:
        return {}, (), "there are cameras, but neither masks nor photos of all sides that have cameras"
    return *found_by_methods(given, known, options.fruit_diameter_m, progress), ""


def _given(files: FujiFiles, row: FujiRow, out: Path, options: BenchmarkOptions, progress: Progress) -> Given | None:
    """What fruits are made of where cameras are given: masks of the segmenter, and a cloud, where none are given.

    None where there are neither masks nor photos of all sides.
    """
    assert row.cameras is not None
    placed = [side for side in files.sides if side.cameras is not None]
    photos = _photos(files, progress) if all(side.photos for side in placed) else None
    detections, threshold, cloud = row.detections, 0.0, row.cloud
    if detections is None:
        if photos is None:
            return None
        detections, threshold = _segmented(files, photos, out, options, progress)
    if cloud is None and photos is not None:
        from pomona.stages.dense import fruit_cloud

        dense = RunOptions(method="paper", fruit_diameter_m=options.fruit_diameter_m).dense
        cloud = fruit_cloud(photos, detections.at_least(threshold), row.cameras, options=dense, progress=progress)
    if photos is not None and not _of_one_size(photos, row.cameras):
        progress.warn("The fruits are not looked at again: the masks have another size than the photos.")
        photos = None
    return Given(row.cameras, detections, photos, cloud, threshold)


def _of_one_size(photos: Photos, cameras: Cameras) -> bool:
    """Say whether the cameras, which have the masks' size where masks are given, are of photos of this size."""
    by_name = photos.by_name()
    sizes = ((by_name[name], cameras.intrinsics_of(i)) for i, name in enumerate(cameras.photos))
    return all((photo.width_px, photo.height_px) == (lens.width_px, lens.height_px) for photo, lens in sizes)


def _photos(files: FujiFiles, progress: Progress) -> Photos:
    """The photos of all sides, by the names that their cameras have."""
    named = {
        path.resolve(): (name, side.name)
        for side in files.sides
        for path, name in zip(side.photos, photo_names(side), strict=True)
    }
    loaded = load_photos(_sources(files), min_photos=1, progress=progress)
    kept = [(photo, *named[photo.path.resolve()]) for photo in loaded if photo.path.resolve() in named]
    return Photos(tuple(replace(photo, name=name, side=side) for photo, name, side in kept))


def _sources(files: FujiFiles) -> list[Path]:
    return list(dict.fromkeys(path.parent for side in files.sides for path in side.photos))


def _segmented(
    files: FujiFiles, photos: Photos, out: Path, options: BenchmarkOptions, progress: Progress
) -> tuple[SurveyDetections, float]:
    """The segmenter's detections by our names for the photos; a stopped run goes on where it was."""
    survey = out / "survey"
    run_pipeline(_sources(files), survey, RunOptions(model=options.model), progress, until="select")
    theirs = load_photos(_sources(files), min_photos=1)
    names = {photo.path.resolve(): photo.name for photo in photos}
    found = read_coco(SurveyFolder.open(survey).detections, theirs)
    renamed = {
        names[photo.path.resolve()]: replace(found[photo.name], photo=names[photo.path.resolve()])
        for photo in theirs
        if photo.name in found and photo.path.resolve() in names
    }
    record = SurveyFolder.open(survey).record_of("select")
    assert record is not None
    return SurveyDetections(renamed), float(record.info["score_threshold"])


def _from_photos(
    files: FujiFiles, known: TrueTrees | None, out: Path, options: BenchmarkOptions, progress: Progress
) -> tuple[dict[str, Fruits], tuple[str, ...], str]:
    """Fruits from photos alone, laid over the true ones by the pattern in which they hang."""
    if not _sources(files):
        return {}, (), "there are no photos of a side, and no cameras (*_cameras.out)"
    survey = out / "survey"
    chosen = RunOptions(model=options.model, fruit_diameter_m=options.fruit_diameter_m)
    try:
        run_pipeline(_sources(files), survey, chosen, progress)
    except ReconstructionError as error:
        return {}, (), str(error)
    fruits = read_fruits(SurveyFolder.open(survey).fruits)
    if known is None:
        return {OBJECT: fruits}, (), ""
    laid = _laid_over(fruits, known.truth, options.fruit_diameter_m)
    if laid is None:
        return (
            {},
            (),
            (
                f"{len(fruits)} fruits were found in the photos, but no cameras in the boxes' frame are given "
                "(*_cameras.out), and the fruits' pattern does not show how they lie over the boxes"
            ),
        )
    return (
        {OBJECT: laid},
        ("no cameras were given: the fruits were laid over the boxes by the pattern they hang in",),
        "",
    )


def _laid_over(fruits: Fruits, truth: Truth, fruit_diameter_m: float) -> Fruits | None:
    overlay = register(fruits.centers_in_world, truth.centers_in_world, fruit_diameter_m)
    if overlay is None:
        return None
    truth_from_world = overlay.target_from_source
    return replace(
        fruits,
        centers_in_world=truth_from_world.apply(fruits.centers_in_world),
        diameters_m=fruits.diameters_m * truth_from_world.scale,
    )


def _totals(found: dict[str, Fruits], notes: tuple[str, ...]) -> ComparedTable:
    counts = {name: len(fruits) for name, fruits in found.items()}
    figure = Figure("fruits found in all", counts, sum(part.figures["T"] for part in FUJI_TABLE_3.values()))
    return ComparedTable("Total", (figure,), "annotated apples; the paper, Table 1", notes)
