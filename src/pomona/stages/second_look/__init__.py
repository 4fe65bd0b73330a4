"""The second look: fruits that a first association found are looked at again in all photos at once."""

from __future__ import annotations

from pomona.stages.second_look.network import CentersNetwork
from pomona.stages.second_look.options import SecondLookOptions
from pomona.stages.second_look.second_look import look_again

__all__ = ["CentersNetwork", "SecondLookOptions", "look_again"]
