"""Draws a scene with OpenGL, on a GPU or on the CPU (Mesa): the one module that imports `moderngl`.

What is seen in each pixel is drawn first (place, normal, colour, id), then lit: by a sun with a shadow map, and by a
sky of a few directions, each with a shadow map of its own, which makes the inside of a crown as dark as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pomona.arrays import FloatArray
from pomona.errors import MissingExtraError
from pomona.synth.quick.lights import Lighting
from pomona.synth.quick.scene import Scene

try:
    import moderngl
except ImportError as missing:
    raise MissingExtraError(
        "Drawing pictures needs OpenGL for Python (moderngl), which is not installed here; "
        "run: pip install 'pomona[synth]'"
    ) from missing

Float32Array = npt.NDArray[np.float32]

_SUN_MAP_PX, _SKY_MAP_PX = 2048, 512
_SKY_MAPS = 10

_SHADOW_VERTEX = """
#version 330
uniform mat4 clip_from_world;
in vec3 place;
void main() { gl_Position = clip_from_world * vec4(place, 1.0); }
"""
_SHADOW_FRAGMENT = """
#version 330
void main() {}
"""
_SEEN_VERTEX = """
#version 330
uniform mat4 clip_from_world;
uniform vec3 offset;
uniform vec3 eye;
in vec3 place; in vec3 normal; in vec3 colour; in float material; in float fruit;
out vec3 local; out vec3 facing; out vec3 paint; flat out float kind; flat out float id;
void main() {
    local = place; facing = normal; paint = colour; kind = material; id = fruit;
    gl_Position = clip_from_world * vec4(place + offset, 1.0);
}
"""
_SEEN_FRAGMENT = """
#version 330
uniform vec3 eye;
uniform vec3 offset;
uniform float ignored_id;
in vec3 local; in vec3 facing; in vec3 paint; flat in float kind; flat in float id;
layout(location=0) out vec4 at; layout(location=1) out vec4 normal; layout(location=2) out vec4 albedo;
float hash(vec3 p) { p = fract(p * 0.3183 + 0.1); p *= 17.0; return fract(p.x * p.y * p.z * (p.x + p.y + p.z)); }
float noise(vec3 x) {
    vec3 i = floor(x), f = fract(x); f = f * f * (3.0 - 2.0 * f);
    return mix(mix(mix(hash(i), hash(i + vec3(1,0,0)), f.x), mix(hash(i + vec3(0,1,0)), hash(i + vec3(1,1,0)), f.x), f.y),
               mix(mix(hash(i + vec3(0,0,1)), hash(i + vec3(1,0,1)), f.x),
                   mix(hash(i + vec3(0,1,1)), hash(i + vec3(1,1,1)), f.x), f.y), f.z);
}
void main() {
    vec3 n = normalize(facing);
    vec3 view = normalize(eye - (local + offset));
    if (dot(n, view) < 0.0) n = -n;
    vec3 tint = paint;
    if (kind < 0.25) tint *= 0.75 + 0.5 * noise(local * 60.0);
    else if (kind < 0.75) {
        tint *= 0.85 + 0.3 * noise(local * 110.0);
        tint *= 1.0 + 0.35 * smoothstep(0.88, 0.96, noise(local * 420.0));
        n = normalize(n + 0.05 * (vec3(noise(local * 200.0), noise(local * 200.0 + 7.0), noise(local * 200.0 + 19.0)) - 0.5));
    }
    else tint *= 0.5 + noise(local * 45.0) * 0.6 + noise(local * 7.0) * 0.4;
    at = vec4(local, (id > 0.5 && ignored_id > 0.5) ? ignored_id : id);
    normal = vec4(n, kind);
    albedo = vec4(tint, 1.0);
}
"""
_LIGHT_VERTEX = """
#version 330
in vec2 corner;
out vec2 uv;
void main() { uv = corner * 0.5 + 0.5; gl_Position = vec4(corner, 0.0, 1.0); }
"""
_LIGHT_FRAGMENT = """
#version 330
const int MAPS = %d;
uniform sampler2D at_map; uniform sampler2D normal_map; uniform sampler2D albedo_map; uniform sampler2D backdrop;
uniform sampler2DArray sky_shadows; uniform sampler2DShadow sun_shadow;
uniform mat4 sky_from_world[MAPS]; uniform vec3 sky_towards[MAPS]; uniform vec3 sky_light[MAPS];
uniform mat4 sun_from_world; uniform vec3 sun_towards; uniform vec3 sun_light;
uniform vec3 bounce; uniform vec3 eye; uniform float gloss; uniform float inner; uniform float sun_size;
uniform vec4 fog;
in vec2 uv;
layout(location=0) out vec4 result;
float random(vec2 p) { return fract(sin(dot(p, vec2(12.9898, 78.233))) * 43758.5453); }
void main() {
    vec4 at = texture(at_map, uv);
    vec4 nk = texture(normal_map, uv);
    vec4 tint = texture(albedo_map, uv);
    if (tint.a < 0.5) { result = vec4(texture(backdrop, uv).rgb, 0.0); return; }
    vec3 n = nk.xyz, paint = tint.rgb, view = normalize(eye - at.xyz);
    bool leaf = nk.w < 0.25, fruit = nk.w > 0.25 && nk.w < 0.75;
    vec3 through = leaf ? vec3(1.5, 1.7, 0.6) * paint * 0.45 : vec3(0.0);
    vec3 diffuse = leaf ? paint * 0.7 : paint;
    vec3 light = vec3(0.0), shine = vec3(0.0), sky_seen = vec3(0.0);
    vec3 mirrored = reflect(-view, n);
    float seen = 0.0, most = 0.0;
    for (int k = 0; k < MAPS; k++) {
        vec3 p = (sky_from_world[k] * vec4(at.xyz + n * 0.012, 1.0)).xyz * 0.5 + 0.5;
        vec2 jitter = (vec2(random(gl_FragCoord.xy + k), random(gl_FragCoord.yx - k)) - 0.5) * 6.0 / 512.0;
        float depth = texture(sky_shadows, vec3(p.xy + jitter, float(k))).r;
        float open = p.z - 0.004 < depth ? 1.0 : 0.0;
        if (any(lessThan(p, vec3(0.0))) || any(greaterThan(p, vec3(1.0)))) open = 1.0;
        float c = dot(n, sky_towards[k]);
        light += sky_light[k] * open * (diffuse * max(c, 0.0) + through * max(-c, 0.0));
        if (fruit) light += sky_light[k] * open * diffuse * 0.12 * max(0.0, 1.0 - abs(c));
        seen += open; most += 1.0;
        shine += sky_light[k] * open * pow(max(dot(mirrored, sky_towards[k]), 0.0), 4.0);
        sky_seen += sky_light[k];
    }
    seen /= most;
    vec3 p = (sun_from_world * vec4(at.xyz + n * 0.005, 1.0)).xyz * 0.5 + 0.5;
    float lit = 0.0;
    for (int k = 0; k < 5; k++) {
        float turn = 6.2832 * (random(gl_FragCoord.xy) + float(k) / 5.0);
        vec2 step = vec2(cos(turn), sin(turn)) * sqrt((float(k) + 0.5) / 5.0) * sun_size;
        lit += texture(sun_shadow, vec3(p.xy + step, p.z - 0.0012)) / 5.0;
    }
    if (any(lessThan(p, vec3(0.0))) || any(greaterThan(p, vec3(1.0)))) lit = 1.0;  // beyond the map
    float c = dot(n, sun_towards);
    light += sun_light * lit * (diffuse * max(c, 0.0) + through * max(-c, 0.0));
    if (fruit) light += sun_light * lit * diffuse * vec3(0.16, 0.09, 0.05) * max(0.0, 1.0 - abs(c + 0.2));
    light += diffuse * bounce * (0.55 - 0.45 * n.z) * (0.25 + 0.75 * seen);
    light += diffuse * inner * sky_seen * vec3(0.7, 1.0, 0.5) / most;  // what leaves pass on to each other
    float fresnel = 0.04 + 0.96 * pow(1.0 - max(dot(n, view), 0.0), 5.0);
    vec3 halfway = normalize(view + sun_towards);
    float sharp = fruit ? mix(12.0, 90.0, gloss) : 30.0, strength = fruit ? gloss : (leaf ? 0.45 : 0.05);
    light += strength * (0.04 * (sharp + 2.0) / 8.0 * pow(max(dot(n, halfway), 0.0), sharp) * max(c, 0.0) * lit * sun_light);
    light += strength * fresnel * shine * 0.6;
    float away = length(eye - at.xyz);
    result = vec4(mix(light, fog.rgb, 1.0 - exp(-fog.a * away)), 1.0);
}
""" % _SKY_MAPS


@dataclass(frozen=True, eq=False)
class View:
    """Where the camera stands: `clip_from_world` (4, 4), its place, and the picture's size in pixels."""

    clip_from_world: FloatArray
    eye: FloatArray
    width_px: int
    height_px: int


class Painter:
    """Draws one scene after another; one at a time in a process."""

    def __init__(self) -> None:
        try:
            self._context = moderngl.create_context(standalone=True, backend="egl", require=330)
        except Exception as error:  # moderngl raises plain exceptions
            raise MissingExtraError(
                f"OpenGL cannot be used here ({error}); on Debian, install libegl1 and libgl1-mesa-dri"
            ) from error
        self._shadow = self._context.program(vertex_shader=_SHADOW_VERTEX, fragment_shader=_SHADOW_FRAGMENT)
        self._seen = self._context.program(vertex_shader=_SEEN_VERTEX, fragment_shader=_SEEN_FRAGMENT)
        self._light = self._context.program(vertex_shader=_LIGHT_VERTEX, fragment_shader=_LIGHT_FRAGMENT)
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
        self._sky = context.texture_array((_SKY_MAP_PX, _SKY_MAP_PX, _SKY_MAPS), 1, layers.tobytes(), dtype="f4")
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

    def draw(self, view: View, lighting: Lighting, backdrop: Float32Array) -> tuple[Float32Array, Float32Array]:
        """Return linear light (h, w, 3) and ids (h, w), 0 where there is no fruit; `backdrop` (h', w', 3) is far off."""
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
        for away_m, ignored in ((0.0, 0.0), *((m, 60_000.0) for m in self._scene.rows_m)):
            self._seen["offset"].value = (0.0, away_m, 0.0)
            self._seen["ignored_id"].value = ignored
            self._drawn.render()
        behind = context.texture(backdrop.shape[1::-1], 3, np.ascontiguousarray(backdrop, np.float32).tobytes(), dtype="f4")
        result = context.texture(size, 4, dtype="f4")
        picture = context.framebuffer([result])
        picture.use()
        context.disable(moderngl.DEPTH_TEST)
        self._set_lights(lighting, view, sun_view)
        for unit, texture in enumerate((*layers, behind, self._sky, sun)):
            texture.use(unit)
        self._square.render(moderngl.TRIANGLE_STRIP)
        light = np.frombuffer(result.read(), np.float32).reshape(*size[::-1], 4)[::-1, :, :3]
        ids = np.frombuffer(layers[0].read(), np.float32).reshape(*size[::-1], 4)[::-1, :, 3]
        for thing in (*layers, depth, frame, behind, result, picture, sun):
            thing.release()
        return light, ids

    def _set_lights(self, lighting: Lighting, view: View, sun_view: FloatArray) -> None:
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
    k = np.arange(_SKY_MAPS)
    z = (k + 0.5) / _SKY_MAPS * 0.95 + 0.04
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
