"""COCO files of any program as labelled photos."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pomona.errors import FormatError
from pomona.formats.detections.coco_file import CocoAnnotation, CocoImage, parse_coco
from pomona.formats.detections.labelled import Box, LabelledFruit, LabelledPhoto, PhotoFinder, SizeOf, named_within


def is_coco(content: Any) -> bool:
    """Say whether the content of a JSON file looks like COCO's."""
    return isinstance(content, dict) and "images" in content and "annotations" in content


def read_coco_labels(path: Path, size_of: SizeOf, folders: tuple[Path, ...] = ()) -> list[LabelledPhoto]:
    """Read a COCO file of polygons, runs or boxes; its photos lie in `folders`, beside it, or in `images/`.

    Raises `MissingFileError`, and `FormatError` naming file, entry and what was expected.
    """
    content = parse_coco(path)
    if not content.images:
        raise FormatError(f"{path}: images: expected at least one photo, found none")
    of_image: dict[int, list[LabelledFruit]] = {image.id: [] for image in content.images}
    for annotation in content.annotations:
        if (fruit := _fruit(annotation, named=bool(content.categories))) is not None:
            of_image[annotation.image_id].append(fruit)
    finder = PhotoFinder(path, size_of, folders)
    photos = []
    for image in content.images:
        file, width, height = finder.find(image.file_name, f"image {image.id}")
        _check_size(path, image, width, height)
        name = named_within(
            file, path.parent / "images" if file.is_relative_to(path.parent / "images") else path.parent
        )
        photos.append(LabelledPhoto(file, name, width, height, tuple(of_image[image.id])))
    return photos


def _fruit(annotation: CocoAnnotation, *, named: bool) -> LabelledFruit | None:
    """A fruit; None of what covers no pixel."""
    category = annotation.category if named else None
    mask = None if annotation.from_box else annotation.mask
    box: Box | None = annotation.box_px
    if mask is not None:
        x0, y0, x1, y1 = mask.box_px
        box = (x0, y0, x1, y1)
    if box is None or (mask is None and not annotation.from_box):
        return None
    if annotation.crowd or mask is None:
        return LabelledFruit(box, mask, category, ignored=annotation.crowd)
    return LabelledFruit.from_mask(mask, category)


def _check_size(path: Path, image: CocoImage, width: int, height: int) -> None:
    if (image.width_px, image.height_px) == (width, height):
        return
    turned = (image.width_px, image.height_px) == (height, width)
    hint = ": label the photo upright, as its EXIF orientation says" if turned else ""
    raise FormatError(
        f"{path}: image {image.id} '{image.file_name}': expected the photo's size {width} × {height}, "
        f"found {image.width_px} × {image.height_px}{hint}"
    )
