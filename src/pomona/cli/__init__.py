"""The command line: one file a command. Results go to stdout, progress and messages to stderr.

Exit status: 0 done; 1 something given cannot be used, or no result could be made (the message says what to do);
2 a wrong command line; 3 a mistake of Pomona's own; 130 stopped by Ctrl-C, or told to end.
"""

import contextlib
import io
import os
import signal
import sys
from types import FrameType
from typing import Any, NoReturn

STOPPED = 130
_IMPORT_LOOK_S = 0.02  # between two looks at whether what was being imported when Ctrl-C came still is


def main() -> None:
    """Run `pomona`."""
    try:
        _speak_utf8()
        _have_outputs()
        _stop_when_told()
        _refuse_empty_arguments()
        from pomona.cli.app import app

        app()
    except KeyboardInterrupt:
        # Before a command has begun, which says itself what was kept; or once more, while it says so.
        _say_stopped()
        _end_at_once_when_told_again()
        sys.exit(STOPPED)
    except SystemExit as ended:
        if ended.code == STOPPED:
            if ended.__context__ is not None and isinstance(ended.__context__.__cause__, KeyboardInterrupt):
                _say_stopped()  # while arguments were read: Typer ends then without a word
            _end_at_once_when_told_again()
        raise


def _say_stopped() -> None:
    print("Stopped: nothing was lost.", file=sys.stderr)


def _refuse_empty_arguments() -> None:
    """End with a wrong command line where an argument is empty: as a path it would be the current folder."""
    if "" in sys.argv[1:]:
        from pomona.cli.failures import say

        place = sys.argv.index("", 1)
        where = f"after `{sys.argv[place - 1]}`" if place > 1 else "the first one"
        say("Error", "bold red", f"An argument is empty ({where}): a variable of the shell that is not set?")
        sys.exit(2)


class _Messages(io.FileIO):
    """Where messages go: a terminal that was closed, or a log on a full disk, takes them no more, and the work goes on.

    What matters of them is in the survey, too.
    """

    def write(self, message: Any, /) -> int:
        with contextlib.suppress(OSError):
            return super().write(message) or 0
        return len(message)


def _have_outputs() -> None:
    """Have stdin, stdout and stderr open, and have no message end the work that it is about.

    Services start programs with some of them closed: the next files that are opened are taken for these then, and what
    engines print would be written into results.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest number that is free: this one
    if sys.stdout is None:
        sys.stdout = _text(io.FileIO(1, "w", closefd=False))
    if sys.stderr is None or sys.platform != "win32":  # whose terminals are no files
        sys.stderr = _text(_Messages(2, "w", closefd=False))


def _text(file: io.FileIO) -> io.TextIOWrapper:
    return io.TextIOWrapper(io.BufferedWriter(file), encoding="utf-8", errors="backslashreplace", line_buffering=True)


def _stop_when_told() -> None:
    """End as by Ctrl-C at SIGTERM, which queues of clusters and a computer that shuts down send: the survey says where
    it was stopped. Processes that are forked off end silently."""
    signal.signal(signal.SIGTERM, _stop)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _stop)
    if sys.platform != "win32":
        # Held back meanwhile: a new process that is told before it has its own way of ending would go on.
        told = {signal.SIGTERM}
        os.register_at_fork(
            before=lambda: signal.pthread_sigmask(signal.SIG_BLOCK, told),
            after_in_parent=lambda: signal.pthread_sigmask(signal.SIG_UNBLOCK, told),
            after_in_child=_end_silently,
        )


def _end_at_once_when_told_again() -> None:
    """Have no further Ctrl-C disturb how a stopped program ends, which waits for its threads: it ends there and then.

    All has been said, and what was finished is on the disk.
    """

    def end(number: int, frame: FrameType | None) -> NoReturn:
        os._exit(STOPPED)

    for told in (signal.SIGINT, signal.SIGTERM):
        signal.signal(told, end)


def _end_silently() -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})


def _stop(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`, once nothing is being imported: NumPy and others make an `ImportError` of it."""
    if sys.platform != "win32" and _is_importing(frame):
        signal.signal(signal.SIGALRM, _stop)
        signal.setitimer(signal.ITIMER_REAL, _IMPORT_LOOK_S)
    else:
        raise KeyboardInterrupt


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False


def _speak_utf8() -> None:
    """Have names of files in UTF-8, and nothing printed fail: not in every locale is that so by itself."""
    if sys.platform != "win32" and sys.getfilesystemencoding() != "utf-8":
        # Only a new interpreter can do so, and the processes that it starts.
        arguments = [sys.executable, "-X", "utf8", *sys.orig_argv[1:]]
        # Programs that are asked for something (NumPy asks lscpu) answer in UTF-8 then, too, in the same language.
        language = {name: value for name, value in os.environ.items() if name != "LC_ALL"}
        if all_of_it := os.environ.get("LC_ALL"):
            language["LANG"] = language["LC_MESSAGES"] = all_of_it
        os.execve(sys.executable, arguments, {**language, "LC_CTYPE": "C.UTF-8", "PYTHONUTF8": "1"})
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
