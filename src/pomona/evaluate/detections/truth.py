"""The true fruits of photos: boxes, masks where there are some, and which of them are not to be scored."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.errors import InputError, few
from pomona.formats.detections.coco_file import CocoImage
from pomona.progress import Progress, Silent
from pomona.values.detections import Mask
from pomona.values.photo_names import pair_names


@dataclass(frozen=True, eq=False)
class PhotoTruth:
    """The n true fruits of one photo of `width_px` × `height_px` pixels.

    `boxes_px` (n, 4) holds x0, y0, x1, y1 edges; `masks` is None where the truth has boxes alone. `ignored` (n,) are
    not scored; `crowds` (n,) neither, and any number of detections may lie in one of them.
    """

    photo: str
    width_px: int
    height_px: int
    ids: IntArray
    boxes_px: FloatArray
    masks: tuple[Mask, ...] | None = None
    ignored: BoolArray = field(default_factory=lambda: np.zeros(0, bool))
    crowds: BoolArray = field(default_factory=lambda: np.zeros(0, bool))

    def __post_init__(self) -> None:
        n = len(self.ids)
        set_checked(self, "ids", (n,), np.int64)
        set_checked(self, "boxes_px", (n, 4), np.float64)
        for name in ("ignored", "crowds"):
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.zeros(n, bool))
            set_checked(self, name, (n,), bool)
        if self.masks is not None and len(self.masks) != n:
            raise InputError(f"PhotoTruth of {self.photo}: expected {n} masks, found {len(self.masks)}")

    def __len__(self) -> int:
        return len(self.ids)

    def scored(self, min_size_px: float, min_visible_px: int) -> BoolArray:
        """Say of each true fruit (n,) whether it is to be found: wide enough, enough of it visible, not ignored."""
        large = self.boxes_px[:, 2] - self.boxes_px[:, 0] >= min_size_px
        if self.masks is not None and min_visible_px:
            large &= np.array([mask.area_px >= min_visible_px for mask in self.masks], bool)
        scored: BoolArray = large & ~self.ignored & ~self.crowds
        return scored


@dataclass(frozen=True, eq=False)
class DetectionTruth(Mapping[str, PhotoTruth]):
    """The truth of many photos by name; of all of them masks, or of none. `images` are a COCO file's."""

    by_photo: Mapping[str, PhotoTruth]
    images: tuple[CocoImage, ...] = ()

    def __post_init__(self) -> None:
        if len({truth.masks is None for truth in self.by_photo.values()}) > 1:
            raise InputError("DetectionTruth: expected masks of all photos or of none")

    def __getitem__(self, photo: str) -> PhotoTruth:
        return self.by_photo[photo]

    def __iter__(self) -> Iterator[str]:
        return iter(self.by_photo)

    def __len__(self) -> int:
        return len(self.by_photo)

    @property
    def has_masks(self) -> bool:
        """Whether the truth has masks, not boxes alone."""
        return all(truth.masks is not None for truth in self.by_photo.values())

    @property
    def total(self) -> int:
        """The number of true fruits in all photos, scored or not."""
        return sum(len(truth) for truth in self.by_photo.values())

    def of_photos(self, photos: Sequence[str], *, progress: Progress | None = None) -> DetectionTruth:
        """Return the truth of those `photos` that it knows, under their names.

        Names are paired as they are, by the end of the path, or by the stem. Photos that have no truth, and truth of
        other photos, are left out with a warning. Raises `InputError` where no name fits.
        """
        progress = progress or Silent()
        pairs = pair_names(tuple(self.by_photo), photos)
        if not pairs:
            raise InputError(
                f"The truth names no photo of the {len(photos)} that were searched: expected names such as "
                f"{few(photos, 2)}, found {few(tuple(self.by_photo), 2)}"
            )
        renamed = {photo: replace(self.by_photo[known], photo=photo) for known, photo in pairs.items()}
        kept = {photo: renamed[photo] for photo in photos if photo in renamed}
        if without := [photo for photo in photos if photo not in kept]:
            progress.warn(f"Photos without truth are left out: {few(without)}.")
        if others := [name for name in self.by_photo if name not in pairs]:
            progress.warn(f"Truth of photos that were not searched is left out: {few(others)}.")
        return DetectionTruth(kept)
