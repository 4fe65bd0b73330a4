"""Sort the real tiles into those to train on and those to measure on, by photo and tree.

python benchmarks/fruit_tiles.py OUT [--unlabelled MODEL.onnx [--tile PX] [--sure SCORE]] [--masks MODEL.onnx]

Writes OUT/train/SET and OUT/val/SET, each a COCO file and a link to the set's images, as `pomona train OUT` and
`benchmarks/train_fruit.py --tiles OUT` take them. Held out are photos by their names, 15 %, as in `pomona train`;
tiles of other photos of the same trees are left out of both.

In the tiles only the near tree is labelled. With --unlabelled, what that segmenter finds with confidence in tiles to
train on where there is no box is written as a crowd: to find it is neither right nor wrong. A segmenter that learnt
from such tiles sees fruits of the next row only in small tiles (--tile 224), which hide how large leaves are beside
them. With --masks, boxes to train on that a segmenter finds get its masks.
"""

import json
import zlib
from pathlib import Path

import numpy as np
from pycocotools import mask as coco_mask
from scipy.optimize import linear_sum_assignment

from command_line import DATA, parser_of
from pomona.learning.train.samples import group_of
from pomona.stages.capture import load_photos
from pomona.stages.segment import SegmentOptions, load_segmenter, segment_photos
from pomona.stages.segment.box_overlap import overlapping_pairs, pair_iou
from pomona.values.detections import Detections, SurveyDetections

HELD_OUT = 0.15
SCALE = 0.62  # at which the tiles' fruits are as wide as the network reads best
LIKELY = 0.2  # a score from which a detection in a labelled box shows that fruit's mask
SAME_BOX = 0.5  # intersection over union
SURE = 0.6  # a score from which a detection without a box is taken for a fruit that was not labelled
MOST_COVERED = 0.25  # of a detection's box by a labelled one


def labels_of(folder: Path) -> dict:
    return json.loads((folder / "boxes.coco.json").read_text())


def is_held_out(photo: str) -> bool:
    return zlib.crc32(photo.encode()) % 1000 < 1000 * HELD_OUT


def tree_of(photo: str) -> str:
    """DSC_1046_17kv10r3k shows the tree 17kv10r3k; photos of cherries do not say which tree they show."""
    return photo.split("_")[-1]


def tile_sets(data: Path = DATA) -> dict[str, Path]:
    """The folders of all sets of tiles by their names."""
    folders = [file.parent for kind in ("apple", "fruit") for file in sorted(data.glob(f"{kind}-tiles/*/*.coco.json"))]
    return {folder.name: folder for folder in folders}


def sides(sets: dict[str, dict]) -> dict[str, dict[str, list[dict]]]:
    """The images of each set to train on and to measure on."""
    photos = {group_of(Path(i["file_name"]).stem) for coco in sets.values() for i in coco["images"]}
    held_trees = {tree_of(photo) for photo in photos if is_held_out(photo)}
    found: dict[str, dict[str, list[dict]]] = {name: {"train": [], "val": []} for name in sets}
    for name, coco in sets.items():
        for image in coco["images"]:
            photo = group_of(Path(image["file_name"]).stem)
            if is_held_out(photo):
                found[name]["val"].append(image)
            elif tree_of(photo) not in held_trees:
                found[name]["train"].append(image)
    return found


def found_by(
    model: Path, folder: Path, images: list[dict], score: float, tile_px: int | None = None
) -> SurveyDetections:
    photos = load_photos([folder / "images" / image["file_name"] for image in images], min_photos=1)
    options = SegmentOptions(scale=SCALE, score_threshold=score, kept_share=1, tile_px=tile_px)
    return segment_photos(photos, load_segmenter(model), options=options)


def masks_of_boxes(annotations: list[dict], images: list[dict], found: SurveyDetections) -> list[dict]:
    """The annotations; those whose box a detection has, one to one, with the detection's mask."""
    result = []
    for image in images:
        mine = [a for a in annotations if a["image_id"] == image["id"]]
        detections = found[image["file_name"]]
        labelled = np.array([a["bbox"] for a in mine], float).reshape(-1, 4)
        labelled[:, 2:] += labelled[:, :2]
        shapes = {}
        overlap = np.zeros((len(mine), len(detections)))
        pairs = overlapping_pairs(labelled, detections.boxes_px)
        overlap[pairs] = pair_iou(labelled[pairs[0]], detections.boxes_px[pairs[1]])
        for i, j in zip(*linear_sum_assignment(-overlap), strict=True):
            if overlap[i, j] >= SAME_BOX:
                shapes[i] = packed_mask(detections, j, labelled[i])
        result += [a | shapes.get(i, {}) for i, a in enumerate(mine)]
    return result


def packed_mask(found: Detections, k: int, box: np.ndarray | None = None) -> dict:
    """The mask of a detection as COCO has it, without what lies outside a labelled box."""
    full = np.zeros((found.height_px, found.width_px), np.uint8)
    left, top, right, bottom = found.masks[k].box_px
    full[top:bottom, left:right] = found.masks[k].pixels
    if box is not None:
        x0, y0, x1, y1 = (int(v) for v in (*np.floor(box[:2]), *np.ceil(box[2:])))
        inside = np.zeros_like(full)
        inside[max(y0, 0) : y1, max(x0, 0) : x1] = 1
        full *= inside
    packed = coco_mask.encode(np.asfortranarray(full))
    segmentation = {"size": packed["size"], "counts": packed["counts"].decode()}
    return {"area": float(full.sum()), "segmentation": segmentation}


def unlabelled(coco: dict, images: list[dict], found: SurveyDetections) -> list[dict]:
    """Annotations to ignore: what the segmenter is sure of where there is no box."""
    result = []
    for image in images:
        boxes = [a["bbox"] for a in coco["annotations"] if a["image_id"] == image["id"]]
        labelled = np.array(boxes, float).reshape(-1, 4)
        labelled[:, 2:] += labelled[:, :2]
        result += [
            {"image_id": image["id"], "category_id": 1, "iscrowd": 1, **shape}
            for shape in beside(found[image["file_name"]], labelled)
        ]
    return result


def beside(found: Detections, labelled: np.ndarray) -> list[dict]:
    boxes = found.boxes_px
    i, j = overlapping_pairs(boxes, labelled)
    shared = (np.minimum(boxes[i, 2:], labelled[j, 2:]) - np.maximum(boxes[i, :2], labelled[j, :2])).prod(1)
    covered = np.zeros(len(found))
    np.maximum.at(covered, i, shared / np.maximum((boxes[i, 2:] - boxes[i, :2]).prod(1), 1e-9))
    shapes = []
    for k in np.flatnonzero(covered < MOST_COVERED):
        x0, y0, x1, y1 = (float(v) for v in boxes[k])
        shapes.append({"bbox": [x0, y0, x1 - x0, y1 - y0], **packed_mask(found, k)})
    return shapes


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--unlabelled", type=Path, metavar="MODEL.onnx")
    parser.add_argument("--tile", type=int, help="side of the tiles that --unlabelled looks at, in pixels")
    parser.add_argument("--sure", type=float, default=SURE, help="score from which --unlabelled writes a crowd")
    parser.add_argument("--masks", type=Path, metavar="MODEL.onnx")
    arguments = parser.parse_args()
    folders = tile_sets()
    sets = {name: labels_of(folder) for name, folder in folders.items()}
    for name, parts in sides(sets).items():
        for part, images in parts.items():
            ids = {image["id"] for image in images}
            annotations = [a for a in sets[name]["annotations"] if a["image_id"] in ids]
            ignored = []
            if arguments.unlabelled and part == "train":
                found = found_by(arguments.unlabelled, folders[name], images, arguments.sure, arguments.tile)
                ignored = unlabelled(sets[name], images, found)
            if arguments.masks and part == "train":
                found = found_by(arguments.masks, folders[name], images, LIKELY)
                annotations = masks_of_boxes(annotations, images, found)
            annotations = [{**a, "id": k} for k, a in enumerate([*annotations, *ignored], start=1)]
            to = arguments.out / part / name
            to.mkdir(parents=True, exist_ok=True)
            coco = {"images": images, "annotations": annotations, "categories": sets[name]["categories"]}
            (to / "boxes.coco.json").write_text(json.dumps(coco))
            if not (to / "images").exists():
                (to / "images").symlink_to(folders[name] / "images")
            fruits = len(annotations) - len(ignored)
            print(f"{part}/{name}: {len(images)} tiles, {fruits} boxes, {len(ignored)} to be ignored", flush=True)


if __name__ == "__main__":
    main()
