"""Render training scenes: `python benchmarks/render_training_scenes.py OUT FIRST LAST` writes OUT/s000, s001, ..."""

import sys
from pathlib import Path

from pomona.synth import render_row
from pomona.synth.training import training_options


def main() -> None:
    out, first, last = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    for number in range(first, last + 1):
        folder = out / f"s{number:03d}"
        if not folder.exists():
            print(render_row(training_options(number), folder), flush=True)


if __name__ == "__main__":
    main()
