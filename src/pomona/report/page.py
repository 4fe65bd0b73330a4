"""`report.html`: one file that opens from disk and fetches nothing."""

from __future__ import annotations

from pathlib import Path

from pomona.report.data import ReportData


def write_report(data: ReportData, path: Path) -> None:
    """Write the report of one survey as a self-contained page: table, plots, and a 3D view that can be turned."""
    raise NotImplementedError("report")
