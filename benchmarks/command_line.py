"""What the scripts here begin with: a command line, the data beside the repository, and progress in lines."""

import argparse
import time
from pathlib import Path

from pomona.progress import Silent

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def parser_of(script: str | None) -> argparse.ArgumentParser:
    """Return a parser whose help is the script's docstring as it is written."""
    return argparse.ArgumentParser(description=script, formatter_class=argparse.RawDescriptionHelpFormatter)


class Lines(Silent):
    """Progress as a line for each `every` units of work, with the time of day."""

    def __init__(self, every: int = 1) -> None:
        super().__init__()
        self.done, self.every = 0, every

    def start(self, label: str, total: int | None = None) -> None:
        print(label, total or "", flush=True)
        self.done = 0

    def advance(self, units: int = 1) -> None:
        self.done += units
        if self.done % self.every == 0:
            print(self.done, time.strftime("%H:%M"), flush=True)
