"""A model file of floats as one of eight bits, as it is shipped: docs/lab/speed.md, "Eight bits".

python benchmarks/quantise_weights.py MODEL.onnx OUT.onnx [--tiles TILES] [--rows FOLDER ...] [--crops N] [--seed 0]

Which numbers occur is seen in some crops. Those of a segmenter are as training draws them, each fourth with wider
fruits, of TILES (`fruit_tiles.py`) and of rendered rows; those of a network that looks at crops, of the second look or
of circles, are what it is given in rendered rows. `pomona train` does the same with what it has learnt from.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from command_line import parser_of
from pomona.basics.onnx_file import OnnxFile
from pomona.fruit.crops.crop_network import CropNetwork
from pomona.learning.train.augment import AugmentOptions
from pomona.learning.train.center import CenterLearner
from pomona.learning.train.eight_bits import in_eight_bits
from pomona.learning.train.fit import some_crops
from pomona.learning.train.gather import gather
from pomona.learning.train.options import FitOptions
from pomona.stages.segment.center_offset import KIND
from row_cases import row_case

OF_EACH_BATCH = 12


def training_crops(folders: list[Path], count: int, seed: int) -> list[np.ndarray]:
    """Crops as training draws them, each fourth with wider fruits."""
    options = FitOptions(seed=seed, augment=AugmentOptions(leafy=0.1, shaded=0.15))
    with TemporaryDirectory() as cache:
        training, _ = gather(folders, Path(cache), 0.1)
        return some_crops(training, CenterLearner(weights="none"), options, count)


def crops_looked_at(rows: list[Path], side_px: int, count: int, seed: int) -> list[np.ndarray]:
    """Some of the crops of this size that the networks are given in rows, with the shipped weights."""
    rng, found, batches = np.random.default_rng(seed), [], CropNetwork.batches

    def kept(network, crops, output, shape):
        if network.side_px == side_px and len(crops):
            found.extend(crops[rng.choice(len(crops), min(len(crops), OF_EACH_BATCH), replace=False)])
        return batches(network, crops, output, shape)

    CropNetwork.batches = kept
    for row in rows:
        case = row_case(row)
        case.measured(case.looked_again(case.associated()))
    CropNetwork.batches = batches
    return [found[k] for k in rng.permutation(len(found))[:count]]


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("model", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--tiles", type=Path)
    parser.add_argument("--rows", type=Path, nargs="*", default=[])
    parser.add_argument("--crops", type=int, default=64)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    file = OnnxFile(arguments.model)
    if file.metadata["pomona.kind"] == KIND:
        folders = [arguments.tiles] if arguments.tiles else []
        crops = training_crops(folders + arguments.rows, arguments.crops, arguments.seed)
    else:
        (side_px,) = file.numbers("pomona.side_px", 1)
        crops = crops_looked_at(arguments.rows, int(side_px), arguments.crops, arguments.seed)
    in_eight_bits(arguments.model, arguments.out, crops)


if __name__ == "__main__":
    main()
