"""Files of cameras that are damaged, of something else, or of other photos: a clear error, no silent result."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from camera_scenes import WRITERS, make_scene, photos_of, write_bundler
from pomona.errors import FormatError, InputError, MissingFileError, PomonaError
from pomona.formats.cameras.bundler import parse_bundle
from pomona.formats.cameras.read import read_cameras
from pomona.values.photos import Photo, Photos
from work import counted

SCENE = make_scene(11, cameras=3, points=6)
PHOTOS = photos_of(SCENE)


def _written(name: str, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return WRITERS[name](SCENE, folder, np.random.default_rng(11)).path


def _photo(folder: str, name: str) -> Photo:
    own = f"{folder}/{Path(name).name}"
    return Photo(own, Path("/") / own, 1600, 1200)


def _edited(name: str, folder: Path, edit: Callable[[str], str]) -> Path:
    path = _written(name, folder)
    path.write_text(edit(path.read_text()))
    return path


def test_nothing_there(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"COLMAP .* Bundler .* Metashape"):
        read_cameras(tmp_path / "none.xml", PHOTOS)


@pytest.mark.parametrize(
    ("name", "text"), [("a.txt", "hello"), ("a.json", '{"a": 1}'), ("a.psx", "x"), ("a.nvm", "NVM_V3")]
)
def test_something_else(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(FormatError, match="expected cameras of COLMAP"):
        read_cameras(tmp_path / name, PHOTOS)


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("rc.csv", "a table, such as RealityCapture's: export the cameras as COLMAP or Bundler"),
        ("IMG_1.xmp", "RealityCapture's: export its cameras as COLMAP or Bundler"),
        ("opk.txt", "of Metashape export the cameras as Agisoft XML, of other programs as COLMAP or Bundler"),
    ],
)
def test_what_cannot_be_read_says_what_to_export(tmp_path: Path, name: str, advice: str) -> None:
    (tmp_path / name).write_text("#name,x,y,alt,heading,pitch,roll\n")
    with pytest.raises(FormatError, match=advice):
        read_cameras(tmp_path / name, PHOTOS)
    if name == "IMG_1.xmp":
        with pytest.raises(FormatError, match=f"found {advice}"):
            read_cameras(tmp_path, PHOTOS)


def test_cameras_of_another_survey(tmp_path: Path) -> None:
    _written("colmap text", tmp_path / "cameras")
    assert len(read_cameras(tmp_path, PHOTOS).cameras) == 3


def test_folder_of_nothing_and_of_several(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="found none in the folder"):
        read_cameras(tmp_path, PHOTOS)
    _written("nerfstudio", tmp_path)
    assert len(read_cameras(tmp_path, PHOTOS).cameras) == 3
    _written("colmap text", tmp_path / "sparse" / "0")
    with pytest.raises(InputError, match="several sets of cameras"):
        read_cameras(tmp_path, PHOTOS)


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("opensfm brown", "opensfm"), ("colmap OPENCV", "sparse/0"), ("colmap text", "."), ("bundler", "bundle"),
        ("openmvg pinhole", "reconstruction"), ("metashape local", "."),
    ],
)  # fmt: skip
def test_folder_of_a_project(tmp_path: Path, name: str, place: str) -> None:
    _written(name, tmp_path / place)
    assert len(read_cameras(tmp_path, PHOTOS).cameras) == 3


def test_content_tells_the_program_whatever_the_name(tmp_path: Path) -> None:
    for name in ("opensfm brown", "nerfstudio", "openmvg pinhole", "metashape local"):
        path = _written(name, tmp_path / name)
        moved = path.with_name("export.dat")
        path.rename(moved)
        assert len(read_cameras(moved, PHOTOS).cameras) == 3
    file_of_a_model = _written("colmap text", tmp_path / "colmap") / "images.txt"
    assert len(read_cameras(file_of_a_model, PHOTOS).cameras) == 3


def test_other_photos(tmp_path: Path) -> None:
    path = _written("openmvg pinhole", tmp_path)
    others = Photos((Photo("other/DSC_1.JPG", Path("/other/DSC_1.JPG"), 1600, 1200),))
    with pytest.raises(InputError, match=r"none of its 3 photos .* other/DSC_1.JPG, found .*IMG_0000"):
        read_cameras(path, others)
    cropped = photos_of(SCENE, 1600, 1000)
    with pytest.raises(InputError, match="1600 × 1200 pixels, but the photo has 1600 × 1000"):
        read_cameras(path, cropped)


def test_some_photos_alone(tmp_path: Path) -> None:
    path = _written("colmap OPENCV", tmp_path)
    read = read_cameras(path, Photos(PHOTOS.items[1:]))
    assert read.cameras.photos == tuple(SCENE.names[1:])
    assert set(read.cameras.track_photo_idx.tolist()) == {0, 1}
    assert any("1 of 3 cameras are of photos that were not given: row/IMG_0000.JPG" in note for note in read.notes)


def test_names_that_fit_several_photos(tmp_path: Path) -> None:
    path = _written("metashape local", tmp_path)
    twice = [_photo(side, name) for side in "ab" for name in SCENE.names]
    with pytest.raises(InputError, match="fits several photos"):
        read_cameras(path, Photos(tuple(twice)))
    named = _written("colmap text", tmp_path / "paths")
    rows = [_photo(f"{side}/row", name) for side in "ab" for name in SCENE.names]
    with pytest.raises(InputError, match="fits several photos"):
        read_cameras(named, Photos(tuple(rows)))
    with_one = [replace(photo, path=Path("/x/row") / Path(photo.name).name) for photo in rows[:3]]
    assert read_cameras(named, Photos(tuple(with_one))).cameras.photos[0] == "a/row/IMG_0000.JPG"


def _cut(text: str) -> str:
    return text[: len(text) // 2]


def _for(old: str, new: str, count: int = -1) -> Callable[[str], str]:
    return lambda text: text.replace(old, new, count)


def _line(number: int, line: str) -> Callable[[str], str]:
    return lambda text: "\n".join(line if i == number else old for i, old in enumerate(text.splitlines(), 1))


# What is done to which file, and what the error has to say.
BAD: dict[str, tuple[str, Callable[[str], str], str]] = {
    "bundler: cut short": ("bundler", _cut, "line"),
    "bundler: wrong counts": ("bundler", _for("3 6\n", "4 6\n", 1), "line"),
    "bundler: counts of another world": ("bundler", _for("3 6\n", "3000000000 6\n", 1), "cut short"),
    "bundler: NaN rotation": ("bundler", _line(4, "nan 0 0"), "line 4: .*not finite"),
    "bundler: no rotation": ("bundler", _line(4, "9 0 0"), "line 4, camera 0: .*rotation"),
    "bundler: words": ("bundler", _line(3, "a b c"), "line 3: expected f k1 k2"),
    "bundler: lines too many": ("bundler", lambda text: text + "1 2 3\n", "end of the file"),
    "metashape: cut short": ("metashape local", _cut, "no XML"),
    "metashape: NaN": ("metashape local", _for("<f>", "<f>nan"), "calibration/f: expected 1 finite"),
    "metashape: no pose": ("metashape local", _for("<transform>", "<transform>9", 1), "camera/transform: .*'9-?0"),
    "metashape: no rotation": ("metashape local", _for("<transform>", "<transform>1 1 1 1 1 "), "camera/transform"),
    "metashape: no cameras": ("metashape local", _for("cameras", "photos"), "<cameras>"),
    "metashape: sensor missing": ("metashape local", _for('sensor_id="0"', 'sensor_id="5"'), "sensor 5"),
    "metashape: of a panorama": ("metashape local", _for('type="frame"', 'type="spherical"'), "spherical"),
    "metashape: unknown reference": ("metashape earth", _for("GEOGCS", "XXGCS"), "PROJ"),
    "opensfm: cut short": ("opensfm brown", _cut, "no JSON"),
    "opensfm: NaN": ("opensfm brown", _for('"focal_x": 0', '"focal_x": NaN, "was": 0'), "focal_x"),
    "opensfm: unknown lens": ("opensfm brown", _for('"brown"', '"spherical"'), "projection_type"),
    "opensfm: lens missing": ("opensfm brown", _for('"camera": "v2 one"', '"camera": "x"'), "camera"),
    "nerfstudio: cut short": ("nerfstudio", _cut, "no JSON"),
    "nerfstudio: no focal length": ("nerfstudio", _for('"fl_x"', '"flx"'), "fl_x"),
    "nerfstudio: panorama": ("nerfstudio", _for('"OPENCV"', '"EQUIRECTANGULAR"'), "camera_model"),
    "nerfstudio: reflected": ("nerfstudio", _for("[0.0, -1.0, 0.0", "[0.0, 1.0, 0.0"), "reflection"),
    "openmvg: cut short": ("openmvg fisheye", _cut, "no JSON"),
    "openmvg: no poses": ("openmvg fisheye", _for('"extrinsics"', '"extrinsics": [], "x"'), "poses"),
    "openmvg: unknown lens": ("openmvg fisheye", _for('"fisheye"', '"spherical"'), "spherical"),
    "openmvg: infinite": ("openmvg fisheye", _for('"center": [', '"center": [1e999, '), "center"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_named(tmp_path: Path, case: str) -> None:
    name, edit, message = BAD[case]
    path = _edited(name, tmp_path, edit)
    with pytest.raises(FormatError, match=message) as error:
        read_cameras(path, PHOTOS)
    assert path.name in str(error.value)


def test_bundler_and_its_list(tmp_path: Path) -> None:
    path = _written("bundler", tmp_path)
    (tmp_path / "list.txt").write_text("one.jpg\ntwo.jpg\n")
    with pytest.raises(FormatError, match=r"list.txt: expected 3 photos, .* found 2"):
        read_cameras(path, PHOTOS)
    (tmp_path / "list.txt").unlink()
    with pytest.raises(FormatError, match="does not name its photos"):
        read_cameras(path, PHOTOS)
    assert len(parse_bundle(path)) == 3


def test_colmap_binary_of_the_other_byte_order(tmp_path: Path) -> None:
    path = _written("colmap OPENCV", tmp_path) / "images.bin"
    content = path.read_bytes()
    path.write_bytes(content[:8][::-1] + content[8:])
    with pytest.raises(FormatError, match="other byte order"):
        read_cameras(tmp_path, PHOTOS)


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
def test_colmap_binary_cut_short(tmp_path: Path, name: str) -> None:
    path = _written("colmap OPENCV", tmp_path) / f"{name}.bin"
    content = path.read_bytes()
    for size in (0, 5, 8, len(content) // 2, len(content) - 1, len(content) + 3):
        path.write_bytes((content + b"abc")[:size])
        with pytest.raises(FormatError, match=f"{name}.bin"):
            read_cameras(tmp_path, PHOTOS)
    path.unlink()
    with pytest.raises(PomonaError):
        read_cameras(tmp_path, PHOTOS)


def test_frame_beside_says_metres(tmp_path: Path) -> None:
    path = _written("openmvg pinhole", tmp_path)
    (tmp_path / "frame.json").write_text('{"scale_source": "given"}')
    frame = read_cameras(path, PHOTOS).cameras.frame
    assert (frame.scale_source, frame.approximate, frame.up_is_known) == ("given", False, True)
    (tmp_path / "frame.json").write_text('{"scale_source": "guessed"}')
    with pytest.raises(FormatError, match=r"frame.json: scale_source"):
        read_cameras(path, PHOTOS)


_WORDS = [b"nan", b"inf", b"-1", b"1e999", b"9" * 20, b"null", b"[]", b"{}", b"\xff\xfe", b'""', b"\0"]


def _mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """The bytes with some changed, cut out, doubled, or with words that programs trip over."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(0, max(len(data), 1)))
        kind = int(rng.integers(0, 6))
        if kind == 0 and data:
            data[at % len(data)] = int(rng.integers(0, 256))
        elif kind == 1:
            del data[at : at + int(rng.integers(1, 200))]
        elif kind == 2:
            data[at:at] = data[at : at + int(rng.integers(1, 200))]
        elif kind == 3:
            words = [
                b"nan",
                b"inf",
                b"-1",
                b"1e999",
                b"99999999999999999999",
                b"null",
                b"[]",
                b"{}",
                b"\xff\xfe",
                b'""',
                b"\0",
            ]
            data[at : at + int(rng.integers(0, 6))] = words[int(rng.integers(len(words)))]
        elif kind == 4:
            del data[at:]
        else:
            data[at : at + 8] = rng.bytes(8)
    return bytes(data)


@pytest.mark.parametrize("name", WRITERS)
def test_fuzzed_files_give_our_errors_alone(tmp_path: Path, name: str) -> None:
    whole = _written(name, tmp_path / "whole")
    files = sorted(p for p in (tmp_path / "whole").iterdir() if p.is_file())
    rng = np.random.default_rng(sum(name.encode()))
    refused = 0
    for k in range(24):
        folder = tmp_path / str(k)
        shutil.copytree(tmp_path / "whole", folder)
        victim = files[k % len(files)]
        (folder / victim.name).write_bytes(_mutated(victim.read_bytes(), rng))
        try:
            with counted() as work:
                cameras = read_cameras(folder if whole.is_dir() else folder / whole.name, PHOTOS).cameras
        except PomonaError:
            refused += 1
            continue
        finally:
            assert 100 < work.calls < 100_000  # a damaged number is no reason to count to it
            assert 0 < work.peak_mb < 50
        assert np.isfinite(cameras.cam_from_world).all()
        assert np.isfinite(cameras.points_in_world).all()
        assert all(np.isfinite(lens.params).all() and lens.focal_px > 0 for lens in cameras.intrinsics)
        np.testing.assert_allclose(np.linalg.det(cameras.cam_from_world[:, :, :3]), 1, atol=1e-6)
    assert refused > 0


def test_writer_of_this_test_is_readable(tmp_path: Path) -> None:
    assert len(read_cameras(write_bundler(SCENE, tmp_path, np.random.default_rng(0)).path, PHOTOS).cameras) == 3
