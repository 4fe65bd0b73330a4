"""What can be chosen about the paper's method: its constants, and where its text and its published code differ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from pomona.errors import InputError

Overlap = Literal["either", "iou"]
Projection = Literal["lens", "dlt"]


@dataclass(frozen=True, kw_only=True)
class PaperOptions:
    """Options of `paper.fuse`. Lengths are metres; docs/paper-method.md tells where each value comes from.

    `min_score`: detections below are not used. `eps_m`, `dbscan_min_points`: DBSCAN's. `overlap`: "iou" is intersection
    over union, "either" intersection over the smaller of the two sets; a detection joins an earlier fruit above
    `min_overlap`. `unify_all`: a detection that overlaps several fruits makes one of them, else it joins the best.
    `min_points`, `min_views`: fruits with fewer points of the cloud, or seen in fewer photos, are dropped.
    `split_above_points`: fruits with more points are split in two by k-means. `projection`: "dlt" replaces every camera
    by a pinhole without lens distortion, fitted to its sparse points.
    """

    min_score: float = 0.5
    eps_m: float = 0.03
    dbscan_min_points: int = 10
    overlap: Overlap = "either"
    min_overlap: float = 0.5
    unify_all: bool = True
    min_points: int = 10
    min_views: int = 1
    split_above_points: int | None = None
    projection: Projection = "lens"

    def __post_init__(self) -> None:
        if self.overlap not in get_args(Overlap):
            raise InputError(f"overlap: expected one of {', '.join(get_args(Overlap))}, found {self.overlap!r}")
        if self.projection not in get_args(Projection):
            raise InputError(
                f"projection: expected one of {', '.join(get_args(Projection))}, found {self.projection!r}"
            )
        if not self.eps_m > 0:
            raise InputError(f"eps_m: expected a positive distance in metres, found {self.eps_m}")
        for name in ("min_score", "min_overlap"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"{name}: expected 0 to 1, found {getattr(self, name)}")
        for name in ("dbscan_min_points", "min_points", "min_views"):
            if getattr(self, name) < 1:
                raise InputError(f"{name}: expected at least 1, found {getattr(self, name)}")
        if self.split_above_points is not None and self.split_above_points < 2:
            raise InputError(f"split_above_points: expected None or at least 2, found {self.split_above_points}")

    @classmethod
    def as_printed(cls) -> PaperOptions:
        """Return the reading of the text that is nearest to its letter: IoU, each detection joins one fruit."""
        return cls(overlap="iou", unify_all=False)

    @classmethod
    def as_published_code(cls) -> PaperOptions:
        """Return what the authors' published program does."""
        return cls(min_score=0.95, split_above_points=4000, projection="dlt")
