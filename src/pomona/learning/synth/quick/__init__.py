"""Rough pictures of orchards in seconds each, with exact masks and whole-fruit circles, to train segmenters on.

`render_pictures` draws with OpenGL on the CPU (Mesa) or a GPU and needs the extra `synth`; scenes and looks do not.
"""

from pomona.learning.synth.quick.looks import KINDS, FruitLook
from pomona.learning.synth.quick.pictures import QuickPictureOptions, render_pictures

__all__ = ["KINDS", "FruitLook", "QuickPictureOptions", "render_pictures"]
