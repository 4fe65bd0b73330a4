"""Draws a row with Blender's Cycles on the CPU: the one module that imports `bpy`."""

from __future__ import annotations

import contextlib
import math
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.errors import MissingExtraError
from pomona.learning.synth import materials
from pomona.learning.synth.cameras import RowCamera
from pomona.learning.synth.layout import Row
from pomona.learning.synth.meshes import Mesh, fruit, ground, hedge, plate
from pomona.learning.synth.options import LIGHTS, VARIETIES, RowOptions

try:
    import bpy
    from mathutils import Matrix
except ImportError as missing:
    raise MissingExtraError(
        "Rendering rows needs Blender as a Python module (bpy 4.5, for Python 3.11), which is not installed here; "
        "with Python 3.11, run: pip install 'pomona[synth]'"
    ) from missing


class BlenderStage:
    """A Blender scene of one row, ready to be photographed. One at a time in a process."""

    def __init__(self, row: Row, marker_cells: list[IntArray], options: RowOptions) -> None:
        self._options = options
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self._scene = bpy.context.scene
        self._materials = {name: self._material(name, build) for name, build in materials.BUILDERS.items()}
        # As lamps, all leaves would be sorted for every mask, which takes twenty times as long as the mask itself.
        self._materials["fruit_id"].cycles.emission_sampling = "NONE"
        variety = VARIETIES[options.variety]
        self._materials["fruit"] = self._material("fruit", lambda tree: materials.fruit(tree, variety))
        self._add_row(row, marker_cells)
        self._add_background(row)
        self._add_light()
        self._add_camera()
        self._set_cycles()

    def photograph(self, camera: RowCamera, path: Path, *, photo_idx: int) -> None:
        """Render a photo to a PNG file."""
        scene, cycles = self._scene, self._scene.cycles
        bpy.context.view_layer.material_override = None
        cycles.samples, cycles.max_bounces = self._options.samples, 4
        cycles.seed = self._options.seed * 1000 + photo_idx
        cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 1.5
        cycles.use_denoising = self._denoiser is not None and not self._options.grainy
        scene.view_settings.view_transform, scene.view_settings.look = "AgX", "AgX - Medium High Contrast"
        scene.view_settings.exposure = LIGHTS[self._options.light].exposure + self._options.exposure
        scene.world.node_tree.nodes["Background"].mute = False
        self._render(camera, path)

    def mask(self, camera: RowCamera, path: Path, *, photo_idx: int) -> None:
        """Render the fruits' ids as colours to a PNG file: one sample in each pixel's centre, no light."""
        del photo_idx  # nothing here moves between photos
        scene, cycles = self._scene, self._scene.cycles
        bpy.context.view_layer.material_override = self._materials["fruit_id"]
        cycles.samples, cycles.max_bounces, cycles.use_denoising = 1, 0, False
        cycles.pixel_filter_type, cycles.filter_width = "BOX", 0.01
        scene.view_settings.view_transform, scene.view_settings.look = "Raw", "None"
        scene.view_settings.exposure = 0
        scene.world.node_tree.nodes["Background"].mute = True
        self._render(camera, path)

    # ---- building ----------------------------------------------------------------------------------------------------

    def _material(self, name: str, build: materials.Builder) -> Any:
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        material.node_tree.nodes.clear()
        build(material.node_tree)
        return material

    def _add_mesh(self, name: str, mesh: Mesh, material: str, *, smooth: bool = True, pass_id: int = 0) -> Any:
        data = bpy.data.meshes.new(name)
        corners = mesh.faces.shape[1]
        data.vertices.add(len(mesh.vertices))
        data.vertices.foreach_set("co", mesh.vertices.astype(np.float32).ravel())
        data.loops.add(mesh.faces.size)
        data.loops.foreach_set("vertex_index", mesh.faces.astype(np.int32).ravel())
        data.polygons.add(len(mesh.faces))
        data.polygons.foreach_set("loop_start", np.arange(0, mesh.faces.size, corners, dtype=np.int32))
        data.polygons.foreach_set("use_smooth", np.full(len(mesh.faces), smooth))
        colours = data.color_attributes.new("Col", "FLOAT_COLOR", "POINT")
        rgba = np.column_stack([mesh.colours, np.ones(len(mesh.colours))])
        colours.data.foreach_set("color", rgba.astype(np.float32).ravel())
        data.update(calc_edges=True)
        data.materials.append(self._materials[material])
        thing = bpy.data.objects.new(name, data)
        thing.pass_index = pass_id
        self._scene.collection.objects.link(thing)
        return thing

    def _add_row(self, row: Row, marker_cells: list[IntArray]) -> None:
        self._trees = [
            (self._add_mesh(f"bark{i}", bark, "bark"), self._add_mesh(f"leaves{i}", foliage, "leaf"))
            for i, (bark, foliage) in enumerate(zip(row.bark, row.foliage, strict=True))
        ]
        self._add_mesh("posts", row.posts, "plain")
        self._add_mesh("grass", row.grass, "grass", smooth=False)
        if row.stems is not None:
            self._add_mesh("stems", row.stems, "plain")
        rng = self._options.rng(500)
        variety = VARIETIES[self._options.variety]
        for fruit_id, centre, size in zip(
            row.fruits.ids, row.fruits.centres_in_world, row.fruits.diameters_m, strict=True
        ):
            thing = self._add_mesh(f"fruit{fruit_id}", fruit(variety, size, rng), "fruit", pass_id=int(fruit_id))
            thing.location = centre
            thing.rotation_euler = (*rng.normal(0, 0.25, 2), rng.uniform(0, 2 * math.pi))
        plates = row.plates
        for cells, centre, yaw in zip(marker_cells, plates.centres_in_world, plates.yaw, strict=True):
            thing = self._add_mesh("plate", plate(cells, plates.size_m), "plain", smooth=False)
            thing.location, thing.rotation_euler = centre, (0, 0, yaw)

    def _add_background(self, row: Row) -> None:
        """Add ground, neighbour rows (the same trees turned round, without fruits) and a hedge on the horizon."""
        rng = self._options.rng(600)
        self._add_mesh("ground", ground(self._options.length_m, (0.1, 0.1, 0.1)), "ground")
        for y in (-8.2, -4.3, 4.3, 8.2):
            for x in np.arange(-7.0, self._options.length_m + 7.5, 0.95):
                turn = Matrix.Rotation(rng.uniform(0, 2 * math.pi), 4, "Z") @ Matrix.Diagonal(
                    (*rng.uniform(0.85, 1.15, 3), 1)
                )
                i = int(rng.integers(len(self._trees)))
                foot = Matrix.Translation((-row.woods[i].lines[0][0, 0], 0, 0))
                for part in self._trees[i]:
                    copy = bpy.data.objects.new("background", part.data)
                    copy.matrix_world = Matrix.Translation((x + rng.normal(0, 0.08), y, 0)) @ turn @ foot
                    self._scene.collection.objects.link(copy)
        around = hedge(self._options.length_m, (0.05, 0.05, 0.05), rng)
        self._add_mesh("hedge", around, "hedge", smooth=False)

    def _add_light(self) -> None:
        world = bpy.data.worlds.new("sky")
        self._scene.world = world
        world.use_nodes = True
        azimuth = self._options.sun_azimuth_deg
        if azimuth is None:
            azimuth = float(self._options.rng(700).uniform(0, 360))
        materials.sky(world.node_tree, LIGHTS[self._options.light], azimuth)

    def _add_camera(self) -> None:
        lens = bpy.data.cameras.new("camera")
        lens.sensor_fit, lens.sensor_width = "HORIZONTAL", 36.0
        lens.lens = self._options.focal_px * 36.0 / self._options.width_px
        self._camera = bpy.data.objects.new("camera", lens)
        self._scene.collection.objects.link(self._camera)
        self._scene.camera = self._camera

    def _set_cycles(self) -> None:
        scene = self._scene
        scene.render.engine = "CYCLES"
        scene.cycles.device = "CPU"
        scene.render.threads_mode, scene.render.threads = "FIXED", self._options.threads
        scene.render.use_persistent_data = True
        scene.render.resolution_x, scene.render.resolution_y = self._options.width_px, self._options.height_px
        scene.render.resolution_percentage = 100
        scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGB"
        scene.render.image_settings.color_depth, scene.render.dither_intensity = "8", 0.0
        scene.render.image_settings.compression = 15
        cycles = scene.cycles
        cycles.use_adaptive_sampling, cycles.adaptive_threshold = True, 0.04
        cycles.diffuse_bounces, cycles.glossy_bounces, cycles.transmission_bounces = 2, 1, 2
        cycles.caustics_reflective = cycles.caustics_refractive = False
        self._denoiser: str | None = None
        with contextlib.suppress(TypeError):  # builds of bpy without OpenImageDenoise do not know the name
            cycles.denoiser = "OPENIMAGEDENOISE"
            cycles.denoising_quality = cycles.denoising_prefilter = "FAST"
            self._denoiser = "OPENIMAGEDENOISE"

    def _render(self, camera: RowCamera, path: Path) -> None:
        right, down, ahead = camera.rotation_cam_from_world
        matrix: FloatArray = np.eye(4)
        matrix[:3, :3] = np.column_stack([right, -down, -ahead])  # Blender's camera looks along -z, y up
        matrix[:3, 3] = camera.centre_in_world
        self._camera.matrix_world = Matrix(matrix.tolist())
        self._scene.render.filepath = str(path)
        with _quiet():
            bpy.ops.render.render(write_still=True)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep Blender's own chatter off stdout, which belongs to results."""
    sys.stdout.flush()
    kept = os.dup(1)
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
