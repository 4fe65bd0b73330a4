"""Any fruit by its name: a detector that takes words finds boxes, a segmenter that takes boxes finds the masks.

Both run in Hugging Face transformers, which comes with the `open-vocabulary` extra and is imported here alone; their
weights come from the hub or from a folder. Boxes: OWLv2, OWL-ViT (Minderer 2022, 2023), Grounding DINO (Liu 2023).
Masks: Segment Anything 1 or 2 (Kirillov 2023, Ravi 2024). The weights used by default are Apache-2.0.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pomona.basics.arrays import ByteArray, Float32Array, FloatArray
from pomona.errors import FormatError, InputError, MissingExtraError, MissingFileError
from pomona.formats.files import from_home
from pomona.stages.segment.box_overlap import non_maximum_suppression
from pomona.stages.segment.placement import TilePlacement, corners, with_masks
from pomona.stages.segment.protocol import SegmenterTraits, TileByTile, TileDetections

DEFAULT_DETECTOR = "google/owlv2-base-patch16-ensemble"
DEFAULT_MASKS = "facebook/sam2.1-hiera-tiny"
_SCORE_THRESHOLDS = {"owlvit": 0.2, "owlv2": 0.2, "grounding-dino": 0.3, "mm-grounding-dino": 0.3}
_MAX_BOX_IOU = 0.6
_MASK_BEYOND_BOX = 0.05
_BOXES_AT_ONCE = 32
_GREY = 127


@dataclass(frozen=True)
class Wish:
    """What to look for, and the weights of the two networks: a folder each, or the name on the hub."""

    words: tuple[str, ...]
    detector: str = DEFAULT_DETECTOR
    masks: str = DEFAULT_MASKS

    @classmethod
    def parse(cls, text: str) -> Wish:
        """Read `WORDS`, `WORDS@DETECTOR` or `WORDS@DETECTOR+MASKS`; several words are separated by commas.

        A folder with the subfolders `detector` and `masks` stands for both. Raises `InputError`.
        """
        said, _, weights = text.partition("@")
        words = tuple(word.strip() for word in said.split(",") if word.strip())
        if not words:
            raise InputError(f"Model 'open:{text}': expected what to look for, such as 'open:ripe apple'")
        detector, masks = weights, ""
        if "+" in weights and not from_home(weights).is_dir():
            detector, _, masks = weights.partition("+")
        elif weights and all((from_home(weights) / part).is_dir() for part in ("detector", "masks")):
            detector, masks = f"{weights}/detector", f"{weights}/masks"
        return cls(words, _at_home(detector) or DEFAULT_DETECTOR, _at_home(masks) or DEFAULT_MASKS)


class OpenVocabularySegmenter(TileByTile):
    """A `Segmenter` that finds whatever words say.

    Raises `MissingExtraError` without transformers, `MissingFileError` for a folder that does not exist or weights
    that the hub does not give, and `FormatError` for weights of another kind of network.
    """

    def __init__(self, wish: Wish, *, score_floor: float | None = None) -> None:
        self._transformers, self._torch = _engines()
        self._device = "cuda" if self._torch.cuda.is_available() else "cpu"
        self._wish = wish
        self._detector = self._network(wish.detector, "AutoModelForZeroShotObjectDetection", "a detector")
        self._masker = self._network(wish.masks, "AutoModelForMaskGeneration", "a segmenter from boxes")
        kind = self._detector.config.model_type
        if kind not in _SCORE_THRESHOLDS:
            raise FormatError(f"{wish.detector}: expected one of {', '.join(_SCORE_THRESHOLDS)}, found {kind}")
        self._words = self._processor(wish.detector, "AutoProcessor")
        self._pixels_of_masker = self._processor(wish.masks, "AutoImageProcessor")
        tile_px = _side_px(self._words.image_processor.size)
        # Tiles of the detector's own size, so that the photo's scale is kept.
        traits = SegmenterTraits(score_threshold=_SCORE_THRESHOLDS[kind], tile_px=tile_px, min_overlap_px=tile_px // 4)
        name = f"open:{','.join(wish.words)}@{_named(wish.detector)}+{_named(wish.masks)}"
        super().__init__(name, traits, score_floor)

    @classmethod
    def named(cls, text: str, *, score_floor: float | None = None) -> OpenVocabularySegmenter:
        """Return the segmenter of `WORDS`, `WORDS@DETECTOR` or `WORDS@DETECTOR+MASKS`."""
        return cls(Wish.parse(text), score_floor=score_floor)

    def _segment_tile(self, tile: ByteArray) -> TileDetections:
        with self._torch.inference_mode():
            return self._in_tile(tile)

    def _in_tile(self, tile: ByteArray) -> TileDetections:
        height, width = tile.shape[:2]
        side = max(height, width)
        # A square, so that it makes no difference whether a network's own processor pads or stretches.
        square = np.full((side, side, 3), _GREY, np.uint8)
        square[:height, :width] = tile
        boxes, scores = self._boxes(square)
        kept = np.flatnonzero(non_maximum_suppression(boxes, scores, _MAX_BOX_IOU))
        placement = TilePlacement((width, height), (side, side), (1.0, 1.0), (0, 0))
        boxes, scores = placement.boxes_in_tile(boxes[kept]), scores[kept]
        seen = (boxes[:, 2:] - boxes[:, :2] >= 1).all(1)
        boxes, scores = boxes[seen], scores[seen]
        masks = []
        for box, logits in zip(boxes, self._logits(square, boxes), strict=True):
            grown = placement.grown(box, _MASK_BEYOND_BOX)
            cell_px = side / logits.shape[1], side / logits.shape[0]
            masks.append(placement.mask_in_tile(logits, (0, 0), cell_px, grown))
        return with_masks(boxes, scores, masks)

    def _boxes(self, square: ByteArray) -> tuple[FloatArray, FloatArray]:
        """Boxes (n, 4) in pixels and scores (n,) of what the words say."""
        inputs = self._words(images=square, text=[list(self._wish.words)], return_tensors="pt").to(self._device)
        outputs = self._detector(**inputs)
        scores = outputs.logits[0].sigmoid().amax(-1).cpu().numpy().astype(float)
        kept = np.flatnonzero(scores >= self._score_floor)
        found = outputs.pred_boxes[0].cpu().numpy().astype(float)[kept] * square.shape[0]
        return corners(found), scores[kept]

    def _logits(self, square: ByteArray, boxes: FloatArray) -> list[Float32Array]:
        """The mask of each box as logits (h, w) over the whole square."""
        if len(boxes) == 0:
            return []
        pixels = self._pixels_of_masker(images=square, return_tensors="pt")["pixel_values"].to(self._device)
        image = self._masker.get_image_embeddings(pixels)
        scaled = self._torch.tensor(boxes * (pixels.shape[-1] / square.shape[0]), dtype=pixels.dtype).to(self._device)
        logits: list[Float32Array] = []
        for part in scaled.split(_BOXES_AT_ONCE):
            masks = self._masker(image_embeddings=image, input_boxes=part[None], multimask_output=False).pred_masks
            logits.extend(np.asarray(mask, np.float32) for mask in masks[0, :, 0].cpu().numpy())
        return logits

    def _network(self, source: str, loader: str, expected: str) -> Any:
        """Load a network from a folder or the hub; nothing of it may be left to chance."""
        model, info = _loaded(
            source, expected, getattr(self._transformers, loader).from_pretrained, output_loading_info=True
        )
        parameters = {name for name, _ in model.named_parameters()}
        if missing := sorted(parameters & set(info["missing_keys"])):
            raise FormatError(
                f"{source}: expected all weights of {type(model).__name__}; {len(missing)} missing: "
                f"{', '.join(missing[:2])}{', …' if len(missing) > 2 else ''}"
            )
        return model.to(self._device).eval()

    def _processor(self, source: str, loader: str) -> Any:
        return _loaded(source, "the settings of its processor", getattr(self._transformers, loader).from_pretrained)


def _at_home(source: str) -> str:
    return str(from_home(source.strip())) if source.startswith("~") else source.strip()


def _engines() -> tuple[Any, Any]:
    try:
        import torch
        import transformers
    except ImportError:
        raise MissingExtraError(
            "Finding fruit by words needs transformers and PyTorch: install them with "
            "`pip install 'pomona[open-vocabulary]'`"
        ) from None
    return transformers, torch


def _loaded(source: str, expected: str, load: Any, **options: Any) -> Any:
    folder = Path(source)
    if folder.exists() and not folder.is_dir():
        raise FormatError(f"{source}: expected a folder with {expected} saved by transformers, found a file")
    if not folder.is_dir() and (source.count("/") != 1 or source.startswith(("/", "."))):
        raise MissingFileError(f"{source}: expected a folder, or a name on the hub such as {DEFAULT_DETECTOR}")
    try:
        return load(str(folder) if folder.is_dir() else source, local_files_only=folder.is_dir(), **options)
    except Exception as error:  # Whatever the libraries below it raise for a damaged file: no common base class.
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        if folder.is_dir():
            raise FormatError(f"{source}: expected a folder with {expected} saved by transformers: {reason}") from error
        raise MissingFileError(
            f"{source}: expected {expected} on the hub, or a folder of that name: {reason}. Without a connection, "
            "download the weights elsewhere and give their folders: open:WORDS@DETECTOR+MASKS"
        ) from error


def _side_px(size: Any) -> int:
    """The side of the square that an image processor makes of a square."""
    wanted = dict(size)
    return int(wanted.get("shortest_edge") or wanted.get("height") or max(value for value in wanted.values() if value))


def _named(source: str) -> str:
    """The hub's name, or the folder's with a digest of what it holds."""
    folder = Path(source)
    if not folder.is_dir():
        return source
    digest = hashlib.sha256()
    for file in sorted(file for file in folder.rglob("*") if file.is_file()):
        digest.update(file.relative_to(folder).as_posix().encode())
        with file.open("rb") as content:
            digest.update(hashlib.file_digest(content, "sha256").digest())
    return f"{folder.name}-{digest.hexdigest()[:12]}"
