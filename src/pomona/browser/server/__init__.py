"""Pages served to a browser on this computer, or in the local network to those who know a token."""

from pomona.browser.server.bodies import json_of
from pomona.browser.server.serving import LOOPBACK, PageServer
from pomona.browser.server.updates import Updates

__all__ = ["LOOPBACK", "PageServer", "Updates", "json_of"]
