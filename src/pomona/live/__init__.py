"""`pomona watch`: count, places and coverage while photos arrive, and the survey of a run at the end."""

from pomona.live.options import WatchOptions
from pomona.live.pages import WatchServer
from pomona.live.watch import Watch

__all__ = ["Watch", "WatchOptions", "WatchServer"]
