"""What exports are made of."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

from pomona.progress import Progress
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.crop import RowSegments
from pomona.values.fruits import FruitCloud, Fruits
from pomona.values.photos import Photos
from pomona.values.trees import Trees

if TYPE_CHECKING:
    from pomona.corrections.training import LabelledMasks

Part = Literal["fruits", "cloud", "cameras"]
"""A part of a survey that has a file, or a folder, of its own."""


class ExportSource(Protocol):
    """The results of a survey, each read when an export asks for it; errors of reading them pass through."""

    @property
    def progress(self) -> Progress:
        """Who hears of what an export lacks."""
        ...

    @property
    def frame(self) -> WorldFrame:
        """What coordinates mean."""
        ...

    @property
    def fruits(self) -> Fruits:
        """The fruits, as corrected."""
        ...

    @property
    def trees(self) -> Trees:
        """The trees; none where they are not known."""
        ...

    @property
    def segments(self) -> RowSegments:
        """The parts of the row; none where nothing was estimated."""
        ...

    @property
    def cloud(self) -> FruitCloud:
        """The points on the fruits."""
        ...

    @property
    def cameras(self) -> Cameras:
        """The cameras, in `frame`."""
        ...

    def photos_of(self, cameras: Cameras) -> Photos:
        """Return the photos of `cameras`, in their order, with a warning for those that are not found.

        What stands for a photo that is not found has its name and size, and no file.
        """
        ...

    def labelled_masks(self) -> LabelledMasks:
        """Return the masks of the fruits, as corrected."""
        ...

    def file(self, part: Part) -> Path:
        """Return the survey's own file of a part; formats that are this file are copies of it."""
        ...
