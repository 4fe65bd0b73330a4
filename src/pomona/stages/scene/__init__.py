"""A coloured cloud of the whole row, leaves, wood and fruit: depth maps of all photos, checked with each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from pomona.basics.arrays import counted
from pomona.errors import InputError, MissingFileError, few
from pomona.fruit.traits.ranges import fruit_ranges
from pomona.fruit.traits.size import FruitSize
from pomona.progress import Progress, Silent, track
from pomona.stages.capture import read_pixels
from pomona.stages.dense.views import View, make_view
from pomona.stages.scene.maps import SceneMap, row_points, scene_map
from pomona.stages.scene.options import DenseSceneOptions
from pomona.stages.scene.partners import along_the_path, choose_partners
from pomona.stages.scene.voxels import VoxelCloud
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, SurveyDetections
from pomona.values.fruits import FruitCloud
from pomona.values.photos import Photo, Photos

__all__ = ["DenseSceneOptions", "dense_scene"]


def dense_scene(
    photos: Photos,
    detections: SurveyDetections,
    cameras: Cameras,
    *,
    options: DenseSceneOptions | None = None,
    progress: Progress | None = None,
) -> FruitCloud:
    """Return a cloud of what the photos show of the row, in the world frame, `fruit_id` 0 throughout.

    `detections` say how wide fruits are in the photos, and so how far the row is. Where photos cannot be compared with
    others, or not be read, there are fewer points, and a warning through `progress`.
    """
    options, progress = options or DenseSceneOptions(), progress or Silent()
    maps = _Maps(photos, detections, cameras, options)
    if not any(maps.partners):
        progress.warn(
            "No dense scene was made: no two photos show the same part of the row from places far enough apart "
            f"({options.min_angle_deg:g} to {options.max_angle_deg:g}° as seen from the fruits)"
        )
        return FruitCloud.empty()
    cloud = VoxelCloud(
        options.voxel_diameters * maps.diameter_m, options.most_points, np.median(cameras.centers_in_world, axis=0)
    )
    for i in track(maps.order.tolist(), progress, "scene", len(cameras)):
        own = maps.get(i)
        if own is not None:
            others = [found for j in maps.partners[i] if (found := maps.get(j)) is not None]
            if others:
                cloud.add(*row_points(own, others, float(maps.depths_m[i]), options))
        maps.release(i)
    _warn_of_gaps(maps, cameras, progress)
    points, rgb = cloud.points(options.min_pixels)
    return FruitCloud(points, rgb, np.zeros(len(points), np.int64))


def _warn_of_gaps(maps: _Maps, cameras: Cameras, progress: Progress) -> None:
    if maps.unread:
        progress.warn(
            f"The scene lacks {counted(len(maps.unread), 'photo')} that could not be read: {few(maps.unread)}"
        )
    alone = [cameras.photos[i] for i in maps.order if not maps.partners[i]]
    if 2 * len(alone) > len(cameras):
        progress.warn(
            f"The scene lacks {len(alone)} of {len(cameras)} photos: no other photo shows the same from a place beside "
            f"them: {few(alone)}"
        )


class _Maps:
    """The depth maps of a survey's photos, each made once and dropped when no later photo needs it."""

    def __init__(
        self, photos: Photos, detections: SurveyDetections, cameras: Cameras, options: DenseSceneOptions
    ) -> None:
        by_name = photos.by_name()
        self._photos: list[Photo] = [by_name[name] for name in cameras.photos]
        self._cameras, self._options = cameras, options
        ranges = fruit_ranges(detections, cameras, FruitSize(options.fruit_diameter_m))
        self.diameter_m, self.depths_m = ranges.size.diameter_m, ranges.typical_m
        self._scales = np.minimum(1.0, options.work_fruit_px / ranges.widths_px)
        sides = tuple(photo.side for photo in self._photos)
        self.partners = choose_partners(cameras, sides, self.depths_m, options)
        self.order = along_the_path(cameras, sides)
        self.unread: list[str] = []
        self._views: dict[int, View | None] = {}
        self._maps: dict[int, SceneMap | None] = {}
        # A map is made of its partners' views, and asked for by its own photo and by those whose partner it is.
        self._map_uses = Counter(j for i, others in enumerate(self.partners) for j in (i, *others))
        self._view_uses = Counter(j for i, others in enumerate(self.partners) for j in (i, *others))

    def get(self, i: int) -> SceneMap | None:
        """Return the map of photo i, None where there can be none."""
        if i not in self._maps:
            view = self._view(i) if self.partners[i] else None
            others = [other for j in self.partners[i] if (other := self._view(j)) is not None]
            depth_m = float(self.depths_m[i])
            self._maps[i] = None if view is None else scene_map(view, others, depth_m, self._options)
            _drop(self._views, self._view_uses, (i, *self.partners[i]))
        return self._maps[i]

    def release(self, i: int) -> None:
        """Say that photo i is done: its own map and those of its partners have been asked for by it."""
        _drop(self._maps, self._map_uses, (i, *self.partners[i]))

    def _view(self, i: int) -> View | None:
        if i not in self._views:
            self._views[i] = self._read(i)
        return self._views[i]

    def _read(self, i: int) -> View | None:
        photo, lens = self._photos[i], self._cameras.intrinsics_of(i)
        longer = max(photo.width_px, photo.height_px)
        side_px = min(self._options.most_side_px, round(self._scales[i] * longer))
        try:
            rgb = read_pixels(photo, max_side_px=side_px)
        except (InputError, MissingFileError):
            self.unread.append(photo.name)
            return None
        nothing = Detections.empty(photo.name, photo.width_px, photo.height_px)
        return make_view(i, rgb, nothing, lens, self._cameras.cam_from_world[i])


def _drop(kept: dict[int, SceneMap | None] | dict[int, View | None], uses: Counter[int], used: Sequence[int]) -> None:
    for j in used:
        uses[j] -= 1
        if uses[j] <= 0:
            kept.pop(j, None)
