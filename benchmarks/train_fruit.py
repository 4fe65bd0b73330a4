"""Train the shipped weights: real tiles with boxes, and rendered scenes with masks where there are some.

python benchmarks/train_fruit.py OUT.onnx --tiles TILES [--rows FOLDER] [--weights CHECKPOINT.pt | fruit.onnx]
        [--steps N] [--learning-rate RATE] [--crop PX] [--batch N] [--leafy SHARE] [--shaded SHARE] [--phones SHARE]
        [--pasted SHARE]

TILES is what `benchmarks/fruit_tiles.py` wrote.
"""

from dataclasses import replace
from pathlib import Path

import torch

from command_line import Lines, parser_of
from pomona.learning.train import FitOptions, options_for, train
from pomona.learning.train.augment import AugmentOptions
from pomona.learning.train.center import CENTER_NETWORKS


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--arch", choices=CENTER_NETWORKS)
    parser.add_argument("--batch", type=int, default=FitOptions().batch)
    parser.add_argument("--workers", type=int, default=FitOptions().workers)
    parser.add_argument("--tiles", type=Path, required=True)
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--weights", help="best.pt, last.pt or .onnx of an earlier training to go on from")
    parser.add_argument("--learning-rate", type=float, default=FitOptions().learning_rate)
    parser.add_argument("--check-every", type=int, default=FitOptions().check_every)
    parser.add_argument("--steps", type=int, default=FitOptions().steps)
    parser.add_argument("--crop", type=int, default=AugmentOptions().crop_px, help="side of the crops, in pixels")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--leafy", type=float, default=0.0, help="share of rendered crops with leaves before fruits")
    parser.add_argument("--shaded", type=float, default=0.0, help="share of crops with shade")
    parser.add_argument("--phones", type=float, default=0.0, help="share of crops like frames of a phone's video")
    parser.add_argument("--pasted", type=float, default=0.0, help="share of crops with fruits of other photos")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    rows = sorted(arguments.rows.glob("[sq][0-9][0-9][0-9]")) if arguments.rows else []
    augment = AugmentOptions(
        crop_px=arguments.crop,
        leafy=arguments.leafy,
        shaded=arguments.shaded,
        phones=arguments.phones,
        copy_paste=arguments.pasted,
    )
    fit = replace(
        FitOptions(),
        steps=arguments.steps,
        learning_rate=arguments.learning_rate,
        check_every=arguments.check_every,
        batch=arguments.batch,
        workers=arguments.workers,
        augment=augment,
    )
    options = replace(options_for(arguments.arch, weights=arguments.weights), fit=fit)
    print(train([arguments.tiles, *rows], arguments.out, options=options, progress=Lines(every=10)))


if __name__ == "__main__":
    main()
