"""Pomona: photographs of an orchard row in, every fruit out.

    survey = pomona.run("photos/", "my-row")
    survey.fruits.to_pandas()

A run goes through the stages in the order of `stages/__init__.py`:

    capture, segment, sfm, scale, fuse, second_look, filter, measure, planting, dense, scene, yields, report

Importing this package is quick: each outside engine (pycolmap, ONNX Runtime, torch, OpenCV) is imported by the stage
that needs it.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pomona.api import Survey, adapt, compare, open, run, sample_folder
    from pomona.pipeline.options import RunOptions

__version__ = "0.1.0"
__all__ = ["RunOptions", "Survey", "__version__", "adapt", "compare", "open", "run", "sample_folder"]


def __getattr__(name: str) -> object:
    if name == "RunOptions":
        from pomona.pipeline.options import RunOptions

        return RunOptions
    if name in ("Survey", "adapt", "compare", "open", "run", "sample_folder"):
        from pomona import api

        return getattr(api, name)
    raise AttributeError(f"module 'pomona' has no attribute '{name}'")


def __dir__() -> list[str]:
    return __all__
