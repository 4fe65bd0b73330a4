"""How soon `pomona watch` answers, and whether it ends as a run does: photos copied into a folder one after another.

    python benchmarks/watching.py PHOTOS FOLDER [--step SECONDS] [--markers markers.csv]

PHOTOS is a folder of photos, or one with a folder for each side; FOLDER, new, takes their copies and the survey. Prints
for each photo how long after its copy the last hint could come (it is placed), and the first count with it; processor
seconds a photo; and the number of fruits of the survey that this ends in.
"""

from __future__ import annotations

import shutil
import threading
import time
from pathlib import Path

import numpy as np

from command_line import parser_of
from pomona.browser.live import Watch, WatchOptions
from pomona.pipeline import RunOptions
from pomona.progress import Silent
from pomona.stages.report.contract import WatchState
from usage import peak_mb, processor_s


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("photos", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--step", type=float, default=7.5, help="seconds between photos")
    parser.add_argument("--markers", type=Path)
    given = parser.parse_args()
    photos = sorted(path for path in given.photos.rglob("*") if path.suffix.lower() in (".jpg", ".jpeg", ".png"))
    copied: list[float] = []
    placed: dict[int, float] = {}
    counted: dict[int, float] = {}
    detected = [0]

    def told(state: WatchState) -> None:
        now = time.monotonic()
        placed.setdefault(state.photos, now)
        detected[0] += state.doing.startswith("Looking for fruits")
        if state.phase == "waiting" and state.fruits is not None:
            counted.setdefault(detected[0], now)

    def walk() -> None:
        for photo in photos:
            target = given.folder / "photos" / photo.relative_to(given.photos)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(photo, target)
            copied.append(time.monotonic())
            time.sleep(given.step)

    (given.folder / "photos").mkdir(parents=True)
    watch = Watch(
        given.folder / "photos",
        given.folder / "survey",
        RunOptions(markers=given.markers),
        WatchOptions(until=len(photos)),
        on_state=told,
    )
    threading.Thread(target=walk, daemon=True).start()
    watch.follow()
    used = processor_s()
    to_place = [min(t for k, t in placed.items() if k > i) - begun for i, begun in enumerate(copied)]
    to_count = [min(t for k, t in counted.items() if k > i) - begun for i, begun in enumerate(copied)]
    print(f"{len(photos)} photos, one each {given.step:g} s")
    print(f"placed, with its hints: median {np.median(to_place):.1f} s, at most {max(to_place):.1f} s after it came")
    print(f"the tenth counted {to_count[9]:.1f} s after it came; later ones: median {np.median(to_count[10:]):.1f} s,")
    print(f"  at most {max(to_count[10:]):.1f} s")
    print(f"{used / len(photos):.1f} processor seconds a photo, peak memory {peak_mb() / 1000:.1f} GB")
    assert watch.answer is not None
    print(f"provisional: {len(watch.answer.fruits)} fruits, {len(watch.answer.cameras)} photos placed")
    summary = watch.finish(Silent())
    print(f"survey: {summary.fruits} fruits, {processor_s() - used:.0f} processor seconds more")


if __name__ == "__main__":
    main()
