"""Crops in other light and from other cameras: colour, exposure, shade, blur, noise, compression."""

from __future__ import annotations

import cv2
import numpy as np

from pomona.basics.arrays import Array, ByteArray


def _shade(shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Return factors (h, w, 3) of the light where leaves throw shade: patches with soft edges, bluish as the sky."""
    cells = int(rng.integers(2, 9))
    field = cv2.resize(rng.standard_normal((cells, cells), np.float32), shape[::-1], interpolation=cv2.INTER_CUBIC)
    edge = rng.uniform(0.05, 0.6)
    shaded = np.clip((field - rng.uniform(-0.7, 0.7)) / edge + 0.5, 0, 1)[:, :, None]
    light = np.exp(rng.uniform(-1.7, -0.3)) * np.array([rng.uniform(0.8, 1.0), 1.0, rng.uniform(1.0, 1.25)])
    factors: Array = (1 - shaded * (1 - light)).astype(np.float32)
    return factors


def recolour(pixels: ByteArray, rng: np.random.Generator, shaded: float = 0.0) -> ByteArray:
    """Return the crop in another light and from another camera: colour, exposure, white balance, blur, noise."""
    hsv = cv2.cvtColor(pixels, cv2.COLOR_RGB2HSV).astype(np.float32)
    hsv[:, :, 0] = (hsv[:, :, 0] + rng.uniform(-9, 9)) % 180
    hsv[:, :, 1] = np.clip(hsv[:, :, 1] * rng.uniform(0.55, 1.4), 0, 255)
    image = cv2.cvtColor(hsv.astype(np.uint8), cv2.COLOR_HSV2RGB).astype(np.float32) / 255
    dark = rng.random() < 0.35  # in the shade, or against the light
    image = image ** np.float32(np.exp(rng.uniform(0.1, 0.8) if dark else rng.uniform(-0.35, 0.5)))
    gain = np.exp(rng.uniform(-1.3, -0.2) if dark else rng.uniform(-0.35, 0.15))
    image *= (gain * np.exp(rng.uniform(-0.1, 0.1, 3))).astype(np.float32)
    if not dark and shaded > 0 and rng.random() < shaded:
        shade = _shade(image.shape[:2], rng)
        image *= shade
        if rng.random() < 0.5:  # the darker, the grainier: what cameras and renderers make of deep shade
            grain = rng.standard_normal(image.shape, np.float32) * rng.uniform(0.05, 0.4)
            image *= 1 + grain.astype(np.float32) * (1 - shade)
    if rng.random() < 0.25:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 1.6))
    if rng.random() < 0.4:  # a sensor's noise: of reading out, and of light, which grows with its root
        spread = rng.uniform(0.003, 0.03) + rng.uniform(0, 0.1) * np.sqrt(np.clip(image, 0, 1))
        image += spread.astype(np.float32) * rng.standard_normal(image.shape, np.float32)
    result = (np.clip(image, 0, 1) * 255).astype(np.uint8)
    if rng.random() < 0.3:
        result = _compressed(result, int(rng.integers(35, 90)))
    return np.ascontiguousarray(result)


def as_phones_show(pixels: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Return the crop as frames of a phone's video look: little contrast between light and shade, which lifts what is
    dark, colours without texture, edges drawn sharp, much compression, enlarged.
    """
    image = pixels.astype(np.float32) / 255
    light = np.log(image.mean(2) + 0.02)
    spread_px = rng.uniform(0.03, 0.15) * len(pixels)
    around = cv2.GaussianBlur(light, (0, 0), spread_px)
    # A phone lights every part of the picture alike; fruits, smaller than such a part, keep some of their shading.
    evened = (rng.uniform(0.3, 0.9) - 1) * (around - around.mean()) + (rng.uniform(0.6, 1.0) - 1) * (light - around)
    image = image * np.exp(evened + rng.uniform(-0.1, 0.45))[:, :, None]
    image = 1 - (1 - np.clip(image, 0, 1)) ** np.float32(rng.uniform(1.0, 1.3))
    result = (np.clip(image, 0, 1) * 255).astype(np.uint8)
    result = cv2.bilateralFilter(result, 5, rng.uniform(10, 45), rng.uniform(1.0, 2.5))
    small = round(len(pixels) * rng.uniform(0.4, 1.0))
    result = cv2.resize(result, (small, small), interpolation=cv2.INTER_AREA)
    result = _compressed(result, int(rng.integers(20, 75)))
    result = cv2.resize(result, pixels.shape[1::-1], interpolation=cv2.INTER_CUBIC)
    sharp = rng.uniform(0.0, 1.0)
    result = cv2.addWeighted(result, 1 + sharp, cv2.GaussianBlur(result, (0, 0), 1.2), -sharp, 0)
    return np.ascontiguousarray(result)


def _compressed(pixels: ByteArray, quality: int) -> ByteArray:
    """Return the pixels as JPEG of a quality of 0 to 100 keeps them."""
    _, packed = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)
