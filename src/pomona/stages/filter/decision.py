"""Dropping what is probably no fruit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.progress import Progress, Silent
from pomona.stages.filter.colours import count_colours, judged_by_colours
from pomona.stages.filter.options import FilterOptions
from pomona.stages.filter.point_features import features, resized
from pomona.stages.filter.svm import LinearSvm, shipped
from pomona.stages.filter.view_features import LOOKED_FEATURE_NAMES, ViewFeatures, view_features
from pomona.stages.fuse import Fused
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.photos import Photos

# The probabilities below which fruits are dropped: the paper's machine parts at a half; by views, the F1 of what is
# left is greatest at about F1 / 2.
_BY_POINTS, _BY_VIEWS = 0.5, 0.4


def apply(fused: Fused, svm: LinearSvm | None = None, *, options: FilterOptions | None = None) -> Fused:
    """Return the fruits of the paper's method whose probability is high enough, with that as their score.

    `svm` None: the machine that Pomona ships for this method. Fruits without points in the cloud cannot be judged: they
    stay as they are. Features are taken at the size of the fruits that the machine was trained on, so that it also
    serves smaller and larger fruit, and scales that are only approximate.
    """
    svm, options = svm or LinearSvm.load(shipped("paper")), options or FilterOptions()
    found = features(fused.cloud, svm.names)
    probability = svm.probability(resized(found.values, _size_factor(fused, svm), svm.names))
    judged = dict(zip(found.ids.tolist(), probability.tolist(), strict=True))
    probability = np.array([judged.get(i, np.nan) for i in fused.fruits.ids.tolist()])
    return _kept(fused, probability, _BY_POINTS if options.threshold is None else options.threshold)


def apply_to_views(
    fused: Fused,
    detections: SurveyDetections,
    cameras: Cameras,
    svm: LinearSvm | None = None,
    *,
    photos: Photos | None = None,
    options: FilterOptions | None = None,
    progress: Progress | None = None,
) -> Fused:
    """Return the fruits that the photos speak for (`view_features`), with a probability as their score.

    That is, that there is a fruit within half a diameter of that place: that it is fruit, times that the place is
    right, and then what the colours of all say (`judged_by_colours`), if there are `photos`. `detections` and `cameras`
    are those that `fused` was made of; `svm` None: the machines that Pomona ships for fruits of `fuse.object`, and for
    those that were looked at again. Those kept keep their ids. Raises `LostFileError` naming a photo that is gone.
    """
    options = options or FilterOptions()
    probability = _judged(view_features(fused, detections, cameras, options), svm)
    if photos is not None:
        colours = count_colours(fused.fruits.ids, fused.observations, detections, photos, progress or Silent())
        probability = judged_by_colours(probability, colours.likeness_nats())
    return _kept(fused, probability, _BY_VIEWS if options.threshold is None else options.threshold)


def view_probability(features: ViewFeatures, svm: LinearSvm) -> FloatArray:
    """Return the probability (n,) that there is a fruit within half a diameter of where each is said.

    A machine of `VIEW_FEATURE_NAMES` judges fruits that were looked at again by these alone.
    """
    looked = svm.names == LOOKED_FEATURE_NAMES
    return svm.probability(features.values[:, : len(svm.names)]) * features.place_probability(looked=looked)


def _judged(features: ViewFeatures, svm: LinearSvm | None) -> FloatArray:
    """Probabilities (n,) by a machine, or the shipped one of fruits that were looked at again.

    Those that it cannot judge, as no photo could be looked at, are judged by what the association saw of them.
    """
    probability = view_probability(features, LinearSvm.load(shipped("object")))
    if svm is None and features.values.shape[1] == len(LOOKED_FEATURE_NAMES):
        svm = LinearSvm.load(shipped("object", "second-look"))
    if svm is not None:
        able = np.isfinite(features.values[:, : len(svm.names)]).all(1)
        probability[able] = view_probability(features[able], svm)
    return probability


def _kept(fused: Fused, probability: FloatArray, threshold: float) -> Fused:
    """Keep the fruits whose probability (n,) is high enough, or NaN, which is not known.

    They keep their ids; of the others the observations go, and their points belong to none (0).
    """
    scores = np.where(np.isnan(probability), fused.fruits.scores, probability)
    fruits = replace(fused.fruits, scores=scores)[np.isnan(probability) | (probability >= threshold)]
    fruit_id = np.where(np.isin(fused.cloud.fruit_id, fruits.ids), fused.cloud.fruit_id, 0)
    return Fused(
        fruits,
        fused.observations[np.isin(fused.observations.fruit_id, fruits.ids)],
        replace(fused.cloud, fruit_id=fruit_id),
    )


def _size_factor(fused: Fused, svm: LinearSvm) -> float:
    if not np.isfinite(svm.fruit_diameter_m):
        return 1.0
    trained_on = FruitSize(svm.fruit_diameter_m)
    return trained_on.diameter_m / size_of_fruits(fused.fruits.diameters_m, trained_on).diameter_m
