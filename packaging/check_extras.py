"""Builds wheel and sdist, installs them in clean environments, and tries Pomona and each extra on its own there.

python packaging/check_extras.py [--extras none,cluster,pandas] [--demo] [--folder FOLDER]

Needs a package index. Printed are, for each extra, what was installed, how large it is and how long it took; the exit
status is 1 where one does not work. `none` is Pomona without any; `--demo` also runs the bundled sample with it.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
import tomllib
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# What an extra brings must do, besides being importable.
TRIES = {
    "none": "import pomona, pomona.cli.app; assert (pomona.sample_folder() / 'markers.csv').is_file()",
    "train": "import torch, torchvision, onnx, pomona.learning.train",
    "synth": "import pomona.learning.synth, moderngl",
    "open-vocabulary": "import transformers, torch, pomona.stages.segment",
    "cluster": (
        "import fsspec, pyarrow; from pomona.orchard import WorkerOptions; from pomona.orchard.cluster import "
        "local_workers\nif __name__ == '__main__':\n    with local_workers(WorkerOptions(processes=1)) as workers:\n"
        "        assert workers.dashboard.startswith('http://127.0.0.1:')"
    ),
    "rerun": "import rerun, pomona.formats.rerun",
    "pandas": "from pomona.values.fruits import Fruits; assert len(Fruits.empty().to_pandas()) == 0",
    "geopandas": "from pomona.values.fruits import Fruits; assert len(Fruits.empty().to_geopandas()) == 0",
    "geoparquet": (
        "from pathlib import Path; from pomona.values.cameras import WorldFrame; "
        "from pomona.values.fruits import Fruits; "
        "from pomona.formats.geoparquet import write_geoparquet; "
        "write_geoparquet(Path('f.parquet'), Fruits.empty(), WorldFrame('markers'))"
    ),
}
OF_DEVELOPERS = {"dev", "docs"}


def build(folder: Path) -> Path:
    """Build the sdist, and from it the wheel; return the wheel."""
    subprocess.run([sys.executable, "-m", "build", "--outdir", str(folder), str(ROOT)], check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def check(extra: str, wheel: Path, folder: Path, *, demo: bool) -> str:
    """Install the wheel with an extra in an environment of its own and try it; return what was wrong, "" if nothing."""
    venv.create(folder / extra, with_pip=True)
    python = folder / extra / "bin" / "python"
    wanted = str(wheel) if extra == "none" else f"{wheel}[{extra}]"
    script = folder / f"try_{extra.replace('-', '_')}.py"
    script.write_text(TRIES[extra] + "\n")
    commands = [
        [str(python), "-m", "pip", "install", "--quiet", wanted],
        [str(python), "-m", "pip", "check"],
        [str(python), str(script)],
        [str(python.with_name("pomona")), "--version"],
    ]
    if demo:
        commands.append([str(python.with_name("pomona")), "demo", "--out", str(folder / "demo")])
    for command in commands:
        done = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)
        if done.returncode:
            return f"{' '.join(command[1:4])}: {(done.stderr or done.stdout).strip().splitlines()[-1:]}"
    return ""


def size_mb(folder: Path) -> float:
    """Return how much all files in a folder take."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def main() -> int:
    """Try the extras that are asked for; return the exit status."""
    extras = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])
    assert extras - OF_DEVELOPERS == set(TRIES) - {"none"}, "each extra needs a try"
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--extras", default=",".join(TRIES), help="which to try")
    parser.add_argument("--demo", action="store_true", help="also run the bundled sample")
    parser.add_argument("--folder", type=Path, help="where environments go; kept")
    options = parser.parse_args()
    wrong = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        wheel = build(folder / "dist")
        print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB")
        for extra in options.extras.split(","):
            start = time.monotonic()
            reason = check(extra, wheel, folder, demo=options.demo and extra == "none")
            said = reason or "works"
            print(f"{extra:16} {size_mb(folder / extra):7.0f} MB {time.monotonic() - start:6.0f} s  {said}", flush=True)
            wrong += bool(reason)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
