"""Pictures of scenes, one after another, into a folder: photos, masks, whole-fruit circles; stops and resumes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from pomona.basics.arrays import Float32Array, FloatArray, IntArray
from pomona.errors import InputError
from pomona.formats.detections.png_masks import IGNORED_ID
from pomona.learning.synth.meshes import unit
from pomona.learning.synth.quick.develop import develop
from pomona.learning.synth.quick.lights import BACKDROP_PX, backdrop, draw_lighting
from pomona.learning.synth.quick.looks import KINDS, FruitLook
from pomona.learning.synth.quick.scene import FALLEN, Scene, build_scene
from pomona.learning.synth.truth import Ids, RowFolder, write_mask
from pomona.progress import Progress, Silent
from pomona.stages.capture.images import write_jpeg

if TYPE_CHECKING:
    from pomona.learning.synth.quick.gl import GlView, Painter

_FINER = 1.5  # pictures are drawn so many times as wide and high, then made smaller: edges are soft
_LEAVES = 1_000_003  # a stream of random numbers of its own
_LEAST_PX, _LEAST_SHARE = 30, 0.1  # a fruit of which less is seen is to be ignored


@dataclass(frozen=True, kw_only=True)
class QuickPictureOptions:
    """`kinds` are drawn in proportion to `shares`; `per_scene` pictures are taken of each scene.

    `fruit_px` is the range of the fruits' width in pictures of `size_px`, drawn log-uniformly; so is by how much leaves
    are larger than the kind's, within `leaf_growth`. `foliage` are photos of which blurred parts are seen far behind.
    """

    kinds: tuple[str, ...] = tuple(KINDS)
    shares: tuple[float, ...] | None = None
    per_scene: int = 8
    size_px: int = 640
    fruit_px: tuple[float, float] = (18.0, 95.0)
    leaf_growth: tuple[float, float] = (1.0, 1.0)
    foliage: tuple[Path, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        if unknown := [kind for kind in self.kinds if kind not in KINDS]:
            raise InputError(f"kinds: expected some of {', '.join(KINDS)}, found {', '.join(unknown)}")
        if self.shares is not None and len(self.shares) != len(self.kinds):
            raise InputError(f"shares: expected {len(self.kinds)}, one a kind, found {len(self.shares)}")
        if not 0.2 <= self.leaf_growth[0] <= self.leaf_growth[1] <= 5:
            raise InputError(f"leaf_growth: expected a range within 0.2 to 5, found {self.leaf_growth}")


def render_pictures(
    out: Path, scenes: Sequence[int], options: QuickPictureOptions | None = None, progress: Progress | None = None
) -> None:
    """Draw the scenes of these numbers into `out`; those that are there already are left as they are.

    `out/images/KIND-SCENE-K.jpg` are the photos, `out/truth/masks/*.png` the ids of what is seen (0: none; 65534: a
    fruit to be ignored), `out/truth/circles/*.json` for each id the whole fruit's centre and radius in pixels and the
    pixels of it that are seen. The same number gives the same scene. Raises `MissingExtraError` without OpenGL.
    """
    from pomona.learning.synth.quick.gl import Painter  # needs the extra

    options, progress = options or QuickPictureOptions(), progress or Silent()
    folder = RowFolder(out)
    folder.make()
    (out / "truth" / "circles").mkdir(exist_ok=True)
    painter = Painter()
    progress.start("scenes", len(scenes))
    for number in scenes:
        _one_scene(folder, number, painter, options)
        progress.advance()


def _one_scene(folder: RowFolder, number: int, painter: Painter, options: QuickPictureOptions) -> None:
    rng = np.random.default_rng([options.seed, number])
    shares = np.array(options.shares or np.ones(len(options.kinds)), float)
    kind = options.kinds[rng.choice(len(options.kinds), p=shares / shares.sum())]
    names = [f"{kind}-{options.seed}-{number:05d}-{k}" for k in range(options.per_scene)]
    if all(folder.truth(f"circles/{name}.json").exists() for name in names):
        return
    look = with_grown_leaves(KINDS[kind][rng.integers(len(KINDS[kind]))], number, options)
    scene = build_scene(look, rng)
    painter.take(scene)
    for k, name in enumerate(names):
        _one_picture(folder, name, scene, painter, options, np.random.default_rng([options.seed, number, k]))


def with_grown_leaves(look: FruitLook, number: int, options: QuickPictureOptions) -> FruitLook:
    """Return a look with leaves as large as in the scene of this number: fruits may be small beside them."""
    # Drawn apart from all else: where leaves do not grow, scenes are what they would be without this.
    growth = float(np.exp(np.random.default_rng([options.seed, number, _LEAVES]).uniform(*np.log(options.leaf_growth))))
    return replace(look, leaf=(look.leaf[0] * growth, look.leaf[1] * growth))


def _one_picture(
    folder: RowFolder, name: str, scene: Scene, painter: Painter, options: QuickPictureOptions, rng: np.random.Generator
) -> None:
    view, focal_px = _view(scene, options, rng)
    lighting = draw_lighting(rng)
    light, drawn_ids = painter.draw(
        view, lighting, backdrop(lighting, _foliage(options.foliage, rng), rng).astype(np.float32)
    )
    size = options.size_px
    light = cv2.resize(light, (size, size), interpolation=cv2.INTER_AREA)
    ids = smaller_ids(drawn_ids, size)
    write_jpeg(folder.photo(name), develop(light, lighting.exposure, rng))
    seen, circles = _truth(ids, scene, view, focal_px / _FINER)
    write_mask(folder.mask(name), seen)
    folder.truth(f"circles/{name}.json").write_text(json.dumps({"light": lighting.name, "circles": circles}))


def smaller_ids(ids: Float32Array, size: int) -> IntArray:
    """Return the ids (h, w) of a drawing as they are in the picture of `size` pixels a side: in each pixel's middle."""
    # The plain nearest one is that of each pixel's corner: at 1.5 times, masks would lie a third of a pixel beside.
    smaller = cv2.resize(ids, (size, size), interpolation=cv2.INTER_NEAREST_EXACT)
    return np.asarray(smaller.round(), np.int64)


def _view(scene: Scene, options: QuickPictureOptions, rng: np.random.Generator) -> tuple[GlView, float]:
    """A camera some metres away that looks at a fruit or near it, and its focal length in pixels."""
    from pomona.learning.synth.quick.gl import GlView

    size = round(options.size_px * _FINER)
    centres, diameters = scene.fruits.centres_in_world, scene.fruits.diameters_m
    aim = centres[rng.integers(len(centres))] + rng.normal(0, [0.15, 0.1, 0.15]) if len(centres) else scene.high / 2
    fruit_m = float(np.median(diameters)) if len(diameters) else 0.07
    fruit_px = np.exp(rng.uniform(*np.log(options.fruit_px))) * _FINER
    away_m = rng.uniform(1.0, 3.6)
    focal_px = float(np.clip(fruit_px * away_m / fruit_m, 0.7 * size, 6 * size))
    away_m = focal_px * fruit_m / fruit_px
    turn, rise = rng.normal(0, 0.35), rng.normal(0.0, 0.18)
    eye = aim + away_m * np.array([np.sin(turn) * np.cos(rise), -np.cos(turn) * np.cos(rise), -np.sin(rise)])
    eye[2] = max(eye[2], 0.3)
    ahead = unit(aim - eye)
    right = unit(np.cross(ahead, [0, 0, 1.0]) + rng.normal(0, 0.06, 3))
    right = unit(right - ahead * (right @ ahead))
    rotation = np.stack([right, np.cross(right, ahead), -ahead])
    camera = np.eye(4)
    camera[:3, :3], camera[:3, 3] = rotation, -rotation @ eye
    near, far = 0.05, 40.0
    f = 2 * focal_px / size
    projection = np.array([[f, 0, 0, 0], [0, f, 0, 0],
                           [0, 0, (near + far) / (near - far), 2 * near * far / (near - far)],
                           [0, 0, -1, 0]])  # fmt: skip
    return GlView(projection @ camera, eye, size, size), focal_px


def _foliage(photos: tuple[Path, ...], rng: np.random.Generator) -> FloatArray | None:
    """A part of a photo, so blurred that no fruit in it is one any more, as linear light."""
    if not photos or rng.random() < 0.4:
        return None
    pixels = cv2.imread(str(photos[rng.integers(len(photos))]), cv2.IMREAD_REDUCED_COLOR_4)
    if pixels is None:
        return None
    pixels = cv2.resize(pixels, (BACKDROP_PX, BACKDROP_PX))
    soft = cv2.GaussianBlur(pixels, (0, 0), rng.uniform(5, 10))[:, :, ::-1]
    return np.asarray((soft.astype(np.float32) / 255) ** 2.2)


def _truth(
    ids: IntArray, scene: Scene, view: GlView, focal_px: float
) -> tuple[Ids, list[tuple[int, float, float, float, int]]]:
    """Ids of what is seen, as stored, and (id, x, y, radius, pixels seen) of the whole fruits."""
    found, counts = np.unique(ids[(ids > 0) & (ids < FALLEN)], return_counts=True)
    centres = scene.fruits.centres_in_world[found - 1]
    clip = np.concatenate([centres, np.ones((len(centres), 1))], 1) @ view.clip_from_world.T
    size = ids.shape[0]
    x, y = (clip[:, 0] / clip[:, 3] + 1) / 2 * size, (1 - clip[:, 1] / clip[:, 3]) / 2 * size
    radius = focal_px * scene.fruits.diameters_m[found - 1] / 2 / clip[:, 3]
    enough = (counts >= _LEAST_PX) & (counts >= _LEAST_SHARE * np.pi * radius**2)
    stored = np.where((ids >= FALLEN) | np.isin(ids, found[~enough]), IGNORED_ID, ids)
    circles = [
        (int(i), round(float(a), 2), round(float(b), 2), round(float(r), 2), int(n))
        for i, a, b, r, n, learnt in zip(found, x, y, radius, counts, enough, strict=True)
        if learnt
    ]
    return stored.astype(np.uint16), circles
