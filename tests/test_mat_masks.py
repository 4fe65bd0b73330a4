"""Masks in MATLAB files: of every version, byte order and type of number; and files that are wrong."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse

from pomona.errors import FormatError, MissingFileError
from pomona.formats.detections.mat_masks import is_mat, read_mat_masks
from pomona.formats.mat_file import NotNumbers, read_mat

LABELS = np.zeros((40, 60), np.uint16)
LABELS[5:15, 8:20] = 1
LABELS[20:30, 40:60] = 4  # 2 and 3 have no pixel: others cover them
SCORES = np.array([0.9, 0.8, 0.7, 0.6, 0.5])


def write(path: Path, **variables: Any) -> Path:
    scipy.io.savemat(path, {"mask": LABELS, "scores": SCORES} | variables)
    return path


@pytest.mark.parametrize("options", [{}, {"do_compression": True}, {"format": "4"}])
def test_variables_are_those_that_scipy_reads(tmp_path: Path, options: dict[str, Any]) -> None:
    rng, path = np.random.default_rng(0), tmp_path / "a.mat"
    of_4 = "format" in options
    kinds = ["u1", "i2", "u2", "i4", "f4", "f8"] + ([] if of_4 else ["i1", "u4", "i8", "u8"])
    shapes = [(3, 4), (1, 5), (0, 0), (1, 1)] + ([] if of_4 else [(2, 3, 4)])
    values = {
        f"v{k}{kind}": rng.integers(0, 120, shape).astype(kind) for k, shape in enumerate(shapes) for kind in kinds
    }
    values |= {"small": np.array([[1.0, 2.0]]), "text": "apple", "complex": np.array([[1 + 2j]])}
    values |= (
        {} if of_4 else {"cell": np.array([[1, "a"]], object), "structure": {"a": 1}, "logical": np.array([[True]])}
    )
    scipy.io.savemat(path, values, **options)
    read, wanted = read_mat(path, values.keys(), "anything"), scipy.io.loadmat(path)
    assert read.keys() == values.keys()
    for name, value in read.items():
        if name in ("text", "complex", "cell", "structure"):
            assert isinstance(value, NotNumbers), name
        else:
            np.testing.assert_array_equal(value, wanted[name])
            assert isinstance(value, np.ndarray)
            assert value.dtype == wanted[name].dtype, name


def test_a_variable_packed_small_that_is_large_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pomona.formats.mat_file._MOST_BYTES", 1_000_000)
    body = zlib.compress(bytes(1_000_001), 9)
    head = b"MATLAB 5.0 MAT-file, by hand".ljust(124) + struct.pack("<HH", 0x0100, 0x4D49)
    (tmp_path / "a.mat").write_bytes(head + struct.pack("<II", 15, len(body)) + body)
    with pytest.raises(FormatError, match="more than 1 MB is packed"):
        read_mat_masks(tmp_path / "a.mat")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.float32, np.float64])
@pytest.mark.parametrize("options", [{}, {"do_compression": True}, {"format": "4"}])
def test_masks_and_scores_are_those_of_the_labels(tmp_path: Path, dtype: type, options: dict[str, Any]) -> None:
    path = tmp_path / "IMG_1.mat"
    scipy.io.savemat(path, {"mask": LABELS.astype(dtype), "scores": SCORES, "other": "text"}, **options)
    read = read_mat_masks(path)
    assert (read.width_px, read.height_px) == (60, 40)
    assert read.labels.tolist() == [1, 4]
    assert read.scores is not None
    assert read.scores.tolist() == [0.9, 0.6]
    assert [mask.box_px for mask in read.masks] == [(8, 5, 20, 15), (40, 20, 60, 30)]
    assert [mask.area_px for mask in read.masks] == [120, 200]


def element(code: int, data: bytes, order: str) -> bytes:
    return struct.pack(order + "II", code, len(data)) + data + bytes(-len(data) % 8)


def by_hand(order: str) -> bytes:
    """A file of version 5 as its description tells (MAT-File Format, 2-byte order mark and all), of one variable."""
    labels = np.arange(6, dtype=order + "u2").reshape(2, 3)
    parts = (
        element(6, struct.pack(order + "II", 11, 0), order)  # flags: uint16
        + element(5, struct.pack(order + "ii", 2, 3), order)  # height, width
        + element(1, b"mask", order)
        + element(4, labels.T.tobytes(), order)  # column by column
    )
    head = b"MATLAB 5.0 MAT-file, by hand".ljust(124) + struct.pack(order + "HH", 0x0100, 0x4D49)
    return head + element(14, parts, order)


@pytest.mark.parametrize("order", ["<", ">"])
def test_both_byte_orders_are_read(tmp_path: Path, order: str) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(by_hand(order))
    assert is_mat(path.read_bytes()[:128])
    read = read_mat_masks(path)
    assert [mask.box_px[:2] for mask in read.masks] == [(1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    assert read.scores is None


def test_a_photo_without_fruit(tmp_path: Path) -> None:
    for empty in (np.zeros((1, 0)), np.zeros((0, 0)), np.zeros((0, 1))):
        assert read_mat_masks(write(tmp_path / "a.mat", mask=np.zeros((4, 5)), scores=empty)).masks == ()


@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({"mask": LABELS + 0.5}, "mask: expected whole numbers from 0 to 65535, found 0.5"),
        ({"mask": -LABELS.astype(float)}, "mask: expected whole numbers from 0 to 65535, found -1"),
        ({"mask": np.where(LABELS, np.nan, 1)}, "mask: expected whole numbers from 0 to 65535, found nan"),
        ({"mask": LABELS.astype(np.uint32) * 70000}, "mask: .* found 70000"),
        ({"mask": np.zeros((4, 5, 3))}, "mask: expected a label image of height × width numbers, found .* 4 × 5 × 3"),
        ({"mask": "apple"}, "mask: expected a label image"),
        ({"mask": {"a": 1}}, "mask: expected a label image"),
        ({"mask": scipy.sparse.csc_matrix(LABELS.astype(float))}, r"mask: .*sparse ones: give full\(mask\)"),
        ({"scores": SCORES[:3]}, "scores: expected one for each label up to 4, found 3"),
        ({"scores": SCORES * 2}, r"scores\(1\): expected a number from 0 to 1, found 1.8"),
        ({"scores": np.where(SCORES == 0.7, np.nan, SCORES)}, r"scores\(3\): .* found nan"),
        ({"scores": np.ones((2, 3))}, "scores: expected a row or a column of numbers, found .* 2 × 3"),
    ],
)
def test_wrong_variables_are_named(tmp_path: Path, variables: dict[str, Any], said: str) -> None:
    with pytest.raises(FormatError, match=rf"a\.mat: {said}"):
        read_mat_masks(write(tmp_path / "a.mat", **variables))


def test_wrong_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    with pytest.raises(MissingFileError, match="no such file"):
        read_mat_masks(path)
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n")
    with pytest.raises(FormatError, match=r"7\.3.*save it again with save\(file, 'mask', 'scores', '-v7'\)"):
        read_mat_masks(path)
    scipy.io.savemat(path, {"masks": LABELS})
    with pytest.raises(FormatError, match="no variable mask"):
        read_mat_masks(path)
    whole = write(path).read_bytes()
    for content in (b"", b"no", whole[:140], whole[:1000]):
        path.write_bytes(content)
        with pytest.raises(FormatError, match=r"a\.mat: expected a MATLAB file"):
            read_mat_masks(path)
