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
from argparse import ArgumentParser, Namespace
from pathlib import Path

from command_line import parser_of
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


SETS = {"demo": {"demo": DEMO}, "rows": ROWS, "held-out": HELD_OUT}


def parser() -> ArgumentParser:
    made = parser_of(__doc__)
    kinds = made.add_subparsers(dest="kind", required=True)
    for kind in SCENES:
        of_kind = kinds.add_parser(kind)
        of_kind.add_argument("out", type=Path)
        of_kind.add_argument("first", type=int)
        of_kind.add_argument("last", type=int)
    for kind in SETS:
        kinds.add_parser(kind).add_argument("out", type=Path)
    bundling = kinds.add_parser("bundle")
    bundling.add_argument("row", type=Path)
    bundling.add_argument("to", type=Path)
    return made


def wanted(args: Namespace) -> dict[str, RowOptions]:
    if of_number := SCENES.get(args.kind):
        return {f"s{n:03d}": of_number(n) for n in range(args.first, args.last + 1)}
    return SETS[args.kind]


def bundle(row: Path, to: Path) -> None:
    for photo in sorted((row / "images").iterdir()):
        side = to / photo.name.split("_")[0]
        side.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(photo, side / photo.name)
    (to / "truth").mkdir(exist_ok=True)
    shutil.copyfile(row / "truth" / "markers.csv", to / "markers.csv")
    shutil.copyfile(row / "truth" / "fruits.csv", to / "truth" / "fruits.csv")


def main() -> None:
    args = parser().parse_args()
    if args.kind == "bundle":
        bundle(args.row, args.to)
        return
    for name, options in wanted(args).items():
        folder = args.out / name
        if not folder.exists():
            folder.parent.mkdir(parents=True, exist_ok=True)
            print(render_row(options, folder), flush=True)


if __name__ == "__main__":
    main()
