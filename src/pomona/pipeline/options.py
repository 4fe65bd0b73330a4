"""What a person can choose about a run. The options of each stage are made from these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from pomona.errors import InputError, MissingFileError
from pomona.fruit_size import DEFAULT_DIAMETER_M
from pomona.survey.digest import plain

if TYPE_CHECKING:
    from pomona.dense import DenseOptions
    from pomona.fuse.object import ObjectOptions
    from pomona.fuse.paper import PaperOptions
    from pomona.measure import MeasureOptions
    from pomona.scale import ScaleOptions
    from pomona.segment import SegmentOptions
    from pomona.sfm import SfmOptions

Method = Literal["object", "paper"]
Variant = Literal["text", "published-code"]
Engine = Literal["auto", "opencv", "patchmatch"]
METHODS: tuple[str, ...] = get_args(Method)
VARIANTS: tuple[str, ...] = get_args(Variant)
ENGINES: tuple[str, ...] = get_args(Engine)


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of a run; the defaults need no tuning.

    `sides`: "auto", "none" or "GLOB,GLOB". `model`: None (the shipped weights), a model file or the name of an
    installed segmenter; `score_threshold` None: the model's own. `detections`: a file or folder of masks
    (docs/reference/detection-formats.md), in place of a segmenter, and `classes`, those of it that are fruit (None: it
    has one).
    `cameras`: a folder with a COLMAP text model, used in place of structure from motion. `markers`,
    `scale_bar` (two ids, metres), `use_gnss`, `fruit_diameter_m`: where metres come from, in this order.
    `variant` of the method "paper": to the letter of its "text", or as its authors' "published-code" does it; None:
    what is best of both (docs/reference/methods/paper.md). `engine` makes the dense cloud.
    `filter_false_positives`: whether the support vector machine has its say, with `filter_model` (None: the shipped
    one).

    The files named must exist: raises `MissingFileError`, and `InputError` for values that are unknown.
    """

    sides: str = "auto"
    method: str = "object"
    variant: str | None = None
    model: str | None = None
    score_threshold: float | None = None
    detections: Path | None = None
    classes: tuple[str, ...] | None = None
    cameras: Path | None = None
    markers: Path | None = None
    scale_bar: tuple[int, int, float] | None = None
    marker_dictionary: str = "DICT_4X4_50"
    use_gnss: bool = True
    fruit_diameter_m: float = DEFAULT_DIAMETER_M
    engine: str = "auto"
    filter_false_positives: bool = True
    filter_model: Path | None = None

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"--method: expected one of {', '.join(METHODS)}, found '{self.method}'")
        if self.variant is not None and self.variant not in VARIANTS:
            raise InputError(f"--variant: expected one of {', '.join(VARIANTS)}, found '{self.variant}'")
        if self.variant is not None and self.method != "paper":
            raise InputError(f"--variant {self.variant} is of --method paper, found --method {self.method}")
        if self.classes is not None and self.detections is None:
            raise InputError(f"--classes {','.join(self.classes)} are those of --detections, which is not given")
        if self.engine not in ENGINES:
            raise InputError(f"--engine: expected one of {', '.join(ENGINES)}, found '{self.engine}'")
        for name in ("detections", "cameras", "markers", "filter_model"):
            path = getattr(self, name)
            if path is None:
                continue
            object.__setattr__(self, name, Path(path).expanduser().resolve())
            if not getattr(self, name).exists():
                raise MissingFileError(f"--{name.replace('_', '-')}: {path} does not exist")
        # Made once here, so that wrong values are told of before any work is done.
        _ = self.scale, self.segment, self.dense

    @property
    def scale(self) -> ScaleOptions:
        """Options of the scale stage."""
        from pomona.scale.options import ScaleOptions

        return ScaleOptions(
            markers=self.markers,
            scale_bar=self.scale_bar,
            marker_dictionary=self.marker_dictionary,
            fruit_diameter_m=self.fruit_diameter_m,
            use_gnss=self.use_gnss,
        )

    @property
    def segment(self) -> SegmentOptions:
        """Options of the segment stage."""
        from pomona.segment.protocol import KEPT_SHARE
        from pomona.segment.stage import SegmentOptions

        # Detections below the threshold are kept in the file with their scores; they do not count as fruit.
        return SegmentOptions(score_threshold=self.score_threshold, kept_share=KEPT_SHARE)

    def least_score(self, model_threshold: float) -> float:
        """Return the score from which detections become fruit, where a single photo's are best from `model_threshold`.

        Who sees all photos may trust less in each: 0.8 of it finds more fruits (docs/lab/object-method.md).
        """
        if self.score_threshold is not None:
            return self.score_threshold
        return model_threshold if self.method == "paper" else 0.8 * model_threshold

    @property
    def sfm(self) -> SfmOptions:
        """Options of structure from motion."""
        from pomona.sfm.options import SfmOptions

        return SfmOptions()

    @property
    def dense(self) -> DenseOptions:
        """Options of the dense stage."""
        from pomona.dense.options import DenseOptions

        return DenseOptions(engine=self.engine, fruit_diameter_m=self.fruit_diameter_m)  # type: ignore[arg-type]

    @property
    def paper(self) -> PaperOptions:
        """Options of the paper's fusion."""
        from pomona.fuse.paper import PaperOptions

        made = {"text": PaperOptions.as_printed, "published-code": PaperOptions.as_published_code}
        options = made[self.variant]() if self.variant else PaperOptions()
        # Scores were looked at when segmenting; but the published code has its own threshold.
        as_code = self.variant == "published-code" and self.score_threshold is None
        # 3 cm were chosen for apples of 75 mm; other fruits have their own size.
        return replace(options, eps_m=0.4 * self.fruit_diameter_m, min_score=options.min_score if as_code else 0.0)

    @property
    def object(self) -> ObjectOptions:
        """Options of the association."""
        from pomona.fuse.object import ObjectOptions

        return ObjectOptions(fruit_diameter_m=self.fruit_diameter_m)

    @property
    def measure(self) -> MeasureOptions:
        """Options of the measures: fruits that were found by their outlines stay near where they were found."""
        from pomona.measure import MeasureOptions

        return MeasureOptions(center_tie=1.0) if self.method == "object" else MeasureOptions()

    def check_files(self) -> None:
        """Read the small files named, and look up names, so that a mistake is told of before hours of work.

        Raises `InputError`, `FormatError` or `MissingFileError`.
        """
        if self.markers is not None or self.scale_bar is not None:
            from pomona.scale.aruco import dictionary_names

            if self.marker_dictionary not in dictionary_names():
                known = ", ".join(name for name in dictionary_names() if name.startswith("DICT_4X4"))
                raise InputError(
                    f"--marker-dictionary: expected one of OpenCV's, such as {known}, found '{self.marker_dictionary}'"
                )
        if self.markers is not None:
            from pomona.scale.marker_table import read_markers

            read_markers(self.markers)
        if self.filter_model is not None:
            from pomona.filter import CODE_FEATURE_NAMES, FEATURE_NAMES, VIEW_FEATURE_NAMES, LinearSvm

            of_points = CODE_FEATURE_NAMES if self.variant == "published-code" else FEATURE_NAMES
            expected = of_points if self.method == "paper" else VIEW_FEATURE_NAMES
            found = LinearSvm.load(self.filter_model).names
            if found != expected:
                raise InputError(
                    f"--filter-model {self.filter_model}: --method {self.method} expects a machine trained on "
                    f"{', '.join(expected)}; found one of {', '.join(found)}"
                )

    def to_json(self) -> dict[str, Any]:
        """Return the options as `survey.json` holds them."""
        values: dict[str, Any] = plain(self)
        return values

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> RunOptions:
        """Return the options that `to_json` gave; entries of other versions are ignored."""
        known = {field.name: values[field.name] for field in fields(cls) if field.name in values}
        if known.get("scale_bar"):
            one, other, length_m = known["scale_bar"]
            known["scale_bar"] = int(one), int(other), float(length_m)
        if known.get("classes") is not None:
            known["classes"] = tuple(known["classes"])
        return cls(**known)
