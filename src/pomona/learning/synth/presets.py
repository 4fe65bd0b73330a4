"""Options of the rows that the project itself uses: training scenes, the demo sample, rows to measure on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona.learning.synth.options import LIGHTS, VARIETIES, RowOptions

# Seeds of training rows start here, so that no demo or test row shares their trees.
_TRAINING, _DENSE, _BUNCHED, _ROUGH = 77_000, 78_000, 79_000, 90_000
_SHADED, _SHADED_CROWNS = 99_100, 9_100  # seeds of rows to measure on, and which dense scenes' crowns they have


def training_options(number: int) -> RowOptions:
    """Return the options of the `number`-th training scene: one side, six photos far apart, no two scenes alike."""
    rng = np.random.default_rng([number, _TRAINING])
    apples = [name for name in VARIETIES if name != "orange"]
    variety = apples[number % len(apples)] if number % 12 != 11 else "orange"
    focal_35mm = int(rng.integers(28, 52))
    fruit_m = float(rng.uniform(0.045, 0.065) if variety == "unripe" else rng.uniform(0.065, 0.085))
    wanted_px = rng.uniform(22, 64)  # how wide a fruit appears
    focal_px = focal_35mm / 43.2666 * np.hypot(640, 960)
    distance_m = float(np.clip(focal_px * fruit_m / wanted_px, 1.3, 3.4))
    markers = bool(distance_m > 1.6 and rng.random() < 0.3)
    return RowOptions(
        seed=_TRAINING + number,
        trees=3,
        fruits_per_tree=int(rng.integers(30, 110)),
        variety=variety,
        fruit_diameter_m=fruit_m,
        leaves_per_tree=int(rng.integers(2600, 5600)),
        light=list(LIGHTS)[(number + number // len(LIGHTS)) % len(LIGHTS)],
        sides=("east",),
        photos_per_side=6,
        step_m=float(rng.uniform(0.28, 0.42)),
        distance_m=distance_m,
        camera_height_m=float(rng.uniform(1.1, 2.0)),
        tilt_deg=float(rng.uniform(-8, 10)),
        jitter_m=0.15,
        jitter_deg=5.0,
        width_px=640,
        height_px=960,
        focal_35mm=focal_35mm,
        markers=markers,
        samples=8,
        jpeg_quality=92,
    )


def dense_options(number: int) -> RowOptions:
    """Return the options of the `number`-th training scene of dense crowns: deep shade, grain, small leaves."""
    rng = np.random.default_rng([number, _DENSE])
    sunny = ("noon", "sun", "low-sun")
    return replace(
        training_options(number),
        seed=_DENSE + number,
        leaves_per_tree=int(rng.integers(6_000, 15_000)),
        leaf_length_m=float(rng.uniform(0.05, 0.085)),
        leaf_scatter_m=float(rng.uniform(0.02, 0.12)),
        light=sunny[number % 3] if rng.random() < 0.75 else "overcast",
        exposure=float(rng.uniform(-1.5, 0.3)),
        grainy=bool(rng.random() < 0.8),
        samples=int(rng.integers(6, 13)),
    )


def bunched_options(number: int) -> RowOptions:
    """Return the options of the `number`-th training scene of dense crowns in which most fruits hang in bunches."""
    rng = np.random.default_rng([number, _BUNCHED])
    return replace(dense_options(number), seed=_BUNCHED + number, bunch_share=float(rng.uniform(0.3, 0.9)))


_SHADED_ROWS = (  # variety, light, share of the fruits in bunches, exposure
    ("red", "overcast", 0.3, -0.4),
    ("yellow", "low-sun", 0.4, -0.8),
    ("bicolour", "sun", 0.4, -0.3),
    ("green", "hazy", 0.3, -0.2),
    ("dark-red", "noon", 0.5, -0.5),
    ("yellow", "overcast", 0.5, -0.3),
    ("unripe", "sun", 0.4, -0.3),
)


def shaded_options(number: int) -> RowOptions:
    """Return the options of one of seven rows to measure on: both sides of three dense crowns in deep shade."""
    variety, light, bunch_share, exposure = _SHADED_ROWS[number]
    crowns = dense_options(_SHADED_CROWNS + number)
    return RowOptions(
        seed=_SHADED + number,
        fruits_per_tree=50,
        variety=variety,
        fruit_diameter_m=0.06 if variety == "unripe" else 0.074,
        bunch_share=bunch_share,
        leaves_per_tree=min(crowns.leaves_per_tree, 11_000),
        leaf_length_m=crowns.leaf_length_m,
        leaf_scatter_m=crowns.leaf_scatter_m,
        light=light,
        exposure=exposure,
        photos_per_side=12,
        step_m=0.32,
        camera_height_m=1.6,
        jitter_deg=2.0,
        samples=10,
        grainy=True,
        jpeg_quality=88,
    )


def rough_options(number: int) -> RowOptions:
    """Return the options of the `number`-th rough training row: two trees, both sides, in most of them bunches.

    Every fourth has thin crowns, and every fourth, the one after it, mostly no bunches.
    """
    rng = np.random.default_rng([number, 424_242])
    row = replace(
        bunched_options(5000 + number),  # no path-traced scene is that of a rough row
        rough=True,
        seed=_ROUGH + number,
        trees=2,
        fruits_per_tree=int(rng.integers(45, 95)),
        sides=("east", "west"),
        photos_per_side=4,
        step_m=0.45,
        samples=8,
        markers=False,
    )
    if number % 4 < 2:
        row = replace(row, width_px=800, height_px=1200)
    if number % 4 == 0:
        return replace(
            row,
            leaves_per_tree=int(rng.integers(2600, 6000)),
            leaf_length_m=0.08,
            leaf_scatter_m=0.05,
            distance_m=float(rng.uniform(1.9, 3.1)),
            focal_35mm=38,
        )
    if number % 4 == 1:
        return replace(row, bunch_share=0.0) if rng.random() < 0.6 else row
    return replace(row, bunch_share=float(rng.uniform(0.4, 0.95)))


DEMO = RowOptions(
    seed=2024,
    trees=2,
    fruits_per_tree=32,
    variety="red",
    leaves_per_tree=3200,
    light="hazy",
    sun_azimuth_deg=75.0,
    photos_per_side=14,
    step_m=0.2,
    distance_m=2.2,
    camera_height_m=1.5,
    jitter_m=0.03,
    width_px=720,
    height_px=1080,
    focal_35mm=32,
    marker_size_m=0.10,
    marker_offset_m=0.75,
    samples=10,
    jpeg_quality=88,
)
"""The bundled sample of `pomona demo`: two trees, 14 photos a side."""

ROWS: dict[str, RowOptions] = {
    "r00": RowOptions(
        seed=5000, fruits_per_tree=45, variety="bicolour", light="low-sun", sun_azimuth_deg=240.0, samples=8
    ),
    "r01": RowOptions(
        seed=5001, fruits_per_tree=55, variety="green", light="overcast", fruit_diameter_m=0.07, leaves_per_tree=3600,
        samples=8,
    ),
}  # fmt: skip
"""Two-sided rows of three trees, 17 photos a side, to train the filter on and to measure with."""

_SMALL = RowOptions(photos_per_side=2, step_m=1.0, width_px=560, height_px=840, markers=False, samples=8)
HELD_OUT: dict[str, RowOptions] = {
    "h00": replace(_SMALL, seed=9000, variety="yellow", light="low-sun", sun_azimuth_deg=10.0),
    "h01": replace(_SMALL, seed=9001, variety="bicolour", light="sun", sun_azimuth_deg=200.0, fruits_per_tree=60),
}
"""Two-sided rows to measure segmenters on, never to train on; h00 is seen against a low sun from the east."""
