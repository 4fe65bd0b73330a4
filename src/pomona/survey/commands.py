"""Commands as a person can paste them into a terminal."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Sequence

_PLAIN_ON_WINDOWS = re.compile(r"[\w.:\\/=,+~-]+")


def command_line(arguments: Sequence[object], platform: str = sys.platform) -> str:
    """Return a command in one line, arguments with spaces and the like quoted as the shells of `platform` read them."""
    texts = [str(argument) for argument in arguments]
    if platform != "win32":
        return shlex.join(texts)
    # cmd and PowerShell both know double quotes; a name on Windows has none.
    return " ".join(text if _PLAIN_ON_WINDOWS.fullmatch(text) else f'"{text}"' for text in texts)
