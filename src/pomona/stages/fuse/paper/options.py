"""What can be chosen about the paper's method: its constants, and where its text and its published code differ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError

Overlap = Literal["either", "iou"]
Projection = Literal["lens", "dlt"]
Grouping = Literal["dbscan", "reach"]
Unify = Literal["all", "best", "first"]


@dataclass(frozen=True, kw_only=True)
class PaperOptions:
    """Options of `paper.fuse`. Lengths are metres; docs/reference/methods/paper.md says where each value comes from.

    `min_score`: detections below are not used. `eps_m`, `dbscan_min_points`: DBSCAN's, the point itself counted.
    `grouping`: "dbscan", where noise is dropped, or "reach": a group goes on through all its points, core or not, and
    of fewer than two groups all points are taken, noise too. `overlap`: "iou" is intersection over union, "either"
    intersection over the smaller of the two sets; a detection joins an earlier fruit above `min_overlap`. `unify`: a
    detection that overlaps several fruits makes one of "all", or joins the "best", or the one seen "first".
    `min_points`, `min_views`: fruits with fewer points of the cloud, or seen in fewer photos, are dropped.
    `split_above_points`: fruits with more points are split in two by k-means. `projection`: "dlt" replaces every camera
    by a pinhole without lens distortion, fitted to its sparse points; photos with fewer than 10 of them are left out.
    Of the first estimate of centres and diameters, in radii: `scatter_radii`, how far points lie off a fruit's sphere,
    and `size_spread`, how much fruits of a row differ.
    """

    min_score: float = 0.5
    eps_m: float = 0.03
    dbscan_min_points: int = 10
    grouping: Grouping = "dbscan"
    overlap: Overlap = "either"
    min_overlap: float = 0.5
    unify: Unify = "all"
    min_points: int = 10
    min_views: int = 1
    split_above_points: int | None = None
    projection: Projection = "lens"
    scatter_radii: float = 0.12
    size_spread: float = 0.12

    def __post_init__(self) -> None:
        expect_kinds(self)
        choices = {"overlap": Overlap, "projection": Projection, "grouping": Grouping, "unify": Unify}
        for name, known in choices.items():
            if getattr(self, name) not in get_args(known):
                raise InputError(
                    f"`{name}`: expected one of {', '.join(get_args(known))}, found {getattr(self, name)!r}"
                )
        if not self.eps_m > 0:
            raise InputError(f"`eps_m`: expected a positive distance in metres, found {self.eps_m}")
        for name in ("scatter_radii", "size_spread"):
            if not getattr(self, name) > 0:
                raise InputError(f"`{name}`: expected a positive number, found {getattr(self, name)}")
        for name in ("min_score", "min_overlap"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"`{name}`: expected 0 to 1, found {getattr(self, name)}")
        for name in ("dbscan_min_points", "min_points", "min_views"):
            if getattr(self, name) < 1:
                raise InputError(f"`{name}`: expected at least 1, found {getattr(self, name)}")
        if self.split_above_points is not None and self.split_above_points < 2:
            raise InputError(f"`split_above_points`: expected None or at least 2, found {self.split_above_points}")

    @classmethod
    def as_printed(cls) -> PaperOptions:
        """Return the reading of the text that is nearest to its letter: IoU, each detection joins one fruit."""
        return cls(overlap="iou", unify="best")

    @classmethod
    def as_published_code(cls) -> PaperOptions:
        """Return what the authors' published program does (docs/reference/methods/paper.md says how that was read)."""
        return cls(
            min_score=0.95,
            dbscan_min_points=11,  # 10 others
            grouping="reach",
            unify="first",
            split_above_points=4000,
            projection="dlt",
        )
