"""The answer so far: the photos' places in metres, and the fruits that they show.

By the stages of a run, without what takes long and changes little: markers, the adjustment on fruits, the alignment of
sides, the second look, what colours say, measuring. So metres are approximate, fruits seen from both sides count twice,
and it says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pomona import __version__
from pomona.browser.live.coverage import Coverage, Walk, coverage_of
from pomona.fruit.traits.kinds import many_of, packing_of
from pomona.pipeline.filter import FilterChoice, filter_stage
from pomona.pipeline.fuse import FUSE_BY_OBJECT
from pomona.pipeline.options import RunOptions, StageOptions
from pomona.pipeline.results import scene_cloud
from pomona.pipeline.scale import SCALE
from pomona.pipeline.segment import Segmented
from pomona.pipeline.select import SELECT
from pomona.progress import Silent
from pomona.stages.filter import VIEW_FEATURE_NAMES, LinearSvm
from pomona.stages.report import ReportData
from pomona.stages.sfm.pieces import Piece, Reconstruction
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import Fruits, Observations
from pomona.values.photos import Photos

_FILTER = filter_stage(FUSE_BY_OBJECT)


@dataclass(frozen=True, eq=False)
class Provisional:
    """Places, fruits and masks so far, and what they cover."""

    cameras: Cameras
    fruits: Fruits
    observations: Observations
    masks: SurveyDetections
    coverage: Coverage

    def page_data(self, title: str, photos: Photos, options: RunOptions) -> ReportData:
        """Return what the page shows of it; `options` are those of the run that is to come."""
        from pomona.values.fruits import FruitCloud

        return ReportData(
            title=title,
            photos=photos,
            cameras=self.cameras,
            fruits=self.fruits,
            observations=self.observations,
            cloud=scene_cloud(FruitCloud.empty(), self.cameras, self.fruits, FruitCloud.empty()),
            masks=self.masks,
            detections=self.masks.total,
            fruit_words=many_of(options.fruit),
            packing=packing_of(options.fruit, options.packing),
            version=__version__,
        )


def provisional(pieces: Sequence[Piece], segmented: Segmented, photos: Photos, options: StageOptions) -> Provisional:
    """Return the answer for the photos that were placed and segmented so far."""
    progress = Silent()
    assert SELECT.options
    assert SCALE.options
    assert FUSE_BY_OBJECT.options
    assert _FILTER.options
    selected = SELECT.compute(segmented=segmented, options=SELECT.options(options), progress=progress)
    chosen = SCALE.options(options)
    plain = replace(chosen.scale, markers=None, markers_crs=None, gcp=None, scale_bar=None, refine=False)
    placed = SCALE.compute(
        reconstruction=Reconstruction(tuple(pieces)),
        selected=selected,
        photos=photos,
        options=replace(chosen, scale=plain, association=None),
        progress=progress,
    )
    fruits, observations = Fruits.empty(), Observations.empty()
    if placed.cameras.frame.metric:
        fused = FUSE_BY_OBJECT.compute(
            selected=selected, placed=placed, options=FUSE_BY_OBJECT.options(options), progress=progress
        )
        fused = _FILTER.compute(
            fused=fused,
            selected=selected,
            placed=placed,
            photos=None,
            options=_without_second_look(_FILTER.options(options)),
            progress=progress,
        )
        fruits, observations = fused.fruits, fused.observations
    walks = [Walk(piece.side, piece.cameras.photos) for piece in pieces]
    coverage = coverage_of(placed.cameras, fruits, walks, in_one_frame=placed.report.sides_are_tied)
    return Provisional(placed.cameras, fruits, observations, selected.trusted, coverage)


def _without_second_look(choice: FilterChoice) -> FilterChoice:
    """The choice with the shipped machine in place of one that judges by the second look, which has not been taken."""
    if choice.model is None or LinearSvm.load(choice.model).names == VIEW_FEATURE_NAMES:
        return choice
    return replace(choice, model=None)
