"""What a person can choose about a run, and the options of each stage made from that."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args, get_type_hints

from pomona.basics.option_values import expect_kind
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.files import is_there, resolved
from pomona.fruit.traits.kinds import FRUIT_KINDS, FruitKind, fruit_kind
from pomona.fruit.traits.packing import check_unit, packing_classes
from pomona.survey.digest import plain

if TYPE_CHECKING:
    from pomona.pipeline.select import SelectOptions
    from pomona.stages.capture import KeyFrameOptions
    from pomona.stages.dense.options import DenseOptions
    from pomona.stages.filter.options import FilterOptions
    from pomona.stages.fuse.object.options import ObjectOptions
    from pomona.stages.fuse.paper.options import PaperOptions
    from pomona.stages.measure.allometry import Allometry
    from pomona.stages.measure.options import MeasureOptions
    from pomona.stages.planting.options import PlantingOptions
    from pomona.stages.report.options import ReportOptions
    from pomona.stages.scale.options import ScaleOptions
    from pomona.stages.scene.options import DenseSceneOptions
    from pomona.stages.second_look.options import SecondLookOptions
    from pomona.stages.segment.photo_detections import SegmentOptions
    from pomona.stages.sfm.options import SfmOptions
    from pomona.stages.yields.options import YieldOptions

T = TypeVar("T")

Method = Literal["object", "paper"]
Variant = Literal["text", "published-code"]
Engine = Literal["auto", "opencv", "patchmatch"]
METHODS: tuple[str, ...] = get_args(Method)
VARIANTS: tuple[str, ...] = get_args(Variant)
ENGINES: tuple[str, ...] = get_args(Engine)

# Options that name a small file, of which a survey keeps a copy.
TABLES = ("markers", "gcp", "positions", "weights", "trees", "hand_counts", "filter_model")
# Options that name a file or folder, which must exist when a run begins.
FILES = ("detections", "cameras", *TABLES)
# Options of `pomona run`, hyphens as underscores, that have another name than the field that they set.
COMMAND_NAMES = {
    "fruit_diameter": "fruit_diameter_m",
    "gnss": "use_gnss",
    "filter": "filter_false_positives",
}
# The paper's 3 cm were chosen for apples of 75 mm; other fruits have their own size.
_EPS_DIAMETERS = 0.4


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of a run; the defaults need no tuning.

    `sides`: "auto", "none" or "GLOB,GLOB". `model`: None (the shipped weights), a model file or the name of an
    installed segmenter; `score_threshold` None: the model's own. `detections`: a file or folder of masks, in place of a
    segmenter, and `classes`, those of it that are fruit, a text as well (None: it has one). `cameras`: a reconstruction
    of another program, used in place of structure from motion. `fruit`: what grows there, a name of `FRUIT_KINDS`,
    which says how wide and heavy fruits usually are and what they are called (None: as wide and heavy as apples);
    `fruit_diameter_m` goes before its width, and `weights`, a table of pairs (`diameter_mm,weight_g`), before its
    weights. `markers` (metres, or places of `markers_crs`, such as "EPSG:25831") or `gcp` (points clicked in photos, a
    `gcp_list.txt`), `scale_bar` (two ids, metres; "0,1,0.85" is read, too), `use_gnss` (places of EXIF, or of
    `positions`, a table of photos), the usual width: where metres come from, in this order. `variant` of the method
    "paper": to the letter of its "text", or as its authors' "published-code" does it; None: what is best of both.
    `engine` makes the dense cloud. `second_look`: whether fruits of the method "object" are looked at again in all
    photos. `scene`: whether a dense cloud of the whole row is made, to look at. `filter_false_positives`: whether the
    support vector machine decides which fruits are dropped, with `filter_model` (None: the shipped one).

    `trees`, a table of trunks (`id,x,y`, in the survey's frame or the system of `markers_crs` or `gcp`), or
    `tree_spacing`, the planting distance in metres, say which tree a fruit hangs on; without either, trees are where
    fruits gather at equal distances, if they do. `hand_counts`, a table of trees that were counted by hand
    (`tree,count`), calibrates the estimate of all fruit. `packing` are the classes of size of the report: a name of
    `PACKING_PRESETS`, or edges in mm such as "60,65,70".

    `key_frames` says how the frames of a video are chosen. `segment`, `select`, `sfm`, `scale`, `object`, `paper`,
    `dense`, `looking` (of the second look), `dense_scene`, `filter`, `measure`, `planting`, `yields`, `report` are
    options of single stages, for those who know them; what the options above say goes before, but `paper` is taken as
    it is.

    Raises `InputError` for values that are unknown or of another kind. The files named are looked for by `check_files`
    alone: a survey is read back wherever they are by then.
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
    markers_crs: str | None = None
    gcp: Path | None = None
    scale_bar: tuple[int, int, float] | None = None
    marker_dictionary: str = "DICT_4X4_50"
    use_gnss: bool = True
    positions: Path | None = None
    fruit: str | None = None
    fruit_diameter_m: float | None = None
    weights: Path | None = None
    trees: Path | None = None
    tree_spacing: float | None = None
    hand_counts: Path | None = None
    packing: str | None = None
    engine: str = "auto"
    second_look: bool = True
    scene: bool = True
    filter_false_positives: bool = True
    filter_model: Path | None = None
    key_frames: KeyFrameOptions | None = None
    segment: SegmentOptions | None = None
    select: SelectOptions | None = None
    sfm: SfmOptions | None = None
    scale: ScaleOptions | None = None
    object: ObjectOptions | None = None
    paper: PaperOptions | None = None
    dense: DenseOptions | None = None
    looking: SecondLookOptions | None = None
    dense_scene: DenseSceneOptions | None = None
    filter: FilterOptions | None = None
    measure: MeasureOptions | None = None
    planting: PlantingOptions | None = None
    yields: YieldOptions | None = None
    report: ReportOptions | None = None

    def __post_init__(self) -> None:
        self._take_texts()
        for name, hint in option_kinds().items():
            self._expect_kind(name, hint)
        for name, known in (("method", METHODS), ("variant", VARIANTS), ("engine", ENGINES)):
            value = getattr(self, name)
            if value is not None and value not in known:
                raise InputError(f"`{name}`: expected one of {', '.join(known)}, found '{value}'")
        if self.variant is not None and self.method != "paper":
            raise InputError(f"`variant` {self.variant} is of `method` paper, found `method` {self.method}")
        if self.variant is not None and self.paper is not None:
            raise InputError(f"`variant` {self.variant} and `paper` both say how the method goes: give one of them")
        if self.classes is not None and self.detections is None:
            raise InputError(f"`classes` {','.join(self.classes)} are those of `detections`, which is not given")
        if self.packing is not None:
            packing_classes(self.packing)
        if self.fruit is not None:
            object.__setattr__(self, "fruit", fruit_kind(self.fruit).name)
        for name in FILES:
            if (path := getattr(self, name)) is not None:
                object.__setattr__(self, name, resolved(path))
        if self.model is not None:
            from pomona.stages.segment.load import located

            object.__setattr__(self, "model", located(self.model, Path.cwd()))
        # Wrong values are said before any work is done; the table of weights is not read for that.
        _ = self.of_stages if self.weights is None else replace(self, weights=None)

    def _take_texts(self) -> None:
        """Read what the command line says as one text, and take a model's path as its name."""
        read: tuple[tuple[str, type, Callable[[Any], Any]], ...] = (
            ("scale_bar", str, parse_scale_bar),
            ("classes", str, parse_names),
            ("model", PathLike, str),
        )
        for name, kind, taken in read:
            if isinstance(value := getattr(self, name), kind):
                object.__setattr__(self, name, taken(value))

    def _expect_kind(self, name: str, hint: Any) -> None:
        value = getattr(self, name)
        if name == "filter" and isinstance(value, bool):
            raise InputError(f"`filter`: expected FilterOptions, found {value}: give filter_false_positives={value}")
        expect_kind(f"`{name}`", hint, value)
        if isinstance(value, list):  # a tuple is compared and kept as it was read
            object.__setattr__(self, name, tuple(value))

    @property
    def kind(self) -> FruitKind:
        """The kind of fruit; of an apple where none was given."""
        return FRUIT_KINDS["apple"] if self.fruit is None else fruit_kind(self.fruit)

    @property
    def segmenter(self) -> str | None:
        """What finds the fruits: the model named, or the shipped weights that know the kind; None: the usual ones."""
        if self.model is not None or self.kind.weights == FruitKind.weights:
            return self.model
        from pomona.stages.segment.load import shipped_weights

        return str(shipped_weights(self.kind.weights))

    @property
    def usual_diameter_m(self) -> float:
        """How wide fruits are taken to be: what was given, else what is usual of the kind."""
        return self.kind.diameter_m if self.fruit_diameter_m is None else self.fruit_diameter_m

    @property
    def allometry(self) -> Allometry:
        """The weights of fruits by their diameters: of the pairs given, else of the kind."""
        from pomona.stages.measure.allometry import allometry_of_kind
        from pomona.stages.measure.weight_table import read_allometry

        return allometry_of_kind(self.kind) if self.weights is None else read_allometry(self.weights)

    @property
    def of_stages(self) -> StageOptions:
        """The options of each stage."""
        usual = StageOptions.usual(self)
        return StageOptions(
            run=self,
            segment=replace(self.segment or usual.segment, score_threshold=self.score_threshold),
            select=self._select(usual.select),
            sfm=self.sfm or usual.sfm,
            scale=replace(
                self.scale or usual.scale,
                markers=self.markers,
                markers_crs=self.markers_crs,
                gcp=self.gcp,
                scale_bar=self.scale_bar,
                marker_dictionary=self.marker_dictionary,
                fruit_diameter_m=self.usual_diameter_m,
                use_gnss=self.use_gnss,
            ),
            object=replace(self.object or usual.object, fruit_diameter_m=self.usual_diameter_m),
            paper=self.paper or self._paper(usual.paper),
            dense=replace(
                self.dense or usual.dense,
                engine=self.engine,  # type: ignore[arg-type]
                fruit_diameter_m=self.usual_diameter_m,
            ),
            looking=self.looking or usual.looking,
            dense_scene=replace(self.dense_scene or usual.dense_scene, fruit_diameter_m=self.usual_diameter_m),
            filter=self.filter or usual.filter,
            measure=self._measure(usual.measure),
            planting=self._planting(usual.planting),
            yields=self._yields(usual.yields),
            report=self.report or usual.report,
        )

    def _measure(self, usual: MeasureOptions) -> MeasureOptions:
        options = self.measure or usual
        if self.method == "paper":  # also where a person's corrections are measured, without the points
            options = replace(options.known_by(points=True, circles=False), nearest_radii=0.0)
        if self.fruit is not None:
            options = replace(options, kind=self.kind)
        return options if self.fruit is None and self.weights is None else replace(options, allometry=self.allometry)

    def _planting(self, usual: PlantingOptions) -> PlantingOptions:
        options = self.planting or usual
        if self.trees is None and self.tree_spacing is None:
            return options
        crs, gcp = (None, None) if self.trees is None else (self.markers_crs, self.gcp)
        return replace(options, trees=self.trees, trees_crs=crs, trees_gcp=gcp, spacing_m=self.tree_spacing)

    def _yields(self, usual: YieldOptions) -> YieldOptions:
        options = self.yields or usual
        return options if self.hand_counts is None else replace(options, hand_counts=self.hand_counts)

    def _select(self, usual: SelectOptions) -> SelectOptions:
        chosen = replace(self.select or usual, score_threshold=self.score_threshold)
        # The paper's method trusts no detection that does not count in its photo.
        return replace(chosen, trusted_share=1.0) if self.method == "paper" else chosen

    def _paper(self, usual: PaperOptions) -> PaperOptions:
        made = {"text": usual.as_printed, "published-code": usual.as_published_code}
        options = made[self.variant]() if self.variant else usual
        # Scores were compared with the threshold already; but the published code has its own.
        as_code = self.variant == "published-code" and self.score_threshold is None
        return replace(
            options,
            eps_m=_EPS_DIAMETERS * self.usual_diameter_m,
            min_score=options.min_score if as_code else 0.0,
        )

    def check_files(self) -> None:
        """Look for the files named, read the small ones, and look up names: a mistake is said before hours of work.

        Raises `InputError`, `FormatError` or `MissingFileError`.
        """
        for name in FILES:
            path = getattr(self, name)
            if path is not None and not is_there(path):
                raise MissingFileError(f"`{name}`: {path} does not exist")
        if self.model is not None and self.model.endswith((".onnx", ".pt", ".pth")) and not Path(self.model).is_file():
            raise MissingFileError(f"`model` {self.model}: no such file")
        if self.model is not None and self.detections is None:
            from pomona.stages.segment.load import check_name

            check_name(self.model)
        if self.marker_dictionary != RunOptions.marker_dictionary:
            from pomona.stages.scale.aruco import dictionary_names

            if self.marker_dictionary not in dictionary_names():
                known = ", ".join(name for name in dictionary_names() if name.startswith("DICT_4X4"))
                raise InputError(
                    f"`marker_dictionary`: expected one of OpenCV's, such as {known}, found '{self.marker_dictionary}'"
                )
        if self.packing is not None:
            check_unit(packing_classes(self.packing))
        self._read_tables()
        if self.filter_model is not None:
            self._check_filter_model(self.filter_model)

    def _read_tables(self) -> None:
        if self.markers is not None:
            from pomona.stages.scale.control_points import surveyed_markers

            surveyed_markers(self.markers, self.markers_crs)
        if self.positions is not None:
            from pomona.stages.capture.positions import read_positions

            read_positions(self.positions)
        if self.gcp is not None:
            from pomona.stages.scale.control_points import read_control_points

            read_control_points(self.gcp)
        if self.weights is not None:
            _ = self.allometry
        if self.trees is not None:
            from pomona.stages.planting import read_trunks

            read_trunks(self.trees, in_metres=self.markers_crs is None and self.gcp is None)
        if self.hand_counts is not None:
            from pomona.stages.yields import read_hand_counts

            read_hand_counts(self.hand_counts)

    def _check_filter_model(self, path: Path) -> None:
        from pomona.stages.filter import (
            CODE_FEATURE_NAMES,
            FEATURE_NAMES,
            LOOKED_FEATURE_NAMES,
            VIEW_FEATURE_NAMES,
            LinearSvm,
        )

        of_points = CODE_FEATURE_NAMES if self.variant == "published-code" else FEATURE_NAMES
        of_views = (LOOKED_FEATURE_NAMES, VIEW_FEATURE_NAMES) if self.second_look else (VIEW_FEATURE_NAMES,)
        expected = (of_points,) if self.method == "paper" else of_views
        found = LinearSvm.load(path).names
        if found not in expected:
            raise InputError(
                f"`filter_model` {path}: `method` {self.method} expects a machine trained on "
                f"{', '.join(expected[0])}; found one of {', '.join(found)}"
            )

    def to_json(self) -> dict[str, Any]:
        """Return the options as `survey.json` holds them."""
        values: dict[str, Any] = plain(self)
        return values

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> RunOptions:
        """Return the options that `to_json` gave; entries of other versions are ignored.

        Raises `FormatError` for values that no option can have.
        """
        return _from_plain(cls, values)


@dataclass(frozen=True, kw_only=True)
class StageOptions:
    """The options of all stages of one run, made from `run`, what a person chose."""

    run: RunOptions
    segment: SegmentOptions
    select: SelectOptions
    sfm: SfmOptions
    scale: ScaleOptions
    object: ObjectOptions
    paper: PaperOptions
    dense: DenseOptions
    looking: SecondLookOptions
    dense_scene: DenseSceneOptions
    filter: FilterOptions
    measure: MeasureOptions
    planting: PlantingOptions
    yields: YieldOptions
    report: ReportOptions

    @classmethod
    def usual(cls, run: RunOptions) -> StageOptions:
        """Return those of stages of which nothing was said."""
        return cls(run=run, **_usual_of_stages())


def _usual_of_stages() -> dict[str, Any]:
    """The options of stages of which nothing was said, by the fields; imported here, as they bring the engines."""
    from pomona.pipeline.select import SelectOptions
    from pomona.stages.dense.options import DenseOptions
    from pomona.stages.filter.options import FilterOptions
    from pomona.stages.fuse.object.options import ObjectOptions
    from pomona.stages.fuse.paper.options import PaperOptions
    from pomona.stages.measure.options import MeasureOptions
    from pomona.stages.planting.options import PlantingOptions
    from pomona.stages.report.options import ReportOptions
    from pomona.stages.scale.options import ScaleOptions
    from pomona.stages.scene.options import DenseSceneOptions
    from pomona.stages.second_look.options import SecondLookOptions
    from pomona.stages.segment.photo_detections import SegmentOptions
    from pomona.stages.sfm.options import SfmOptions
    from pomona.stages.yields.options import YieldOptions

    return {
        "segment": SegmentOptions(),
        "select": SelectOptions(),
        "sfm": SfmOptions(),
        "scale": ScaleOptions(),
        "object": ObjectOptions(),
        "paper": PaperOptions(),
        "dense": DenseOptions(),
        "looking": SecondLookOptions(),
        "dense_scene": DenseSceneOptions(),
        "filter": FilterOptions(),
        "measure": MeasureOptions(),
        "planting": PlantingOptions(),
        "yields": YieldOptions(),
        "report": ReportOptions(),
    }


def _from_plain(cls: type[T], values: Mapping[str, Any]) -> T:
    """Return the options of which `plain` gave the entries."""
    assert is_dataclass(cls)
    known = {field.name: values[field.name] for field in fields(cls) if field.name in values}
    kinds = get_type_hints(cls, localns=option_classes())
    try:
        return cls(**{name: _value(kinds[name], value) for name, value in known.items()})
    except (TypeError, ValueError, AttributeError) as error:
        raise FormatError(f"Options of {cls.__name__}: expected those of a run, but {error}") from None


def option_classes() -> dict[str, Any]:
    """Return the classes of the options of single stages by name, which annotations of `RunOptions` speak of."""
    from pomona.stages.capture import KeyFrameOptions

    return {cls.__name__: cls for cls in (KeyFrameOptions, *map(type, _usual_of_stages().values()))}


@cache
def option_kinds() -> Mapping[str, Any]:
    """Return what the value of each field of `RunOptions` is: its annotation."""
    hints = get_type_hints(RunOptions, localns=option_classes())
    return {field.name: hints[field.name] for field in fields(RunOptions)}


def named_options(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by the fields of `RunOptions`; names of the command line, hyphens as underscores, are others.

    `filter` is both: true or false as `pomona run` has it, or the options of the stage.

    Raises `InputError` for names that are none, and for an option that is given by both its names.
    """
    known = {field.name for field in fields(RunOptions)} | COMMAND_NAMES.keys()
    if unknown := sorted(set(given) - known):
        raise InputError(f"`{unknown[0]}` is not an option: expected some of {', '.join(sorted(known))}")
    named: dict[str, Any] = {}
    for said, value in given.items():
        is_stage = said == "filter" and not isinstance(value, bool)
        name = said if is_stage else COMMAND_NAMES.get(said, said)
        if name != said and name in given:
            raise InputError(f"`{said}` and `{name}` are the same option: give one of them")
        named[name] = value
    return named


def parse_names(text: str | None) -> tuple[str, ...] | None:
    """Return the names in `NAME,NAME`."""
    return tuple(name.strip() for name in text.split(",")) if text is not None else None


def parse_scale_bar(text: str | None) -> tuple[int, int, float] | None:
    """Return marker ids and metres from `ID,ID,METRES`; raises `InputError` for anything else."""
    if text is None:
        return None
    try:
        one, other, length_m = text.split(",")
        return int(one), int(other), float(length_m)
    except ValueError:
        raise InputError(f"`scale_bar`: expected ID,ID,METRES such as 0,1,0.85, found '{text}'") from None


def _value(kind: Any, value: Any) -> Any:
    if value is None or not isinstance(value, dict | list | str):
        return value
    kinds = [kind, *get_args(kind)]
    if isinstance(value, dict):
        classes = [k for k in kinds if is_dataclass(k) and isinstance(k, type)]
        if not classes:
            raise TypeError(f"found {value!r:.80} where no object is expected")
        return _from_plain(classes[0], value)
    if isinstance(value, list):
        return tuple(value)
    return Path(value) if Path in kinds else value
