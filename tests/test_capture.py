"""Photos from folders: what is found, in which order, on which side, with what EXIF; and what is refused or skipped."""

from __future__ import annotations

import os
import shutil
import struct
import unicodedata
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any
from zlib import crc32

import cv2
import numpy as np
import pillow_heif
import pytest
from PIL import Image

from pomona.errors import InputError, LostFileError, MissingFileError
from pomona.progress import Silent
from pomona.stages.capture import load_photos, read_grey, read_pixels
from pomona.stages.capture.exif import Exif, focal_px, parse_exif
from pomona.stages.capture.files import list_photos, natural_key
from pomona.stages.capture.images import Header, read_header
from pomona.stages.capture.sensors import sensor_width_mm
from pomona.stages.capture.sides import sides_by_globs, sides_by_names
from pomona.values.photos import Photo

_DETAILS, _GPS = 0x8769, 0x8825


def painted(size: tuple[int, int], seed: int) -> Image.Image:
    """6 × 5 blocks of colour, each as large as the size allows."""
    blocks = np.random.default_rng(seed).integers(0, 255, (5, 6, 3), np.uint8)
    return Image.fromarray(blocks).resize(size, Image.Resampling.NEAREST)


def write_photo(
    path: Path,
    size: tuple[int, int] = (60, 40),
    *,
    seed: int | None = None,
    camera: str = "Canon EOS 60D",
    focal_mm: float | None = 24.0,
    orientation: int = 1,
    seconds: int | None = None,
    taken_px: tuple[int, int] | None = None,
) -> Path:
    """Write a photo of blocks of colour (None: those of its path) with EXIF, its format by its suffix."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image = painted(size, crc32(str(path).encode()) if seed is None else seed)
    exif = Image.Exif()
    exif[0x0112] = orientation
    if camera:
        exif[0x010F], exif[0x0110] = camera.split()[0], camera
    details = exif.get_ifd(_DETAILS)
    if focal_mm is not None:
        details[0x920A] = focal_mm
    if seconds is not None:
        details[0x9003] = f"2017:09:28 11:00:{seconds:02d}"
    if taken_px is not None:
        details[0xA002], details[0xA003] = taken_px
    image.save(path, exif=exif)
    return path


def test_headers_are_read_again_only_of_files_that_are_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []

    def reading(path: Path) -> Header:
        read.append(path.name)
        return read_header(path)

    monkeypatch.setattr("pomona.stages.capture.load.read_header", reading)
    for k in range(3):
        write_photo(tmp_path / f"IMG_{k}.jpg")
    (tmp_path / "IMG_8.jpg").write_bytes(b"no photo")
    first = load_photos([tmp_path])
    assert sorted(read) == ["IMG_0.jpg", "IMG_1.jpg", "IMG_2.jpg", "IMG_8.jpg"]
    read.clear()
    write_photo(tmp_path / "IMG_3.jpg")
    write_photo(tmp_path / "IMG_1.jpg", size=(200, 100))
    second = load_photos([tmp_path])
    assert {"IMG_1.jpg", "IMG_3.jpg"} <= set(read) <= {"IMG_1.jpg", "IMG_3.jpg", "IMG_8.jpg"}
    assert [photo.width_px for photo in second][1] == 200 != [photo.width_px for photo in first][1]
    assert [list(second)[k] for k in (0, 2)] == [list(first)[k] for k in (0, 2)]


def test_orders_photos_naturally_and_ignores_other_files(tmp_path: Path) -> None:
    for name in ("IMG_10.JPG", "IMG_9.jpeg", "img_11.Png", "IMG_2.tif"):
        write_photo(tmp_path / name)
    write_photo(tmp_path / ".hidden.jpg")
    (tmp_path / "notes.txt").write_text("no photo")
    (tmp_path / "markers.csv").write_text("id,x,y,z")
    photos = load_photos([tmp_path])
    assert photos.names == ("IMG_2.tif", "IMG_9.jpeg", "IMG_10.JPG", "img_11.Png")
    assert photos.sides == ("row",)
    assert not photos.from_video


def test_orders_photos_by_time_of_capture_where_all_have_one(tmp_path: Path) -> None:
    for name, seconds in (("a1.jpg", 3), ("a2.jpg", 1), ("a3.jpg", 2)):
        write_photo(tmp_path / name, seconds=seconds)
    photos = load_photos([tmp_path])
    assert photos.names == ("a2.jpg", "a3.jpg", "a1.jpg")
    assert photos.items[0].taken_at == datetime(2017, 9, 28, 11, 0, 1)


def test_two_folders_are_two_sides_and_give_names(tmp_path: Path) -> None:
    for side in ("east", "west"):
        for i in range(3):
            write_photo(tmp_path / side / f"IMG_{i}.jpg")
    together, apart = load_photos([tmp_path]), load_photos([tmp_path / "west", tmp_path / "east"])
    assert together.names[:2] == ("east/IMG_0.jpg", "east/IMG_1.jpg")
    assert together.sides == ("east", "west")
    assert set(apart.names) == set(together.names)
    assert apart.sides == ("west", "east")
    assert load_photos([tmp_path], sides="none").sides == ("row",)
    files = [tmp_path / side / f"IMG_{i}.jpg" for side in ("west", "east") for i in range(3)]
    progress = Silent()
    named = load_photos([*files, *files[:1]], progress=progress)  # as `east/*.jpg west/*.jpg` does
    assert (named.names, named.sides) == (apart.names, apart.sides)
    assert not progress.warnings


@pytest.mark.parametrize(
    ("folders", "told"),
    [
        (("east", "west"), False),
        (("Links", "Rechts"), False),
        (("lado izquierda", "lado derecha"), False),
        (("gauche", "droite"), False),
        (("fila7_sinistra", "fila7_destra"), False),
        (("Reihe 3 Ost", "Reihe 3 West"), False),
        (("monday", "tuesday"), True),
        (("originals", "edited"), True),
    ],
)
def test_what_was_taken_for_sides_is_said(tmp_path: Path, folders: tuple[str, str], told: bool) -> None:
    for k, side in enumerate(folders):
        for i in range(3):
            write_photo(tmp_path / side / f"IMG_{i}.jpg", seed=3 * k + i)
    progress = Silent()
    assert set(load_photos([tmp_path], progress=progress).sides) == set(folders)
    said = [warning for warning in progress.warnings if "taken as the two sides" in warning]
    assert len(said) == told
    assert all(f"'{folder}'" in warning for warning in said for folder in folders)
    assert all("taken as" not in warning for warning in _told([tmp_path / folder for folder in folders]))


def _told(sources: list[Path], **options: Any) -> list[str]:
    progress = Silent()
    load_photos(sources, progress=progress, **options)
    return progress.warnings


def test_words_for_sides_in_other_languages() -> None:
    for pair in (("links", "rechts"), ("izquierda", "derecha"), ("gauche", "droite"), ("sinistra", "destra")):
        names = [f"reihe3_{side}_{k}.jpg" for side in pair for k in range(3)]
        assert sides_by_names(names) == (pair[0],) * 3 + (pair[1],) * 3


def test_photos_further_down_are_found(tmp_path: Path) -> None:
    card, archive = tmp_path / "card", tmp_path / "archive"
    for i in range(3):
        write_photo(card / "DCIM" / "100CANON" / f"IMG_{i}.jpg", seed=i)
        for side in ("east", "west"):
            write_photo(archive / "2026" / "row7" / side / f"IMG_{i}.jpg", seed=i + 3 * (side == "west"))
    photos = load_photos([card])
    assert photos.sides == ("row",)
    assert photos.names[0] == "DCIM/100CANON/IMG_0.jpg"
    photos = load_photos([archive])
    assert photos.sides == ("east", "west")
    assert photos.names[0] == "2026/row7/east/IMG_0.jpg"
    # Two folders whose photos lie deeper still are the sides, and what is further down beside photos is not taken.
    both = tmp_path / "both"
    shutil.copytree(card, both / "left")
    shutil.copytree(archive / "2026" / "row7" / "west", both / "right" / "DCIM" / "101CANON")
    assert load_photos([both]).sides == ("left", "right")
    write_photo(both / "left" / "IMG_9.jpg", seed=9)
    assert load_photos([both], min_photos=1).names == ("left/IMG_9.jpg",)


def test_files_that_are_no_photos_among_those_named_are_left_out(tmp_path: Path) -> None:
    for i in range(3):
        write_photo(tmp_path / f"IMG_{i}.jpg", seed=i)
    (tmp_path / "notes.txt").write_text("windy")
    write_photo(tmp_path / "thumbs" / "IMG_0.jpg", seed=7)
    progress = Silent()
    assert len(load_photos(sorted(tmp_path.iterdir()), progress=progress)) == 3
    assert any("left out: notes.txt" in warning for warning in progress.warnings)
    assert any(warning.endswith("photos beside them: thumbs") for warning in progress.warnings)
    with pytest.raises(InputError, match=r"notes\.txt is neither a folder of photos nor a video"):
        load_photos([tmp_path / "notes.txt"])


def test_two_folders_of_one_name_are_told_apart_by_those_above(tmp_path: Path) -> None:
    for side in ("up", "down"):
        write_photo(tmp_path / side / "photos" / "1.jpg")
    assert load_photos([tmp_path / "up" / "photos", tmp_path / "down" / "photos"]).sides == ("up", "down")


@pytest.mark.parametrize(
    "folders",
    [("100CANON", "101CANON"), ("DJI_001", "DJI_002"), ("DJI_202405011010_001", "DJI_202405011032_002")],
)
def test_camera_folders_are_no_sides(tmp_path: Path, folders: tuple[str, str]) -> None:
    for folder in folders:
        write_photo(tmp_path / folder / "IMG_0001.jpg")
    photos = load_photos([tmp_path])
    assert photos.sides == ("row",)
    assert len(photos) == 2


def test_folders_of_a_drone_that_a_person_named_are_sides(tmp_path: Path) -> None:
    for folder in ("DJI_202405011010_001_east", "DJI_202405011032_002_west"):
        write_photo(tmp_path / folder / "DJI_0001.jpg")
    assert load_photos([tmp_path]).sides == ("DJI_202405011010_001_east", "DJI_202405011032_002_west")


@pytest.mark.parametrize(
    ("stems", "sides"),
    [
        (["east_0", "east_1", "east_2", "west_0", "west_1", "west_2"], ["east"] * 3 + ["west"] * 3),
        (["E1", "E2", "E3", "W1", "W2", "W3"], ["e"] * 3 + ["w"] * 3),
        (["row3-left-1", "row3-left-2", "row3-left-3", "row3-right-1", "row3-right-2", "row3-right-3"], None),
        (["A_1", "A_2", "A_3", "B_1", "B_2"], []),
        (["IMG_1", "IMG_2", "IMG_3", "DSC_1", "DSC_2", "DSC_3"], []),
        (["a1", "b1", "c1", "a2", "b2", "c2", "a3", "b3", "c3"], []),
        (["1", "2", "3", "4"], []),
    ],
)
def test_sides_by_names(stems: list[str], sides: list[str] | None) -> None:
    expected = ["left"] * 3 + ["right"] * 3 if sides is None else sides
    assert sides_by_names([f"{stem}.jpg" for stem in stems]) == (tuple(expected) or None)


def test_accents_are_letters_however_they_are_encoded() -> None:
    for form in ("NFC", "NFD"):
        names = [unicodedata.normalize(form, f"{side}_{k}.jpg") for side in ("Nord", "Süd") for k in range(3)]
        assert sides_by_names(names) == ("nord",) * 3 + ("süd",) * 3


def test_sub_folders_that_may_not_be_read_are_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for i in range(2):
        write_photo(tmp_path / f"{i}.jpg", (60, 40), seed=i)
    (tmp_path / "lost+found").mkdir()
    real, real_stat = os.scandir, Path.stat

    def scandir(path: Path) -> Iterator[os.DirEntry[str]]:
        if Path(path).name == "lost+found":
            raise PermissionError(13, "Permission denied", str(path))
        return real(path)

    def stat(path: Path, **how: bool) -> os.stat_result:
        if path.parent.name == "lost+found":  # nor may it be asked what is in it
            raise PermissionError(13, "Permission denied", str(path))
        return real_stat(path, **how)

    monkeypatch.setattr(os, "scandir", scandir)
    monkeypatch.setattr(Path, "stat", stat)
    assert load_photos([tmp_path]).names == ("0.jpg", "1.jpg")
    (tmp_path / "east").mkdir()
    for i in range(2):
        (tmp_path / f"{i}.jpg").rename(tmp_path / "east" / f"{i}.jpg")
    assert load_photos([tmp_path]).names == ("east/0.jpg", "east/1.jpg")


def test_each_folder_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("row/7/east/IMG_0.jpg", "row/7/east/more/IMG_2.jpg", "row/7/west/DCIM/100CANON/IMG_1.jpg"):
        write_photo(tmp_path / name)
    read = Counter[str]()
    for name in ("listdir", "scandir"):
        real = getattr(os, name)

        def counted(path: Path, real: Any = real) -> Any:
            read[Path(path).name] += 1
            return real(path)

        monkeypatch.setattr(os, name, counted)
    assert len(list_photos(tmp_path / "row").files) == 1
    assert read == Counter(["row", "7", "east", "more", "west", "DCIM", "100CANON"])


def test_sides_by_globs_take_their_literal_names() -> None:
    names = ["photos/E_1.JPG", "photos/E_2.JPG", "photos/w_1.JPG"]
    assert sides_by_globs(names, "E_*.jpg, W_*") == ("E", "E", "W")
    assert sides_by_globs(names, "*/e*,*/w*") == ("e", "e", "w")


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("both", "expected auto, none"),
        ("east", "expected auto, none"),
        ("a*,b*,c*", "expected auto, none"),
        ("IMG_0*,DSC*", "matches neither pattern"),
        ("IMG*,*_1*", "matches both patterns"),
    ],
)
def test_sides_option_that_does_not_fit_is_refused(tmp_path: Path, option: str, said: str) -> None:
    for i in range(3):
        write_photo(tmp_path / f"IMG_{i + 1}.jpg", seed=i)
    with pytest.raises(InputError, match=said):
        load_photos([tmp_path], sides=option)


def test_empty_folder_says_what_was_looked_for_and_found(tmp_path: Path) -> None:
    (tmp_path / "readme.txt").write_text("empty")
    with pytest.raises(InputError, match=r"holds no photo: looked for JPEG.*found 1 × \.txt"):
        load_photos([tmp_path])
    (tmp_path / "IMG_1.CR2").write_bytes(b"raw")
    with pytest.raises(InputError, match="export them as JPEG"):
        load_photos([tmp_path])


@pytest.mark.parametrize(
    ("file", "advice"), [("DCIM/100CANON/IMG_1.CR3", "export them as JPEG"), ("100GOPRO/G1.MP4", "the video file")]
)
def test_a_card_without_photos_says_what_was_found_in_its_folders(tmp_path: Path, file: str, advice: str) -> None:
    (tmp_path / file).parent.mkdir(parents=True)
    (tmp_path / file).write_bytes(b"no photo")
    with pytest.raises(InputError, match=rf"found 1 × {Path(file).suffix.lower()}\. .*{advice}"):
        load_photos([tmp_path])


def test_photos_and_videos_that_are_left_out_are_told_of(tmp_path: Path) -> None:
    def said(folder: Path) -> list[str]:
        progress = Silent()
        assert {name.rpartition("/")[0] for name in load_photos([folder], progress=progress).names} <= {"", "east"}
        return [warning.replace(f"{folder}", "") for warning in progress.warnings if "left out" in warning]

    for folder in (tmp_path / "flat", tmp_path / "card" / "east", tmp_path / "raw" / "east", tmp_path / "pairs"):
        for i in range(3):
            write_photo(folder / f"IMG_{i}.jpg", (60, 40), seed=i)
    assert said(tmp_path / "flat") == said(tmp_path / "card") == []
    # The other side, in folders that a camera made; and below a folder that has photos itself.
    write_photo(tmp_path / "card" / "west" / "100CANON" / "IMG_7.jpg", (60, 40), seed=7)
    (card,) = said(tmp_path / "card")
    assert "photos further down, in folders of west, were left out, as there are photos in east" in card
    shutil.copytree(tmp_path / "card" / "west", tmp_path / "flat" / "west")
    assert said(tmp_path / "flat") == [": photos in sub-folders (west) were left out, as there are photos beside them"]
    # The other side, or more of this one, in what is no photo.
    (tmp_path / "raw" / "west").mkdir()
    (tmp_path / "raw" / "west" / "IMG_7.CR2").write_bytes(b"raw")
    (tmp_path / "raw" / "east" / "VID_1.MP4").write_bytes(b"video")
    assert said(tmp_path / "raw") == [
        "/east: 1 video left out, such as VID_1.MP4, as photos are used where there are some; a video is given by "
        "itself",
        "/west: 1 camera RAW file left out, such as IMG_7.CR2: export them as JPEG",
    ]
    # Those of a photo are no others, nor are the small pictures that disks make of photos.
    for name in ("IMG_0.CR2", "IMG_1.MOV"):
        (tmp_path / "pairs" / name).write_bytes(b"of a photo")
    write_photo(tmp_path / "pairs" / "@eaDir" / "IMG_0.jpg" / "SYNOPHOTO_THUMB_M.jpg", (60, 40), seed=9)
    assert said(tmp_path / "pairs") == []


def test_photos_that_are_links_to_nowhere_are_told_of(tmp_path: Path) -> None:
    for side in ("east", "west"):
        (tmp_path / "row" / side).mkdir(parents=True)
        (tmp_path / "row" / side / "lost.jpg").symlink_to(tmp_path / "away" / "IMG_1.jpg")
        for i in range(2):
            write_photo(tmp_path / "row" / side / f"{i}.jpg", (60, 40), seed=i)
    progress = Silent()
    assert len(load_photos([tmp_path / "row" / "east"], progress=progress)) == 2
    (said,) = [warning for warning in progress.warnings if "left out" in warning]
    assert "east: 1 photo left out, such as lost.jpg: the name links to a file that is not there" in said
    for i in range(2):
        (tmp_path / "row" / "west" / f"{i}.jpg").unlink()
    progress = Silent()
    assert len(load_photos([tmp_path / "row"], progress=progress)) == 2
    assert any("west: 1 photo left out, such as lost.jpg" in warning for warning in progress.warnings)
    with pytest.raises(InputError, match=r"west: 1 photo left out, such as lost\.jpg"):
        load_photos([tmp_path / "row" / "west"])


def test_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="nowhere does not exist"):
        load_photos([tmp_path / "nowhere"])


def test_one_photo_is_too_few_unless_allowed(tmp_path: Path) -> None:
    path = write_photo(tmp_path / "IMG_1.jpg")
    with pytest.raises(InputError, match=r"found 1 photo that can be used, expected at least 2 .*3 or more"):
        load_photos([tmp_path])
    assert len(load_photos([tmp_path], min_photos=1)) == 1
    assert len(load_photos([path], min_photos=1)) == 1


def test_damaged_files_are_skipped_named_and_warned_of(tmp_path: Path) -> None:
    for i in range(3):
        write_photo(tmp_path / f"good_{i}.jpg", (600, 400), seed=i)
    whole = (tmp_path / "good_0.jpg").read_bytes()
    (tmp_path / "cut.jpg").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "zeros.jpg").write_bytes(whole[: len(whole) // 2] + bytes(len(whole) // 2))
    (tmp_path / "text.jpg").write_text("this is not a photo")
    (tmp_path / "nothing.jpg").touch()
    progress = Silent()
    photos = load_photos([tmp_path], progress=progress)
    assert photos.names == ("good_0.jpg", "good_1.jpg", "good_2.jpg")
    reasons = {skipped.name: skipped.reason for skipped in photos.skipped}
    assert set(reasons) == {"cut.jpg", "zeros.jpg", "text.jpg", "nothing.jpg"}
    assert "truncated" in reasons["cut.jpg"]
    assert "truncated" in reasons["zeros.jpg"]
    assert "0 bytes" in reasons["nothing.jpg"]
    assert any("4 files could not be used" in warning and "cut.jpg" in warning for warning in progress.warnings)


@pytest.mark.parametrize("suffix", ["png", "tif", "heic"])
def test_truncation_is_told_in_other_formats(tmp_path: Path, suffix: str) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    for i in range(2):
        _save(Image.fromarray(pixels + np.uint8(i)), tmp_path / f"good{i}.{suffix}")
    whole = (tmp_path / f"good0.{suffix}").read_bytes()
    (tmp_path / f"cut.{suffix}").write_bytes(whole[: int(len(whole) * 0.8)])
    photos = load_photos([tmp_path])
    assert len(photos) == 2
    assert [skipped.name for skipped in photos.skipped] == [f"cut.{suffix}"]


def test_data_after_the_end_of_a_jpeg_is_no_damage(tmp_path: Path) -> None:
    for i in range(2):
        path = write_photo(tmp_path / f"{i}.jpg", (300, 200), seed=i)
        path.write_bytes(path.read_bytes() + b"a second image, or a video" * 50)
    assert len(load_photos([tmp_path])) == 2


def test_copies_of_photos_are_left_out(tmp_path: Path) -> None:
    for i in range(4):
        write_photo(tmp_path / f"{i}.jpg", seed=i)
    shutil.copy(tmp_path / "1.jpg", tmp_path / "1 (copy).jpg")
    (tmp_path / "3.jpg").write_bytes(
        (tmp_path / "2.jpg").read_bytes().replace(b"Canon", b"Canom")
    )  # of one size, and another
    progress = Silent()
    photos = load_photos([tmp_path], leave_out_copies=True, progress=progress)
    kept = set(photos.names)
    assert {"0.jpg", "2.jpg", "3.jpg"} < kept
    assert len(kept & {"1.jpg", "1 (copy).jpg"}) == 1
    (skipped,) = photos.skipped
    assert skipped.reason == f"a copy of {next(iter(kept & {'1.jpg', '1 (copy).jpg'}))}"
    assert any("a copy of" in warning for warning in progress.warnings)
    shutil.copy(tmp_path / "0.jpg", tmp_path / "00.jpg")
    with pytest.raises(InputError, match=r"found 1 photo .*00\.jpg: a copy of 0\.jpg|0\.jpg: a copy of 00\.jpg"):
        load_photos([tmp_path / "0.jpg", tmp_path / "00.jpg"], leave_out_copies=True)
    assert len(load_photos([tmp_path])) == 6  # whoever looks for photos by name finds all


def test_copies_in_another_format_are_left_out(tmp_path: Path) -> None:
    """A phone's HEIC photos beside the JPEGs made of them; and what has the same name, and is another photo."""
    for i in range(3):
        for suffix in ("heic", "jpg"):
            write_photo(tmp_path / f"IMG_{i}.{suffix}", seed=i, seconds=i)
    write_photo(tmp_path / "IMG_3.heic", seed=3, seconds=3)
    write_photo(tmp_path / "IMG_3.jpg", seed=4, seconds=40)  # of another camera
    for suffix in ("png", "JPG"):  # times are not known
        write_photo(tmp_path / f"a.{suffix}", (120, 80), seed=5, camera="", focal_mm=None)
    write_photo(tmp_path / "b.png", (120, 80), seed=6, camera="", focal_mm=None)
    write_photo(tmp_path / "b.jpg", (120, 80), seed=7, camera="", focal_mm=None)
    write_photo(tmp_path / "c.jpg", (120, 80), seed=8, seconds=8)
    write_photo(tmp_path / "c.png", (80, 80), seed=8, seconds=8)  # a part of it
    progress = Silent()
    photos = load_photos([tmp_path], leave_out_copies=True, progress=progress)
    kept = {"IMG_0.jpg", "IMG_1.jpg", "IMG_2.jpg", "IMG_3.heic", "IMG_3.jpg", "a.JPG"}
    assert set(photos.names) == kept | {"b.png", "b.jpg", "c.jpg", "c.png"}
    assert {skipped.name: skipped.reason for skipped in photos.skipped} == {
        **{f"IMG_{i}.heic": f"a copy of IMG_{i}.jpg" for i in range(3)},
        "a.png": "a copy of a.JPG",
    }
    assert any("a copy of" in warning for warning in progress.warnings)
    assert len(load_photos([tmp_path])) == 14


def test_mixed_cameras_sizes_and_missing_exif_are_warned_of_once(tmp_path: Path) -> None:
    write_photo(tmp_path / "1.jpg", seed=1)
    write_photo(tmp_path / "2.jpg", seed=2, focal_mm=35.0)
    write_photo(tmp_path / "3.jpg", (90, 60), seed=3, camera="NIKON D750")
    write_photo(tmp_path / "4.jpg", seed=4, camera="", focal_mm=None)
    write_photo(tmp_path / "5.jpg", seed=5, camera="", focal_mm=None)
    write_photo(tmp_path / "6.jpg", seed=6, camera="", focal_mm=None)
    progress = Silent()
    photos = load_photos([tmp_path], progress=progress)
    assert len({photo.camera_key for photo in photos}) == 4
    assert [photo.focal_px is None for photo in photos] == [False, False, False, True, True, True]
    for said in ("4 cameras or zooms", "3 of 6 photos say nothing of their focal length", "different sizes"):
        assert sum(said in warning for warning in progress.warnings) == 1


def test_cropped_photos_are_named_and_resized_ones_are_not(tmp_path: Path) -> None:
    write_photo(tmp_path / "cropped.jpg", (84, 78), seed=1, taken_px=(4000, 3000))
    write_photo(tmp_path / "resized.jpg", (80, 60), seed=2, taken_px=(4000, 3000))
    write_photo(tmp_path / "upright.jpg", (60, 80), seed=3, taken_px=(4000, 3000))
    progress = Silent()
    photos = load_photos([tmp_path], progress=progress).by_name()
    (said,) = [warning for warning in progress.warnings if "cropped" in warning]
    assert "cropped.jpg" in said
    assert "resized.jpg" not in said
    assert "upright.jpg" not in said
    # EXIF's focal length is of the whole photo: it does not hold for a part.
    assert [photos[name].focal_px is None for name in ("cropped.jpg", "resized.jpg", "upright.jpg")] == [True, 0, 0]


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", ["jpg", "png", "tif"])
def test_pixels_are_upright_at_any_size(tmp_path: Path, orientation: int, suffix: str) -> None:
    write_photo(tmp_path / f"0.{suffix}", (96, 80), seed=3, orientation=orientation, camera="")
    photo = load_photos([tmp_path], min_photos=1).items[0]
    # Each orientation by EXIF's own words: where the stored first row and first column are in the upright photo.
    turn = {
        1: lambda a: a, 2: lambda a: a[:, ::-1], 3: lambda a: a[::-1, ::-1], 4: lambda a: a[::-1],
        5: lambda a: a.transpose(1, 0, 2), 6: lambda a: np.rot90(a, -1),
        7: lambda a: np.rot90(a, -1)[::-1], 8: np.rot90,
    }[orientation]  # fmt: skip
    expected = turn(np.asarray(painted((96, 80), 3)))
    assert (photo.width_px, photo.height_px) == ((96, 80) if orientation < 5 else (80, 96))
    # Other programs read it as it is stored: cameras are exchanged with them by this.
    assert photo.orientation == orientation
    # JPEG blurs the borders of the blocks; a turn too many or too few is some 80 grey values.
    assert np.abs(read_pixels(photo).astype(int) - expected).mean() <= (12 if suffix == "jpg" else 0)
    for side_px in (None, 24):
        grey, seen = read_grey(photo, max_side_px=side_px), read_pixels(photo, max_side_px=side_px)
        assert grey.shape == seen.shape[:2]
        apart = np.abs(grey - seen @ [0.299, 0.587, 0.114])
        assert apart.mean() < 1
        assert apart.max() < 12  # of vivid colours a channel is cut off
    small = read_pixels(photo, max_side_px=24)
    assert small.shape == ((20, 24, 3) if orientation < 5 else (24, 20, 3))
    # Each block of colour spans four pixels of the small photo: its inner pixels keep the colour.
    full = Image.fromarray(np.ascontiguousarray(expected))
    oracle = np.asarray(full.resize(small.shape[1::-1], Image.Resampling.BOX), float)
    assert np.abs(small.astype(float) - oracle).mean() < 6.0


def test_heic_is_read_upright_with_its_exif(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112], exif[0x010F], exif[0x0110] = 6, "Apple", "iPhone 12"
    exif.get_ifd(_DETAILS)[0xA405] = 26
    ramp = np.repeat(np.linspace(0, 255, 64).astype(np.uint8)[None, :, None], 48, axis=0).repeat(3, axis=2)
    _save(Image.fromarray(ramp), tmp_path / "0.HEIC", exif=exif.tobytes())
    photo = load_photos([tmp_path], min_photos=1).items[0]
    assert (photo.width_px, photo.height_px) == (48, 64)
    pixels = read_pixels(photo).astype(int)
    assert pixels.shape == (64, 48, 3)
    assert pixels[-1].mean() - pixels[0].mean() > 200
    assert photo.focal_px == pytest.approx(26 / 43.267 * 80, rel=1e-3)


def test_16_bit_grey_becomes_8_bit_colour(tmp_path: Path) -> None:
    grey = np.linspace(0, 65535, 64 * 64).reshape(64, 64).astype(np.uint16)
    Image.fromarray(grey).save(tmp_path / "0.tif")
    pixels = read_pixels(load_photos([tmp_path], min_photos=1).items[0])
    assert pixels.shape == (64, 64, 3)
    assert np.array_equal(pixels[:, :, 0], grey >> 8)


@pytest.mark.parametrize(
    ("kind", "brightest", "expected"), [(np.uint16, 4095, 255), (np.uint16, 1023, 255), (np.float32, 1.0, 255)]
)
def test_grey_of_other_depths_is_as_bright(tmp_path: Path, kind: type, brightest: float, expected: int) -> None:
    grey = np.linspace(0, brightest, 64 * 64).reshape(64, 64).astype(kind)
    Image.fromarray(grey).save(tmp_path / "0.tif")
    pixels = read_pixels(load_photos([tmp_path], min_photos=1).items[0])[:, :, 0].astype(int)
    assert pixels.min() == 0
    assert pixels.max() == expected
    assert np.abs(pixels - np.linspace(0, 255, 64 * 64).reshape(64, 64)).max() <= 1


def _deep_photo(path: Path, rgb: np.ndarray[Any, Any]) -> Photo:
    """Write a photo of 16 bits a channel, which OpenCV can and Pillow cannot."""
    cv2.imwrite(str(path), rgb[..., ::-1])
    return load_photos([path.parent], min_photos=1).items[0]


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("bits", [10, 12, 16])
def test_colours_of_other_depths_are_as_bright_at_every_size(tmp_path: Path, suffix: str, bits: int) -> None:
    true = np.asarray(painted((200, 120), seed=3)).copy()
    true[0, 0] = 255
    photo = _deep_photo(tmp_path / f"0.{suffix}", true.astype(np.uint16) << (bits - 8))
    assert np.array_equal(read_pixels(photo), true)
    assert np.array_equal(read_grey(photo), cv2.cvtColor(true, cv2.COLOR_RGB2GRAY))
    small = cv2.resize(true, (50, 30), interpolation=cv2.INTER_AREA)
    assert np.array_equal(read_pixels(photo, max_side_px=50), small)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_deep_photos_are_upright(tmp_path: Path, orientation: int) -> None:
    true = np.asarray(painted((60, 40), seed=4))
    (tmp_path / "8").mkdir()
    write_photo(tmp_path / "8" / "0.tif", (60, 40), seed=4, orientation=orientation)
    stored = _deep_photo(tmp_path / "0.tif", true.astype(np.uint16) << 4).path
    # The tag of one plane for all colours, as is usual, becomes that of the orientation.
    planes, turned = (struct.pack("<HHIHH", tag, 3, 1, value, 0) for tag, value in ((284, 1), (274, orientation)))
    stored.write_bytes(stored.read_bytes().replace(planes, turned))
    deep, plain = (load_photos([folder], min_photos=1).items[0] for folder in (tmp_path, tmp_path / "8"))
    assert deep.orientation == orientation
    assert np.array_equal(read_pixels(deep), read_pixels(plain))


def test_transparency_of_deep_photos_is_dropped(tmp_path: Path) -> None:
    true = np.asarray(painted((60, 40), seed=4)).astype(np.uint16) << 4
    see_through = np.dstack([np.full((40, 60), 2000, np.uint16), true])  # written the other way round: ABGR is BGRA
    assert np.array_equal(read_pixels(_deep_photo(tmp_path / "0.png", see_through)), true >> 4)


@pytest.mark.parametrize("brightest", [0, 2**14 - 1])
def test_dark_photos_stay_dark(tmp_path: Path, brightest: int) -> None:
    deep = np.linspace(0, brightest, 40 * 60 * 3).reshape(40, 60, 3).astype(np.uint16)
    assert np.array_equal(read_pixels(_deep_photo(tmp_path / "0.tif", deep)), deep >> 8)
    black = np.full((40, 60, 3), 3, np.uint8)
    assert np.array_equal(read_pixels(_deep_photo(tmp_path / "0.tif", black)), black)


def test_a_file_that_breaks_after_loading_is_named(tmp_path: Path) -> None:
    for i in range(2):
        write_photo(tmp_path / f"{i}.jpg", (300, 200), seed=i)
    photos = load_photos([tmp_path])
    whole = photos.items[0].path.read_bytes()
    photos.items[0].path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(LostFileError, match=r"0\.jpg was changed while it was worked with"):
        read_pixels(photos.items[0])
    with pytest.raises(InputError, match=r"0\.jpg.*cannot be decoded"):
        read_pixels(replace(photos.items[0], file_state=None))
    photos.items[1].path.unlink()
    with pytest.raises(LostFileError, match=r"1\.jpg was there and is gone"):
        read_pixels(photos.items[1])
    with pytest.raises(MissingFileError, match=r"1\.jpg does not exist"):
        read_pixels(replace(photos.items[1], file_state=None))
    with pytest.raises(InputError, match="max_side_px"):
        read_pixels(photos.items[0], max_side_px=0)


def test_natural_key_counts_as_people_do() -> None:
    assert sorted(["b2", "b10", "B1", "a"], key=natural_key) == ["a", "B1", "b2", "b10"]


@pytest.mark.parametrize(
    ("exif", "size", "expected"),
    [
        # A known sensor: 24 mm on 22.3 mm, at the size the photo has now.
        (Exif(make="Canon", model="Canon EOS 60D", focal_mm=24.0, focal_35mm=38), (864, 1296), 24 / 22.3 * 1296),
        # 35 mm equivalents are by the diagonal: 3:2, and a phone's 4:3.
        (Exif(focal_35mm=36.0), (3000, 2000), 3000.0),
        (Exif(focal_35mm=26.0), (4032, 3024), 26 / 43.2666 * 5040),
        # The camera's own sensor width.
        (Exif(focal_mm=10.0, plane_width_mm=20.0), (4000, 3000), 2000.0),
        # The camera's own before what is usual in its family, unless the photo was made smaller.
        (Exif(make="Canon", model="Canon PowerShot V10", focal_mm=6.5, plane_width_mm=13.1), (4000, 3000), 1984.73),
        (Exif(make="Canon", model="Canon PowerShot A640", focal_mm=7.3, plane_width_mm=7.2), (4000, 3000), 4055.56),
        (Exif(make="Canon", model="Canon PowerShot A550", focal_mm=5.8, plane_width_mm=5.76), (3000, 2000), 3020.83),
        (Exif(make="Canon", model="Canon PowerShot SX260 HS", focal_mm=4.5), (4000, 3000), 4.5 / 6.17 * 4000),
        (Exif(make="Canon", model="Canon PowerShot SX260 HS", focal_mm=4.5, plane_width_mm=4.6), (3000, 2250), 2188.01),
        # A known camera's sensor before what it writes: the EOS 6D Mark II writes nonsense.
        (Exif(make="Canon", model="Canon EOS 6D Mark II", focal_mm=24.0, plane_width_mm=23.7), (6240, 4160), 4160.0),
        # Digital zoom: the equivalent knows of it, the sensor's width does not.
        (Exif(make="Canon", model="Canon EOS 60D", focal_mm=24.0, focal_35mm=76), (3000, 2000), 76 / 36 * 3000),
        # 16:9 of a sensor of 4:3: the equivalent may be of its whole diagonal (8 % off), its width is right.
        (Exif(make="Apple", model="iPhone 12", focal_mm=4.2, focal_35mm=26), (4032, 2268), 4.2 / 5.64 * 4032),
        (Exif(focal_mm=4.2, plane_width_mm=5.64, focal_35mm=26), (2268, 4032), 4.2 / 5.64 * 4032),
        (Exif(make="Unheard", model="Of", focal_mm=24.0), (3000, 2000), None),
        (Exif(), (3000, 2000), None),
        # What stands for a lens that is not known.
        (Exif(focal_35mm=65535), (3000, 2000), None),
        (Exif(focal_35mm=1), (3000, 2000), None),
        (Exif(make="Canon", model="Canon EOS 60D", focal_mm=4294967295.0), (3000, 2000), None),
        (Exif(make="Canon", model="Canon EOS 60D", focal_mm=24.0, focal_35mm=65535), (3000, 2000), 24 / 22.3 * 3000),
    ],
)  # fmt: skip
def test_focal_length(exif: Exif, size: tuple[int, int], expected: float | None) -> None:
    found = focal_px(exif, *size)
    assert found is None if expected is None else found is not None and found[0] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("exif", "share"),
    [
        # Whole millimetres are uniform over one: 1 / sqrt(12) / 26 = 1.11 %; and 1 % for a lens that is nominal.
        (Exif(focal_35mm=26.0), 0.01495),
        (Exif(focal_35mm=100.0), 0.01041),
        (Exif(make="Canon", model="Canon EOS 60D", focal_mm=24.0), 0.01565),
        # Tenths and hundredths say more.
        (Exif(focal_mm=5.4, plane_width_mm=6.4), 0.01134),
        (Exif(focal_mm=4.25, plane_width_mm=5.64), 0.01002),
    ],
)  # fmt: skip
def test_focal_lengths_are_as_exact_as_they_were_written(exif: Exif, share: float) -> None:
    found = focal_px(exif, 4000, 3000)
    assert found is not None
    assert found[1] / found[0] == pytest.approx(share, rel=2e-3)


@pytest.mark.parametrize(
    ("make", "model", "width_mm"),
    [
        ("Canon", "Canon EOS 60D", 22.3),
        ("Canon", "Canon EOS 5D Mark III", 36.0),
        ("NIKON CORPORATION", "NIKON D750", 35.9),
        ("NIKON CORPORATION", "NIKON D7500", 23.5),
        ("SONY", "ILCE-7M3", 35.8),
        ("SONY", "ILCE-6000", 23.5),
        ("DJI", "FC6310", 13.2),
        ("Canon", "Canon PowerShot G1 X", 18.7),
        ("Canon", "Canon PowerShot G1 X Mark II", 18.7),
        ("Canon", "Canon PowerShot G1 X Mark III", 22.3),
        ("Canon", "Canon PowerShot G3 X", 13.2),
        ("Canon", "Canon PowerShot G9 X Mark II", 13.2),
        ("Canon", "Canon PowerShot G9", 7.44),
        ("Canon", "Canon PowerShot G12", 7.44),
        ("Canon", "Canon PowerShot G16", 7.44),
        ("Canon", "Canon PowerShot S120", 7.44),
        ("Canon", "Canon PowerShot SX260 HS", None),
        ("SONY", "DSC-RX1", 35.8),
        ("SONY", "DSC-RX1RM2", 35.8),
        ("SONY", "DSC-RX100", 13.2),
        ("SONY", "DSC-RX100M3", 13.2),
        ("SONY", "DSC-RX10M4", 13.2),
        ("Canon", "Canon EOS R6m2", 36.0),
        ("Canon", "Canon EOS R10", 22.3),
        ("Canon", "Canon EOS M50m2", 22.3),
        ("NIKON CORPORATION", "NIKON Z 6_2", 35.9),
        ("NIKON CORPORATION", "NIKON Z6_3", 35.9),
        ("NIKON CORPORATION", "NIKON Z f", 35.9),
        ("NIKON CORPORATION", "NIKON Z fc", 23.5),
        ("NIKON CORPORATION", "NIKON Z 50", 23.5),
        ("NIKON CORPORATION", "NIKON D90", 23.5),
        ("NIKON CORPORATION", "NIKON D300S", 23.5),
        ("NIKON CORPORATION", "NIKON D4S", 35.9),
        ("NIKON CORPORATION", "NIKON D600", 35.9),
        ("SONY", "SLT-A99V", 35.8),
        ("SONY", "SLT-A77V", 23.5),
        ("SONY", "ZV-E1", 35.8),
        ("SONY", "ZV-E10", 23.5),
        ("FUJIFILM", "X-S1", 8.8),
        ("FUJIFILM", "X-S10", 23.5),
        ("FUJIFILM", "X100V", 23.5),
        ("OLYMPUS CORPORATION", "E-M10MarkII", 17.3),
        ("OLYMPUS IMAGING CORP.", "FE-100,X-710", None),
        ("DJI", "ZenmuseP1", 35.9),
        ("DJI", "M3E", 17.3),
        ("DJI", "M3T", None),
        ("", "", None),
    ],
)
def test_sensor_table(make: str, model: str, width_mm: float | None) -> None:
    assert sensor_width_mm(make, model) == width_mm


@pytest.mark.parametrize(
    ("make", "model", "focal_mm", "focal_35mm", "size"),
    [
        ("DJI", "FC220", 4.73, 26, (4000, 3000)),
        ("DJI", "FC330", 3.61, 20, (4000, 3000)),
        ("DJI", "FC3170", 4.5, 24, (4000, 3000)),
        ("DJI", "FC3411", 8.38, 22, (5472, 3648)),
        ("DJI", "FC3582", 6.72, 24, (4032, 3024)),
        ("DJI", "FC6310", 8.8, 24, (5472, 3648)),
        ("DJI", "FC6360", 5.74, 40, (1600, 1300)),
        ("DJI", "FC7303", 4.49, 24, (4000, 3000)),
        ("DJI", "FC8482", 6.72, 24, (4032, 3024)),
        ("Hasselblad", "L1D-20c", 10.26, 28, (5472, 3648)),
        ("Hasselblad", "L2D-20c", 12.29, 24, (5280, 3956)),
        ("Apple", "iPhone 5", 4.12, 33, (3264, 2448)),
        ("Apple", "iPhone 7", 3.99, 28, (4032, 3024)),
        ("Apple", "iPhone SE (2nd generation)", 3.99, 28, (4032, 3024)),
        ("Apple", "iPhone X", 4.0, 28, (4032, 3024)),
        ("Apple", "iPhone XS Max", 4.25, 26, (4032, 3024)),
        ("Apple", "iPhone 11 Pro", 4.25, 26, (4032, 3024)),
        ("Apple", "iPhone 12 Pro", 4.2, 26, (4032, 3024)),
        ("Apple", "iPhone 12 Pro Max", 5.1, 26, (4032, 3024)),
        ("Apple", "iPhone 13", 5.1, 26, (4032, 3024)),
        ("Apple", "iPhone 13 Pro", 5.7, 26, (4032, 3024)),
        ("Apple", "iPhone 14", 5.7, 26, (4032, 3024)),
        ("Apple", "iPhone 14 Pro", 6.86, 24, (4032, 3024)),
        ("Apple", "iPhone 15", 5.96, 26, (5712, 4284)),
        ("Apple", "iPhone 16 Pro Max", 6.765, 24, (5712, 4284)),
        ("Google", "Pixel 2", 4.442, 27, (4032, 3024)),
        ("Google", "Pixel 6a", 4.38, 27, (4032, 3024)),
        ("Google", "Pixel 7 Pro", 6.81, 24, (4080, 3072)),
        ("Google", "Pixel 8", 6.9, 25, (4080, 3072)),
        ("samsung", "SM-G920F", 4.3, 28, (5312, 2988)),
        ("samsung", "SM-G973F", 4.3, 26, (4032, 3024)),
        ("samsung", "SM-G981B", 5.4, 26, (4032, 3024)),
        ("samsung", "SM-G991B", 5.4, 26, (4032, 3024)),
        ("samsung", "SM-G998B", 6.7, 24, (4000, 3000)),
        ("samsung", "SM-S901B", 5.4, 23, (4000, 3000)),
        ("samsung", "SM-S918B", 6.3, 23, (4000, 3000)),
        ("samsung", "Galaxy S24 Ultra", 6.3, 23, (4000, 3000)),
    ],
)
def test_sensors_agree_with_what_cameras_write_themselves(
    make: str, model: str, focal_mm: float, focal_35mm: float, size: tuple[int, int]
) -> None:
    # Equivalents are rounded to whole millimetres (2 % of 24) and follow a diagonal that makers round, too.
    by_table = focal_px(Exif(make=make, model=model, focal_mm=focal_mm), *size)
    by_equivalent = focal_px(Exif(focal_35mm=focal_35mm), *size)
    assert by_table is not None
    assert by_equivalent is not None
    assert by_table[0] == pytest.approx(by_equivalent[0], rel=0.06)


def test_exif_nonsense_is_ignored() -> None:
    details = {0x920A: "no number", 0xA405: 0, 0x9003: "0000:00:00 00:00:00", 0xA20E: float("nan")}
    gps = {1: "N", 2: (0.0, 0.0, 0.0), 3: "E", 4: (0.0, 0.0, 0.0)}
    exif = parse_exif({0x0112: 77, 0x010F: None}, details, gps)
    assert exif == Exif()
    odd = {0x9003: "2017:09:28 11:02:03", 0x9291: "\N{SUPERSCRIPT TWO}"}
    assert parse_exif({}, odd, {}).taken_at == datetime(2017, 9, 28, 11, 2, 3)
    last = {0x9003: "9999:12:31 23:59:59", 0x9291: "9" * 30}  # rounded up, there would be no such day
    assert parse_exif({}, last, {}).taken_at == datetime(9999, 12, 31, 23, 59, 59, 999999)
    far = parse_exif({}, {}, {1: "N", 2: (41.0, 0.0, 0.0), 3: "E", 4: (1.0, 0.0, 0.0), 6: 4294967295.0}).gnss
    assert far is not None
    assert far.altitude_m is None


def test_exif_position_and_time() -> None:
    gps = {1: "S", 2: (41.0, 30.0, 36.0), 3: "W", 4: (0.0, 52.0, 12.0), 5: b"\0", 6: 212.5}
    details = {0x9003: "2017:09:28 11:02:03", 0x9291: "25", 0xA002: 4000, 0xA003: 3000, 0xA20E: 2000.0, 0xA20F: 2000.0}
    exif = parse_exif({}, details | {0xA210: 3}, gps)
    assert exif.gnss is not None
    assert exif.gnss.latitude_deg == pytest.approx(-41.51)
    assert exif.gnss.longitude_deg == pytest.approx(-0.87)
    assert exif.gnss.altitude_m == 212.5
    assert exif.taken_at == datetime(2017, 9, 28, 11, 2, 3, 250000)
    assert exif.plane_width_mm == pytest.approx(20.0)
    for resolution in (12000.0, 600.0):  # per cm: sensors of 3 and 67 mm
        assert parse_exif({}, details | {0xA210: 3, 0xA20E: resolution, 0xA20F: resolution}, {}).plane_width_mm is None


@pytest.mark.parametrize(
    ("reference", "altitude_m"),
    [(None, 212.5), (0, 212.5), (b"\0", 212.5), (1, -212.5), (b"\1", -212.5), (2, 212.5), (b"\2", 212.5), (3, -212.5),
     (b"\3", -212.5)],
)  # fmt: skip
def test_altitudes_are_above_or_below_as_every_version_of_exif_says_it(
    reference: int | bytes | None, altitude_m: float
) -> None:
    gps = {1: "N", 2: (31.0, 30.0, 0.0), 3: "E", 4: (35.0, 30.0, 0.0), 6: 212.5}
    gnss = parse_exif({}, {}, gps if reference is None else gps | {5: reference}).gnss
    assert gnss is not None
    assert gnss.altitude_m == altitude_m


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif", "heic"])
def test_exif_is_read_from_every_format(tmp_path: Path, suffix: str) -> None:
    exif = Image.Exif()
    exif[0x010F], exif[0x0110] = "Acme", "Acme One"
    exif.get_ifd(_DETAILS).update({0x9003: "2020:06:01 09:30:00", 0xA405: 36})
    exif.get_ifd(_GPS).update({1: "N", 2: (41.0, 30.0, 36.0), 3: "E", 4: (0.0, 52.0, 12.0), 5: b"\0", 6: 212.5})
    for i in range(2):
        _save(painted((90, 60), i), tmp_path / f"{i}.{suffix}", exif.tobytes())
    photo = load_photos([tmp_path]).items[0]
    assert photo.taken_at == datetime(2020, 6, 1, 9, 30)
    assert photo.focal_px == pytest.approx(90, rel=1e-3)
    assert photo.camera_key.startswith("Acme One")
    assert photo.gnss is not None
    assert (photo.gnss.latitude_deg, photo.gnss.longitude_deg) == pytest.approx((41.51, 0.87), abs=1e-6)
    assert photo.gnss.altitude_m == 212.5


def test_orchard_dev_photos(shared_data: Path) -> None:
    progress = Silent()
    photos = load_photos([shared_data / "orchard-dev" / "images"], progress=progress)
    assert len(photos) == 34
    assert photos.sides == ("east", "west")
    assert [photo.focal_px for photo in photos] == pytest.approx([1394.798] * 34, abs=1e-3)
    assert len({photo.camera_key for photo in photos}) == 1
    assert progress.warnings == []


def _save(image: Image.Image, path: Path, exif: bytes | None = None) -> None:
    options = {} if exif is None else {"exif": exif}
    if path.suffix.lower() == ".heic":
        pillow_heif.from_pillow(image).save(path, quality=95, **options)
    else:
        image.save(path, **options)
