"""Circles of whole fruits in photos: as equations, as the shipped network sees them, and in the measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest

from fuse_scenes import cameras_in_a_row, detections_of
from pomona.basics.arrays import ByteArray, Float32Array, FloatArray
from pomona.basics.geometry import offsets_from_rays
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.fruit.crops.likeness import with_likeness
from pomona.fruit.geometry.mask_rays import mask_rays
from pomona.fruit.traits.colours import ColourCounts
from pomona.fruit.traits.kinds import FRUIT_KINDS
from pomona.progress import Silent
from pomona.stages.fuse.object import fuse
from pomona.stages.measure import MeasureOptions, measure
from pomona.stages.measure.circle_network import SHIPPED, CirclesNetwork
from pomona.stages.measure.circle_options import CircleOptions
from pomona.stages.measure.circles import CircleTerms, SeenCircles, circle_terms, see_circles
from pomona.stages.measure.spheroids import Spheroids
from pomona.stages.second_look.network import SHIPPED as SECOND_LOOK
from pomona.values.cameras import Cameras
from pomona.values.fruits import Observations
from pomona.values.intrinsics import Intrinsics
from test_second_look import half_hidden, photos_of

CAMERAS = cameras_in_a_row(6, step_m=0.1)
CENTERS = np.array([[-0.25, 0.0, 0.1], [0.0, 0.05, -0.15], [0.22, -0.05, 0.05]])
RADII_M = np.array([0.034, 0.04, 0.037])
USUAL_M = 0.037


def seen_from(cameras: Cameras, photo_idx: Sequence[int], assumed: FloatArray) -> SeenCircles:
    """What an exact network would see of the fruits, in crops about places where they are not quite."""
    of, which = (a.ravel() for a in np.meshgrid(np.arange(len(CENTERS)), photo_idx))
    poses = cameras.cam_from_world[which]
    true, thought = (
        np.einsum("kij,kj->ki", poses[:, :, :3], places[of]) + poses[:, :, 3] for places in (CENTERS, assumed)
    )
    offsets = (true[:, :2] / true[:, 2:] - thought[:, :2] / thought[:, 2:]) * thought[:, 2:] / USUAL_M
    log_ratios = np.log(RADII_M[of] / true[:, 2]) - np.log(USUAL_M / thought[:, 2])
    eyes = cameras.centers_in_world[which]
    return SeenCircles(of, assumed, USUAL_M, poses[:, :, :3], eyes, offsets, log_ratios, np.full((len(of), 3), 0.05))


def solved(terms: CircleTerms) -> FloatArray:
    result: FloatArray = terms.starts + np.linalg.solve(terms.precisions, terms.pulls[:, :, None])[:, :, 0]
    return result


def test_exact_circles_have_fruits_where_they_are_and_as_wide() -> None:
    off = USUAL_M * np.array([[0.2, 0.3, -0.2], [-0.2, -0.3, 0.1], [-0.1, 0.4, 0.2]])
    found = solved(circle_terms(seen_from(CAMERAS, range(6), CENTERS + off), CircleOptions()))
    assert np.linalg.norm(found[:, :3] - CENTERS, axis=1).max() < 0.02 * USUAL_M
    np.testing.assert_allclose(np.exp(found[:, 3]), RADII_M, rtol=0.005)


def test_from_one_place_a_width_is_known_only_for_a_distance() -> None:
    terms = circle_terms(seen_from(CAMERAS, [2], CENTERS), CircleOptions())
    values = np.linalg.eigvalsh(terms.precisions)
    assert (values[:, 0] < 1e-6 * values[:, 1]).all()
    np.testing.assert_allclose(np.exp(terms.log_radii(CENTERS)), RADII_M, rtol=1e-9)
    farther = CENTERS + 0.1 * (CENTERS - CAMERAS.centers_in_world[2])
    np.testing.assert_allclose(np.exp(terms.log_radii(farther)), 1.1 * RADII_M, rtol=0.01)


def test_photos_say_less_together_than_each_alone_and_gradients_fit() -> None:
    seen = seen_from(CAMERAS, range(6), CENTERS)
    alone, together = (circle_terms(seen, CircleOptions(together=share)) for share in (0.0, 1.0))
    np.testing.assert_allclose(alone.precisions, 6 * together.precisions, atol=1e-6)
    n = len(CENTERS)
    at = Spheroids(CENTERS, RADII_M, np.ones(n), np.zeros((n, 2)), np.eye(3))
    sizes = np.abs(alone.precisions).sum(axis=2)
    assert (np.abs(alone.at(at)) < 1e-9 * sizes).all()
    lower = alone.lower_by(0.1)
    np.testing.assert_allclose(lower.log_radii(CENTERS), np.log(RADII_M) - 0.1)
    np.testing.assert_allclose(lower.doubted(4).log_radii(CENTERS), np.log(RADII_M) - 0.1)
    assert np.isnan(CircleTerms.none(2).log_radii(CENTERS[:2])).all()


def test_circles_take_the_level_of_outlines_and_count_less_where_they_scatter() -> None:
    rng, n = np.random.default_rng(0), 40
    centers, log_radii = rng.normal(0, 1, (n, 3)), np.log(USUAL_M) + rng.normal(0, 0.08, n)
    spheroids = Spheroids(centers, np.exp(log_radii), np.ones(n), np.zeros((n, 2)), np.eye(3))
    starts = np.column_stack([centers, np.full(n, np.log(USUAL_M))])
    precisions = np.zeros((n, 4, 4))
    precisions[:, 3, 3] = 0.02**-2
    clear, options = rng.random(n) < 0.6, CircleOptions(level_of_outlines=1.0)
    for scatter in (0.02, 0.08):
        said = log_radii - 0.05 + rng.normal(0, scatter, n)
        terms = CircleTerms(starts, precisions, precisions[:, :, 3] * (said - np.log(USUAL_M))[:, None])
        found = terms.as_outlines_have_it(spheroids, np.full(n, 1e-5), clear, options)
        assert abs(np.median((found.log_radii(centers) - log_radii)[clear])) < 1e-9
        doubt = np.sqrt(precisions[0, 3, 3] / found.precisions[0, 3, 3])
        assert 0.65 * scatter / 0.02 < doubt < 1.5 * scatter / 0.02
        few = terms.as_outlines_have_it(spheroids, np.full(n, 1e-5), np.arange(n) < 3, options)
        np.testing.assert_array_equal(few.pulls, terms.pulls)


@pytest.mark.parametrize("colour", [(200, 40, 40), (190, 170, 60)], ids=["red", "yellow"])
@pytest.mark.parametrize("wide", [0.85, 1.0, 1.15])
def test_the_shipped_network_measures_a_plain_round_fruit(colour: tuple[int, int, int], wide: float) -> None:
    network = CirclesNetwork()
    side, radius_px = network.side_px, network.radius_px
    background = np.random.default_rng(1).integers(20, 70, (side, side, 3), np.uint8)
    background[:, :, 1] += 20
    columns, rows = np.arange(side) + 0.5, np.arange(side)[:, None] + 0.5
    at = np.array([0.2, -0.15])
    away = np.hypot(*(np.broadcast_arrays(columns - side / 2 - at[0] * radius_px, rows - side / 2 - at[1] * radius_px)))
    away = away / (wide * radius_px)
    lit = np.sqrt(np.clip(1 - away**2, 0, 1))[:, :, None]
    pixels = np.where(away[:, :, None] < 1, np.array(colour) * (0.35 + 0.65 * lit), background).astype(np.uint8)
    counts = ColourCounts.of(pixels, away < 1, away > 1)
    crop = with_likeness(np.asarray(cv2.GaussianBlur(pixels, (3, 3), 0), np.uint8), counts, counts)
    (circle,) = network.circles(crop[None])
    assert np.hypot(*(circle[:2] - at)) < 0.12
    assert abs(circle[2] - np.log(wide)) < 0.1
    assert ((np.exp(circle[3:]) > 0.01) & (np.exp(circle[3:]) < 0.3)).all()


class Exact(CirclesNetwork):
    """Sees the blue discs of these tests' photos exactly, as large and far off as they are."""

    def __init__(self) -> None:
        self.radius_px, self.side_px = 18.0, 72

    def circles(self, crops: ByteArray) -> Float32Array:
        found = []
        for crop in crops[:, :, :, 2] > 128:
            rows, columns = np.nonzero(crop)
            radius = np.sqrt(len(rows) / np.pi)
            middle = np.array([columns.mean(), rows.mean()]) + 0.5 - self.side_px / 2
            found.append([*middle / self.radius_px, np.log(radius / self.radius_px), -4.5, -4.5, -4.5])
        return np.array(found, np.float32)


class Told(Silent):
    """Progress that keeps what it was told."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[tuple[str, int | None]] = []
        self.advanced = 0

    def start(self, label: str, total: int | None = None) -> None:
        self.started.append((label, total))

    def advance(self, units: int = 1) -> None:
        self.advanced += units


def test_photos_measure_fruits_whose_masks_do_not(tmp_path: Path) -> None:
    widths_m = 2 * RADII_M
    photos = photos_of(CAMERAS, tmp_path, CENTERS, widths_m)
    detections = half_hidden(CAMERAS, detections_of(CAMERAS, CENTERS, widths_m))
    fused = fuse(detections, CAMERAS)
    progress = Told()
    alone = measure(fused, detections, CAMERAS)
    looked = measure(fused, detections, CAMERAS, photos, network=Exact(), progress=progress)
    assert progress.started == [("measure", 6)]
    assert progress.advanced == 6
    assert progress.warnings == []
    assert "hidden too far" in alone.reasons[2]
    assert looked.reasons == ("", "", "")
    nearest = np.linalg.norm(fused.fruits.centers_in_world[:, None] - CENTERS[None], axis=2).argmin(1)
    before_m, off_m = (np.linalg.norm(f.centers_in_world - CENTERS[nearest], axis=1) for f in (alone, looked))
    assert before_m.max() > 0.03
    assert off_m.max() < 0.006
    # Their masks are narrower than what they show of the fruits, and still count.
    measured = ~np.isnan(alone.diameters_m)
    assert (looked.diameters_m > alone.diameters_m)[measured].all()
    assert (looked.diameters_m < widths_m[nearest]).all()
    assert (looked.diameter_sds_m > 0.0002).all()


@pytest.mark.parametrize("distortion", [-0.2, 0.1])
def test_circles_are_as_wide_wherever_distortion_has_them(distortion: float, tmp_path: Path) -> None:
    centers = np.array([[x, 0.0, z] for x in (-0.5, 0.0, 0.5) for z in (-0.25, 0.25)])
    widths_m, said = np.full(len(centers), 2 * USUAL_M), []
    for k in (0.0, distortion):
        lens = Intrinsics("SIMPLE_RADIAL", 640, 480, np.array([480.0, 320, 240, k]))
        cameras = replace(cameras_in_a_row(5, step_m=0.1, distance_m=1.0), intrinsics=(lens,))
        photos, detections = photos_of(cameras, tmp_path, centers, widths_m), detections_of(cameras, centers, widths_m)
        seen = tuple(name for name, found in detections.items() for _ in found.ids)
        rays = mask_rays(detections, cameras, rays_per_mask=4)
        off = [
            offsets_from_rays(centers, rays.eyes_in_world[p], ray)
            for p, ray in zip(rays.photo_idx, rays.rays, strict=True)
        ]
        fruit_of = dict(zip(rays.ids.tolist(), np.linalg.norm(off, axis=2).argmin(1).tolist(), strict=True))
        ids = np.concatenate([found.ids for found in detections.values()])
        fruit_idx = np.array([fruit_of[i] for i in ids.tolist()])
        observations = Observations(fruit_idx + 1, seen, ids, np.zeros((len(ids), 2)))
        circles = see_circles(
            centers, USUAL_M, fruit_idx, observations, detections, photos, cameras, Exact(), CircleOptions(), Silent()
        )
        said.append(np.exp(circle_terms(circles, CircleOptions()).log_radii(centers)) / USUAL_M)
    # The network of this test takes ellipses for circles as large, and so sees all too wide, whatever the lens.
    np.testing.assert_allclose(said[0], 1.03, atol=0.03)
    np.testing.assert_allclose(said[1], said[0], atol=0.03)


@pytest.mark.parametrize("kind", ["pear", "lemon"])
def test_long_fruits_and_measures_without_circles_go_by_outlines_alone(tmp_path: Path, kind: str) -> None:
    photos = photos_of(CAMERAS, tmp_path, CENTERS, 2 * RADII_M)
    detections = detections_of(CAMERAS, CENTERS, 2 * RADII_M)
    fused = fuse(detections, CAMERAS)
    for options in (MeasureOptions(kind=FRUIT_KINDS[kind]), MeasureOptions(circles=None)):
        looked, alone = (measure(fused, detections, CAMERAS, p, options=options) for p in (photos, None))
        np.testing.assert_array_equal(looked.diameters_m, alone.diameters_m)
        np.testing.assert_array_equal(looked.centers_in_world, alone.centers_in_world)


def test_a_photo_that_is_gone_is_named(tmp_path: Path) -> None:
    photos = photos_of(CAMERAS, tmp_path, CENTERS, 2 * RADII_M)
    detections = detections_of(CAMERAS, CENTERS, 2 * RADII_M)
    (tmp_path / CAMERAS.photos[2]).unlink()
    with pytest.raises(MissingFileError, match=CAMERAS.photos[2]):
        measure(fuse(detections, CAMERAS), detections, CAMERAS, photos)


def test_a_photo_that_cannot_be_decoded_measures_no_fruit_and_is_named(tmp_path: Path) -> None:
    photos = photos_of(CAMERAS, tmp_path, CENTERS, 2 * RADII_M)
    detections = detections_of(CAMERAS, CENTERS, 2 * RADII_M)
    (tmp_path / CAMERAS.photos[2]).write_bytes(b"no photo any more")
    progress = Told()
    measured = measure(fuse(detections, CAMERAS), detections, CAMERAS, photos, network=Exact(), progress=progress)
    (warning,) = progress.warnings
    assert warning.startswith(f"{CAMERAS.photos[2]} measures no fruit: its pixels cannot be decoded (")
    assert warning.count(CAMERAS.photos[2]) == 1
    assert progress.advanced == 6
    assert np.isfinite(measured.diameters_m).all()


def test_another_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"circles.*second-look"):
        CirclesNetwork(SECOND_LOOK)
    with pytest.raises(MissingFileError, match=r"none\.onnx"):
        CirclesNetwork(Path("none.onnx"))
    model = onnx.load(str(SHIPPED))
    next(entry for entry in model.metadata_props if entry.key == "pomona.channels").value = "3"
    onnx.save(model, str(tmp_path / "colours_alone.onnx"))
    with pytest.raises(FormatError, match=r"pomona\.channels = 4, found 3"):
        CirclesNetwork(tmp_path / "colours_alone.onnx")


@pytest.mark.parametrize(
    "wrong", [{"most_photos": 0}, {"least_sd": 0.0}, {"together": 1.5}, {"level_of_outlines": -0.1}]
)
def test_wrong_options_are_named(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        replace(CircleOptions(), **wrong)  # type: ignore[arg-type]
