"""Files made to do harm: they lead nowhere outside, fill no memory, and run nothing."""

from __future__ import annotations

import csv
import json
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import pomona
from pomona.basics.onnx_file import OnnxFile
from pomona.datasets.fruitnerf_scene import find_scenes
from pomona.errors import FormatError, InputError, MissingFileError, PomonaError
from pomona.formats.detections.photo_source import PhotoFinder
from pomona.formats.npz import read_npz
from pomona.formats.tables import read_observations, write_observations, write_table
from pomona.formats.xml_file import load_xml
from pomona.progress import Silent
from pomona.stages.capture import KeyFrameOptions
from pomona.stages.capture.images import read_header
from pomona.stages.capture.video import extract_key_frames
from pomona.stages.segment import load_segmenter
from pomona.survey import SurveyFolder
from pomona.values.fruits import Observations

TRICKS = (
    "../../secret.jpg", "/etc/secret.jpg", "..\\..\\secret.jpg", "C:\\secret.jpg",
    "\\\\host\\share\\secret.jpg", "a/../../../secret.jpg",
)  # fmt: skip


class Harm:
    """What would write a file if it were unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return Path.touch, (self.path,)


@pytest.mark.parametrize("name", TRICKS)
def test_a_survey_names_no_files_outside_of_it(tmp_path: Path, name: str) -> None:
    SurveyFolder.create(tmp_path / "survey")
    path = tmp_path / "survey" / "survey.json"
    stages = {"results": {"fingerprint": "f", "outputs": {name: "0"}}}
    path.write_text(json.dumps(json.loads(path.read_text()) | {"stages": stages}))
    with pytest.raises(FormatError, match="expected files in the survey"):
        SurveyFolder.open(tmp_path / "survey")


@pytest.mark.parametrize("name", TRICKS)
def test_labels_show_no_photos_from_elsewhere(tmp_path: Path, name: str) -> None:
    labels = tmp_path / "a" / "b" / "labels.json"
    labels.parent.mkdir(parents=True)
    (tmp_path / "secret.jpg").touch()
    with pytest.raises(MissingFileError, match="is not there"):
        PhotoFinder(labels, lambda path: (1, 1)).find(name, "here")
    link = labels.parent / "link.jpg"
    link.symlink_to(tmp_path / "secret.jpg")
    with pytest.raises(PomonaError):
        PhotoFinder(labels, lambda path: (1, 1)).find("../../secret.jpg", "here")


def test_photos_may_lie_in_a_linked_folder_but_names_lead_out_of_it_no_more_than_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "disk" / "photos").mkdir(parents=True)
    (tmp_path / "disk" / "photos" / "a.jpg").touch()
    (tmp_path / "disk" / "secret.jpg").touch()
    (tmp_path / "set" / "first").mkdir(parents=True)
    (tmp_path / "set" / "first" / "images").symlink_to(tmp_path / "disk" / "photos")
    finder = PhotoFinder(tmp_path / "set" / "first" / "labels.json", lambda path: (1, 1))
    assert finder.find("a.jpg", "here").path.name == "a.jpg"
    with pytest.raises(MissingFileError, match="is not there"):
        finder.find("../secret.jpg", "there")


def test_transforms_name_no_files_outside_of_their_folder(tmp_path: Path) -> None:
    (tmp_path / "tree").mkdir()
    (tmp_path / "secret.png").touch()
    for name in ("../secret.png", str(tmp_path / "secret.png")):
        (tmp_path / "tree" / "transforms.json").write_text(json.dumps({"frames": [{"file_path": name}]}))
        with pytest.raises(FormatError, match="leads out of it"):
            find_scenes(tmp_path)


def test_a_list_of_frames_removes_nothing_outside(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "frames").mkdir()
    listed = {"made_from": {}, "frames": [{"name": "../mine.txt"}]}
    (tmp_path / "frames" / "frames.json").write_text(json.dumps(listed))
    (tmp_path / "row.mp4").write_bytes(b"no video")
    with pytest.raises(InputError):
        extract_key_frames(tmp_path / "row.mp4", tmp_path / "frames", Silent(), KeyFrameOptions())
    assert (tmp_path / "mine.txt").read_text() == "mine"


@pytest.mark.slow
def test_arrays_are_never_unpickled_and_no_more_than_they_are(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", a=np.array([Harm(tmp_path / "harmed")], object))
    with pytest.raises(FormatError, match="Python objects"):
        read_npz(tmp_path / "a.npz", "arrays")
    with zipfile.ZipFile(tmp_path / "b.npz", "w", zipfile.ZIP_DEFLATED) as file:
        zeros = bytes(50_000_000)
        with file.open("a.npy", "w", force_zip64=True) as member:
            for _ in range(21):
                member.write(zeros)
    assert (tmp_path / "b.npz").stat().st_size < 2_000_000
    with pytest.raises(FormatError, match=r"1\.[01] GB of arrays packed"):
        read_npz(tmp_path / "b.npz", "arrays")
    assert not (tmp_path / "harmed").exists()


def test_checkpoints_are_weights_alone(tmp_path: Path) -> None:
    (tmp_path / "model.pt").write_bytes(pickle.dumps({"model": Harm(tmp_path / "harmed")}))
    with pytest.raises(FormatError):
        load_segmenter(tmp_path / "model.pt")
    assert not (tmp_path / "harmed").exists()


def test_xml_defines_no_entities(tmp_path: Path) -> None:
    levels = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, 10))
    (tmp_path / "a.xml").write_text(f'<!DOCTYPE a [<!ENTITY e0 "aaaaaaaaaa">{levels}]><a>&e9;</a>')
    with pytest.raises(FormatError, match="entities"):
        load_xml(tmp_path / "a.xml", "cameras")
    (tmp_path / "b.xml").write_text('<!DOCTYPE a [<!ENTITY e SYSTEM "file:///etc/passwd">]><a>&e;</a>')
    with pytest.raises(FormatError, match="entities"):
        load_xml(tmp_path / "b.xml", "cameras")


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_images_of_enormous_sizes_are_not_made_room_for(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    Image.new("RGB", (8, 8)).save(path)
    data = bytearray(path.read_bytes())
    if suffix == "png":
        import zlib

        data[16:24] = (60_000).to_bytes(4, "big") * 2
        data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
    else:
        at = data.index(b"\xff\xc0")
        data[at + 5 : at + 9] = b"\xff\xff\xff\xff"
    path.write_bytes(data)
    with pytest.raises(InputError, match="cannot be read"):
        read_header(path)


@pytest.mark.parametrize("place", ["../secret.bin", "/etc/hostname"])
def test_networks_take_no_data_from_outside_their_folder(tmp_path: Path, place: str) -> None:
    onnx = pytest.importorskip("onnx")
    weights = onnx.TensorProto(name="k", data_type=1, dims=[1, 3, 4, 4], data_location=onnx.TensorProto.EXTERNAL)
    weights.external_data.add(key="location", value=place)
    (tmp_path / "secret.bin").write_bytes(bytes(192))
    value = onnx.helper.make_tensor_value_info
    nodes = [onnx.helper.make_node("Conv", ["x", "k"], ["y"])]
    graph = onnx.helper.make_graph(nodes, "g", [value("x", 1, [1, 3, 8, 8])], [value("y", 1, [1, 1, 5, 5])], [weights])
    (tmp_path / "model").mkdir()
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    (tmp_path / "model" / "a.onnx").write_bytes(model.SerializeToString())
    with pytest.raises(FormatError, match="External data path"):
        OnnxFile(tmp_path / "model" / "a.onnx")


FORMULAS = ("=HYPERLINK(1)", "+cmd|' /C calc'!A0", "-2+3", "@SUM(1)", "\t=1", "\r=1", "\n=1", "＝1+1", "''=1")


def test_no_table_has_a_text_that_a_spreadsheet_takes_for_a_formula(tmp_path: Path) -> None:
    row = [*FORMULAS, "'plain", "east", "-0.25", "+1e-3", -0.25, None, 3]
    write_table(tmp_path / "a.csv", [f"c{k}" for k in range(len(row))], [row])
    with (tmp_path / "a.csv").open(newline="", encoding="utf-8") as file:
        _, cells = csv.reader(file)
    assert cells[: len(FORMULAS)] == [f"'{text}" for text in FORMULAS]
    assert cells[len(FORMULAS) :] == ["'plain", "east", "-0.25", "+1e-3", "-0.25", "", "3"]


def test_all_tables_are_written_by_what_keeps_formulas_out() -> None:
    writers = [path for path in Path(pomona.__file__).parent.rglob("*.py") if "csv.writer(" in path.read_text("utf-8")]
    # The truth of a rendered row has nothing but numbers.
    assert [path.relative_to(Path(pomona.__file__).parent).as_posix() for path in sorted(writers)] == [
        "formats/tables.py",
        "learning/synth/truth.py",
    ]


def test_a_spreadsheet_sees_no_formula_in_a_photos_name(tmp_path: Path) -> None:
    names = ("=HYPERLINK(1).jpg", "@a.jpg", "'=a.jpg", "-1.jpg", "'plain.jpg", "east/IMG_1.jpg")
    seen = Observations(np.ones(6, np.int64), names, np.arange(6), np.zeros((6, 2)))
    write_observations(tmp_path / "o.csv", seen)
    cells = [row[1] for row in csv.reader((tmp_path / "o.csv").read_text().splitlines())][1:]
    assert not [cell for cell in cells if cell.startswith(("=", "+", "-", "@"))]
    assert read_observations(tmp_path / "o.csv").photo == names
