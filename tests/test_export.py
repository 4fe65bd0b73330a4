"""The table of export formats: every one is documented, and is written from values without a survey."""

from __future__ import annotations

import errno
from dataclasses import dataclass, field
from pathlib import Path

import laspy
import numpy as np
import pytest

from camera_scenes import make_scene
from faulty_disk import FaultyDisk, Operation
from pomona.cli.export import export as export_command
from pomona.corrections.training import LabelledMasks
from pomona.errors import InputError, SurveyError
from pomona.export import EXPORT_FORMATS, Part, export_format, write_export
from pomona.progress import Progress, Silent
from pomona.values.cameras import Cameras, WorldFrame, local_crs
from pomona.values.crop import RowSegments
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos
from pomona.values.trees import Trees

DOCS = Path(__file__).parent.parent / "docs"
LLEIDA = (41.6215, 0.5954, 187.3)


@dataclass(frozen=True)
class Values:
    """Results in memory, as somebody has them who never wrote a survey."""

    folder: Path
    cameras: Cameras
    fruits: Fruits
    cloud: FruitCloud
    progress: Progress = field(default_factory=Silent)
    trees: Trees = field(default_factory=Trees.empty)
    segments: RowSegments = field(default_factory=RowSegments.empty)

    @property
    def frame(self) -> WorldFrame:
        return self.cameras.frame

    def photos_of(self, cameras: Cameras) -> Photos:
        return Photos(tuple(Photo(name, self.folder / name, 1600, 1200) for name in cameras.photos))

    def labelled_masks(self) -> LabelledMasks:
        return LabelledMasks(
            photos=self.cameras.photos,
            detections=SurveyDetections({}),
            observations=Observations.empty(),
            least_score=0.25,
        )

    def file(self, part: Part) -> Path:
        path = self.folder / f"of-the-survey.{part}"
        path.write_text(f"the survey's {part}")
        return path


@pytest.fixture
def values(tmp_path: Path) -> Values:
    scene = make_scene(3, cameras=4)
    cameras = Cameras(
        photos=tuple(f"IMG_{i}.JPG" for i in range(4)),
        intrinsics=(Intrinsics("SIMPLE_RADIAL", 1600, 1200, np.array([1500, 800, 600, 0.03])),),
        intrinsics_idx=np.zeros(4, np.int64),
        cam_from_world=np.array(
            [np.column_stack([r, -r @ c]) for r, c in zip(scene.rotations, scene.centers, strict=True)]
        ),
        points_in_world=scene.points,
        points_rgb=scene.rgb.astype(np.uint8),
        points_error_px=np.full(len(scene.points), 0.5),
        frame=WorldFrame("gnss", approximate=False, up_is_known=True, crs=local_crs(*LLEIDA[:2]), origin=LLEIDA),
    )
    fruits = Fruits(
        ids=np.array([1, 2]),
        centers_in_world=np.array([[0.0, 0, 1], [0.3, 0, 1]]),
        diameters_m=np.array([0.07, np.nan]),
        scores=np.ones(2),
        views=np.array([3, 2]),
    )
    cloud = FruitCloud(fruits.centers_in_world, np.full((2, 3), 90, np.uint8), fruits.ids)
    return Values(tmp_path, cameras, fruits, cloud)


@pytest.mark.parametrize("kind", EXPORT_FORMATS)
def test_every_format_is_named_and_documented(kind: str) -> None:
    chosen = export_format(kind)
    assert chosen.kind == kind
    assert chosen.title
    assert chosen.is_folder == ("." not in chosen.file_name)
    assert kind in (export_command.__doc__ or "").replace(",", " ").replace(";", " ").replace(".", " ").split()
    assert any(f"`{kind}`" in page.read_text(encoding="utf-8") for page in DOCS.rglob("*.md"))


def test_no_two_formats_write_to_one_place() -> None:
    assert len({chosen.file_name for chosen in EXPORT_FORMATS.values()}) == len(EXPORT_FORMATS)


@pytest.mark.parametrize("kind", EXPORT_FORMATS)
def test_every_format_is_written_from_values(kind: str, values: Values, tmp_path: Path) -> None:
    if kind == "rerun":
        pytest.importorskip("rerun", reason="the extra 'rerun' is not installed")
    if kind == "geoparquet":
        pytest.importorskip("pyarrow", reason="the extra 'geoparquet' is not installed")
    target = tmp_path / "out" / export_format(kind).file_name
    write_export(kind, values, target)
    files = [path for path in target.rglob("*") if path.is_file()] if export_format(kind).is_folder else [target]
    assert files
    assert all(path.stat().st_size > 0 for path in files)
    assert [path.name for path in target.parent.iterdir()] == [target.name]  # and nothing half written


def test_the_table_that_the_survey_has_is_copied(values: Values, tmp_path: Path) -> None:
    write_export("csv", values, tmp_path / "copy")
    assert (tmp_path / "copy").read_text() == "the survey's fruits"


@pytest.mark.parametrize(("kind", "compressed"), [("las", False), ("laz", True)])
def test_clouds_are_compressed_where_that_was_asked_for(
    kind: str, compressed: bool, values: Values, tmp_path: Path
) -> None:
    path = tmp_path / export_format(kind).file_name
    write_export(kind, values, path)
    with laspy.open(path) as cloud:
        assert cloud.header.are_points_compressed == compressed


@pytest.mark.parametrize("kind", ["csv", "geojson", "gpkg"])
def test_a_folder_that_must_not_be_written_to_is_said(kind: str, values: Values, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()

    def refuse(operation: Operation) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", str(operation.path))

    target = out / export_format(kind).file_name
    with FaultyDisk(out, refuse, kinds=("open",)), pytest.raises(SurveyError) as caught:
        write_export(kind, values, target)
    assert str(caught.value) == f"{target} cannot be written to (Permission denied): choose another folder"


@pytest.mark.parametrize("kind", ["las", "coco"])
def test_nothing_half_written_stays_on_a_full_disk(kind: str, values: Values, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()

    def fill(operation: Operation) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(operation.path))

    with FaultyDisk(out, fill, kinds=("write",)), pytest.raises(SurveyError, match="disk is full"):
        write_export(kind, values, out / export_format(kind).file_name)
    assert list(out.iterdir()) == []


@pytest.mark.parametrize(
    ("kind", "name", "said"),
    [
        ("csv", "fruits.xlsx", r"`to` csv is written to a file ending in \.csv or \.txt\. Known are .*\.kml \(kml\)"),
        ("gpkg", "fruits.kml", r"ending in \.gpkg; \.kml is of `to` kml\."),
        ("las", "cloud.laz", r"ending in \.las; \.laz is of `to` laz\."),
    ],
)
def test_a_suffix_of_something_else_is_refused(kind: str, name: str, said: str, values: Values, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        write_export(kind, values, tmp_path / name)
    assert not (tmp_path / name).exists()


def test_other_usual_suffixes_are_taken(values: Values, tmp_path: Path) -> None:
    for kind, name in (("geojson", "fruits.JSON"), ("geoparquet", "fruits.geoparquet")):
        write_export(kind, values, tmp_path / name)
        assert (tmp_path / name).stat().st_size > 100


def test_an_unknown_format(values: Values, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"`to`: expected one of csv \(a table of fruits\), geojson .*, found 'xls'"):
        write_export("xls", values, tmp_path / "fruits.xls")
