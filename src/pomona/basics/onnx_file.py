"""An ONNX file, opened once: what goes in, what comes out, what it says; ONNX Runtime is imported here alone."""

from __future__ import annotations

import ast
import contextlib
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from pomona.basics.arrays import Array, Float32Array
from pomona.basics.gpu import what_is_missing
from pomona.basics.threads import cores
from pomona.errors import FormatError, MissingFileError, OutOfMemoryError, is_out_of_memory

# A photo on each of some cores takes a fifth less of them than one photo after another on all; each takes memory of its
# own.
_MOST_AT_ONCE = 4
# What runs a network, the best first; CUDA's is there where the package `onnxruntime-gpu` is installed.
_PROVIDERS = ("CUDAExecutionProvider", "CPUExecutionProvider")
_WARNING, _FATAL = 2, 4  # levels of ONNX Runtime's log, of which the first is what it has by itself
_FLOATS = {"tensor(float)": np.float32, "tensor(float16)": np.float16}


@dataclass(frozen=True)
class Tensor:
    """An input or output of a network; sizes that the file leaves free are None."""

    name: str
    kind: str
    shape: tuple[int | None, ...]

    def __str__(self) -> str:
        sizes = ", ".join("?" if size is None else str(size) for size in self.shape)
        return f"{self.name} {self.kind} ({sizes})"


class OnnxFile:
    """A network that runs on the GPU where ONNX Runtime can use one, else on the CPU.

    `note` says why it runs on the CPU where ONNX Runtime was made for GPUs; `at_once` how many threads had best run it
    at the same time.

    Raises `MissingFileError` when there is no such file and `FormatError` when ONNX Runtime cannot load it.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        if not self.path.is_file():
            raise MissingFileError(f"Model {path}: no such file")
        self._session, self.note = _open(self.path)
        self.at_once = _at_once() if self._session.get_providers()[0] == "CPUExecutionProvider" else 1
        try:
            self.metadata: Mapping[str, str] = dict(self._session.get_modelmeta().custom_metadata_map)
            self.inputs = tuple(map(_tensor, self._session.get_inputs()))
            self.outputs = tuple(map(_tensor, self._session.get_outputs()))
        except UnicodeDecodeError as error:
            raise FormatError(f"{path}: expected an ONNX model with names and metadata in UTF-8, but {error}") from None

    def run(self, image: Array, outputs: Sequence[str]) -> list[Float32Array]:
        """Run the network on its one input and return the outputs named, as float32.

        Raises `FormatError` where ONNX Runtime cannot, and `OutOfMemoryError`.
        """
        (node,) = self.inputs
        feed = {node.name: np.ascontiguousarray(image, _FLOATS[node.kind])}
        try:
            found = self._session.run(list(outputs), feed)
        except Exception as error:  # ONNX Runtime's own exceptions share no base class but this one.
            given = f"an image of shape {image.shape}"
            if is_out_of_memory(error):
                raise OutOfMemoryError(
                    f"{self.path}: there is not enough memory here to run this model on {given}. What was finished is "
                    "kept: end other programs, or use a computer with more, and the same command goes on where it was"
                ) from None
            raise FormatError(
                f"{self.path}: ONNX Runtime cannot run this model on {given}: {_first_line(error)}"
            ) from None
        return [np.asarray(output, np.float32) for output in found]

    def image_size(self, default_px: tuple[int, int] | None) -> tuple[int, int]:
        """Return the (width, height) of the one image (1, 3, H, W) that the network takes.

        `default_px`: what to take where the file leaves them free. Raises `FormatError` for other inputs.
        """
        expected = "one input of floats (1, 3, H, W)"
        found = "; ".join(map(str, self.inputs))
        if len(self.inputs) != 1 or len(self.inputs[0].shape) != 4 or self.inputs[0].kind not in _FLOATS:
            raise FormatError(f"{self.path}: expected {expected}, found {found}")
        batch, channels, height, width = self.inputs[0].shape
        if batch not in (1, None) or channels not in (3, None):
            raise FormatError(f"{self.path}: expected {expected}, found {found}: export it again for batches of one")
        if 0 in (width, height):
            raise FormatError(f"{self.path}: expected {expected}, found {found}: an image without pixels")
        if width is not None and height is not None:
            return width, height
        if default_px is None:
            raise FormatError(f"{self.path}: expected an input of fixed size, found {found}: export it again with one")
        return default_px[0] if width is None else width, default_px[1] if height is None else height

    def with_fixed_shapes(self, outputs: Sequence[Tensor], image_px: tuple[int, int]) -> list[Tensor]:
        """Return the outputs with the shapes that they have for an image of (width, height).

        Where the file leaves sizes free, the network runs on a blank image once to show them.
        """
        if not any(size is None for node in outputs for size in node.shape[1:]):
            return list(outputs)
        found = self.run(np.zeros((1, 3, image_px[1], image_px[0])), [node.name for node in outputs])
        return [Tensor(node.name, node.kind, output.shape) for node, output in zip(outputs, found, strict=True)]

    def literal(self, key: str, expected: str) -> Any:
        """Return a metadata entry that is written as a Python literal, or None where it is missing.

        Raises `FormatError` saying what was `expected` when it is no literal.
        """
        if key not in self.metadata:
            return None
        try:
            return ast.literal_eval(self.metadata[key])
        except (ValueError, SyntaxError, MemoryError, RecursionError):
            raise FormatError(
                f"{self.path}: metadata {key}: expected {expected}, found '{self.metadata[key][:80]}'"
            ) from None

    def numbers(self, key: str, count: int) -> list[float]:
        """Return the positive numbers of a metadata entry, separated by commas; raises `FormatError`."""
        return positive_numbers(self.path, self.metadata, key, count)


def positive_numbers(path: Path, entries: Mapping[str, str], key: str, count: int) -> list[float]:
    """Return the positive numbers, separated by commas, of a metadata entry of model file `path`.

    Raises `FormatError` naming the entry and what was expected.
    """
    form = "a positive number" if count == 1 else f"{count} positive numbers separated by commas"
    if key not in entries:
        raise FormatError(f"{path}: metadata {key} is missing: expected {form}")
    try:
        numbers = [float(part) for part in entries[key].split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(math.isfinite(number) and number > 0 for number in numbers):
        raise FormatError(f"{path}: metadata {key}: expected {form}, found '{entries[key]}'")
    return numbers


def _tensor(node: Any) -> Tensor:
    return Tensor(node.name, node.type, tuple(size if isinstance(size, int) else None for size in node.shape))


def chosen_providers(available: Sequence[str]) -> list[str]:
    """Return which of ONNX Runtime's providers a network is to run on, the best first."""
    return [name for name in _PROVIDERS if name in available]


def _at_once() -> int:
    return min(_MOST_AT_ONCE, cores())


def _open(path: Path) -> tuple[Any, str | None]:
    """A session on the best provider that works, and why it is not the best that ONNX Runtime has."""
    import onnxruntime as ort

    options = ort.SessionOptions()
    options.log_severity_level = 3
    # Threads that wait for work by turning in circles take processors from each other, and from others: half as much
    # again of what a photo takes, on two that were busy.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.intra_op_num_threads = cores() // _at_once()
    # Memory laid out for images of one size is of no use where sizes vary, and is asked for anew each time.
    options.enable_mem_pattern = False
    best, *_ = providers = chosen_providers(ort.get_available_providers())
    reason = _libraries_missing() or what_is_missing() or "it was not loaded" if best == _PROVIDERS[0] else ""
    while True:
        try:
            # Without ONNX Runtime's own fallback, which prints to where results go.
            with _silent(ort):
                session = ort.InferenceSession(str(path), sess_options=options, providers=providers, enable_fallback=0)
        except Exception as error:  # ONNX Runtime's own exceptions share no base class but this one.
            reason = _first_line(error)
            if len(providers) < 2:
                raise FormatError(
                    f"{path}: expected an ONNX model, but ONNX Runtime cannot load it: {reason}"
                ) from None
            providers = providers[1:]
            continue
        return session, None if session.get_providers()[0] == best else _without_gpu(reason)


@cache
def _libraries_missing() -> str:
    """Load the libraries of CUDA and cuDNN where pip installs them; say which could not be loaded, "" for none."""
    import onnxruntime as ort

    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        ort.preload_dlls()
    return said.getvalue().strip().partition("\n")[0]


@contextlib.contextmanager
def _silent(ort: ModuleType) -> Iterator[None]:
    """Keep ONNX Runtime from printing what it cannot load: that is said in a warning."""
    ort.set_default_logger_severity(_FATAL)
    try:
        yield
    finally:
        ort.set_default_logger_severity(_WARNING)


def _without_gpu(reason: str) -> str:
    return (
        "This ONNX Runtime is made for NVIDIA GPUs, but could not use one, so that networks run on the CPU, which "
        f"gives the same results and takes longer ({reason}). It needs a GPU with its driver, and the versions of CUDA "
        'and cuDNN that it was built for, which `pip install "onnxruntime-gpu[cuda,cudnn]"` brings'
    )


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
