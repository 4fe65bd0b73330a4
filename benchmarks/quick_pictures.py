"""Draw rough pictures of fruits of every kind, with exact masks and whole-fruit circles, to train segmenters on.

python benchmarks/quick_pictures.py OUT FIRST LAST [--tiles TILES] [--seed N] [--per-scene N]
        [--leaves FROM TO] [--kinds KIND=SHARE ...]

OUT/images, OUT/truth/masks and OUT/truth/circles of the scenes FIRST to LAST; a run that was stopped goes on, and
the same numbers give the same pictures. TILES is what `benchmarks/fruit_tiles.py` wrote: parts of its photos to train
on, blurred beyond recognition, are seen far behind the trees.
"""

from pathlib import Path

from command_line import Lines, parser_of
from pomona.learning.synth.quick import QuickPictureOptions, render_pictures

SHARES = {"apple": 0.45, "pear": 0.1, "citrus": 0.14, "peach": 0.07, "plum": 0.05, "cherry": 0.06, "mango": 0.03,
          "kiwi": 0.03, "tomato": 0.07}  # fmt: skip
EVERY_NTH_TILE = 10  # is enough to look at


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--tiles", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--per-scene", type=int, default=QuickPictureOptions().per_scene)
    parser.add_argument("--leaves", type=float, nargs=2, default=(1.0, 1.0), help="times as large as the kind's")
    parser.add_argument("--kinds", nargs="+", metavar="KIND=SHARE", help="instead of the usual shares of kinds")
    arguments = parser.parse_args()
    shares = SHARES if arguments.kinds is None else {k: float(v) for k, v in (a.split("=") for a in arguments.kinds)}
    foliage: list[Path] = []
    for labels in sorted(arguments.tiles.glob("train/*/*.json")) if arguments.tiles else []:
        foliage += sorted((labels.parent / "images").iterdir())[::EVERY_NTH_TILE]
    options = QuickPictureOptions(
        kinds=tuple(shares),
        shares=tuple(shares.values()),
        per_scene=arguments.per_scene,
        leaf_growth=tuple(arguments.leaves),
        foliage=tuple(foliage),
        seed=arguments.seed,
    )
    render_pictures(arguments.out, range(arguments.first, arguments.last + 1), options, Lines())


if __name__ == "__main__":
    main()
