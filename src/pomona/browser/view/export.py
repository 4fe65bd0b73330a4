"""The page and resized photos as a folder that opens from disk, without a server."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import counted
from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError, PomonaError, SurveyError, few
from pomona.progress import Progress, Silent, track
from pomona.stages.report.contract import TruthData
from pomona.stages.report.data import ReportData
from pomona.stages.report.options import ReportOptions
from pomona.stages.report.page import note_of, page_html
from pomona.stages.report.scene import SceneOptions, survey_data
from pomona.stages.report.seen import boxes_by_id, detection_columns
from pomona.survey.files import disk_errors, write_text_file
from pomona.values.drawing import jpeg

PAGE = "index.html"
_PHOTOS = "photos"


@dataclass(frozen=True, kw_only=True)
class FolderOptions:
    """What makes the size of the folder.

    Photos are resized so that an ordinary fruit is `fruit_px` wide, where the photo has it so, with the longer side
    within `least_side_px` and `greatest_side_px`. The page carries at most `max_points` points, 21 MB as text by
    default, and `max_sightings` observations.
    """

    fruit_px: float = 48.0
    least_side_px: int = 1280
    greatest_side_px: int = 3200
    jpeg_quality: int = 82
    max_points: int = 2_000_000
    max_sightings: int = ReportOptions.max_sightings

    def __post_init__(self) -> None:
        expect_kinds(self)
        if not self.fruit_px > 0:
            raise InputError(f"FolderOptions.fruit_px: expected a positive number, found {self.fruit_px}")
        if not 1 <= self.least_side_px <= self.greatest_side_px:
            raise InputError(
                "FolderOptions.least_side_px and greatest_side_px: expected 1 ≤ least ≤ greatest, "
                f"found {self.least_side_px}, {self.greatest_side_px}"
            )
        for name in ("jpeg_quality", "max_points", "max_sightings"):
            if getattr(self, name) < 1:
                raise InputError(f"FolderOptions.{name}: expected at least 1, found {getattr(self, name)}")


def export_folder(
    data: ReportData,
    folder: Path,
    *,
    truth: TruthData | None = None,
    options: FolderOptions | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write `index.html` and `photos/` to a new or empty folder, or over an earlier export; returns the page.

    Raises `SurveyError` where the folder holds something else or cannot be written to.
    """
    options, progress = options or FolderOptions(), progress or Silent()
    present = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    if folder.exists() and (not folder.is_dir() or (present and PAGE not in present)):
        raise SurveyError(f"{folder} holds something else: choose a new or empty folder")
    with disk_errors(folder):
        (folder / _PHOTOS).mkdir(parents=True, exist_ok=True)
        files = _write_photos(data, folder, options, progress)
        scene = SceneOptions(
            source="folder",
            max_points=options.max_points,
            max_sightings=options.max_sightings,
            files=files,
            detections=detection_columns(data),
            truth=truth,
            photos_note=note_of("folder"),
        )
        page = page_html(data, survey_data(data, scene))
        write_text_file(folder / PAGE, page)
    return folder / PAGE


def _write_photos(data: ReportData, folder: Path, options: FolderOptions, progress: Progress) -> dict[str, str]:
    """Write a copy of each photo that has a place and can be read; returns their names in the folder."""
    from pomona.stages.capture import read_pixels

    photos = data.photos.by_name()
    side_px = _side_px(data, options)
    files: dict[str, str] = {}
    missing = []
    for i, name in enumerate(track(data.cameras.photos, progress, "resizing photos", len(data.cameras))):
        # Numbers, as names may hold what no file name or address may.
        file = f"{_PHOTOS}/{i:05d}.jpg"
        if not photos[name].path.is_file():
            missing.append(name)
            continue
        try:
            encoded = jpeg(read_pixels(photos[name], max_side_px=side_px), quality=options.jpeg_quality)
        except (PomonaError, OSError) as error:
            progress.warn(f"{name} is not in the folder: {error}")
            continue
        (folder / file).write_bytes(encoded)
        files[name] = file
    if missing:
        progress.warn(f"Not found, and therefore not in the folder: {counted(len(missing), 'photo')} ({few(missing)})")
    return files


def _side_px(data: ReportData, options: FolderOptions) -> int:
    widths = [x1 - x0 for x0, _, x1, _ in boxes_by_id(data).values()]
    longer = max((max(lens.width_px, lens.height_px) for lens in data.cameras.intrinsics), default=0)
    wanted = longer * options.fruit_px / float(np.median(widths)) if widths else 0.0
    return round(min(max(wanted, options.least_side_px), options.greatest_side_px))
