"""The weights between two model files of one structure, norms folded into convolutions, as a model file.

python benchmarks/blend_files.py FIRST.onnx SECOND.onnx OUT.onnx --share 0.7

OUT has `--share` of SECOND's weights and the rest of FIRST's (Wortsman 2022, robust fine-tuning), and all else as FIRST
has it: metadata, and what it takes off the log odds of scores and pixels. A training that went on from FIRST has that
in its biases already: in a blend it counts once more for SECOND's share.
"""

from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper

from command_line import parser_of


def main() -> None:
    parser = parser_of(__doc__)
    for name in ("first", "second", "out"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--share", type=float, required=True)
    arguments = parser.parse_args()
    first, second = onnx.load(str(arguments.first)), onnx.load(str(arguments.second))
    others = {entry.name: numpy_helper.to_array(entry) for entry in second.graph.initializer}
    for entry in first.graph.initializer:
        weights = numpy_helper.to_array(entry)
        if weights.dtype == np.float32:
            blend = (1 - arguments.share) * weights + arguments.share * others[entry.name]
            entry.CopyFrom(numpy_helper.from_array(blend.astype(np.float32), entry.name))
    onnx.save(first, str(arguments.out))


if __name__ == "__main__":
    main()
