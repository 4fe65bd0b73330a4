"""Rendered orchard rows with exact truth, for training, teaching, planning a capture, and tests.

`render_row` needs Blender as a Python module (the extra `synth`); the layout, cameras and truth files do not.
"""

from pomona.learning.synth.options import LIGHTS, VARIETIES, Light, RowOptions, Variety
from pomona.learning.synth.render import render_row

__all__ = ["LIGHTS", "VARIETIES", "Light", "RowOptions", "Variety", "render_row"]
