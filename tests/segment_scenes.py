"""Painted fruits with known truth, segmenters that see paint, and a small ONNX model, for the tests of `segment`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pomona.stages.segment import SegmenterTraits, TileDetections
from pomona.stages.segment.decode import Maps
from pomona.values.detections import Mask
from pomona.values.photos import Photo, Photos

DISC_PX = 20


def disc(width: int, height: int, x: float, y: float, radius: float) -> np.ndarray:
    """A filled disc, boolean (height, width), centre in COLMAP's pixels."""
    return (np.arange(width) + 0.5 - x) ** 2 + ((np.arange(height) + 0.5 - y) ** 2)[:, None] <= radius**2


def id_image(width: int, height: int, discs: Sequence[tuple[float, float, float]]) -> np.ndarray:
    """An image whose red and green channels hold the number of the disc that covers each pixel, from 1."""
    ids = np.zeros((height, width), np.int64)
    for number, (x, y, radius) in enumerate(discs, start=1):
        ids[disc(width, height, x, y, radius)] = number
    return np.stack([ids % 256, ids // 256, 0 * ids], axis=2).astype(np.uint8)


def masks_of(image: np.ndarray) -> dict[int, Mask]:
    """The mask of each number in an `id_image`."""
    ids = image[:, :, 0].astype(np.int64) + 256 * image[:, :, 1].astype(np.int64)
    found = {}
    for k in np.unique(ids[ids > 0]):
        rows, columns = np.nonzero(ids == k)
        y0, x0 = rows.min(), columns.min()
        found[int(k)] = Mask.from_pixels(ids[y0 : rows.max() + 1, x0 : columns.max() + 1] == k, int(x0), int(y0))
    return found


class IdSegmenter:
    """Sees the numbers of an `id_image`: a perfect segmenter that knows nothing beyond its tile."""

    name = "ids"

    def __init__(self, **traits: object) -> None:
        self.traits = SegmenterTraits(**traits)  # type: ignore[arg-type]
        self.sizes: list[tuple[int, int]] = []

    def segment(self, tiles: Sequence[np.ndarray]) -> list[TileDetections]:
        return [self._of(tile) for tile in tiles]

    def _of(self, tile: np.ndarray) -> TileDetections:
        self.sizes.append(tile.shape[:2])
        masks = tuple(masks_of(tile).values())
        boxes = np.array([mask.box_px for mask in masks], float).reshape(-1, 4)
        return TileDetections(boxes, np.full(len(masks), 0.9), masks)


class RedSegmenter(IdSegmenter):
    """Sees connected red areas, but only those of a width that it knows, as a network does."""

    name = "red"

    def _of(self, tile: np.ndarray) -> TileDetections:
        import cv2

        self.sizes.append(tile.shape[:2])
        _, labels = cv2.connectedComponents((tile[:, :, 0] > 127).astype(np.uint8))
        masks = [Mask.from_pixels(labels == k) for k in np.unique(labels) if k > 0]
        low, high = self.traits.fruit_px or (0, np.inf)
        masks = [mask for mask in masks if low <= mask.width_px <= high]
        boxes = np.array([mask.box_px for mask in masks], float).reshape(-1, 4)
        return TileDetections(boxes, np.full(len(masks), 0.9), tuple(masks))


def red_photo(path: Path, width: int, height: int, discs: Sequence[tuple[float, float, float]], **fields: str) -> Photo:
    """Write a photo of red discs on green."""
    from PIL import Image

    pixels = np.full((height, width, 3), (40, 90, 40), np.uint8)
    for x, y, radius in discs:
        pixels[disc(width, height, x, y, radius)] = (220, 30, 30)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, quality=95)
    return Photo(name=path.name, path=path, width_px=width, height_px=height, **fields)


def red_photos(folder: Path, count: int = 3, width: int = 400, height: int = 300) -> Photos:
    """Photos of a few red discs of 40 px, that of number k with k + 1 of them."""
    centres = [(60.0 + 90 * k, 80.0 + 30 * k, 20.0) for k in range(count)]
    return Photos(tuple(red_photo(folder / f"p{k}.jpg", width, height, centres[: k + 1]) for k in range(count)))


def painted_maps(width: int, height: int, discs: Sequence[tuple[float, float, float]], stride: int = 4) -> Maps:
    """What a perfect network would say of discs on a tile: a later disc hides an earlier one."""
    columns = np.arange(width // stride) * stride + stride / 2
    rows = np.arange(height // stride) * stride + stride / 2
    shape = len(rows), len(columns)
    heatmap, foreground = np.zeros(shape), np.zeros(shape)
    box, offset = np.zeros((4, *shape)), np.zeros((2, *shape))
    best = np.zeros(shape)
    for x, y, radius in discs:
        across, down = np.broadcast_arrays(x - columns[None, :], y - rows[:, None])
        distance = np.hypot(across, down)
        peak = np.exp(-np.square(distance / (0.4 * radius)))
        nearest = peak > best
        best = np.maximum(best, peak)
        heatmap = np.maximum(heatmap, 0.95 * peak)
        for k, reach in enumerate((radius - across, radius - down, radius + across, radius + down)):
            box[k][nearest] = reach[nearest]
        # The share of the cell that is fruit, as a network that was trained on averaged masks would say.
        share = np.clip((radius - distance) / stride + 0.5, 0, 1)
        mine = share > 0
        foreground = np.maximum(foreground, share)
        offset[0][mine], offset[1][mine] = across[mine], down[mine]
    arrays = [array.astype(np.float32) for array in (heatmap, box, foreground, offset)]
    return Maps(*arrays, stride=stride)


def write_disc_model(
    path: Path, *, metadata: dict[str, str] | None = None, rename: dict[str, str] | None = None
) -> Path:
    """Write an ONNX model of the shipped model's contract that finds red discs about `DISC_PX` in radius, by hand.

    Cells are means of 4 × 4 pixels; foreground is redness; the centre is found by the mean of the fruit around a cell.
    `rename` changes the names of outputs, to make a file of another contract.
    """
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    reach = 2 * (DISC_PX // 4) + 1
    side = 2 * (reach // 2) + 1
    steps = (np.arange(side) - side // 2) * 4.0
    round_window = (steps**2 + (steps**2)[:, None] <= (1.5 * DISC_PX) ** 2).astype(np.float32)
    small = (steps**2 + (steps**2)[:, None] <= (0.9 * DISC_PX) ** 2).astype(np.float32)
    kernels = np.stack([round_window, round_window * steps, round_window * steps[:, None], small / small.sum()])[
        :, None
    ]
    constants = {
        "redness": np.array([1.0, -1.0, 0.0], np.float32).reshape(1, 3, 1, 1) / 16,
        "kernels": kernels.astype(np.float32),
        "middle": np.array(90.0, np.float32),
        "softness": np.array(20.0, np.float32),
        "little": np.array(1e-3, np.float32),
        "radius": np.full((1, 4, 1, 1), DISC_PX, np.float32),
        "signs": np.array([-1, -1, 1, 1], np.float32).reshape(1, 4, 1, 1),
        "sizes": np.array([1, 2, 1], np.int64),
    }
    constants["redness"] = np.tile(constants["redness"], (1, 1, 4, 4))
    nodes = [
        helper.make_node("Conv", ["image", "redness"], ["red"], strides=[4, 4], kernel_shape=[4, 4]),
        helper.make_node("Sub", ["red", "middle"], ["above"]),
        helper.make_node("Div", ["above", "softness"], ["logit"]),
        helper.make_node("Sigmoid", ["logit"], ["foreground"]),
        helper.make_node("Conv", ["foreground", "kernels"], ["sums"], pads=[side // 2] * 4, kernel_shape=[side, side]),
        helper.make_node("Split", ["sums", "sizes"], ["count", "moments", "heat"], axis=1),
        helper.make_node("Add", ["count", "little"], ["some"]),
        helper.make_node("Div", ["moments", "some"], ["offset"]),
        helper.make_node("Mul", ["heat", "foreground"], ["heatmap"]),
        helper.make_node("Concat", ["offset", "offset"], ["twice"], axis=1),
        helper.make_node("Mul", ["twice", "signs"], ["signed"]),
        helper.make_node("Add", ["signed", "radius"], ["box"]),
    ]
    channels = {"heatmap": 1, "box": 4, "foreground": 1, "offset": 2}
    for node in nodes:
        node.output[:] = [(rename or {}).get(name, name) for name in node.output]
        node.input[:] = [(rename or {}).get(name, name) for name in node.input]
    graph = helper.make_graph(
        nodes,
        "discs",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, "H", "W"])],
        [
            helper.make_tensor_value_info((rename or {}).get(name, name), TensorProto.FLOAT, [1, n, "h", "w"])
            for name, n in channels.items()
        ],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    default = {
        "pomona.kind": "center-offset",
        "pomona.stride": "4",
        "pomona.fruit_px": "12,120",
        "pomona.typical_fruit_px": "40",
    }
    helper.set_model_props(model, default if metadata is None else metadata)
    onnx.save(model, path)
    return path
