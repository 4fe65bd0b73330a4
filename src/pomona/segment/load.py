"""Which segmenter: the shipped one, a model file, or one that another package brings."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path

from pomona.errors import InputError, MissingFileError
from pomona.segment.protocol import Segmenter

SHIPPED_WEIGHTS = Path(__file__).parent / "weights" / "fruit.onnx"
PLUGIN_GROUP = "pomona.segmenters"


def load_segmenter(model: str | Path | None = None, *, score_floor: float | None = None) -> Segmenter:
    """Return the segmenter that `model` means.

    None: the weights shipped with Pomona; a file `*.onnx`, or `*.pt` or `*.pth` (a torchvision Mask R-CNN, which needs
    the `train` extra); or the name of an entry point of group `pomona.segmenters`, a callable without arguments that
    returns a `Segmenter`. `score_floor` is the least score that the segmenter is to report, where it can be chosen.

    Raises `MissingFileError`, `FormatError`, `MissingExtraError`, or `InputError` for a name that nothing answers to.
    """
    if model is None:
        if not SHIPPED_WEIGHTS.is_file():
            raise MissingFileError(
                f"The weights that Pomona ships are missing: expected {SHIPPED_WEIGHTS}; reinstall the package "
                "or name a model file"
            )
        model = SHIPPED_WEIGHTS
    path = Path(model)
    if path.suffix == ".onnx":
        from pomona.segment.onnx import OnnxSegmenter

        return OnnxSegmenter(path, score_floor=score_floor)
    if path.suffix in (".pt", ".pth"):
        from pomona.segment.torchvision import MaskRcnnSegmenter

        return MaskRcnnSegmenter(path, score_floor=score_floor)
    plugins = {entry.name: entry for entry in entry_points(group=PLUGIN_GROUP)}
    if str(model) in plugins:
        loaded: Segmenter = plugins[str(model)].load()()
        return loaded
    names = f" or one of the installed segmenters: {', '.join(sorted(plugins))}" if plugins else ""
    raise InputError(f"Model '{model}': expected a file ending in .onnx, .pt or .pth{names}")
