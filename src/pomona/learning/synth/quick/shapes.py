"""Bodies of fruits as meshes: spheres made longer, flatter, pear-shaped, grooved; widest diameter as asked."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.learning.synth.meshes import Mesh, fruit, fruit_skin, grid_faces, smooth_noise
from pomona.learning.synth.quick.looks import FruitLook

_RINGS, _SEGMENTS = 18, 24
# Height over width, and how much it varies.
_ASPECTS = {"pear": (1.4, 0.12), "orange": (0.97, 0.03), "mandarin": (0.8, 0.03), "lemon": (1.3, 0.08),
            "peach": (0.95, 0.03), "plum": (1.2, 0.1), "cherry": (0.93, 0.03), "mango": (1.45, 0.1),
            "kiwi": (1.3, 0.08), "tomato": (0.82, 0.06)}  # fmt: skip


def fruit_mesh(look: FruitLook, diameter_m: float, rng: np.random.Generator) -> Mesh:
    """Return a fruit of a look around the origin, stem up, `diameter_m` wide."""
    if look.shape == "apple":
        return fruit(look.skin, diameter_m, rng)
    polar, azimuth = np.meshgrid(
        np.linspace(1e-3, np.pi - 1e-3, _RINGS), np.linspace(0, 2 * np.pi, _SEGMENTS, endpoint=False), indexing="ij"
    )
    polar, azimuth = polar.ravel(), azimuth.ravel()
    n = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)
    stem, calyx = np.exp(-((polar / 0.4) ** 2)), np.exp(-(((np.pi - polar) / 0.3) ** 2))
    vertices = n * (_reach(look.shape, n, azimuth) * (1 + 0.012 * smooth_noise(n, rng, 1.2)))[:, None]
    vertices[:, 2] -= look.skin.cleft * 1.2 * stem * (look.shape in ("peach", "cherry", "tomato", "orange", "mandarin"))
    if look.shape == "mango":
        vertices[:, 0] += 0.18 * n[:, 2] ** 2
    if look.shape == "lemon":
        vertices[:, 2] += 0.25 * (np.exp(-((polar / 0.3) ** 2)) - np.exp(-(((np.pi - polar) / 0.3) ** 2)))
    width = np.ptp(vertices[:, :2], axis=0).max()
    mean, spread = _ASPECTS[look.shape]
    height = np.ptp(vertices[:, 2])
    vertices[:, 2] *= rng.normal(mean, spread / 2) * width / height
    vertices[:, 2] -= (vertices[:, 2].max() + vertices[:, 2].min()) / 2
    colours = fruit_skin(look.skin, n, 0.25 * stem, 0.4 * calyx, rng)
    if look.shape == "tomato":  # sepals
        star = (polar < 0.35 + 0.3 * np.cos(5 * azimuth)) | (polar < 0.2)
        colours[star] = np.array([0.07, 0.16, 0.03]) * rng.uniform(0.7, 1.3)
    return Mesh(vertices * diameter_m / width, grid_faces(_RINGS, _SEGMENTS, wrap=True), colours)


def _reach(shape: str, n: FloatArray, azimuth: FloatArray) -> FloatArray:
    """How far (n,) the body reaches in the directions `n` (n, 3)."""
    reach = np.ones(len(n))
    if shape == "pear":  # a neck below the stem
        up = np.clip((n[:, 2] + 0.1) / 1.1, 0, 1)
        reach = 1 - 0.45 * np.sin(np.pi / 2 * up) ** 2 * (1 - 0.6 * up**6)
    elif shape in ("peach", "plum"):  # a groove from stem to tip
        reach = 1 - (0.07 if shape == "peach" else 0.03) * np.exp(-((np.angle(np.exp(1j * azimuth)) / 0.18) ** 2))
    elif shape == "tomato":
        reach = 1 + 0.025 * np.cos(5 * azimuth) * (1 - n[:, 2] ** 2)
    return np.asarray(reach)
