"""Light of pictures: sun from any side, high or low, clouds, deep shade, dusk; how dark a photo of it comes out."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.learning.synth.meshes import unit
from pomona.learning.synth.options import Light

NAMES = ("front", "side", "back", "low-back", "overcast", "shade", "dusk")
BACKDROP_PX = 160  # a backdrop is far away and out of focus
_SHARES = (0.17, 0.16, 0.17, 0.14, 0.16, 0.12, 0.08)  # about even, but few photograph at dusk


@dataclass(frozen=True, eq=False)
class Lighting:
    """Linear light. The camera looks along +y; `sun_towards` (3,) points at the sun, `zenith`, `horizon` are the sky.

    `glow` (3,) is added where the sky is near the sun; `bounce` is what the ground throws up; `inner` the share of
    light that leaves pass on to each other; `fog` is its colour and density a metre; `sun_size` the blur of shadows;
    `exposure` in stops, against a picture whose mean is grey.
    """

    name: str
    sun_towards: FloatArray
    sun_light: FloatArray
    zenith: FloatArray
    horizon: FloatArray
    glow: FloatArray
    bounce: FloatArray
    inner: float
    sun_size: float
    fog: FloatArray
    exposure: float

    def sky(self, towards: FloatArray) -> FloatArray:
        """Return the light (n, 3) of sky from the directions (n, 3); that of a sky of n parts sums to irradiance."""
        up = np.clip(towards[:, 2:], 0, 1)
        near = np.clip(towards @ self.sun_towards, 0, 1)[:, None] ** 4
        light = self.horizon + (self.zenith - self.horizon) * np.sqrt(up) + self.glow * near
        return np.asarray(light * 2 / len(towards))


def draw_lighting(rng: np.random.Generator) -> Lighting:
    """Return a light drawn at random."""
    name = str(rng.choice(NAMES, p=_SHARES))
    behind_camera, from_side, ahead = -np.pi / 2, 0.0, np.pi / 2
    azimuth = {"front": behind_camera, "side": from_side if rng.random() < 0.5 else np.pi, "back": ahead,
               "low-back": ahead}.get(name, rng.uniform(0, 2 * np.pi)) + rng.normal(0, 0.5)  # fmt: skip
    elevation = np.radians(rng.uniform(6, 22) if name in ("low-back", "dusk") else rng.uniform(14, 65))
    towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    low = np.exp(-((np.degrees(elevation) / 18) ** 2))  # how red the sun is
    warm = np.array([1.0, 0.94 - 0.28 * low, 0.84 - 0.5 * low])
    blue = np.array([0.55, 0.75, 1.0]) * np.exp(rng.normal(0, 0.08, 3))
    white = np.array([0.95, 1.0, 1.05])
    sun, sky, glow, exposure = 3.0 * np.exp(rng.normal(0, 0.25)), 0.55 * np.exp(rng.normal(0, 0.3)), 0.3, 0.0
    colour = blue
    if name == "overcast":
        sun, sky, glow, colour = 0.0, 1.2, 0.2, white
    elif name == "shade":
        sun, sky, glow, exposure = 0.0, 0.6, 0.0, rng.uniform(-0.9, 0.4)
        colour = blue * [0.85, 1.0, 1.1]
    elif name == "dusk":
        sun, sky, glow, exposure = rng.choice([0.0, 0.7]), 0.35, 0.5, rng.uniform(-1.6, 0.2)
    elif name in ("back", "low-back"):
        glow, exposure = 1.2, rng.uniform(-1.3, 0.5)
        sky *= 0.8
    horizon = sky * (0.6 * colour + 0.5 * white)
    haze = rng.uniform(0, 0.03) if rng.random() < 0.5 else 0.0
    return Lighting(
        name=name,
        sun_towards=unit(towards),
        sun_light=sun * warm,
        zenith=sky * colour,
        horizon=horizon,
        glow=glow * sky * warm,
        bounce=(0.25 * sun * np.sin(elevation) * warm + 0.5 * sky * colour) * [0.16, 0.17, 0.07] * rng.uniform(0.5, 2),
        inner=float(rng.uniform(0.01, 0.06)),
        sun_size=float(rng.uniform(0.0006, 0.003)),
        fog=np.array([*(horizon * 0.9), haze]),
        exposure=float(exposure + rng.normal(0.15, 0.45)),
    )


def row_lighting(light: Light, azimuth_deg: float) -> Lighting:
    """Return the light of a rendered row, the sun `azimuth_deg` clockwise from +y."""
    elevation, azimuth = np.radians([light.sun_elevation_deg, azimuth_deg])
    towards = np.array([np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)])
    low = np.exp(-((light.sun_elevation_deg / 18) ** 2))
    warm = np.array([1.0, 0.94 - 0.28 * low, 0.84 - 0.5 * low])
    blue, white = np.array([0.55, 0.75, 1.0]), np.array([0.95, 1.0, 1.05])
    sun, sky = 3.0 * (1 - light.clouds) ** 1.5, 0.55 + 0.65 * light.clouds
    colour = (1 - light.clouds) * blue + light.clouds * white
    horizon = sky * (0.6 * colour + 0.5 * white)
    return Lighting(
        name="row",
        sun_towards=towards,
        sun_light=sun * warm,
        zenith=sky * colour,
        horizon=horizon,
        glow=0.3 * sky * warm,
        bounce=(0.25 * sun * np.sin(elevation) * warm + 0.5 * sky * colour) * [0.16, 0.17, 0.07],
        inner=0.03,
        sun_size=0.0006 + 0.004 * light.clouds,
        fog=np.array([*(horizon * 0.9), 0.004 * (light.haze - 1)]),
        exposure=0.2,
    )


def backdrop(lighting: Lighting, foliage: FloatArray | None, rng: np.random.Generator) -> FloatArray:
    """Return what is seen behind the trees (h, w, 3), linear, lowest row first: sky over a horizon, or far foliage.

    `foliage` (h, w, 3) is linear, of a photo.
    """
    size = BACKDROP_PX
    up = np.linspace(-1, 1, size)[:, None, None]
    ahead = unit(np.concatenate([np.zeros((size, 1)), np.ones((size, 1)), np.linspace(-0.2, 0.9, size)[:, None]], 1))
    sky = lighting.sky(np.maximum(ahead, [-1, -1, 0.02]))[:, None] * size / 2 * np.ones((1, size, 1))
    edge = rng.uniform(-0.6, 0.5)
    crest = np.cumsum(rng.normal(0, 0.03, size)) - rng.uniform(-0.05, 0.05)
    share = np.clip((up - (edge + crest)[None, :, None]) * 8 + 0.5, 0, 1)
    level = float(lighting.bounce.mean() + lighting.zenith.mean() * 0.05)
    dark = np.array([0.5, 0.8, 0.3]) * level * rng.uniform(0.3, 1.2)
    leaves = cv2.resize(rng.lognormal(0, 0.6, (size // 3, size // 3)), (size, size), interpolation=cv2.INTER_CUBIC)
    wood = dark * np.clip(leaves, 0.05, 4)[:, :, None]
    if foliage is not None:
        wood = foliage[::-1] / max(float(foliage.mean()), 1e-3) * level * rng.uniform(0.4, 2.0)
        if rng.random() < 0.4:
            return np.asarray(wood)
    return np.asarray(share * sky + (1 - share) * wood)
