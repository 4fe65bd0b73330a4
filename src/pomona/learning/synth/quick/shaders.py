"""The programs that OpenGL runs: of shadow maps, of what is seen in each pixel, of the light there.

Materials are those of `scene`: a leaf below a quarter, then a fruit, and above three quarters all else; above one and a
half, what reaches far away.
"""

SKY_MAPS = 10
"""Directions from which the sky shines, each with a shadow map."""

SHADOW_VERTEX = """
#version 330
uniform mat4 clip_from_world;
in vec3 place;
void main() { gl_Position = clip_from_world * vec4(place, 1.0); }
"""
SHADOW_FRAGMENT = """
#version 330
void main() {}
"""
SEEN_VERTEX = """
#version 330
uniform mat4 clip_from_world;
uniform mat4 world_from_scene;
in vec3 place; in vec3 normal; in vec3 colour; in float material; in float fruit;
out vec3 local; out vec3 facing; out vec3 paint; flat out float kind; flat out float id;
void main() {
    local = place; facing = normal; paint = colour; kind = material; id = fruit;
    gl_Position = clip_from_world * world_from_scene * vec4(place, 1.0);
}
"""
SEEN_FRAGMENT = """
#version 330
uniform vec3 eye;
uniform mat4 world_from_scene;
uniform float ignored_id;
in vec3 local; in vec3 facing; in vec3 paint; flat in float kind; flat in float id;
layout(location=0) out vec4 at; layout(location=1) out vec4 normal; layout(location=2) out vec4 albedo;
float hash(vec3 p) { p = fract(p * 0.3183 + 0.1); p *= 17.0; return fract(p.x * p.y * p.z * (p.x + p.y + p.z)); }
float noise(vec3 x) {
    vec3 i = floor(x), f = fract(x); f = f * f * (3.0 - 2.0 * f);
    return mix(mix(mix(hash(i), hash(i + vec3(1,0,0)), f.x),
                   mix(hash(i + vec3(0,1,0)), hash(i + vec3(1,1,0)), f.x), f.y),
               mix(mix(hash(i + vec3(0,0,1)), hash(i + vec3(1,0,1)), f.x),
                   mix(hash(i + vec3(0,1,1)), hash(i + vec3(1,1,1)), f.x), f.y), f.z);
}
float grain(float waves) {
    float pixel = length(fwidth(local)) * waves;  // what is finer than a pixel would flicker from picture to picture
    return mix(noise(local * waves), 0.5, smoothstep(0.3, 0.7, pixel));
}
void main() {
    vec3 n = dot(facing, facing) > 1e-8 ? normalize(facing) : vec3(0.0, 0.0, 1.0);
    vec3 view = normalize(eye - (world_from_scene * vec4(local, 1.0)).xyz);
    if (dot(mat3(world_from_scene) * n, view) < 0.0) n = -n;
    vec3 tint = paint;
    if (kind < 0.25) tint *= 0.75 + 0.5 * noise(local * 60.0);
    else if (kind < 0.75) {
        tint *= 0.85 + 0.3 * noise(local * 110.0);
        tint *= 1.0 + 0.35 * smoothstep(0.88, 0.96, noise(local * 420.0));
        vec3 uneven = vec3(noise(local * 200.0), noise(local * 200.0 + 7.0), noise(local * 200.0 + 19.0));
        n = normalize(n + 0.05 * (uneven - 0.5));
    }
    else if (kind < 1.5) tint *= 0.5 + noise(local * 45.0) * 0.6 + noise(local * 7.0) * 0.4;
    else {
        tint *= (0.4 + 1.2 * grain(0.9)) * (0.6 + 0.8 * grain(6.0));
        tint *= (0.5 + 1.0 * grain(38.0)) * (0.7 + 0.6 * grain(110.0));
    }
    at = vec4(local, (id > 0.5 && ignored_id > 0.5) ? ignored_id : id);
    normal = vec4(n, kind);
    albedo = vec4(tint, 1.0);
}
"""
LIGHT_VERTEX = """
#version 330
in vec2 corner;
out vec2 uv;
void main() { uv = corner * 0.5 + 0.5; gl_Position = vec4(corner, 0.0, 1.0); }
"""
LIGHT_FRAGMENT = """
#version 330
const int MAPS = SKY_MAPS;
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
    float fresnel = 0.04 + 0.96 * pow(clamp(1.0 - dot(n, view), 0.0, 1.0), 5.0);
    vec3 halfway = normalize(view + sun_towards);
    float sharp = fruit ? mix(12.0, 90.0, gloss) : 30.0, strength = fruit ? gloss : (leaf ? 0.45 : 0.05);
    float spot = 0.04 * (sharp + 2.0) / 8.0 * pow(max(dot(n, halfway), 0.0), sharp);
    light += strength * spot * max(c, 0.0) * lit * sun_light;
    light += strength * fresnel * shine * 0.6;
    float away = length(eye - at.xyz);
    result = vec4(mix(light, fog.rgb, 1.0 - exp(-fog.a * away)), 1.0);
}
""".replace("SKY_MAPS", str(SKY_MAPS))
