"""Options of structure from motion."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal, get_args

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError

Mapper = Literal["incremental", "global"]


@dataclass(frozen=True, kw_only=True)
class SfmOptions:
    """How photos are matched and placed. The defaults are meant for every orchard; a person need not touch them.

    `max_side_px`: photos are worked on at no more than this size; results are in pixels of the whole photo.
    `max_features`: the strongest features kept of a photo.
    `contrast_threshold`: SIFT's. OpenCV's default is 0.04; leaves in the shade are dim, and `max_features` bounds the
    number of features anyway.
    `first_look_features`: so many of the largest features of a photo say which others it overlaps with.
    `window`: each photo is matched with so many photos before and after it, in order of capture.
    `exhaustive_below`: sides of at most so many photos are matched all with all.
    `loops`: each photo is matched with so many photos which look alike, wherever they are in the order.
    `gnss_neighbours`: the same with photos taken nearby, where the photos have GNSS positions.
    `enough_tracks`: mapping uses about so many points of each photo where there are more.
    `min_matches`: fewer verified matches than this do not make two photos overlap.
    `min_piece_photos`: smaller pieces of a broken reconstruction are not to be trusted, and dropped.
    `least_points`: photos that see fewer points of their piece than this have no place: six degrees of freedom need
    three points, and some of them are wrong.
    `least_explained`: pieces whose cameras explain a smaller share of their photos' matches are accidents, and dropped.
    `first_pair_angle_deg`: least angle of rays for the pair that incremental mapping starts from. COLMAP's default is
    16; photos taken at short steps along a row, or frames of a video, seldom match foliage under such an angle.
    `least_known_points`: incremental mapping places a photo that sees at least so many points which have a place.
    COLMAP's default is 30; where a walk turns a corner there are fewer, and wrong places are found out afterwards.
    `mappers`: the ways of mapping that are tried; the better result of each side is kept (see `selection`).
    `good_enough`: a result with this share of the support that pairs of photos have by themselves (see `selection`)
    ends the search for a better one.
    `focal_prior`: focal length as a multiple of the longer side, where neither EXIF nor the matches tell it.
    `threads` of features and matching: None takes all processors. Mapping takes one (see `colmap/mapping.py`).
    """

    max_side_px: int = 1296
    max_features: int = 8000
    contrast_threshold: float = 0.02
    first_look_features: int = 2000
    window: int = 6
    exhaustive_below: int = 20
    loops: int = 3
    gnss_neighbours: int = 4
    enough_tracks: int = 1000
    min_matches: int = 20
    min_piece_photos: int = 3
    least_points: int = 12
    least_explained: float = 0.3
    first_pair_angle_deg: float = 6.0
    least_known_points: int = 15
    mappers: tuple[Mapper, ...] = get_args(Mapper)
    good_enough: float = 0.95
    focal_prior: float = 1.2
    threads: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        expect_kinds(self)
        least = {
            "max_side_px": 200,
            "max_features": 500,
            "first_look_features": 500,
            "window": 1,
            "enough_tracks": 100,
            "min_matches": 8,
            "min_piece_photos": 3,
            "least_known_points": 6,
            "least_points": 3,
        }
        for field in fields(self):
            value = getattr(self, field.name)
            floor = least.get(field.name, 0)
            if isinstance(value, int) and value < floor:
                raise InputError(f"SfmOptions.{field.name}: expected at least {floor}, found {value}")
        ranges = {
            "contrast_threshold": (0.0, 1.0),
            "least_explained": (0.0, 1.0),
            "first_pair_angle_deg": (0.1, 90.0),
            "good_enough": (0.0, 1.0),
            "focal_prior": (0.3, 5.0),
        }
        for name, (low, high) in ranges.items():
            if not low <= getattr(self, name) <= high:
                raise InputError(f"SfmOptions.{name}: expected {low:g} to {high:g}, found {getattr(self, name)}")
        if self.threads == 0:
            raise InputError("SfmOptions.threads: expected at least 1, or None for all processors, found 0")
        unknown = [name for name in self.mappers if name not in get_args(Mapper)]
        if unknown or not self.mappers:
            wanted = ", ".join(get_args(Mapper))
            raise InputError(f"SfmOptions.mappers: expected some of {wanted}, found {self.mappers}")
