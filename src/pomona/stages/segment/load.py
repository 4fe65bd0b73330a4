"""Which segmenter: the shipped one, a model file, words for what to look for, or one that another package brings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from pomona.errors import FormatError, InputError, MissingFileError, PomonaError
from pomona.formats.files import from_home
from pomona.stages.segment.protocol import Segmenter, SegmenterTraits

SHIPPED_WEIGHTS = Path(__file__).parent / "weights" / "fruit.onnx"
PLUGIN_GROUP = "pomona.segmenters"
OPEN_VOCABULARY = "open"


def load_segmenter(model: str | Path | None = None, *, score_floor: float | None = None) -> Segmenter:
    """Return the segmenter that `model` means.

    None: the weights shipped with Pomona; a file `*.onnx` (Pomona's own, or an exported YOLO-seg or RF-DETR-seg),
    or `*.onnx:CLASS,CLASS` where only some classes are fruit; `*.pt` or `*.pth` (a torchvision Mask R-CNN, which needs
    the `train` extra); `open:WORDS` or `open:WORDS@WEIGHTS` (open-vocabulary, needs the `open-vocabulary` extra); or
    `NAME` or `NAME:ARGUMENT`, an entry point of group `pomona.segmenters`, a callable that takes no argument, or that
    one, and returns a `Segmenter`. `score_floor` is the least score that the segmenter is to report, where it can be
    chosen.

    Raises `MissingFileError`, `FormatError`, `MissingExtraError`, or `InputError` for a name that nothing answers to.
    """
    model = SHIPPED_WEIGHTS if model is None else model
    path, classes = _file_and_classes(model)
    if path.parent == SHIPPED_WEIGHTS.parent and not path.is_file():
        raise MissingFileError(
            f"The weights that Pomona ships are missing: expected {path}; reinstall the package or name a model file"
        )
    if path.suffix == ".onnx":
        return _load_onnx(path, classes, score_floor)
    if path.suffix in (".pt", ".pth"):
        from pomona.stages.segment.mask_rcnn import MaskRcnnSegmenter

        return MaskRcnnSegmenter(path, score_floor=score_floor)
    check_name(model)
    name, colon, argument = str(model).partition(":")
    if name == OPEN_VOCABULARY:
        from pomona.stages.segment.open_vocabulary import OpenVocabularySegmenter

        return OpenVocabularySegmenter.named(argument, score_floor=score_floor)
    return _plugin(_plugins()[name], argument if colon else None)


def check_name(model: str | Path) -> None:
    """Raise `InputError` for a model that is neither a model file by its suffix nor a name that is known here."""
    path, _ = _file_and_classes(model)
    plugins, name = _plugins(), str(model).partition(":")[0]
    if path.suffix in (".onnx", ".pt", ".pth") or name in (OPEN_VOCABULARY, *plugins):
        return
    names = f", or one of the installed segmenters: {', '.join(sorted(plugins))}" if plugins else ""
    raise InputError(f"`model` '{model}': expected a file ending in .onnx, .pt or .pth, or open:WORDS{names}")


def _plugins() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=PLUGIN_GROUP)}


def shipped_weights(name: str) -> Path:
    """Return the file of shipped weights of a name, as `FruitKind.weights` has it."""
    return SHIPPED_WEIGHTS.with_stem(name)


def files_of(model: str | Path | None) -> tuple[Path, ...]:
    """Return the files here that `model` names, sorted: what a result made with it depends on.

    None for an installed segmenter and for weights that come from a hub.
    """
    if model is None:
        return (SHIPPED_WEIGHTS,)
    path, _ = _file_and_classes(model)
    if path.is_file():
        return (path,)
    name, _, argument = str(model).partition(":")
    if name != OPEN_VOCABULARY:
        return ()
    from pomona.stages.segment.open_vocabulary import Wish

    wish = Wish.parse(argument)
    folders = [Path(source) for source in (wish.detector, wish.masks)]
    return tuple(sorted(file for folder in folders if folder.is_dir() for file in folder.rglob("*") if file.is_file()))


def engines_of(model: str | Path | None) -> tuple[str, ...]:
    """Return the packages that the segmenter of `model` runs in, besides ONNX Runtime: those of the extras."""
    if model is None:
        return ()
    path, _ = _file_and_classes(model)
    if path.suffix in (".pt", ".pth"):
        return ("torch", "torchvision")
    return ("torch", "torchvision", "transformers") if str(model).partition(":")[0] == OPEN_VOCABULARY else ()


def located(model: str, folder: Path) -> str:
    """Return a model that is a file by its whole path, where it is said as seen from `folder`; others as they are."""
    path, classes = _file_and_classes(model)
    path = folder / from_home(path)
    if not path.is_file():
        return model
    return ":".join([str(path.resolve()), *([",".join(classes)] if classes else [])])


def _file_and_classes(model: str | Path) -> tuple[Path, tuple[str, ...]]:
    """The path, and the classes after a colon behind an ONNX file's name."""
    match = re.fullmatch(r"(.+\.onnx):(.*)", str(model))
    if match is None or Path(model).exists():
        return Path(model), ()
    classes = tuple(part.strip() for part in match[2].split(",") if part.strip())
    if not classes:
        raise InputError(f"Model '{model}': expected the classes that are fruit behind the colon, by name or number")
    return Path(match[1]), classes


def _load_onnx(path: Path, classes: Sequence[str], score_floor: float | None) -> Segmenter:
    """Return the segmenter of an ONNX file: which network it holds is found from its metadata and outputs.

    `classes`: which are fruit, by name or number; empty: worked out.
    """
    from pomona.basics.onnx_file import OnnxFile
    from pomona.stages.segment.center_offset import KIND, CenterOffsetSegmenter
    from pomona.stages.segment.rf_detr_seg import RfDetrSegmenter
    from pomona.stages.segment.yolo_seg import YoloSegmenter

    file = OnnxFile(path)
    if "pomona.kind" in file.metadata:
        if classes:
            raise InputError(f"{path}: a model of Pomona knows one class, fruit; leave out ':{','.join(classes)}'")
        return CenterOffsetSegmenter(file, score_floor=score_floor)
    exported = (YoloSegmenter, RfDetrSegmenter)
    for segmenter in exported:
        if segmenter.outputs_of(file) is not None:
            return segmenter(file, classes=classes, score_floor=score_floor)
    known = (f"Pomona's own (metadata pomona.kind = '{KIND}')", *(segmenter.layout for segmenter in exported))
    raise FormatError(
        f"{path}: its outputs are of no layout that Pomona knows. Found: {'; '.join(map(str, file.outputs))}. "
        f"Known: {'; '.join(known)}. A detector without masks has to be exported again from its segmentation variant; "
        f"for any other network, see docs/reference/detectors.md"
    )


def _plugin(entry: EntryPoint, argument: str | None) -> Segmenter:
    """What an entry point makes; whatever goes wrong in it is said as an error of the package that it comes from."""
    package = f" of package {entry.dist.name}" if entry.dist is not None else ""
    where = f"Segmenter '{entry.name}'{package} (entry point {entry.value})"
    try:
        factory = entry.load()
    except Exception as error:  # Another package's code may raise anything.
        raise InputError(f"{where} cannot be imported: {_said(error)}. Reinstall or update that package") from error
    if not callable(factory):
        raise InputError(f"{where}: expected a function or class, found an object of type {type(factory).__name__}")
    try:
        made = factory() if argument is None else factory(argument)
    except PomonaError:
        raise
    except Exception as error:
        given = "without an argument" if argument is None else f"with the argument '{argument}'"
        raise InputError(f"{where} could not be made {given}: {_said(error)}") from error
    if not isinstance(made, Segmenter) or not isinstance(made.traits, SegmenterTraits):
        raise InputError(
            f"{where}: expected a pomona.stages.segment.Segmenter (name, traits, segment), "
            f"found an object of type {type(made).__name__}"
        )
    return made


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"
