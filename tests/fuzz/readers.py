"""All readers of files, each with real examples of what it reads. A new reader is a line here.

Examples are written by Pomona's own writers, or by those of tests, which follow the descriptions of other programs.
"""

from __future__ import annotations

import functools
import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image

import camera_scenes
import detection_scenes
from pipeline_fakes import cameras_of
from pomona.values.crop import RowSegments
from pomona.values.fruits import FruitCloud
from pomona.values.photos import Photo, Photos
from pomona.values.trees import Trees
from report_scenes import row_cameras, row_fruits

Write = Callable[[Path], object]
Read = Callable[[Path], object]


@dataclass(frozen=True)
class Example:
    """Files of one kind: `write` makes them in a folder; `name` is the one that is read, "" where it is the folder.

    Files whose names are in `whole` stay as they are.
    """

    write: Write
    name: str = ""
    whole: frozenset[str] = frozenset()

    def path(self, folder: Path) -> Path:
        """Return what is read of the example in a folder."""
        return folder / self.name if self.name else folder


@dataclass(frozen=True)
class Reader:
    """A reader: what of it is read is looked at, so that nothing is left for later; `leaves` are folders it makes."""

    name: str
    read: Read
    examples: tuple[Example, ...]
    leaves: tuple[str, ...] = ()


# Cameras

_SCENE = camera_scenes.make_scene(11, cameras=3, points=6)


def _cameras_example(name: str) -> Example:
    def write(folder: Path) -> Path:
        return camera_scenes.WRITERS[name](_SCENE, folder, np.random.default_rng(11)).path

    return Example(write, _name_written(write))


def _read_cameras(path: Path) -> object:
    from pomona.formats.cameras.read import read_cameras

    return read_cameras(path, camera_scenes.photos_of(_SCENE))


def _name_written(write: Callable[[Path], Path]) -> str:
    """The name of what a writer writes, "" where that is the folder."""
    with tempfile.TemporaryDirectory() as folder:
        path = write(Path(folder))
        return "" if path == Path(folder) else path.relative_to(folder).as_posix()


# Detections and labels


def _read_detections(path: Path) -> object:
    from pomona.formats.detections.read import read_detections

    return read_detections(path, detection_scenes.scene_photos(), classes=None)


def _read_labels(path: Path) -> object:
    from pomona.formats.detections.label_sets import find_label_sets, read_label_set

    return [read_label_set(one, _size_of) for one in find_label_sets(path)]


def _size_of(path: Path) -> tuple[int, int]:
    return detection_scenes.WIDTH, detection_scenes.HEIGHT


_PHOTO_FILES = frozenset(Path(name).name for name in detection_scenes.SCENE)


def _with_photos(write: Callable[[Path], Path], place: str = ".") -> Write:
    """A writer whose folder has files that stand for the photos, too; readers of labels do not open them."""

    def written(folder: Path) -> None:
        write(folder)
        for name in detection_scenes.SCENE:
            (folder / place / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / place / name).write_bytes(b"not looked into")

    return written


def _labelme(folder: Path) -> Path:
    for name, fruits in detection_scenes.SCENE.items():
        shapes = [
            {"label": "apple", "points": fruit.outline()[::8], "shape_type": "polygon", "group_id": None}
            for fruit in fruits
        ]
        shapes += [{"label": "apple", "points": [[50, 60], [60, 60]], "shape_type": "circle"}]
        content = {"version": "5.4.1", "shapes": shapes, "imagePath": name, "imageWidth": 400, "imageHeight": 300}
        detection_scenes.written(folder / f"{Path(name).stem}.json", content)
    return folder


_LABELS = (
    "COCO, compressed runs",
    "COCO, polygons",
    "VIA 1",
    "VIA 2",
    "VIA, a table",
    "CVAT",
    "supervision, Pascal VOC",
)


# Values of Pomona's own


def _tables(folder: Path) -> None:
    from pomona.formats.tables import write_fruits, write_observations, write_segments, write_trees
    from report_scenes import observe

    fruits, cameras = row_fruits(12), row_cameras(2)
    write_fruits(folder / "fruits.csv", fruits)
    write_observations(folder / "observations.csv", observe(fruits, cameras))
    write_trees(folder / "trees.csv", _trees())
    write_segments(folder / "segments.csv", _segments())


def _trees() -> Trees:
    two = np.array([10.5, 20.25])
    whole = np.array([3, 4])
    return Trees(
        ids=np.array([1, 2]), xy_in_world=np.array([[0.0, 1.0], [1.0, 1.0]]), fruits=whole, fruits_low=whole,
        fruits_high=whole, diameters_m=two / 100, weights_kg=two, weights_low_kg=two, weights_high_kg=two,
        all_fruits=two, all_low=two, all_high=two,
    )  # fmt: skip


def _segments() -> RowSegments:
    two = np.array([10.5, 20.25])
    return RowSegments(
        starts_in_world=np.array([[0.0, 0.0], [1.0, 0.0]]), ends_in_world=np.array([[1.0, 0.0], [2.0, 0.0]]),
        fruits=np.array([3, 4]), all_fruits=two, all_low=two, all_high=two, diameters_m=two / 100,
    )  # fmt: skip


def _read_tables(folder: Path) -> object:
    from pomona.formats.tables import read_fruits, read_observations, read_segments, read_trees

    reads = {
        "fruits.csv": read_fruits, "observations.csv": read_observations, "trees.csv": read_trees,
        "segments.csv": read_segments,
    }  # fmt: skip
    return [read(folder / name) for name, read in reads.items()]


def _cloud(points: int = 60) -> FruitCloud:
    rng = np.random.default_rng(3)
    rgb = rng.integers(0, 256, (points, 3)).astype(np.uint8)
    return FruitCloud(rng.normal(0, 1, (points, 3)), rgb, rng.integers(0, 4, points))


def _las(suffix: str) -> Example:
    def write(folder: Path) -> None:
        from pomona.formats.las import write_las
        from pomona.values.cameras import WorldFrame, local_crs

        frame = WorldFrame("gnss", crs=local_crs(41.6, 0.6), origin=(0.0, 0.0, 0.0))
        write_las(folder / f"cloud{suffix}", _cloud(), frame=frame)

    return Example(write, f"cloud{suffix}")


def _read_las(path: Path) -> object:
    from pomona.formats.las import read_las

    return read_las(path)


def _ply(order: str) -> Example:
    def write(folder: Path) -> None:
        cloud = _cloud(20)
        kinds = [(n, "<f4") for n in "xyz"] + [(n, "u1") for n in ("red", "green", "blue")]
        rows = np.zeros(20, kinds)
        for k, name in enumerate("xyz"):
            rows[name] = cloud.points_in_world[:, k]
        for k, name in enumerate(("red", "green", "blue")):
            rows[name] = cloud.rgb[:, k]
        lines = [f"property {'float' if n in 'xyz' else 'uchar'} {n}" for n, _ in kinds]
        head = "\n".join(["ply", f"format {order} 1.0", "element vertex 20", *lines, "end_header", ""])
        text = "\n".join(" ".join(map(str, row.tolist())) for row in rows).encode()
        (folder / "points.ply").write_bytes(head.encode() + (text if order == "ascii" else rows.tobytes()))

    return Example(write, "points.ply")


def _read_ply(path: Path) -> object:
    from pomona.formats.ply_points import read_ply_points

    return read_ply_points(path)


def _xyz(folder: Path) -> None:
    from pomona.formats.xyz import write_xyz

    write_xyz(folder / "cloud.txt", _cloud(20))


def _read_xyz(path: Path) -> object:
    from pomona.formats.xyz import looks_like_xyz, read_xyz

    return looks_like_xyz(path), read_xyz(path)


def _text(name: str, *texts: str) -> tuple[Example, ...]:
    """Examples of one file that a person wrote."""
    return tuple(Example(functools.partial(_write_text, name, text), name) for text in texts)


def _write_text(name: str, text: str, folder: Path) -> None:
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text, encoding="utf-8")


def _read_markers(path: Path) -> object:
    from pomona.stages.scale.control_points import surveyed_markers

    return [surveyed_markers(path, crs) for crs in (None, "EPSG:3857")]


def _read_control_points(path: Path) -> object:
    from pomona.stages.scale.control_points import read_control_points

    return read_control_points(path, detection_scenes.scene_photos())


def _read_positions(path: Path) -> object:
    from pomona.progress import Silent
    from pomona.stages.capture.positions import with_positions

    return with_positions(detection_scenes.scene_photos(), path, Silent())


def _read_trunks(path: Path) -> object:
    from pomona.stages.planting.trunk_table import read_trunks

    return read_trunks(path)


def _read_hand_counts(path: Path) -> object:
    from pomona.stages.yields.hand_counts import read_hand_counts

    return read_hand_counts(path)


def _read_pairs(path: Path) -> object:
    from pomona.stages.measure.weight_table import read_allometry

    return read_allometry(path)


def _read_truth(path: Path) -> object:
    from pomona.evaluate.fruits import read_truth

    return read_truth(path)


def _truth_folder(folder: Path) -> None:
    lines = ["id,x,y,z,diameter,tree", *(f"{k},{k * 0.1},0.2,1.5,0.07,{1 + k // 4}" for k in range(1, 9))]
    _write_text("fruits.csv", "\n".join(lines) + "\n", folder)
    seen = {f"east/IMG_{k}.JPG": {str(i): 200 + i for i in range(1, 9)} for k in range(3)}
    _write_text("visible_pixels.json", json.dumps(seen), folder)


_BOXES = "\n".join(f"{k * 0.1} 0.2 1.5 {k * 0.1 + 0.07} 0.27 1.57" for k in range(1, 9)) + "\n"
_CORNERS = "\n".join(f"{x} {y} {z}" for x in (0, 0.07) for y in (0, 0.07) for z in (1, 1.07)) + "\n"
_BOX_TABLE = "id,x_min,y_min,z_min,x_max,y_max,z_max\n1,0,0,1,0.07,0.07,1.07\n2,0.5,0,1,0.57,0.07,1.07\n"


def _read_detection_truth(path: Path) -> object:
    from pomona.evaluate.detections import read_detection_truth, read_found

    if path.is_dir():
        return read_detection_truth(path)
    return read_detection_truth(path), read_found(path)


def _read_ids(path: Path) -> object:
    from pomona.formats.detections.png_masks import masks_of_ids, read_ids

    return [mask.box_px for _, mask in masks_of_ids(read_ids(path))]


def _id_image(name: str, bits: int, colours: int = 1) -> Example:
    def write(folder: Path) -> None:
        ids = np.zeros((24, 32), np.uint8 if bits == 8 else np.uint16)
        ids[3:9, 4:12], ids[12:20, 20:30] = 1, 2
        Image.fromarray(ids if colours == 1 else np.stack([ids] * colours, axis=2)).save(folder / name)

    return Example(write, name)


def _palette_image(folder: Path) -> None:
    ids = np.zeros((24, 32), np.uint8)
    ids[3:9, 4:12] = 1
    image = Image.fromarray(ids, "P")
    image.putpalette([k % 256 for k in range(768)])
    image.save(folder / "ids.png")


def _corrections(folder: Path) -> None:
    from pomona.corrections import Corrections
    from pomona.corrections.log import Added, Deleted, Mark, Merged, Moved, Split
    from pomona.corrections.log_file import write_corrections

    made, place = "2026-08-01T09:00:00+00:00", (1.0, 2.0, 0.5)
    marks = (Mark("east/IMG_1.JPG", 10.0, 12.5), Mark("east/IMG_2.JPG", 11.0, 12.5))
    log = Corrections(
        (
            Deleted(at=place, made=made),
            Added(at=place, diameter_m=0.07, diameter_sd_m=0.002, marks=marks, made=made),
            Split(at=place, parts=(place, (1.0, 2.1, 0.5)), marks=marks, made=made),
            Merged(at=(place, (1.0, 2.1, 0.5)), made=made),
            Moved(at=place, tree_id=2, made=made),
        ),
        (Deleted(at=place, made=made),),
    )
    write_corrections(folder / "corrections.json", log)


def _read_corrections(path: Path) -> object:
    from pomona.corrections import read_corrections

    return read_corrections(path)


# Surveys


def _survey(folder: Path) -> None:
    """A survey of tiny photos with all its files, but for the report."""
    from pomona.formats.cameras.colmap import write_colmap
    from pomona.formats.detections.coco import write_coco
    from pomona.formats.las import write_las
    from pomona.pipeline.options import RunOptions
    from pomona.stages.scale.report import ScaleReport
    from pomona.survey import StageRecord, SurveyFolder
    from pomona.survey.digest import plain
    from pomona.values.cameras import WorldFrame, concatenate

    names = ("IMG_0000.jpg", "IMG_0001.jpg")
    cameras = concatenate([cameras_of(names)], WorldFrame("fruit-diameter"))
    photos = Photos(tuple(Photo(name, Path(name), 96, 72) for name in names))
    survey = SurveyFolder.create(folder)
    _tables(folder)
    write_colmap(survey.cameras, cameras, photos)
    detections = _discs(photos)
    write_coco(survey.detections, photos, detections)
    write_las(survey.cloud, _cloud(10))
    survey.note(
        sources=["/nowhere/photos"], options=RunOptions().to_json(),
        photos=[{"name": name, "side": "row", "digest": "0" * 24} for name in names],
        skipped=[{"name": "IMG_9.jpg", "reason": "the file is empty"}],
    )  # fmt: skip
    frame = {"frame": plain(cameras.frame), "report": plain(ScaleReport("fruit-diameter")), "lost": []}
    records: dict[str, dict[str, Any]] = {
        "select": {"score_threshold": 0.5, "least_score": 0.2},
        "sfm": {"unregistered": [{"photo": "IMG_9.jpg", "side": "row", "reason": "no match", "advice": "more"}]},
        "scale": frame,
        "results": {"fruits": 12, "observations": 3},
    }
    for name, info in records.items():
        survey.set_record(name, StageRecord(fingerprint="f" * 24, wall_s=1.0, outputs={"fruits.csv": "0"}, info=info))


def _discs(photos: Photos) -> Any:
    """Return a disc in each photo as its detections."""
    from pomona.values.detections import Detections, Mask, SurveyDetections

    disc = np.hypot(*(np.indices((72, 96)) - np.array([36, 40])[:, None, None])) < 8
    return SurveyDetections(
        {
            photo.name: Detections(photo.name, 96, 72, (Mask.from_pixels(disc),), np.array([0.9]), np.array([k + 1]))
            for k, photo in enumerate(photos)
        }
    )


def _read_survey(folder: Path) -> object:
    import pomona
    from pomona.pipeline.options import RunOptions

    survey = pomona.open(folder)
    RunOptions.from_json(survey.files.get("options", {}))
    return [
        survey.fruits, survey.observations, survey.trees, survey.segments, survey.crop, survey.detections,
        survey.cameras, survey.cloud, survey.photos, survey.sides, survey.skipped, survey.frame, survey.scale,
        survey.unplaced, survey.score_threshold, survey.least_score, survey.before_filter, survey.files.records,
    ]  # fmt: skip


def _arrays(folder: Path) -> None:
    from pomona.stages.fuse import Fused, Shown
    from pomona.survey import SurveyFolder
    from pomona.survey.fused import write_fused
    from report_scenes import observe

    fruits, shown = row_fruits(6), Shown(np.full(6, 0.5), np.ones(6))
    write_fused(SurveyFolder.create(folder), "fuse", Fused(fruits, observe(fruits, row_cameras(2)), _cloud(10), shown))


def _read_arrays(folder: Path) -> object:
    from pomona.survey import SurveyFolder
    from pomona.survey.fused import read_fused

    return read_fused(SurveyFolder.open(folder), "fuse")


def _pieces(folder: Path) -> None:
    from pomona.stages.sfm.pieces import Piece, Reconstruction, Unregistered
    from pomona.stages.sfm.store import write_reconstruction

    names = ("IMG_0000.jpg", "IMG_0001.jpg")
    lost = (Unregistered("IMG_9.jpg", "row", "no match", "more overlap"),)
    write_reconstruction(folder / "sfm", Reconstruction((Piece("row", cameras_of(names), 0.4),), lost), _small_photos())


def _small_photos() -> Photos:
    return Photos(tuple(Photo(f"IMG_000{k}.jpg", Path("x"), 96, 72) for k in range(2)))


def _read_pieces(folder: Path) -> object:
    from pomona.stages.sfm.store import read_reconstruction

    return read_reconstruction(folder / "sfm", _small_photos())


def _svm(folder: Path) -> None:
    from pomona.stages.filter.svm import LinearSvm

    rng = np.random.default_rng(0)
    values, is_fruit = rng.normal(0, 1, (60, 3)), np.arange(60) % 2 == 0
    values[is_fruit] += 2
    LinearSvm.train(values, is_fruit, names=("a", "b", "c")).save(folder / "svm.json")


def _read_svm(path: Path) -> object:
    from pomona.stages.filter.svm import LinearSvm

    return LinearSvm.load(path)


# Images


def _image(name: str, **how: Any) -> Example:
    def write(folder: Path) -> None:
        y, x = np.indices((24, 32))
        pixels = np.stack([x * 8, y * 10, (x + y) * 4], axis=2).astype(np.uint8)
        image = Image.fromarray(pixels)
        if name.endswith(".heic"):
            import pillow_heif

            pillow_heif.register_heif_opener()
        image.save(folder / name, **how)

    return Example(write, name)


def _exif() -> Image.Exif:
    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0112], exif[0x0132] = "Canon", "EOS 60D", 6, "2026:08:01 09:30:00"
    details = exif.get_ifd(0x8769)
    details |= {0x920A: 24.0, 0xA405: 38, 0xA404: 1.0, 0x9003: "2026:08:01 09:30:00", 0x9291: "25", 0xA434: "18-55"}
    details |= {0xA002: 32, 0xA003: 24, 0xA20E: 5000.0, 0xA20F: 5000.0, 0xA210: 2}
    gps = exif.get_ifd(0x8825)
    gps |= {1: "N", 2: (41.0, 36.0, 12.5), 3: "E", 4: (0.0, 36.0, 1.25), 5: b"\x00", 6: 210.5}
    return exif


def _read_image(path: Path) -> object:
    from pomona.stages.capture.exif import focal_px
    from pomona.stages.capture.images import read_header, read_pixels

    header = read_header(path)
    photo = Photo("a", path, header.width_px, header.height_px, orientation=header.exif.orientation)
    focal = focal_px(header.exif, header.width_px, header.height_px)
    return focal, header.exif.camera, read_pixels(photo), read_pixels(photo, max_side_px=16)


def _photos(folder: Path) -> None:
    for k in range(2):
        _image(f"IMG_{k}.jpg", exif=_exif()).write(folder)


def _read_photos(folder: Path) -> object:
    from pomona.stages.capture import load_photos

    return load_photos([folder])


def _video(folder: Path) -> None:
    writer = cv2.VideoWriter(str(folder / "row.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    rng = np.random.default_rng(0)
    wide = rng.integers(0, 256, (48, 200, 3), dtype=np.uint8)
    for k in range(8):
        writer.write(np.ascontiguousarray(wide[:, 8 * k : 8 * k + 64]))
    writer.release()


def _read_video(path: Path) -> object:
    from pomona.progress import Silent
    from pomona.stages.capture import KeyFrameOptions
    from pomona.stages.capture.video import extract_key_frames, is_video

    return is_video(path), extract_key_frames(path, path.parent / "frames", Silent(), KeyFrameOptions())


# Networks


def _yolo(folder: Path) -> None:
    from detector_models import write_yolo

    write_yolo(folder / "model.onnx", [((10, 20, 40, 50), 0, 0.9)], input_px=(64, 64))


def _detr(folder: Path) -> None:
    from detector_models import write_detr

    stored = json.dumps({"class_names": ["apple"]})
    write_detr(folder / "model.onnx", [((0.1, 0.2, 0.5, 0.6), 0, 3.0)], metadata={"rfdetr_metadata": stored})


def _read_network(path: Path) -> object:
    from pomona.stages.segment import load_segmenter

    return load_segmenter(path).segment([np.zeros((64, 64, 3), np.uint8)])


# Public datasets


def _fruitnerf(folder: Path) -> None:
    frames = [
        {"file_path": f"images/{k}.png", "semantic_path": f"semantics/{k}.png", "transform_matrix": np.eye(4).tolist()}
        for k in range(2)
    ]
    for name in ("images", "semantics"):
        (folder / name).mkdir()
        for k in range(2):
            Image.fromarray(np.full((24, 32), 255 * (name == "images"), np.uint8)).save(folder / name / f"{k}.png")
    _write_text("transforms.json", json.dumps({"camera_angle_x": 0.7, "frames": frames}), folder)
    cube = [f"v {x} {y} {z}" for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1)]
    _write_text("fruits.obj", "\n".join(["o apple", *cube, "f 1 2 3", "o other", *cube]), folder)


def _read_fruitnerf(folder: Path) -> object:
    from pomona.datasets.fruitnerf_scene import find_scenes, load_scene_photos, read_objects, read_scene_masks
    from pomona.progress import Silent

    found = []
    for scene in find_scenes(folder):
        photos = load_scene_photos(scene, Silent())
        found.append((photos, read_scene_masks(scene, photos, Silent()) if scene.masks else None))
        found.append((photos, read_objects(scene.objects) if scene.objects else None))
    return found


def _wgisd(folder: Path) -> None:
    masks = np.zeros((24, 32, 1), bool)
    masks[4:9, 5:20] = True
    np.savez_compressed(folder / "CDY_1.npz", masks)


def _read_wgisd(path: Path) -> object:
    from pomona.datasets.wgisd import _read_masks

    return _read_masks(path)


def _pfuji(folder: Path) -> None:
    _write_text("4-apples_GT_diameter.txt", "2018_01.txt,71.5\n2018_02.txt,68\n", folder)
    for k in (1, 2):
        _write_text(f"clouds/2018_0{k}.txt", "\n".join(f"{i}.0 {k}.5 0.25 1 2" for i in range(5)), folder)


def _read_pfuji(folder: Path) -> object:
    from pomona.datasets.pfuji_size import read_apples
    from pomona.formats.xyz import read_numbers

    return [read_numbers(apple.path, "points") for apple in read_apples(folder)[1]]


def _row_truth(folder: Path) -> None:
    cameras = {
        f"east/{k}.jpg": {
            "R": np.eye(3).tolist(),
            "t": [0, 0, k],
            "f": 500.0,
            "cx": 50,
            "cy": 40,
            "width": 100,
            "height": 80,
        }
        for k in range(2)
    }
    _write_text("cameras.json", json.dumps(cameras), folder)
    _write_text("fruits.csv", "id,tree,x,y,z,diameter\n1,1,0,0,1,0.07\n2,1,0,0.2,1,0.08\n", folder)


def _read_row_truth(folder: Path) -> object:
    from pomona.learning.synth.truth import read_cameras, read_fruits

    return read_cameras(folder / "cameras.json"), read_fruits(folder / "fruits.csv")


def _depth_map(folder: Path) -> None:
    (folder / "a.geometric.bin").write_bytes(b"4&3&1&" + np.arange(12, dtype="<f4").tobytes())


def _read_depth_map(path: Path) -> object:
    from pomona.stages.dense.patchmatch import read_array

    return read_array(path)


_GCP = (
    "EPSG:25831\n300000.5 4600000.25 210.5 100.5 50.25 IMG_1.JPG a\n300001.5 4600000.25 210.5 120.5 50.25 IMG_1.JPG b\n"
)


# What runs keep for themselves: a damaged file of it is as one that is not there, which counts as refused here


def _needed(value: object) -> object:
    from pomona.errors import FormatError

    if not value:
        raise FormatError("taken for none")
    return value


def _kept_features(folder: Path) -> Any:
    from pomona.stages.sfm.kept_features import KeptFeatures
    from pomona.stages.sfm.options import SfmOptions

    return KeptFeatures(folder, SfmOptions(), "code")


def _features(folder: Path) -> None:
    from pomona.stages.sfm.features import Features

    rng = np.random.default_rng(0)
    keypoints, descriptors = rng.uniform(0, 90, (9, 4)).astype(np.float32), rng.integers(0, 255, (9, 128), np.uint8)
    features = Features(keypoints, descriptors, rng.integers(0, 255, (9, 3), np.uint8), 0.5)
    _kept_features(folder).keep(_small_photos().items[0], features)


def _read_features(folder: Path) -> object:
    return _needed(_kept_features(folder).get(_small_photos().items[0]))


def _photo_detections(folder: Path) -> None:
    from pomona.formats.detections.coco import write_coco
    from pomona.survey.sealed import seal

    photos = _small_photos()
    write_coco(folder / "kept.json", photos, _discs(photos))
    seal(folder / "kept.json")


def _read_photo_detections(path: Path) -> object:
    from pomona.formats.detections.coco import read_coco
    from pomona.survey.sealed import is_sealed

    _needed(is_sealed(path))
    return read_coco(path, _small_photos())


def _read_digests(path: Path) -> object:
    from pomona.pipeline.sources import read_digests

    return _needed(read_digests(path))


def _key_frames(folder: Path) -> None:
    from pomona.stages.capture.video import KeyFrame, write_frame_list

    Image.new("RGB", (8, 8)).save(folder / "frame_000001.jpg")
    write_frame_list(folder, {"version": 0}, [KeyFrame.of(folder / "frame_000001.jpg", 1, 0.5, 8, 8)])


def _read_key_frames(folder: Path) -> object:
    from pomona.stages.capture.video import read_frame_list

    return _needed(read_frame_list(folder, {"version": 0}))


_EVENTS = [
    {"event": "begin", "time": 1.5, "process": 7}, {"event": "stage", "time": 2.5, "name": "photos"},
    {"event": "step", "time": 3.5, "label": "segmenting", "total": 9}, {"event": "done", "time": 4.0, "done": 3},
    {"event": "warning", "time": 5.0, "message": "dark"}, {"event": "end", "time": 6.0, "state": "finished"},
]  # fmt: skip


def _events(folder: Path) -> None:
    _survey(folder)
    (folder / "work").mkdir(exist_ok=True)
    (folder / "work" / "run.jsonl").write_text("".join(json.dumps(event) + "\n" for event in _EVENTS))


def _read_events(folder: Path) -> object:
    from pomona.survey import SurveyFolder
    from pomona.survey.events import run_status

    status: Any = _needed(run_status(SurveyFolder.open(folder)))
    return [status.stage, status.step_left_s, json.dumps(repr(status))]


def _catalogue(folder: Path) -> None:
    from pomona.browser.app.catalogue import Catalogue

    Catalogue(folder / "surveys.json").add("Row 1", Path("/nowhere/row"), ("run", "/nowhere/photos"))


def _read_catalogue(path: Path) -> object:
    from pomona.browser.app.catalogue import Catalogue

    entries: Any = _needed(Catalogue(path).entries)
    return [
        [one.id.strip(), one.name.strip(), one.folder.name, one.created.strip(), [word.strip() for word in one.asked]]
        for one in entries
    ]


_ORCHARD = """title = "Fruit"
[defaults]
sides = "none"
fruit-diameter = 0.075
[workers]
processes = 2
[[survey]]
row = "Row 1"
date = 2026-09-01
photos = ["row-1/photos"]
markers = "markers.csv"
[[survey]]
row = "Row 1"
date = 2026-10-01
photos = ["east", "west"]
"""


def _read_orchard(path: Path) -> object:
    from pomona.orchard.plan import read_orchard

    orchard = read_orchard(path)
    return [orchard.comparisons, [survey.key for survey in orchard.surveys]]


def _outcome_folder(folder: Path) -> Any:
    from pomona.orchard.folder import OrchardFolder
    from pomona.orchard.places import Place

    return OrchardFolder(Place(str(folder)))


def _outcome(folder: Path) -> None:
    from pomona.orchard.jobs import Attempt, JobOutcome

    tried = Attempt(**dict.fromkeys(Attempt.__dataclass_fields__, "x"))
    _outcome_folder(folder).keep(
        "surveys", JobOutcome(name="row-1", state="failed", reason="no photos", attempts=(tried,))
    )


def _read_outcome(folder: Path) -> object:
    outcome = _needed(_outcome_folder(folder).outcome("surveys", "row-1"))
    return outcome.to_json()  # type: ignore[attr-defined]


def _checkpoint(folder: Path) -> None:
    import torch

    state = {"model": {"a.weight": torch.zeros(3, 4), "a.bias": torch.ones(3)}, "arch": "maskrcnn-r50", "step": 7}
    torch.save(state, folder / "model.pt")


def _read_checkpoint(path: Path) -> object:
    from pomona.stages.segment.mask_rcnn import read_checkpoint

    return [str(value) for value in read_checkpoint(path, "a checkpoint").values()]


def _kept() -> Sequence[Reader]:
    return [
        Reader("features of a photo", _read_features, (Example(_features),)),
        Reader("detections of a photo", _read_photo_detections, (Example(_photo_detections, "kept.json"),)),
        Reader(
            "digests.json", _read_digests,
            _text("digests.json", json.dumps({f"/photos/{k}.jpg 100 {k}": f"{k:024x}" for k in range(5)}, indent=1)),
        ),
        Reader("frames.json", _read_key_frames, (Example(_key_frames),)),
        Reader("run.jsonl", _read_events, (Example(_events, whole=_all_but("") | {"survey.json"}),)),
        Reader("surveys of the app", _read_catalogue, (Example(_catalogue, "surveys.json"),)),
        Reader("orchard.toml", _read_orchard, _text("orchard.toml", _ORCHARD)),
        Reader("outcomes of an orchard", _read_outcome, (Example(_outcome),)),
        Reader("checkpoints", _read_checkpoint, (Example(_checkpoint, "model.pt"),)),
    ]  # fmt: skip


def all_readers() -> tuple[Reader, ...]:
    """Return every reader; the examples of cameras and detections grouped by program."""
    return (*_given(), *_own(), *_other(), *_kept())


def _given() -> Sequence[Reader]:
    programs: dict[str, list[Example]] = {}
    for name in camera_scenes.WRITERS:
        programs.setdefault(name.split()[0], []).append(_cameras_example(name))
    cameras = [Reader(f"cameras: {name}", _read_cameras, tuple(found)) for name, found in programs.items()]
    detections = [
        Reader(f"detections: {name}", _read_detections, (Example(write, _name_written(write)),))
        for name, (write, _, _) in detection_scenes.WRITERS.items()
    ]
    labels = [
        Reader(f"labels: {name}", _read_labels, (Example(_with_photos(write, place), whole=_PHOTO_FILES),))
        for name, write, place in [
            *((name, detection_scenes.WRITERS[name][0], ".") for name in _LABELS),
            ("LabelMe", _labelme, "."),
            ("YOLO", functools.partial(detection_scenes.yolo, scored=False), "images"),
        ]
    ]
    return [*cameras, *detections, *labels]


def _own() -> Sequence[Reader]:
    markers = _text("markers.csv", "id,x,y,z,size,yaw\n0,0,0,1,0.1,0\n1,1.5,0,1,0.1,0\n2,0.5,0,1.2,0.1,0.1\n")
    return [
        Reader("tables of a survey", _read_tables, (Example(_tables),)),
        Reader("clouds: LAS", _read_las, (_las(".las"),)),
        Reader("clouds: LAZ", _read_las, (_las(".laz"),)),
        Reader("clouds: PLY", _read_ply, (_ply("ascii"), _ply("binary_little_endian"), _ply("binary_big_endian"))),
        Reader("clouds: text", _read_xyz, (Example(_xyz, "cloud.txt"),)),
        Reader("markers.csv", _read_markers, markers),
        Reader("gcp_list.txt", _read_control_points, _text("gcp_list.txt", _GCP)),
        Reader(
            "positions.csv", _read_positions,
            _text("positions.csv", "photo,latitude,longitude,altitude,sd\nIMG_1.JPG,41,0.5,210,1\nIMG_2.JPG,41,1,,\n"),
        ),
        Reader("trees.csv", _read_trunks, _text("trees.csv", "id;x;y\n1;0;0\n2;0,9;0\n".replace(",", "."))),
        Reader("hand_counts.csv", _read_hand_counts, _text("counts.csv", "tree,count\n1,104\n2,96\n# 3 had none\n")),
        Reader(
            "pairs.csv", _read_pairs,
            _text("pairs.csv", "diameter_mm,weight_g\n60,95\n65,120\n70,150\n72,160\n75,182\n80,220\n55,75\n68,140\n"),
        ),
        Reader("corrections.json", _read_corrections, (Example(_corrections, "corrections.json"),)),
        Reader("survey folder", _read_survey, (Example(_survey),)),
        Reader("survey.json", _read_survey, (Example(_survey, whole=_all_but("survey.json")),)),
        Reader("arrays between stages", _read_arrays, (Example(_arrays, whole=frozenset({"survey.json"})),)),
        Reader("reconstruction between stages", _read_pieces, (Example(_pieces),)),
        Reader("classifier of the filter", _read_svm, (Example(_svm, "svm.json"),)),
    ]  # fmt: skip


def _all_but(name: str) -> frozenset[str]:
    files = {
        "fruits.csv", "observations.csv", "trees.csv", "segments.csv", "detections.json", "cloud.laz",
        "cameras.txt", "images.txt", "points3D.txt", "frame.json",
    }  # fmt: skip
    return frozenset(files - {name})


def _other() -> Sequence[Reader]:
    id_images = (
        _id_image("ids.png", 8), _id_image("ids.png", 16), _id_image("ids.png", 8, 3), _id_image("ids.tif", 16),
        Example(_palette_image, "ids.png"),
    )  # fmt: skip
    truth = (
        Example(_truth_folder), *_text("boxes.txt", _BOXES, _CORNERS), *_text("boxes.csv", _BOX_TABLE),
    )  # fmt: skip
    coco = detection_scenes.WRITERS["COCO, compressed runs"][0]
    return [
        Reader("truth of fruits", _read_truth, truth),
        Reader("truth of detections", _read_detection_truth, (Example(coco, _name_written(coco)),)),
        Reader("images of ids", _read_ids, id_images),
        Reader("images: JPEG and EXIF", _read_image, (_image("a.jpg", exif=_exif()),)),
        Reader("images: PNG", _read_image, (_image("a.png"), _image("b.png", exif=_exif()))),
        Reader("images: TIFF", _read_image, (_image("a.tif"), _image("b.tif", compression="tiff_lzw", exif=_exif()))),
        Reader("images: HEIC", _read_image, (_image("a.heic", exif=_exif()),)),
        Reader("images: WebP and BMP", _read_image, (_image("a.webp", exif=_exif()), _image("a.bmp"))),
        Reader("folder of photos", _read_photos, (Example(_photos),)),
        Reader("video", _read_video, (Example(_video, "row.avi"),), leaves=("frames",)),
        Reader("networks: YOLO", _read_network, (Example(_yolo, "model.onnx"),)),
        Reader("networks: RF-DETR", _read_network, (Example(_detr, "model.onnx"),)),
        Reader("dataset: FruitNeRF", _read_fruitnerf, (Example(_fruitnerf),)),
        Reader("dataset: WGISD", _read_wgisd, (Example(_wgisd, "CDY_1.npz"),)),
        Reader("dataset: PFuji-Size", _read_pfuji, (Example(_pfuji),)),
        Reader("truth of a rendered row", _read_row_truth, (Example(_row_truth),)),
        Reader("depth map of COLMAP", _read_depth_map, (Example(_depth_map, "a.geometric.bin"),)),
    ]


READERS = all_readers()
"""Every reader, by name in the order of the documentation's table."""
