"""From linear light to a photo: exposure, tone curve, white balance, blur, a sensor's noise."""

from __future__ import annotations

import cv2
import numpy as np

from pomona.basics.arrays import Array, ByteArray, FloatArray

_GREY = 0.13  # linear, of the mean of a picture exposed as a camera does


def develop(light: FloatArray, exposure: float, rng: np.random.Generator) -> ByteArray:
    """Return the photo uint8 (h, w, 3) RGB of linear light (h, w, 3), `exposure` stops from a camera's own."""
    image: Array = np.asarray(light, np.float32)
    metered = float(np.exp(np.mean(np.log(image.mean(2) + 1e-3)))) * 0.5 + float(image.mean()) * 0.5
    image = image * np.float32(_GREY / max(metered, 1e-4) * 2.0**exposure)
    image = image * np.exp(rng.normal(0, 0.05, 3)).astype(np.float32)
    image = _blurred(image, rng)
    noise = np.exp(rng.uniform(np.log(0.002), np.log(0.02)))
    spread = noise * np.sqrt(np.clip(image, 0, 2) * 0.5 + 0.02)
    image = image + spread * rng.standard_normal(image.shape, np.float32)
    image = np.clip(image, 0, None)
    shoulder = rng.uniform(2.0, 6.0)
    image = image * (1 + image / shoulder**2) / (1 + image)  # Reinhard's curve: highlights fade out
    image = np.clip(image * rng.uniform(1.25, 1.5), 0, 1) ** np.float32(1 / rng.uniform(1.9, 2.4))
    curve = rng.uniform(0.1, 1.2)  # contrast
    image = image + curve * image * (1 - image) * (2 * image - 1)
    grey = image.mean(2, keepdims=True)
    image = grey + rng.uniform(0.85, 1.35) * (image - grey)
    result: ByteArray = (np.clip(image, 0, 1) * 255).astype(np.uint8)
    return result


def _blurred(image: Array, rng: np.random.Generator) -> Array:
    """A lens's softness; at times a hand that moved, or a little out of focus."""
    chance = rng.random()
    if chance < 0.08:
        size = int(rng.integers(3, 10))
        kernel = np.zeros((size, size), np.float32)
        turn = rng.uniform(0, np.pi)
        middle = (size - 1) / 2
        reach = np.array([np.cos(turn), np.sin(turn)]) * middle
        start, end = (tuple(round(float(v)) for v in middle + s * reach) for s in (-1, 1))
        cv2.line(kernel, start, end, 1.0)
        return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()))
    sigma = rng.uniform(0.9, 1.8) if chance < 0.2 else rng.uniform(0.2, 0.7)
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma))
