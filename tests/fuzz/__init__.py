"""Every reader of files against many damaged ones: `python -m fuzz` in `tests/` (`make fuzz`)."""
