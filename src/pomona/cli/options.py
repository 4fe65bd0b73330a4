"""Options that several commands share, and what makes `RunOptions` of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Photos = Annotated[
    list[Path],
    typer.Argument(metavar="PHOTOS...", help="A folder of photos, two folders (the two sides of the row), or a video."),
]
Out = Annotated[
    Path, typer.Option("--out", "-o", metavar="SURVEY", help="Folder to write: a new one, or a survey to continue.")
]
SurveyArgument = Annotated[Path, typer.Argument(metavar="SURVEY", help="A folder that `pomona run` wrote.")]
Sides = Annotated[str, typer.Option(metavar="auto|none|GLOB,GLOB", help="Assign photos to the sides of the row.")]
Model = Annotated[
    str | None,
    typer.Option(metavar="NAME|FILE", help="Segmenter: .onnx, .pt, .pth, open:WORDS, or the name of an installed one."),
]
ScoreThreshold = Annotated[
    float | None,
    typer.Option(metavar="0..1", help="Ignore detections with a lower score. Default: the model's threshold."),
]
Markers = Annotated[
    Path | None, typer.Option(metavar="CSV", help="Table id,x,y,z: positions of the ArUco markers' centres, in metres.")
]
MarkersCrs = Annotated[
    str | None, typer.Option(metavar="EPSG:CODE", help="Coordinate system of the positions in --markers.")
]
Gcp = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Ground control points clicked in photos: OpenDroneMap's gcp_list.txt."),
]
TruthCrs = Annotated[str | None, typer.Option(metavar="EPSG:CODE", help="Coordinate system of the places in --truth.")]
Positions = Annotated[
    Path | None,
    typer.Option(metavar="CSV", help="Table photo,latitude,longitude,altitude,sd: positions to use instead of EXIF's."),
]
ScaleBar = Annotated[
    str | None, typer.Option(metavar="ID,ID,METRES", help="Two markers and the distance between their centres.")
]
MarkerDictionary = Annotated[str, typer.Option(metavar="NAME", help="ArUco dictionary of the markers.")]
Fruit = Annotated[
    str | None, typer.Option(metavar="NAME", help="Kind of fruit: apple, pear, orange, cherry, tomato, …")
]
FruitDiameter = Annotated[
    float | None,
    typer.Option(
        metavar="METRES",
        help="Diameter of an average fruit; sets the scale if nothing better does. Default: usual for --fruit.",
    ),
]
Weights = Annotated[
    Path | None,
    typer.Option(
        metavar="CSV", help="Table diameter_mm,weight_g: five or more fruits that you weighed; sets the weights of all."
    ),
]
Trees = Annotated[Path | None, typer.Option(metavar="CSV", help="Table id,x,y: positions of the trunks, in metres.")]
TreeSpacing = Annotated[
    float | None, typer.Option(metavar="METRES", help="Planting distance, if positions of trunks are not known.")
]
HandCounts = Annotated[
    Path | None,
    typer.Option(metavar="CSV", help="Table tree,count: trees counted by hand; calibrates the estimate of all fruit."),
]
Packing = Annotated[
    str | None,
    typer.Option(metavar="NAME|MM,MM,…", help="Size classes in the report: apples, citrus, …, or edges in mm."),
]
Cameras = Annotated[
    Path | None,
    typer.Option(metavar="PATH", help="Use cameras from COLMAP, Metashape, ODM, … instead of structure from motion."),
]
GivenDetections = Annotated[
    Path | None,
    typer.Option("--detections", metavar="PATH", help="Use your own masks: COCO, VIA, YOLO, CVAT, PNG, .mat, …"),
]
Classes = Annotated[str | None, typer.Option(metavar="NAME,NAME", help="Classes of --detections that are fruit.")]
Method = Annotated[str, typer.Option(metavar="object|paper", help="Method that turns masks into fruits.")]
Variant = Annotated[
    str | None,
    typer.Option(
        metavar="text|published-code", help="With --method paper: as the text says, or as its authors' code does it."
    ),
]
Gnss = Annotated[bool, typer.Option(help="Use the photos' GNSS positions for scale and place.")]
SecondLook = Annotated[bool, typer.Option(help="Look at every fruit again in all photos, to place it better.")]
Scene = Annotated[bool, typer.Option(help="Make a dense cloud of the whole row for viewing.")]
Filter = Annotated[bool, typer.Option("--filter/--no-filter", help="Remove fruits that are probably false.")]
FilterModel = Annotated[
    Path | None, typer.Option(metavar="JSON", help="Use your own support vector machine for --filter.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Start again: discard earlier results in SURVEY.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
