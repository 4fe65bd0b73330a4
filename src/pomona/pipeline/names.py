"""The names of the stages, without what they bring."""

STAGES = (
    "segment", "select", "sfm", "scale", "fuse", "second_look", "filter", "measure", "planting", "dense", "scene",
    "results", "report",
)  # fmt: skip
"""In the order of the default method; the paper's makes its cloud, `dense`, before `fuse`, and does not look again."""

STAGE_WORDS = {
    "photos": "Photos",
    "segment": "Fruits in photos",
    "select": "Fruits that count",
    "sfm": "Cameras",
    "scale": "Metres",
    "dense": "Cloud of the fruits",
    "fuse": "Fruits in space",
    "second_look": "Second look",
    "filter": "False fruits out",
    "measure": "Sizes",
    "planting": "Trees",
    "scene": "Scene",
    "results": "Tables and map",
    "report": "Report",
    "learn": "Learning",  # with --adapt, between two runs
}
"""What a person reads of them."""
