"""`pomona watch`: count, places and coverage while photos arrive, and the survey of a run at the end."""

from pomona.browser.live.options import WatchOptions
from pomona.browser.live.pages import WatchServer
from pomona.browser.live.watch import Watch

__all__ = ["Watch", "WatchOptions", "WatchServer"]
