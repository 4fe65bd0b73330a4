"""Photographs a row with OpenGL: what `blender.BlenderStage` does by path tracing, in seconds a photo."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from pomona.basics.arrays import ByteArray, FloatArray, IntArray
from pomona.learning.synth.cameras import RowCamera
from pomona.learning.synth.encoding import colours_of_ids
from pomona.learning.synth.layout import Row
from pomona.learning.synth.meshes import unit
from pomona.learning.synth.options import LIGHTS, RowOptions
from pomona.learning.synth.quick.gl import GlView, Painter
from pomona.learning.synth.quick.lights import row_lighting
from pomona.learning.synth.quick.row import row_scene

_FINER = 2  # photos are drawn so many times as wide and high, then made smaller: edges are soft
_NEAR_M, _FAR_M = 0.1, 120.0
_GREY = 0.16  # linear, of the mean of a photo exposed as a camera does
_BACKDROP_PX = 96


class QuickStage:
    """A row, ready to be photographed. One at a time in a process."""

    def __init__(self, row: Row, marker_cells: list[IntArray], options: RowOptions) -> None:
        self._row, self._cells, self._options = row, marker_cells, options
        self._painter = Painter()
        self._scene_idx: int | None = None
        azimuth = options.sun_azimuth_deg
        if azimuth is None:
            azimuth = float(options.rng(700).uniform(0, 360))
        self._lighting = row_lighting(LIGHTS[options.light], azimuth)

    def photograph(self, camera: RowCamera, path: Path, *, photo_idx: int) -> None:
        """Draw a photo to a PNG file."""
        light, _ = self._draw(camera, _FINER, photo_idx)
        light = cv2.resize(light, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA)
        exposure = self._lighting.exposure + self._options.exposure
        Image.fromarray(_toned(light, exposure)).save(path, compress_level=1)

    def mask(self, camera: RowCamera, path: Path, *, photo_idx: int) -> None:
        """Draw the fruits' ids as colours to a PNG file, what is seen in each pixel's centre."""
        _, ids = self._draw(camera, 1, photo_idx)
        Image.fromarray(colours_of_ids(np.round(ids).astype(np.uint16))).save(path, compress_level=1)

    def _draw(self, camera: RowCamera, finer: int, photo_idx: int) -> tuple[FloatArray, FloatArray]:
        scene_idx = photo_idx if self._options.wind_m else 0
        if scene_idx != self._scene_idx:
            self._painter.take(row_scene(self._row, self._cells, self._options, photo_idx=scene_idx))
            self._scene_idx = scene_idx
        backdrop = self._sky_behind(camera)
        light, ids = self._painter.draw(_view(camera, finer), self._lighting, backdrop.astype(np.float32))
        return np.asarray(light), np.asarray(ids)

    def _sky_behind(self, camera: RowCamera) -> FloatArray:
        """The sky in the directions of the photo's pixels (h, w, 3), lowest row first."""
        half = np.array([camera.width_px, camera.height_px]) / 2 / camera.focal_px
        x, y = np.meshgrid(*(np.linspace(-h, h, _BACKDROP_PX) for h in half))
        in_cam = np.stack([x, -y, np.ones_like(x)], axis=-1).reshape(-1, 3)
        towards = unit(in_cam @ camera.rotation_cam_from_world)
        sky = self._lighting.sky(np.maximum(towards, [-1, -1, 0.02])) * len(towards) / 2
        return np.asarray(sky.reshape(_BACKDROP_PX, _BACKDROP_PX, 3))


def _view(camera: RowCamera, finer: int) -> GlView:
    right, down, ahead = camera.rotation_cam_from_world
    in_camera = np.eye(4)
    in_camera[:3, :3] = np.stack([right, -down, -ahead])  # OpenGL's camera looks along -z, y up
    in_camera[:3, 3] = -in_camera[:3, :3] @ camera.centre_in_world
    fx, fy = 2 * camera.focal_px / np.array([camera.width_px, camera.height_px])
    near, far = _NEAR_M, _FAR_M
    projection = np.array([[fx, 0, 0, 0], [0, fy, 0, 0],
                           [0, 0, (near + far) / (near - far), 2 * near * far / (near - far)],
                           [0, 0, -1, 0]])  # fmt: skip
    return GlView(projection @ in_camera, camera.centre_in_world, finer * camera.width_px, finer * camera.height_px)


def _toned(light: FloatArray, exposure: float) -> ByteArray:
    """The picture uint8 (h, w, 3) of linear light, exposed as a camera does."""
    metered = float(np.exp(np.mean(np.log(light.mean(2) + 1e-3))))
    image = np.clip(light * (_GREY / max(metered, 1e-4) * 2.0**exposure), 0, None)
    image = image * (1 + image / 16) / (1 + image)  # Reinhard's curve: highlights fade out
    image = np.clip(image * 1.35, 0, 1) ** (1 / 2.2)
    image = image + 0.6 * image * (1 - image) * (2 * image - 1)
    result: ByteArray = (np.clip(image, 0, 1) * 255).astype(np.uint8)
    return result
