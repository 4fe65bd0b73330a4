"""A model file of the shipped kind with whole numbers of eight bits in place of floats, to compare: it is not shipped.

python benchmarks/quantise_weights.py MODEL.onnx OUT.onnx --tiles TILES [--rows FOLDER] [--crops 96] [--seed 0]

Which numbers occur is seen in `--crops` crops as training draws them, of TILES and of rendered rows; all but one in ten
thousand are covered. The first convolution and the five that give the maps stay as they are. Weights have seven bits:
with eight, products overflow on processors that add two of them in sixteen bits. Metadata is that of MODEL.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import onnx
from onnxruntime.quantization import CalibrationDataReader, CalibrationMethod, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

from pomona.train.augment import AugmentOptions
from pomona.train.center import CenterLearner
from pomona.train.fit import Batches
from pomona.train.gather import gather

_PERCENTILE = 99.99


class Crops(CalibrationDataReader):
    """One crop after the other, as the network takes it."""

    def __init__(self, pixels: Iterator[np.ndarray]) -> None:
        self._pixels = pixels

    def get_next(self) -> dict[str, np.ndarray] | None:
        found = next(self._pixels, None)
        return None if found is None else {"image": found[None].astype(np.float32)}


def crops(arguments: argparse.Namespace, cache: Path) -> Iterator[np.ndarray]:
    rows = sorted(arguments.rows.glob("[sq][0-9][0-9][0-9]")) if arguments.rows else []
    training, _ = gather([arguments.tiles, *rows], cache, 0.1)
    augment = AugmentOptions(leafy=0.1, shaded=0.15)
    stream = Batches(
        training, CenterLearner(weights="none"), steps=arguments.crops, batch=1, seed=arguments.seed, augment=augment
    )
    for k in range(arguments.crops):
        yield stream[k][0][0].numpy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--tiles", type=Path, required=True)
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--crops", type=int, default=96)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    with TemporaryDirectory() as folder:
        folded = Path(folder) / "folded.onnx"
        quant_pre_process(str(arguments.model), str(folded), skip_symbolic_shape=True)
        convolutions = [node.name for node in onnx.load(str(folded)).graph.node if node.op_type == "Conv"]
        quantize_static(
            str(folded),
            str(arguments.out),
            Crops(crops(arguments, Path(folder))),
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=["Conv", "Add", "Resize"],
            nodes_to_exclude=[convolutions[0], *(name for name in convolutions if "/heads." in name)],
            per_channel=True,
            reduce_range=True,
            weight_type=QuantType.QInt8,
            activation_type=QuantType.QUInt8,
            calibrate_method=CalibrationMethod.Percentile,
            extra_options={"CalibPercentile": _PERCENTILE},
        )
    model = onnx.load(str(arguments.out))
    known = {entry.key for entry in model.metadata_props}
    model.metadata_props.extend(
        entry for entry in onnx.load(str(arguments.model)).metadata_props if entry.key not in known
    )
    onnx.save(model, str(arguments.out))


if __name__ == "__main__":
    main()
