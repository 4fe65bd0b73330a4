"""The page and resized photos as a folder that opens from disk, without a server."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pomona.drawing import jpeg
from pomona.errors import PomonaError, SurveyError
from pomona.progress import Progress, Silent, track
from pomona.report.contract import TruthData
from pomona.report.data import ReportData
from pomona.report.page import note_of, page_html
from pomona.report.scene import SceneOptions, survey_data
from pomona.report.seen import boxes_by_id, detection_columns
from pomona.survey.files import disk_errors, write_file

PAGE = "index.html"
_PHOTOS = "photos"
# A fruit is to be at least this wide in the copies, where the photo has it so.
_FRUIT_PX = 48.0
_LEAST_SIDE_PX, _GREATEST_SIDE_PX = 1280, 3200
_QUALITY = 82
# Points that the page carries: 21 MB as text.
_POINTS = 2_000_000


def export_folder(
    data: ReportData, folder: Path, *, truth: TruthData | None = None, progress: Progress | None = None
) -> Path:
    """Write `index.html` and `photos/` to a new or empty folder, or over an earlier export; returns the page.

    Photos are resized so that an ordinary fruit is 48 pixels wide, within 1280 and 3200 pixels for the longer side.

    Raises `SurveyError` where the folder holds something else or cannot be written to.
    """
    progress = progress or Silent()
    present = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    if folder.exists() and (not folder.is_dir() or (present and PAGE not in present)):
        raise SurveyError(f"{folder} holds something else: choose a new or empty folder")
    with disk_errors(folder):
        (folder / _PHOTOS).mkdir(parents=True, exist_ok=True)
        files = _write_photos(data, folder, progress)
        options = SceneOptions(
            source="folder",
            max_points=_POINTS,
            files=files,
            detections=detection_columns(data),
            truth=truth,
            photos_note=note_of("folder"),
        )
        page = page_html(data, survey_data(data, options))
        write_file(folder / PAGE, lambda path: _write_text(path, page))
    return folder / PAGE


def _write_photos(data: ReportData, folder: Path, progress: Progress) -> dict[str, str]:
    """Write a copy of each photo that has a place and can be read; returns their names in the folder."""
    from pomona.capture import read_pixels

    photos = data.photos.by_name()
    side_px = _side_px(data)
    files: dict[str, str] = {}
    for i, name in enumerate(track(data.cameras.photos, progress, "resizing photos", len(data.cameras))):
        # Numbers, as names may hold what no file name or address may.
        file = f"{_PHOTOS}/{i:05d}.jpg"
        try:
            encoded = jpeg(read_pixels(photos[name], max_side_px=side_px), quality=_QUALITY)
        except (PomonaError, OSError) as error:
            progress.warn(f"{name} is not in the folder: {error}")
            continue
        (folder / file).write_bytes(encoded)
        files[name] = file
    return files


def _side_px(data: ReportData) -> int:
    widths = [x1 - x0 for x0, _, x1, _ in boxes_by_id(data).values()]
    longer = max((max(lens.width_px, lens.height_px) for lens in data.cameras.intrinsics), default=_LEAST_SIDE_PX)
    wanted = longer * _FRUIT_PX / float(np.median(widths)) if widths else float(_LEAST_SIDE_PX)
    return round(min(max(wanted, _LEAST_SIDE_PX), _GREATEST_SIDE_PX))


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
