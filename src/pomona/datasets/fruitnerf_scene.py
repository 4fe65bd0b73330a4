"""One tree of the FruitNeRF dataset on disk: photos, cameras, masks, and for rendered trees the true fruits.

The layout (zenodo.org/records/10869455; fruit_nerf/data/fruitnerf_dataparser.py of github.com/meyerls/FruitNeRF reads
it): a folder a tree with `transforms.json`, whose frames have `file_path` and `semantic_path`, an image that is black
where there is no fruit; of rendered trees `fruits.obj`, an object (`o`) with vertices (`v`) a fruit.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy import ndimage

from pomona.basics.arrays import IntArray
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.evaluate.fruits import Truth
from pomona.formats.detections.png_masks import decoded_image, masks_of_ids
from pomona.formats.files import read_text
from pomona.formats.json_file import load_json
from pomona.formats.xyz import first_lines
from pomona.progress import Progress, track
from pomona.stages.capture import load_photos
from pomona.values.detections import Detections, SurveyDetections
from pomona.values.photos import Photos

_TRANSFORMS = "nerfstudio's transforms.json with frames"
_OBJECTS = "a Wavefront file with an object (o) of vertices (v) for each fruit"
_WHITE = 255  # masks of fruit or not, without ids, are 0 and 1 or 0 and 255
_LEAST_PX = 12  # smaller specks are no fruits


@dataclass(frozen=True)
class FruitNerfScene:
    """The files of one tree; `masks` by photo, `objects` where the true fruits are known."""

    folder: Path
    transforms: Path
    photos: tuple[Path, ...]
    masks: dict[Path, Path]
    objects: Path | None

    @property
    def name(self) -> str:
        """What the tree's folder is called."""
        return self.folder.name

    @property
    def described(self) -> str:
        """What there is of it."""
        masks = f"{len(self.masks)} masks" if self.masks else "no masks"
        return (
            f"{self.name}: {len(self.photos)} photos, {masks}, true fruits {'known' if self.objects else 'not known'}"
        )


def find_scenes(root: Path) -> list[FruitNerfScene]:
    """Return the trees below a folder, in the order of their names.

    Raises `MissingFileError`, `InputError` where there is none, and `FormatError` for files that are broken.
    """
    if not root.is_dir():
        raise MissingFileError(f"{root}: expected the folder of the unpacked FruitNeRF dataset, but there is none")
    scenes = [_scene(path) for path in sorted(root.rglob("transforms.json"))]
    if not scenes:
        raise InputError(f"{root}: expected a folder a tree with {_TRANSFORMS}, found none")
    return scenes


def load_scene_photos(scene: FruitNerfScene, progress: Progress) -> Photos:
    """Return the photos that the frames name."""
    return load_photos(list(scene.photos), sides="none", min_photos=1, progress=progress)


def read_scene_masks(scene: FruitNerfScene, photos: Photos, progress: Progress) -> SurveyDetections:
    """Return the fruits of the masks, each sure: by their numbers, or of black and white ones what hangs together.

    Raises `FormatError` where a mask has another size than its photo, or cannot be read.
    """
    by_photo: dict[str, Detections] = {}
    next_id = 1
    for photo in track(photos, progress, "reading masks", len(photos)):
        ids = _ids(scene.masks[photo.path])
        if ids.shape != (photo.height_px, photo.width_px):
            raise FormatError(
                f"{scene.masks[photo.path]}: expected the size of {photo.name}, {photo.width_px} × {photo.height_px}, "
                f"found {ids.shape[1]} × {ids.shape[0]}"
            )
        masks = tuple(mask for _, mask in masks_of_ids(ids) if mask.area_px >= _LEAST_PX)
        new_ids = np.arange(next_id, next_id + len(masks))
        next_id += len(masks)
        by_photo[photo.name] = Detections(
            photo.name, photo.width_px, photo.height_px, masks, np.ones(len(masks)), new_ids
        )
    return SurveyDetections(by_photo)


def read_objects(path: Path) -> Truth:
    """Return the fruits of a Wavefront file, in its own frame and units: middle and mean side of each object's box.

    Raises `FormatError` naming the line.
    """
    objects: list[list[list[float]]] = []
    for number, line in enumerate(read_text(path, _OBJECTS).splitlines(), start=1):
        words = line.split()
        if words[:1] == ["o"]:
            objects.append([])
        elif words[:1] == ["v"]:
            if not objects:
                objects.append([])
            try:
                x, y, z = (float(word) for word in words[1:4])
            except ValueError:
                raise FormatError(f"{path}, line {number}: expected v x y z, found '{line[:60]}'") from None
            objects[-1].append([x, y, z])
    corners = [(np.min(vertices, axis=0), np.max(vertices, axis=0)) for vertices in objects if vertices]
    if not corners:
        raise FormatError(f"{path}: expected {_OBJECTS}, found no vertex; it begins:\n{first_lines(path)}")
    boxes = np.array([np.concatenate(pair) for pair in corners])
    try:
        return Truth.from_boxes(boxes)
    except InputError as error:
        raise FormatError(f"{path}: {error}") from None


def _scene(transforms: Path) -> FruitNerfScene:
    folder = transforms.parent
    content = load_json(transforms, _TRANSFORMS)
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames:
        raise FormatError(f"{transforms}: expected {_TRANSFORMS}, found none")
    photos, masks = [], {}
    for k, frame in enumerate(frames):
        if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
            raise FormatError(f"{transforms}: frames[{k}].file_path: expected a photo's path")
        photo = _file(transforms, folder, frame["file_path"], f"frames[{k}].file_path")
        photos.append(photo)
        if isinstance(frame.get("semantic_path"), str):
            masks[photo] = _file(transforms, folder, frame["semantic_path"], f"frames[{k}].semantic_path")
    if masks and len(masks) < len(photos):
        raise FormatError(f"{transforms}: expected semantic_path in all {len(photos)} frames or in none")
    found = [place for place in (folder / "fruits.obj", folder.parent / "fruits.obj") if place.is_file()]
    return FruitNerfScene(folder, transforms, tuple(photos), masks, found[0] if found else None)


def _file(transforms: Path, folder: Path, name: str, place: str) -> Path:
    path = folder / name.replace("\\", "/")
    try:
        is_inside = path.resolve().is_relative_to(folder.resolve())
    except ValueError:  # NUL, or half a character
        raise FormatError(f"{transforms}: {place}: expected a file's name, found {name!r:.80}") from None
    if not is_inside:
        raise FormatError(
            f"{transforms}: {place}: expected a file in {folder}, found '{name:.80}', which leads out of it"
        )
    if not path.is_file():
        raise MissingFileError(f"{transforms}: {place}: {path} does not exist")
    return path


def _ids(path: Path) -> IntArray:
    """An image of ids; of one that is black and white the parts that hang together."""
    try:
        stored = decoded_image(path.read_bytes(), cv2.IMREAD_UNCHANGED)
    except OSError:
        stored = None
    if stored is None:
        raise FormatError(f"{path}: expected an image of masks, but it cannot be read")
    grey = np.asarray(stored if stored.ndim == 2 else stored[:, :, :3].max(axis=2))
    if np.isin(grey, (0, 1, _WHITE)).all():
        return np.asarray(ndimage.label(grey > 0)[0], np.int64)
    return grey.astype(np.int64)
