"""Digests of options, values and files, by which a stage is known to be valid or stale."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from datetime import datetime
from pathlib import Path
from typing import Any

_LENGTH = 24  # hexadecimal digits: 96 bits, which no two contents share by chance


def plain(value: Any) -> Any:
    """Return `value` as what JSON holds: dataclasses as objects, paths as POSIX text, tuples as lists."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in (sorted(value) if isinstance(value, set | frozenset) else value)]
    if isinstance(value, Path):
        return value.as_posix()
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, float) and value != value:
        return None
    if hasattr(value, "item"):
        return value.item()
    return value


def digest(value: Any) -> str:
    """Return a digest of options and values: the same for equal ones, on every machine."""
    text = json.dumps(plain(value), sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_LENGTH]


def is_digest(value: Any) -> bool:
    """Say whether a value can be what `digest` and `file_digest` return."""
    return isinstance(value, str) and len(value) == _LENGTH and set(value) <= set("0123456789abcdef")


def file_digest(path: Path) -> str:
    """Return a digest of a file's content, or of the names and contents of all (not hidden) files below a folder."""
    if path.is_dir():
        files = sorted(p for p in path.rglob("*") if p.is_file() and not p.name.startswith("."))
        return digest({p.relative_to(path).as_posix(): file_digest(p) for p in files})
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:_LENGTH]


def content_key(value: Any) -> Any:
    """Return `value` as `plain` does, each existing file or folder in it replaced by a digest of what it holds.

    Two options that name equal files by other paths have equal keys. A dataclass that stands for files may say with an
    attribute `content_key` what it stands for.
    """
    if hasattr(value, "content_key"):
        return content_key(value.content_key)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: content_key(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): content_key(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [content_key(item) for item in (sorted(value) if isinstance(value, set | frozenset) else value)]
    if isinstance(value, Path) and value.exists():
        return file_digest(value)
    return plain(value)
