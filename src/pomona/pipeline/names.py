"""The names of the stages, without what they bring."""

STAGES = (
    "segment", "select", "sfm", "scale", "fuse", "second_look", "filter", "measure", "planting", "dense", "scene",
    "results", "report",
)  # fmt: skip
"""In the order of the default method."""


def stages_by(method: str) -> tuple[str, ...]:
    """Return the stages of a method in order: the paper's makes its cloud before it fuses, and does not look again."""
    if method != "paper":
        return STAGES
    others = [name for name in STAGES if name not in ("dense", "second_look")]
    fuse = others.index("fuse")
    return (*others[:fuse], "dense", *others[fuse:])


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
