"""What both engines of stereo share: views at working scale, who is compared with whom, and the check between views."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray
from pomona.errors import DamagedPhotoError
from pomona.fruit.traits.ranges import fruit_ranges
from pomona.fruit.traits.size import FruitSize
from pomona.progress import Progress, Silent, track
from pomona.stages.capture import read_pixels
from pomona.stages.dense.depth_maps import DepthMap, agreed_points, thin
from pomona.stages.dense.neighbours import choose_neighbours
from pomona.stages.dense.options import DenseOptions
from pomona.stages.dense.views import View, make_view
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, SurveyDetections
from pomona.values.photos import Photos


class StereoScene:
    """The photos of a survey as stereo sees them: `ranges` of depth, `neighbours` of each photo, and its views.

    A photo that cannot be decoded is black and has no fruit; `progress` is warned of it once.
    """

    def __init__(
        self,
        photos: Photos,
        detections: SurveyDetections,
        cameras: Cameras,
        options: DenseOptions,
        progress: Progress | None = None,
    ) -> None:
        self._detections, self.cameras, self.options = detections, cameras, options
        self._progress, self._damaged = progress or Silent(), set[int]()
        by_name = photos.by_name()
        self._photos = [by_name[name] for name in cameras.photos]
        self.ranges = fruit_ranges(detections, cameras, FruitSize(options.fruit_diameter_m))
        self._scales = np.minimum(1.0, options.work_fruit_px / self.ranges.widths_px)
        sides = tuple(photo.side for photo in self._photos)
        self.neighbours = choose_neighbours(cameras, sides, self.ranges.typical_m, options)
        # The views used last, so that memory does not grow with the survey.
        self.view = lru_cache(2 * options.neighbours + 3)(self._load)

    def _load(self, i: int) -> View:
        photo = self._photos[i]
        found = self._detections.get(photo.name)
        try:
            rgb = read_pixels(photo, max_side_px=photo.longer_side_px(self._scales[i]))
        except DamagedPhotoError as error:
            if i not in self._damaged:
                self._progress.warn(f"{photo.name} is not in the cloud: {error.reason}")
            self._damaged.add(i)
            width, height = (max(1, round(side * self._scales[i])) for side in (photo.width_px, photo.height_px))
            rgb, found = np.zeros((height, width, 3), np.uint8), None
        if found is None:
            found = Detections.empty(photo.name, photo.width_px, photo.height_px)
        return make_view(i, rgb, found, self.cameras.intrinsics_of(i), self.cameras.cam_from_world[i])


def cloud_of_maps(
    scene: StereoScene, depth_map: Callable[[int], DepthMap], progress: Progress
) -> tuple[FloatArray, ByteArray]:
    """Return points (m, 3) and colours (m, 3) of the surfaces on which the depth maps of neighbours agree.

    `depth_map` gives the map of a photo; each is asked for once, and dropped when no later photo needs it.
    """
    options, fruit_m = scene.options, scene.ranges.size.diameter_m
    uses = Counter(int(j) for i, js in enumerate(scene.neighbours) for j in (i, *js))
    maps: dict[int, DepthMap] = {}
    parts: list[tuple[FloatArray, ByteArray]] = [(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))]
    for i in track(range(len(scene.cameras)), progress, "dense"):
        needed = (i, *map(int, scene.neighbours[i]))
        for j in needed:
            if j not in maps:
                maps[j] = depth_map(j)
        points, rgb, _ = agreed_points(
            maps[i],
            [maps[j] for j in needed[1:]],
            tolerance_m=options.agreement_diameters * fruit_m,
            min_agreeing=min(options.min_agreeing, max(1, len(needed) - 1)),
        )
        parts.append(thin(points, rgb, options.voxel_diameters * fruit_m))
        for j in needed:
            uses[j] -= 1
            if uses[j] == 0:
                del maps[j]
    points, rgb = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return thin(points, rgb, options.voxel_diameters * fruit_m)
