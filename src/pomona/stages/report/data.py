"""What a report is made of: the survey's values, and facts of the run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pomona.stages.capture.quality import Problems
from pomona.stages.scale.report import ScaleReport
from pomona.stages.sfm.pieces import Unregistered
from pomona.values.cameras import Cameras
from pomona.values.crop import Crop, RowSegments, SizeDistribution
from pomona.values.detections import Detections
from pomona.values.fruits import FruitCloud, Fruits, Observations, TotalWeight
from pomona.values.photos import Photos
from pomona.values.trees import Trees


@dataclass(frozen=True)
class StageTime:
    """How long a stage took, in seconds, and its peak memory in MB (None: not measured)."""

    name: str
    wall_s: float
    peak_memory_mb: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class ReportData:
    """All that the report shows of one survey.

    `cloud` holds the points of the scene (`fruit_id` 0) and of the fruits, in the frame of `cameras`. `photos` are
    all that can be used, with files that cannot, or are copies, in `photos.skipped`; `lost` are those without a place,
    `problems` those that are blurred or badly lit (None: not looked at).
    `detections` is their number in all photos (None: not known); `masks`, by photo, are those that may have become
    fruit, where outlines and crops are wanted. `corrections` is how many a person made that found their fruit. `scale`
    says how metres were found, where known.
    `trees` are the table of trees, none where they are not known; `fruit_words` is what many of the fruits are called,
    `weight` that of all of them (None: not known); `crop` is what hangs there, hidden fruits too, and `segments` the
    same along the row. `settings` are a person's options in words, `engines` the versions of outside packages,
    `version` is Pomona's. `provisional`: it is an answer so far, while photos still arrive.
    """

    title: str
    photos: Photos
    cameras: Cameras
    fruits: Fruits
    observations: Observations = field(default_factory=Observations.empty)
    cloud: FruitCloud = field(default_factory=FruitCloud.empty)
    detections: int | None = None
    masks: Mapping[str, Detections] | None = None
    corrections: int = 0
    lost: tuple[Unregistered, ...] = ()
    problems: Problems | None = None
    scale: ScaleReport | None = None
    trees: Trees = field(default_factory=Trees.empty)
    fruit_words: str = "fruits"
    packing: str | None = None
    weight: TotalWeight | None = None
    crop: Crop | None = None
    segments: RowSegments = field(default_factory=RowSegments.empty)
    stages: tuple[StageTime, ...] = ()
    warnings: tuple[str, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    engines: Mapping[str, str] = field(default_factory=dict)
    version: str = ""
    provisional: bool = False

    @property
    def usable_photos(self) -> int:
        """How many photos could be used: files that cannot be read, and copies of others, are not among them."""
        return max(len(self.photos), len(self.cameras) + len(self.lost))  # without their folder, few are known

    @property
    def sizes(self) -> SizeDistribution | None:
        """How large the fruits of the whole crop are; None: not known."""
        return None if self.crop is None else self.crop.sizes


def settings_in_words(options: Mapping[str, Any]) -> dict[str, str]:
    """Return what was chosen for a run, by names of options; of files the names alone, as reports are shared."""
    return {name.replace("_", " "): _word(value) for name, value in options.items() if _is_plain(value)}


def _is_plain(value: Any) -> bool:
    return value is not None and not isinstance(value, Mapping)


def _word(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(_word(part) for part in value)
    return Path(value).name if isinstance(value, str) else str(value)


def engines_of(engines: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """Return the versions of the packages of all stages."""
    return {name: version for each in engines for name, version in sorted(each.items())}
