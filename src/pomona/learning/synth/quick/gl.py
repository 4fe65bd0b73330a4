"""Draws a scene with OpenGL, on a GPU or on the CPU (Mesa): the one module that imports `moderngl`.

What is seen in each pixel is drawn first (place, normal, colour, id), then lit: by a sun with a shadow map, and by a
sky of a few directions, each with a shadow map of its own, which makes the inside of a crown as dark as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pomona.basics.arrays import Float32Array, FloatArray
from pomona.errors import MissingExtraError
from pomona.learning.synth.quick import shaders
from pomona.learning.synth.quick.lights import Lighting
from pomona.learning.synth.quick.scene import FALLEN, Scene
from pomona.learning.synth.quick.shaders import SKY_MAPS

try:
    import moderngl
except ImportError as missing:
    raise MissingExtraError(
        "Drawing pictures needs OpenGL for Python (moderngl), which is not installed here; "
        "run: pip install 'pomona[synth]'"
    ) from missing


_SUN_MAP_PX, _SKY_MAP_PX = 2048, 512


@dataclass(frozen=True, eq=False)
class GlView:
    """Where the camera stands: `clip_from_world` (4, 4), its place, and the picture's size in pixels."""

    clip_from_world: FloatArray
    eye: FloatArray
    width_px: int
    height_px: int


class Painter:
    """Draws one scene after another; one at a time in a process."""

    def __init__(self) -> None:
        try:
            library: Any = moderngl  # whose annotations do not allow for what it takes
            self._context: Any = library.create_context(standalone=True, backend="egl", require=330)
        except Exception as error:  # moderngl raises plain exceptions
            raise MissingExtraError(
                f"OpenGL cannot be used here ({error}); on Debian, install libegl1 and libgl1-mesa-dri"
            ) from error
        self._shadow: Any = self._context.program(
            vertex_shader=shaders.SHADOW_VERTEX, fragment_shader=shaders.SHADOW_FRAGMENT
        )
        self._seen: Any = self._context.program(
            vertex_shader=shaders.SEEN_VERTEX, fragment_shader=shaders.SEEN_FRAGMENT
        )
        self._light: Any = self._context.program(
            vertex_shader=shaders.LIGHT_VERTEX, fragment_shader=shaders.LIGHT_FRAGMENT
        )
        corners = self._context.buffer(np.array([-1, -1, 1, -1, -1, 1, 1, 1], np.float32).tobytes())
        self._square = self._context.vertex_array(self._light, [(corners, "2f", "corner")])
        self._kept: list[Any] = []

    def take(self, scene: Scene) -> None:
        """Make a scene the one that is drawn, and find which parts of the sky each of its places sees."""
        for thing in self._kept:
            thing.release()
        context = self._context
        vertices = context.buffer(scene.vertices.tobytes())
        indices = context.buffer(scene.triangles.tobytes())
        places = context.buffer(np.ascontiguousarray(scene.vertices[:, :3]).tobytes())
        self._bare = context.vertex_array(self._shadow, [(places, "3f", "place")], indices)
        names = ("place", "normal", "colour", "material", "fruit")
        self._drawn = context.vertex_array(self._seen, [(vertices, "3f 3f 3f 1f 1f", *names)], indices)
        self._scene = scene
        self._sky_towards = _sky_directions()
        self._sky_from_world = [_light_view(towards, scene) for towards in self._sky_towards]
        layers = np.concatenate([self._depths(view, _SKY_MAP_PX).ravel() for view in self._sky_from_world])
        self._sky = context.texture_array((_SKY_MAP_PX, _SKY_MAP_PX, SKY_MAPS), 1, layers.tobytes(), dtype="f4")
        self._sky.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._kept = [vertices, indices, places, self._bare, self._drawn, self._sky]

    def _depths(self, view: FloatArray, size: int) -> Float32Array:
        texture = self._shadow_map(view, size)
        depths = np.frombuffer(texture.read(), np.float32).reshape(size, size)
        texture.release()
        return depths

    def _shadow_map(self, view: FloatArray, size: int) -> Any:
        context = self._context
        texture = context.depth_texture((size, size))
        frame = context.framebuffer(depth_attachment=texture)
        frame.use()
        frame.clear(depth=1.0)
        context.enable_only(moderngl.DEPTH_TEST)
        self._shadow["clip_from_world"].write(_column_major(view))
        self._bare.render()
        frame.release()
        return texture

    def draw(self, view: GlView, lighting: Lighting, backdrop: Float32Array) -> tuple[Float32Array, Float32Array]:
        """Return linear light (h, w, 3) and ids (h, w), 0 where there is no fruit; `backdrop` lies behind."""
        context, size = self._context, (view.width_px, view.height_px)
        sun_view = _light_view(lighting.sun_towards, self._scene)
        sun = self._shadow_map(sun_view, _SUN_MAP_PX)
        sun.compare_func = "<="
        sun.filter = (moderngl.LINEAR, moderngl.LINEAR)
        layers = [context.texture(size, 4, dtype="f4") for _ in range(3)]
        for layer in layers:
            layer.filter = (moderngl.NEAREST, moderngl.NEAREST)
        depth = context.depth_renderbuffer(size)
        frame = context.framebuffer(layers, depth)
        frame.use()
        frame.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
        context.enable_only(moderngl.DEPTH_TEST)
        self._seen["clip_from_world"].write(_column_major(view.clip_from_world))
        self._seen["eye"].value = tuple(view.eye)
        self._draw_part(np.eye(4), 0.0, 0, len(self._scene.triangles))
        for copy in self._scene.copies:
            self._draw_part(copy.world_from_scene, FALLEN, *copy.triangles)
        behind = context.texture(
            backdrop.shape[1::-1], 3, np.ascontiguousarray(backdrop, np.float32).tobytes(), dtype="f4"
        )
        result = context.texture(size, 4, dtype="f4")
        picture = context.framebuffer([result])
        picture.use()
        context.disable(moderngl.DEPTH_TEST)
        self._set_lights(lighting, view, sun_view)
        for unit, texture in enumerate((*layers, behind, self._sky, sun)):
            texture.use(unit)
        self._square.render(moderngl.TRIANGLE_STRIP)
        # At the very edge of a triangle, colours and normals are extrapolated: light may come out below 0, or none.
        light = np.maximum(np.nan_to_num(np.frombuffer(result.read(), np.float32), nan=0.0, posinf=0.0), 0)
        light = light.reshape(*size[::-1], 4)[::-1, :, :3]
        ids = np.frombuffer(layers[0].read(), np.float32).reshape(*size[::-1], 4)[::-1, :, 3]
        for thing in (*layers, depth, frame, behind, result, picture, sun):
            thing.release()
        return light, ids

    def _draw_part(self, world_from_scene: FloatArray, ignored_id: float, first: int, end: int) -> None:
        self._seen["world_from_scene"].write(_column_major(world_from_scene))
        self._seen["ignored_id"].value = ignored_id
        self._drawn.render(vertices=3 * (end - first), first=3 * first)

    def _set_lights(self, lighting: Lighting, view: GlView, sun_view: FloatArray) -> None:
        program = self._light
        names = ("at_map", "normal_map", "albedo_map", "backdrop", "sky_shadows", "sun_shadow")
        for unit, name in enumerate(names):
            program[name].value = unit
        program["sky_from_world"].write(b"".join(_column_major(m) for m in self._sky_from_world))
        program["sky_towards"].write(self._sky_towards.astype(np.float32).tobytes())
        program["sky_light"].write(lighting.sky(self._sky_towards).astype(np.float32).tobytes())
        program["sun_from_world"].write(_column_major(sun_view))
        for name, value in (("sun_towards", lighting.sun_towards), ("sun_light", lighting.sun_light),
                            ("bounce", lighting.bounce), ("eye", view.eye), ("fog", lighting.fog)):  # fmt: skip
            program[name].value = tuple(float(v) for v in value)
        program["gloss"].value = self._scene.gloss
        program["inner"].value = lighting.inner
        program["sun_size"].value = lighting.sun_size


def _sky_directions() -> FloatArray:
    """Directions (n, 3) over the upper half of the sphere, each of as large a part of the sky."""
    k = np.arange(SKY_MAPS)
    z = (k + 0.5) / SKY_MAPS * 0.95 + 0.04
    turn = 2.39996 * k
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


def _light_view(towards: FloatArray, scene: Scene) -> FloatArray:
    """The parallel projection (4, 4) of the scene as seen from a direction."""
    ahead = -np.asarray(towards, float)
    right = np.cross(ahead, [0.0, 0.0, 1.0] if abs(ahead[2]) < 0.95 else [1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    rotation = np.stack([right, up, ahead])
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    seen = (scene.low + corners * (scene.high - scene.low)) @ rotation.T
    low, high = seen.min(0), seen.max(0)
    view = np.eye(4)
    scale = 2 / (high - low)
    view[:3, :3] = rotation * scale[:, None]
    view[:3, 3] = -(low + high) / 2 * scale
    return np.asarray(view)


def _column_major(matrix: FloatArray) -> bytes:
    return np.ascontiguousarray(matrix.T, np.float32).tobytes()
