"""The names of the stages, without what they bring."""

STAGES = ("segment", "select", "sfm", "scale", "fuse", "filter", "measure", "planting", "dense", "results", "report")
"""In the order of the default method; the paper's makes its cloud, `dense`, before `fuse`."""
