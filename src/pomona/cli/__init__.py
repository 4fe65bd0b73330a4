"""The command line: one file a command. Results go to stdout, progress and messages to stderr.

Exit status: 0 done; 1 something given cannot be used, or no result could be made (the message says what to do);
2 a wrong command line; 3 a mistake of Pomona's own; 130 stopped by Ctrl-C, or told to end.
"""

import io
import os
import signal
import sys
from types import FrameType
from typing import NoReturn


def main() -> None:
    """Run `pomona`."""
    _speak_utf8()
    signal.signal(signal.SIGTERM, _stop)  # what queues of clusters and a computer that shuts down send
    from pomona.cli.app import app

    app()


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    """End as by Ctrl-C: the survey says where it was stopped."""
    raise KeyboardInterrupt


def _speak_utf8() -> None:
    """Have names of files in UTF-8, and nothing printed fail: not in every locale is that so by itself."""
    if sys.platform != "win32" and sys.getfilesystemencoding() != "utf-8":
        # Only a new interpreter can do so, and the processes that it starts.
        arguments = [sys.executable, "-X", "utf8", *sys.orig_argv[1:]]
        os.execve(sys.executable, arguments, {**os.environ, "PYTHONUTF8": "1"})
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
