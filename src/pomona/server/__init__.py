"""Pages served to a browser on this computer, or in the local network to those who know a token."""

from pomona.server.bodies import json_of
from pomona.server.serving import LOOPBACK, PageServer
from pomona.server.updates import Updates

__all__ = ["LOOPBACK", "PageServer", "Updates", "json_of"]
