"""The weights between a shipped model file and a training that went on from it, as a model file.

python benchmarks/blend_weights.py BEGAN.onnx OUT.onnx CHECKPOINT.pt [CHECKPOINT.pt ...] --share 0.5 --threshold 0.42
    [--foreground 0.57] [--seed 0]

OUT has `--share` of the checkpoint's weights (best.pt, or last.pt: its running mean; of several, their mean) and the
rest of BEGAN's (Wortsman 2022, robust fine-tuning and model soups). `--threshold` is the score of the blend that is to
be 0.5 in the file, `--foreground` the probability from which a pixel of it is fruit; `--seed` is that of the training
that first read BEGAN, on which hangs what a convolution and its norm have of a weight.
"""

import copy
from pathlib import Path

import torch

from command_line import parser_of
from pomona.learning.train.blend import blended
from pomona.learning.train.center import FRUIT_PX, LARGER, TYPICAL_FRUIT_PX, CenterLearner
from pomona.learning.train.export import export_onnx
from pomona.progress import Silent


def mean_of(checkpoints: list[dict]) -> dict[str, torch.Tensor]:
    states = [checkpoint["average"] for checkpoint in checkpoints]
    return {
        name: torch.stack([state[name] for state in states]).mean(0) if value.is_floating_point() else value
        for name, value in states[0].items()
    }


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("began", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("checkpoints", type=Path, nargs="+")
    parser.add_argument("--share", type=float, default=0.5)
    parser.add_argument("--threshold", type=float, default=0.5)
    parser.add_argument("--foreground", type=float, default=0.5)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.manual_seed(arguments.seed)
    checkpoints = [torch.load(path, map_location="cpu", weights_only=True) for path in arguments.checkpoints]
    learner = CenterLearner(checkpoints[0]["arch"], weights=str(arguments.began))
    began = learner.build(start=True, progress=Silent()).eval()
    learnt = copy.deepcopy(began)
    learnt.load_state_dict(mean_of(checkpoints))
    network = blended(began, learnt, arguments.share)
    # The head of circles was not in the file that it began from; its first weights mean nothing.
    network.heads[4].load_state_dict(learnt.heads[4].state_dict())
    export_onnx(
        network,
        arguments.out,
        fruit_px=FRUIT_PX,
        typical_fruit_px=TYPICAL_FRUIT_PX,
        threshold=arguments.threshold,
        foreground_threshold=arguments.foreground,
        larger=LARGER,
    )


if __name__ == "__main__":
    main()
