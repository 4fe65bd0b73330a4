"""The report as a PDF: printed by a browser that is on this computer."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from pomona.errors import InputError

_BROWSERS = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge",
    "microsoft-edge-stable", "msedge",
)  # fmt: skip
# Where they are on systems that do not put them on the PATH.
_PLACES = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "C:/Program Files/Google/Chrome/Application/chrome.exe",
    "C:/Program Files (x86)/Microsoft/Edge/Application/msedge.exe",
)
_PATIENCE_S = 300


def find_browser() -> str | None:
    """Return a Chromium, Chrome or Edge of this computer; None where there is none."""
    on_path = (shutil.which(name) for name in _BROWSERS)
    return next((found for found in on_path if found), None) or next((p for p in _PLACES if Path(p).is_file()), None)


def write_pdf(report: Path, path: Path) -> None:
    """Print `report.html` to a PDF file, with the 3D view as it is when the page opens.

    Raises `InputError` where there is no browser, or it writes nothing.
    """
    browser = find_browser()
    if browser is None:
        raise InputError(
            "No browser was found that prints to PDF: install Chromium, Chrome or Edge, or open "
            f"{report} in any browser and print it"
        )
    with tempfile.TemporaryDirectory() as folder:
        part = Path(folder) / "report.pdf"
        # A profile of its own, as a browser that runs already would take the page and write nothing.
        command = [
            browser, "--headless", "--disable-gpu", "--use-gl=angle", "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader", f"--user-data-dir={folder}/profile", "--no-first-run",
            "--no-pdf-header-footer", "--virtual-time-budget=15000", f"--print-to-pdf={part}",
            report.resolve().as_uri(),
        ]  # fmt: skip
        if sys.platform == "linux" and os.geteuid() == 0:
            command.insert(1, "--no-sandbox")  # without which root cannot start it
        try:
            done = subprocess.run(command, capture_output=True, timeout=_PATIENCE_S, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise InputError(f"{browser} did not print {report}: {error}. Open it and print it by hand") from None
        if not part.is_file():
            said = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
            raise InputError(f"{browser} wrote no PDF of {report} ({' '.join(said)}). Open it and print it by hand")
        shutil.copyfile(part, path)
