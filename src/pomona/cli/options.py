"""Options that several commands share, and what makes `RunOptions` of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pomona.errors import InputError

Photos = Annotated[
    list[Path],
    typer.Argument(metavar="PHOTOS...", help="A folder of photos, two folders (the sides of the row), or a video."),
]
Out = Annotated[Path, typer.Option("--out", "-o", metavar="SURVEY", help="The folder to write: new, or a survey.")]
SurveyArgument = Annotated[Path, typer.Argument(metavar="SURVEY", help="A folder that `pomona run` wrote.")]
Sides = Annotated[str, typer.Option(metavar="auto|none|GLOB,GLOB", help="Which photos are of which side of the row.")]
Model = Annotated[
    str | None,
    typer.Option(metavar="NAME|FILE", help="Segmenter: .onnx, .pt, .pth, open:WORDS, or an installed one's name."),
]
ScoreThreshold = Annotated[
    float | None, typer.Option(metavar="0..1", help="Detections below are left out. Default: the model's own.")
]
Markers = Annotated[
    Path | None, typer.Option(metavar="CSV", help="id,x,y,z: the places of ArUco markers' centres, in metres.")
]
MarkersCrs = Annotated[
    str | None, typer.Option(metavar="EPSG:CODE", help="The coordinate system of the places in --markers.")
]
Gcp = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Ground control points in photos: OpenDroneMap's gcp_list.txt.")
]
Positions = Annotated[
    Path | None,
    typer.Option(metavar="CSV", help="photo,latitude,longitude,altitude,sd: places in place of those in EXIF."),
]
ScaleBar = Annotated[
    str | None, typer.Option(metavar="ID,ID,METRES", help="Two markers and the distance between their centres.")
]
MarkerDictionary = Annotated[str, typer.Option(metavar="NAME", help="The ArUco dictionary of the markers.")]
Fruit = Annotated[
    str | None, typer.Option(metavar="NAME", help="What grows there: apple, pear, orange, cherry, tomato, …")
]
FruitDiameter = Annotated[
    float | None,
    typer.Option(
        metavar="METRES",
        help="An average fruit; sets the scale where nothing better does. Default: that of --fruit.",
    ),
]
Weights = Annotated[
    Path | None,
    typer.Option(metavar="CSV", help="diameter_mm,weight_g: fruits that you weighed, for the weights of all."),
]
Trees = Annotated[Path | None, typer.Option(metavar="CSV", help="id,x,y: where trunks stand, in metres.")]
TreeSpacing = Annotated[float | None, typer.Option(metavar="METRES", help="The planting distance, without trunks.")]
HandCounts = Annotated[
    Path | None,
    typer.Option(metavar="CSV", help="tree,count: trees that you counted, for the estimate of all fruit."),
]
Packing = Annotated[
    str | None,
    typer.Option(metavar="NAME|MM,MM,…", help="Classes of size in the report: apples, citrus, …, or edges in mm."),
]
Cameras = Annotated[
    Path | None,
    typer.Option(metavar="PATH", help="Cameras of COLMAP, Metashape, ODM, ... in place of structure from motion."),
]
GivenDetections = Annotated[
    Path | None,
    typer.Option("--detections", metavar="PATH", help="Your own masks: COCO, VIA, YOLO, CVAT, PNG, .mat, …"),
]
Classes = Annotated[str | None, typer.Option(metavar="NAME,NAME", help="The classes of --detections that are fruit.")]
Method = Annotated[str, typer.Option(metavar="object|paper", help="How masks become fruits.")]
Variant = Annotated[
    str | None,
    typer.Option(
        metavar="text|published-code", help="With --method paper: to its letter, or as its authors' program does it."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


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
        raise InputError(f"--scale-bar: expected ID,ID,METRES such as 0,1,0.85, found '{text}'") from None
