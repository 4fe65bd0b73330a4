"""`python -m pomona.cli.leash COMMAND...`: a command of `pomona` that is stopped when its standard input ends.

It is stopped as by Ctrl-C, with all that it began. A program that runs it holds the other end of the input, and so
the command never outlives it, however the program ends.
"""

from __future__ import annotations

import os
import signal
import sys
import threading

from pomona.cli import main


def _stop_at_the_end_of_input() -> None:
    # Not by `sys.stdin`: its lock, held by a thread that waits, ends Python with an error when the command is done.
    while os.read(sys.stdin.fileno(), 1):
        pass
    if sys.platform != "win32" and os.getpid() == os.getpgrp():
        os.killpg(0, signal.SIGINT)
    else:
        signal.raise_signal(signal.SIGINT)


if __name__ == "__main__":
    # A program that was started in the background hands down that Ctrl-C is to be ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_stop_at_the_end_of_input, daemon=True).start()
    main()
