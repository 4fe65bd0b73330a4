"""COLMAP, by way of pycolmap, which structure from motion touches here alone: its database, two views, mapping.

Everything in the database is in working pixels (`features.working_scale`), so that COLMAP's thresholds, all given in
pixels, mean the same for photos of any size; what comes out is in pixels of the whole photo.
"""

from pomona.basics.gpu import own_signals

with own_signals():
    import pycolmap

pycolmap.logging.minloglevel = 2
pycolmap.logging.logtostderr = True
