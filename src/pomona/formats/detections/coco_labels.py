"""COCO files of any program as photos with fruits."""

from __future__ import annotations

from pathlib import Path

from pomona.errors import FormatError, InputError, few
from pomona.formats.detections.coco_file import CocoAnnotation, CocoFile, is_coco, parse_coco
from pomona.formats.detections.format import AnnotationFiles, Format
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto, check_size, edges_of
from pomona.formats.detections.photo_source import Sources
from pomona.progress import Progress, Silent


def read_coco_labels(path: Path, sources: Sources, *, progress: Progress | None = None) -> list[LabelledPhoto]:
    """Read a COCO file of polygons, runs or boxes; what covers no pixel is left out with a warning.

    Raises `MissingFileError`, and `FormatError` naming file, entry and what was expected.
    """
    content = parse_coco(path)
    if not content.images:
        raise FormatError(f"{path}: images: expected at least one photo, found none")
    return labelled_coco(path, content, sources, progress=progress)


def labelled_coco(
    path: Path, content: CocoFile, sources: Sources, *, progress: Progress | None = None
) -> list[LabelledPhoto]:
    """Return the photos of a COCO file that was read from `path`; raises what `read_coco_labels` raises."""
    of_image: dict[int, list[LabelledFruit]] = {image.id: [] for image in content.images}
    empty = []
    for annotation in content.annotations:
        fruit = _fruit(annotation, named=bool(content.categories))
        if fruit is None:
            empty.append(str(annotation.id))
        else:
            of_image[annotation.image_id].append(fruit)
    if empty:
        (progress or Silent()).warn(f"{path}: annotations that cover no pixel are left out: {few(empty)}.")
    source = sources(path)
    photos = []
    for image in content.images:
        photo = source.find(image.file_name, f"image {image.id}")
        if photo is None:
            continue
        try:
            check_size((image.width_px, image.height_px), photo)
        except InputError as error:
            raise FormatError(f"{path}: image {image.id} '{image.file_name}': {error}") from None
        photos.append(LabelledPhoto.of(photo, of_image[image.id]))
    return photos


def _fruit(annotation: CocoAnnotation, *, named: bool) -> LabelledFruit | None:
    """A fruit; None of what covers no pixel."""
    mask = None if annotation.from_box else annotation.mask
    box = annotation.box_px or (edges_of(mask) if mask else None)
    if box is None or (mask is None and not annotation.from_box):
        return None
    return LabelledFruit(
        box,
        mask,
        annotation.category if named else None,
        ignored=annotation.crowd or annotation.ignored,
        score=annotation.score,
        id=annotation.id,
        crowd=annotation.crowd,
    )


def _read(given: AnnotationFiles) -> list[LabelledPhoto]:
    return [p for file in given.files for p in read_coco_labels(file, given.sources, progress=given.progress)]


FORMAT = Format(
    kind="coco",
    title="COCO",
    recognise=lambda content: is_coco(content.json),
    read=_read,
    labels="a COCO file (*.json with images and annotations)",
)
