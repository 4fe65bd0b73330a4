"""Mapping and adjusting in a process of its own: it can be stopped at once, and if COLMAP dies it dies alone."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pomona.stages.sfm.options import Mapper, SfmOptions

Task = Mapper | Literal["joining", "growing"]

_RUN = "import sys; from pomona.stages.sfm.mapping_process import main; main(sys.argv[1:])"


class MappingProcess:
    """A mapper at work in another process, or an adjustment of what was joined.

    `details` can be written as JSON: for a mapper the cameras that are fixed, for joining the poses [R | t] of photos
    and the parameters of cameras, as pairs of index and numbers; for growing the names of the photos and the folder of
    the model so far (None: there is none).
    """

    def __init__(self, task: Task, database: Path, out: Path, options: SfmOptions, details: Any = ()) -> None:
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        self.out = out
        self._log = out.with_suffix(".log")
        told = out.with_suffix(".json")  # an argument would be too long for the poses of a long row
        told.write_text(json.dumps(details), encoding="utf-8")
        with self._log.open("wb") as log:
            arguments = [task, str(database), str(out), json.dumps(asdict(options)), str(told)]
            self._process = subprocess.Popen(
                [sys.executable, "-c", _RUN, *arguments],
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                encoding="utf-8",
            )
        self._reader: threading.Thread | None = None

    def listen(self, on_photo: Callable[[], None]) -> None:
        """Call `on_photo` for each photo placed from now on, from another thread."""
        self._reader = threading.Thread(target=self._read, args=(on_photo,), daemon=True)
        self._reader.start()

    def wait(self) -> str | None:
        """Wait for the end. Returns None, or why the mapper failed."""
        if self._reader is not None:
            self._reader.join()
        code = self._process.wait()
        if code == 0:
            return None
        lines = self._log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return f"{lines[-1].strip() if lines else 'no message'} (exit status {code}, log in {self._log})"

    def stop(self) -> None:
        """End the process if it still runs."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _read(self, on_photo: Callable[[], None]) -> None:
        assert self._process.stdout is not None
        for _ in self._process.stdout:
            on_photo()


def main(arguments: list[str]) -> None:
    """Run one task (TASK DATABASE OUT OPTIONS_JSON DETAILS_FILE), printing a line for each photo that it places."""
    from pomona.stages.sfm.colmap.mapping import adjust_poses, map_further, map_global, map_incremental

    task, database, out, options_json, told = arguments
    values, details = json.loads(options_json), json.loads(Path(told).read_text(encoding="utf-8"))
    options = SfmOptions(**{**values, "mappers": tuple(values["mappers"])})
    if task == "global":
        map_global(Path(database), Path(out), options)
    elif task == "incremental":
        map_incremental(Path(database), Path(out), options, details, lambda: print("photo", flush=True))
    elif task == "growing":
        before = Path(details["before"]) if details["before"] else None
        map_further(Path(database), Path(out), options, details["names"], before)
    else:
        poses = {photo: np.array(pose) for photo, pose in details["poses"]}
        params = {camera: np.array(numbers) for camera, numbers in details["params"]}
        adjust_poses(Path(database), Path(out), poses, params, options)
