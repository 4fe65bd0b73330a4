"""The cloud of fruits that are known as spheres: points on them, coloured by the photos."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from fuse_scenes import HEIGHT, WIDTH, cameras_in_a_row, detections_of, seen_pixels
from pomona.progress import Silent
from pomona.stages.capture import load_photos
from pomona.stages.dense import sphere_cloud
from pomona.values.fruits import Fruits, Observations
from pomona.values.photos import Photo, Photos

CENTERS = np.array([[-0.15, 0.0, 0.05], [0.12, 0.05, -0.05], [0.0, 0.1, 0.15]])
DIAMETERS = np.full(3, 0.08)
COLOURS = np.array([[200, 30, 30], [30, 180, 40], [230, 200, 40]], np.uint8)


def test_points_lie_on_what_the_photos_show_of_each_sphere_and_have_its_colour(tmp_path: Path) -> None:
    cameras = cameras_in_a_row(5)
    for i, name in enumerate(cameras.photos):
        pixels = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
        for seen, colour in zip(seen_pixels(cameras, i, CENTERS, DIAMETERS), COLOURS, strict=True):
            pixels[seen] = colour
        Image.fromarray(pixels).save(tmp_path / name, quality=100, subsampling=0)
    photos, detections = load_photos([tmp_path]), detections_of(cameras, CENTERS, DIAMETERS)
    seen = [(k + 1, name, int(found.ids[k])) for name, found in detections.items() for k in range(3)]
    observations = Observations(
        np.array([s[0] for s in seen]), tuple(s[1] for s in seen), np.array([s[2] for s in seen]), np.zeros((15, 2))
    )
    diameters_m = np.array([0.08, 0.08, np.nan])
    fruits = Fruits(np.array([1, 2, 3]), CENTERS, diameters_m, np.full(3, 0.9), np.full(3, 5))
    cloud = sphere_cloud(fruits, observations, detections, cameras, photos)

    assert set(cloud.fruit_id.tolist()) == {1, 2}  # the third was not measured
    for k in (0, 1):
        points = cloud.points_in_world[cloud.fruit_id == k + 1]
        assert 200 < len(points) < 5000
        np.testing.assert_allclose(np.linalg.norm(points - CENTERS[k], axis=1), 0.04, atol=1e-9)
        assert (points[:, 1] < CENTERS[k, 1] + 0.012).all()  # cameras look along +y: only the near side is seen
        off = np.abs(cloud.rgb[cloud.fruit_id == k + 1].astype(int) - COLOURS[k]).max(1)
        assert (off < 40).mean() > 0.9


def test_no_fruits_have_no_cloud(tmp_path: Path) -> None:
    cameras = cameras_in_a_row(2)
    for name in cameras.photos:
        Image.new("RGB", (WIDTH, HEIGHT)).save(tmp_path / name)
    detections = detections_of(cameras, CENTERS, DIAMETERS)
    cloud = sphere_cloud(Fruits.empty(), Observations.empty(), detections, cameras, load_photos([tmp_path]))
    assert len(cloud) == 0


def test_a_photo_that_cannot_be_decoded_is_left_out(tmp_path: Path) -> None:
    cameras = cameras_in_a_row(2)
    for name in cameras.photos:
        Image.new("RGB", (WIDTH, HEIGHT)).save(tmp_path / name)
    photos = Photos(tuple(Photo(name, tmp_path / name, WIDTH, HEIGHT) for name in cameras.photos))
    detections = detections_of(cameras, CENTERS, DIAMETERS)
    ids = [int(detections[name].ids[0]) for name in cameras.photos]
    observations = Observations(np.array([1, 1]), tuple(cameras.photos), np.array(ids), np.zeros((2, 2)))
    fruits = Fruits(np.array([1]), CENTERS[:1], np.array([0.08]), np.full(1, 0.9), np.full(1, 2))
    sizes = []
    for damaged in (None, *photos):
        if damaged is not None:
            damaged.path.write_bytes(b"no photo any more")
        progress = Silent()
        sizes.append(len(sphere_cloud(fruits, observations, detections, cameras, photos, progress=progress)))
    assert 0.4 * sizes[0] < sizes[1] < 0.6 * sizes[0]
    assert sizes[2] == 0
    assert [said.split(": ")[0] for said in progress.warnings] == [f"{n} is not in the cloud" for n in cameras.photos]
