"""The names of the stages, without what they bring."""

STAGES = (
    "segment", "select", "sfm", "scale", "fuse", "second_look", "filter", "measure", "planting", "dense", "scene",
    "results", "report",
)  # fmt: skip
"""In the order of the default method; the paper's makes its cloud, `dense`, before `fuse`, and does not look again."""
