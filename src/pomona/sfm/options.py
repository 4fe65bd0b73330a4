"""Options of structure from motion."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal, get_args

from pomona.errors import InputError

Mapper = Literal["incremental", "global"]


@dataclass(frozen=True, kw_only=True)
class SfmOptions:
    """How photos are matched and placed. The defaults are meant for every orchard; a person need not touch them.

    `max_side_px`: photos are worked on at no more than this size; results are in pixels of the whole photo.
    `max_features`: the strongest features kept of a photo.
    `window`: each photo is matched with so many photos before and after it, in order of capture.
    `exhaustive_below`: sides of at most so many photos are matched all with all.
    `loops`: each photo is matched with so many photos which look alike, wherever they are in the order.
    `gnss_neighbours`: the same with photos taken nearby, where the photos have GNSS positions.
    `enough_tracks`: mapping uses about so many points of each photo where there are more.
    `min_matches`: fewer verified matches than this do not make two photos overlap.
    `min_piece_photos`: smaller pieces of a broken reconstruction are not to be trusted, and dropped.
    `mappers`: the ways of mapping that are tried; the better result of each side is kept (see `choose`).
    `good_enough`: a result with this much support (0 to 1, see `choose`) ends the search for a better one (1: never).
    `focal_prior`: focal length as a multiple of the longer side, where neither EXIF nor the matches tell it.
    `threads`: None takes all processors.
    """

    max_side_px: int = 1600
    max_features: int = 8000
    window: int = 6
    exhaustive_below: int = 20
    loops: int = 3
    gnss_neighbours: int = 4
    enough_tracks: int = 1000
    min_matches: int = 20
    min_piece_photos: int = 3
    mappers: tuple[Mapper, ...] = get_args(Mapper)
    good_enough: float = 0.95
    focal_prior: float = 1.2
    threads: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        least = {
            "max_side_px": 200,
            "max_features": 500,
            "window": 1,
            "enough_tracks": 100,
            "min_matches": 8,
            "min_piece_photos": 3,
        }
        for field in fields(self):
            value = getattr(self, field.name)
            floor = least.get(field.name, 0)
            if isinstance(value, int) and value < floor:
                raise InputError(f"SfmOptions.{field.name}: expected at least {floor}, found {value}")
        if not 0.3 <= self.focal_prior <= 5:
            raise InputError(f"SfmOptions.focal_prior: expected 0.3 to 5, found {self.focal_prior}")
        if self.threads == 0:
            raise InputError("SfmOptions.threads: expected at least 1, or None for all processors, found 0")
        unknown = [name for name in self.mappers if name not in get_args(Mapper)]
        if unknown or not self.mappers:
            wanted = ", ".join(get_args(Mapper))
            raise InputError(f"SfmOptions.mappers: expected some of {wanted}, found {self.mappers}")
