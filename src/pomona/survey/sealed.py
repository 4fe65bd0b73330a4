"""JSON files that carry a digest of themselves: for files between runs that no manifest knows of."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

_SEAL = re.compile(rb',\n"sha256": "([0-9a-f]{64})"\}\n\Z')
_SEAL_BYTES = 128  # as long as a seal is, and more


def seal(path: Path) -> None:
    """Add to an object in a JSON file the entry `sha256`, of all that is before it."""
    content = path.read_bytes().rstrip()
    assert content.endswith(b"}"), f"{path} holds no object"
    content = content[:-1].rstrip()
    path.write_bytes(content + f',\n"sha256": "{hashlib.sha256(content).hexdigest()}"}}\n'.encode("ascii"))


def is_sealed(path: Path) -> bool:
    """Say whether a file is there and as it was sealed."""
    try:
        content = path.read_bytes()
    except OSError:
        return False
    found = _SEAL.search(content, max(0, len(content) - _SEAL_BYTES))
    return found is not None and hashlib.sha256(content[: found.start()]).hexdigest() == found[1].decode("ascii")
