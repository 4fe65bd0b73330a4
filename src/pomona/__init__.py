"""Pomona: photographs of an orchard row in, every fruit out.

Importing this package loads numpy alone: each outside engine (pycolmap, ONNX Runtime, torch, OpenCV) is imported
by the stage that needs it.
"""

__version__ = "0.1.0"
