"""The contact sheet: outlines where a sphere is seen, circles at the right pixels, photos well chosen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pomona.errors import InputError
from pomona.fruit.geometry.sphere_outlines import centers_px, sphere_outlines_px
from pomona.progress import Silent
from pomona.stages.report import ContactSheetOptions, write_contact_sheet
from pomona.stages.report.choose import choose_photos
from pomona.values.cameras import Cameras
from pomona.values.drawing import OTHER, SEEN
from pomona.values.fruits import Fruits, Observations
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photos
from report_scenes import LENS, looking, observe, row_cameras, row_fruits, row_photos

_AHEAD = looking(np.array([0.0, -2.0, 0.0]), np.zeros(3))


def _camera(lens: Intrinsics = LENS) -> Cameras:
    return Cameras(("a.png",), (lens,), np.zeros(1, int), _AHEAD[None])


def test_outline_is_where_rays_touch_the_sphere() -> None:
    centers, diameters = np.array([[0.3, 0.1, 0.2], [-0.4, 0.5, 0.0]]), np.array([0.3, 0.08])
    camera = _camera()
    outlines = sphere_outlines_px(camera, 0, centers, diameters)
    for outline, center, diameter in zip(outlines, centers, diameters, strict=True):
        rays = camera.rays_in_world(0, outline)
        to_center = center - camera.centers_in_world[0]
        off = np.linalg.norm(np.cross(rays, to_center), axis=1)
        assert np.allclose(off, diameter / 2, rtol=1e-3)


def test_straight_ahead_the_outline_is_a_circle_of_known_radius() -> None:
    lens = Intrinsics("SIMPLE_PINHOLE", 800, 600, np.array([700.0, 400.0, 300.0]))
    outline = sphere_outlines_px(_camera(lens), 0, np.zeros((1, 3)), np.array([0.2]))[0]
    radius = np.linalg.norm(outline - [400, 300], axis=1)
    assert np.allclose(radius, 700 * 0.1 / np.sqrt(2**2 - 0.1**2), atol=1e-6)


def test_what_cannot_be_seen_is_nan() -> None:
    behind, around, unmeasured = [0.0, -4.0, 0.0], [0.0, -2.0, 0.05], [0.0, 0.0, 0.0]
    outlines = sphere_outlines_px(_camera(), 0, np.array([behind, around, unmeasured]), np.array([0.1, 0.3, np.nan]))
    assert np.isnan(outlines).any(axis=(1, 2)).all()


def test_a_lens_that_folds_back_shows_nothing_there() -> None:
    folding = Intrinsics("SIMPLE_RADIAL", 800, 600, np.array([700.0, 400.0, 300.0, -0.4]))
    far_aside = np.array([[2.4, 0.0, 0.0]])
    projected, _ = _camera(folding).project(0, far_aside)
    assert 0 < projected[0, 0] < 800  # the fold is real
    assert np.isnan(centers_px(_camera(folding), 0, far_aside)).all()
    assert np.isfinite(centers_px(_camera(folding), 0, np.array([[0.2, 0.0, 0.0]]))).all()


def test_circles_lie_at_the_right_pixels(tmp_path: Path) -> None:
    """Photos black, so that only what is drawn is seen: the yellow ring's middle and radius are known."""
    cameras, fruits = (
        _camera(),
        Fruits(
            np.array([5, 6]),
            np.array([[0.25, 0, 0.1], [-0.2, 0.2, -0.1]]),
            np.full(2, 0.2),
            np.ones(2),
            np.ones(2, int),
        ),
    )
    photos = row_photos(cameras, tmp_path)
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((LENS.height_px, LENS.width_px, 3), np.uint8))
    xy, _ = cameras.project(0, fruits.centers_in_world)
    seen = Observations(np.array([5]), ("a.png",), np.array([1]), xy[:1])
    options = ContactSheetOptions(photo_side_px=400, fruit_px=10, jpeg_quality=98)
    write_contact_sheet(photos, cameras, fruits, seen, tmp_path / "sheet.jpg", options=options)
    sheet = cv2.imread(str(tmp_path / "sheet.jpg"))[:, :, ::-1].astype(int)
    outlines = sphere_outlines_px(cameras, 0, fruits.centers_in_world, fruits.diameters_m)
    for i, colour in enumerate((SEEN, OTHER)):
        close = np.abs(sheet[:312, :412] - colour).max(axis=2) < 60
        drawn = np.argwhere(close)[:, ::-1] + 0.5 - 12  # the gap around photos
        expected = outlines[i] / 2  # 800 px shown on 400
        for edge in (np.min, np.max):
            assert np.allclose(edge(drawn, axis=0), edge(expected, axis=0), atol=2.0)


def test_a_large_photo_is_cut_to_where_fruits_are(tmp_path: Path) -> None:
    cameras, fruits = row_cameras(1), row_fruits(40)
    photos = row_photos(cameras, tmp_path)
    for photo in photos:
        photo.path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(photo.path.with_suffix(".png")), np.zeros((LENS.height_px, LENS.width_px, 3), np.uint8))
    photos = Photos(tuple(replace(photo, path=photo.path.with_suffix(".png")) for photo in photos))
    options = ContactSheetOptions(photo_side_px=200, fruit_px=15)
    write_contact_sheet(photos, cameras, fruits, observe(fruits, cameras), tmp_path / "sheet.jpg", options=options)
    sheet = cv2.imread(str(tmp_path / "sheet.jpg"))
    assert 200 + 34 < sheet.shape[0] < 200 + 100  # two cells of 200 × 200 in one row


def test_lost_photo_files_are_told_of_and_left_out(tmp_path: Path) -> None:
    cameras, fruits = row_cameras(2), row_fruits(5)
    listener = Silent()
    write_contact_sheet(
        row_photos(cameras, tmp_path / "gone"),
        cameras,
        fruits,
        observe(fruits, cameras),
        tmp_path / "sheet.jpg",
        progress=listener,
    )
    assert len(listener.warnings) == 4
    assert cv2.imread(str(tmp_path / "sheet.jpg")) is not None


def test_photos_are_of_both_sides_and_show_most_fruits() -> None:
    cameras, fruits = row_cameras(8), row_fruits(200)
    seen = observe(fruits, cameras)
    chosen = choose_photos(row_photos(cameras), cameras, seen, 4)
    assert len(set(chosen)) == 4
    assert [name.split("/")[0] for name in chosen] == ["east", "east", "west", "west"]
    covered = {int(f) for f, p in zip(seen.fruit_id, seen.photo, strict=True) if p in chosen}
    assert len(covered) > 0.85 * len(set(seen.fruit_id.tolist()))


def test_without_fruits_photos_are_taken_evenly() -> None:
    cameras = row_cameras(9)
    chosen = choose_photos(row_photos(cameras), cameras, Observations.empty(), 6)
    assert len(set(chosen)) == 6
    assert sum(name.startswith("east") for name in chosen) == 3
    assert len(choose_photos(row_photos(cameras), cameras, Observations.empty(), 100)) == 18


def test_options_are_checked() -> None:
    with pytest.raises(InputError, match="columns: expected at least 1, found 0"):
        ContactSheetOptions(columns=0)


def test_photos_that_are_shown_whole_are_drawn_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is read may be read-only, and a photo shown whole is not copied on the way."""

    def read_only(photo: object, **_: object) -> np.ndarray:
        pixels = np.zeros((LENS.height_px, LENS.width_px, 3), np.uint8)
        pixels.setflags(write=False)
        return pixels

    monkeypatch.setattr("pomona.stages.report.contact_sheet.read_pixels", read_only)
    cameras, fruits = row_cameras(1), row_fruits(4)
    photos = row_photos(cameras, tmp_path)
    for photo in photos:
        cv2.imwrite(str(photo.path), np.zeros((LENS.height_px, LENS.width_px, 3), np.uint8))
    options = ContactSheetOptions(photo_side_px=LENS.width_px)
    write_contact_sheet(photos, cameras, fruits, Observations.empty(), tmp_path / "sheet.jpg", options=options)
    assert (cv2.imread(str(tmp_path / "sheet.jpg")) > 60).any()


def test_the_key_says_what_a_cross_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notes: list[str] = []

    def noted(width: int, entries: object, note: str = "") -> np.ndarray:
        notes.append(note)
        return np.zeros((30, width, 3), np.uint8)

    monkeypatch.setattr("pomona.stages.report.contact_sheet.key", noted)
    cameras, fruits = row_cameras(1), row_fruits(4)
    photos = row_photos(cameras, tmp_path)
    for photo in photos:
        photo.path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(photo.path), np.zeros((LENS.height_px, LENS.width_px, 3), np.uint8))
    write_contact_sheet(photos, cameras, fruits, observe(fruits, cameras), tmp_path / "sheet.jpg")
    assert notes == ["cross: its size is not known"]
