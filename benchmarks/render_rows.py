"""Render the project's own rows. Each is skipped where its folder is there already, and goes on where it was stopped.

python benchmarks/render_rows.py training OUT FIRST LAST     OUT/s000, s001, ...: one side, six photos
python benchmarks/render_rows.py dense OUT FIRST LAST        the same, in dense crowns and deep shade
python benchmarks/render_rows.py bunched OUT FIRST LAST      the same, and fruits that touch in bunches
python benchmarks/render_rows.py shaded OUT FIRST LAST       both sides of dense crowns in deep shade, to measure on
python benchmarks/render_rows.py rough OUT FIRST LAST        rough rows of two trees, four photos a side
python benchmarks/render_rows.py demo OUT                    OUT/demo: the bundled sample, with masks
python benchmarks/render_rows.py rows OUT                    OUT/r00, r01: both sides, 17 photos a side
python benchmarks/render_rows.py held-out OUT                OUT/h00, h01: two photos a side, to measure on
python benchmarks/render_rows.py bundle OUT/demo TO          the sample as the package ships it
"""

import shutil
import sys
from pathlib import Path

from pomona.learning.synth import RowOptions, render_row
from pomona.learning.synth.presets import (
    DEMO,
    HELD_OUT,
    ROWS,
    bunched_options,
    dense_options,
    rough_options,
    shaded_options,
    training_options,
)

SCENES = {
    "training": training_options, "dense": dense_options, "bunched": bunched_options, "shaded": shaded_options,
    "rough": rough_options,
}  # fmt: skip


def wanted(kind: str, numbers: list[str]) -> dict[str, RowOptions]:
    if of_number := SCENES.get(kind):
        first, last = (int(n) for n in numbers)
        return {f"s{n:03d}": of_number(n) for n in range(first, last + 1)}
    return {"demo": {"demo": DEMO}, "rows": ROWS, "held-out": HELD_OUT}[kind]


def bundle(row: Path, to: Path) -> None:
    for photo in sorted((row / "images").iterdir()):
        side = to / photo.name.split("_")[0]
        side.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(photo, side / photo.name)
    (to / "truth").mkdir(exist_ok=True)
    shutil.copyfile(row / "truth" / "markers.csv", to / "markers.csv")
    shutil.copyfile(row / "truth" / "fruits.csv", to / "truth" / "fruits.csv")


def main() -> None:
    kind, out, *numbers = sys.argv[1:]
    if kind == "bundle":
        bundle(Path(out), Path(numbers[0]))
        return
    for name, options in wanted(kind, numbers).items():
        folder = Path(out) / name
        if not folder.exists():
            folder.parent.mkdir(parents=True, exist_ok=True)
            print(render_row(options, folder), flush=True)


if __name__ == "__main__":
    main()
