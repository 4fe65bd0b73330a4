"""A survey as a recording of the Rerun viewer (`.rrd`): points, cameras and fruits. rerun-sdk is touched here alone.

Lenses are without distortion there, as Rerun knows none, and photos are not in the file.
"""

from __future__ import annotations

from pathlib import Path

from pomona.errors import MissingExtraError
from pomona.fruit.geometry.spheres import Spheres
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.values.cameras import Cameras
from pomona.values.fruits import FruitCloud, Fruits

_FRUIT_RGB = (214, 40, 40)


def write_rerun(path: Path, cameras: Cameras, fruits: Fruits, cloud: FruitCloud) -> None:
    """Write `world/points`, `world/cameras/PHOTO` and `world/fruits` to `path`.

    Raises `MissingExtraError` where rerun-sdk is not installed.
    """
    try:
        import rerun
    except ImportError:
        raise MissingExtraError(
            "`to` rerun needs the package rerun-sdk: install it with `pip install 'pomona[rerun]'`"
        ) from None
    recording = rerun.RecordingStream("pomona")
    recording.save(path)
    recording.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log("world/points", rerun.Points3D(cloud.points_in_world, colors=cloud.rgb), static=True)
    labels = [f"fruit {fruit_id}" for fruit_id in fruits.ids.tolist()]
    usual_m = size_of_fruits(fruits.diameters_m, FruitSize()).diameter_m
    spheres = Spheres.of_fruits(fruits.centers_in_world, fruits.likely_diameters_m, usual_m / 2)
    balls = rerun.Points3D(
        spheres.centers_in_world,
        radii=spheres.radii_m,
        colors=_FRUIT_RGB,
        labels=labels,
        show_labels=False,
    )
    recording.log("world/fruits", balls, static=True)
    for i, name in enumerate(cameras.photos):
        place = ["world", "cameras", name]
        rotation = cameras.cam_from_world[i, :, :3].T
        pose = rerun.Transform3D(translation=cameras.centers_in_world[i], mat3x3=rotation)
        lens = cameras.intrinsics_of(i)
        size = [lens.width_px, lens.height_px]
        pinhole = rerun.Pinhole(image_from_camera=lens.matrix, resolution=size, camera_xyz=rerun.ViewCoordinates.RDF)
        recording.log(place, pose, pinhole, static=True)
    recording.flush()
    recording.disconnect()
