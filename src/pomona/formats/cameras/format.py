"""What Pomona knows of a format of cameras: one record, by which its files are found, recognised and read."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pomona.formats.cameras.given import GivenCameras
from pomona.formats.files import read_head
from pomona.values.photos import Photos

_HEAD_BYTES = 4096  # as far as the root element of XML, or the first keys of JSON


class CameraFile:
    """A file or folder that may hold cameras, and what it begins with; the file is read when it is asked for."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @cached_property
    def head(self) -> str:
        """The beginning of a file, "" of a folder; raises `FormatError` where it cannot be read."""
        if self.path.is_dir():
            return ""
        return read_head(self.path, "cameras", _HEAD_BYTES).decode("utf-8", "replace").lstrip("\ufeff \t\r\n")

    @property
    def is_json(self) -> bool:
        """Whether it begins as JSON does."""
        return self.head.startswith(("{", "["))

    def has_key(self, key: str) -> bool:
        """Say whether JSON has a key, or the first item of a list.

        Of JSON that is damaged it is whether the beginning has the key, so that the format's reader can say how.
        """
        return self.is_json and (f'"{key}"' in self.head if self._content is None else key in self._content)

    @cached_property
    def _content(self) -> set[str] | None:
        """The keys; None of JSON that is damaged."""
        try:
            content: Any = json.loads(self.path.read_text(encoding="utf-8-sig"))
        except (ValueError, RecursionError):
            return None
        content = content[0] if isinstance(content, list) and content else content
        return set(content) if isinstance(content, dict) else set()


@dataclass(frozen=True)
class CameraFormat:
    """One format of cameras: a record in its module, listed in `registry.CAMERA_FORMATS`.

    `kind` is its short name, `title` what messages call it; `recognise` says whether a file, or a folder, is of it, by
    its content; `read` returns its cameras and raises `MissingFileError`, and `FormatError` naming file and place.

    In the folder of a project it lies at one of `places`, or is a file of one of `patterns` that is recognised.
    `folder_files` are the files by which a format that is a folder may be named. JSON that is called `json_name` is of
    it, whatever is in it, unless it is recognised as another. `companions` gives other files that `read` reads.
    """

    kind: str
    title: str
    recognise: Callable[[CameraFile], bool]
    read: Callable[[Path, Photos], GivenCameras]
    places: Sequence[str]
    patterns: Sequence[str] = ()
    folder_files: frozenset[str] = frozenset()
    json_name: str = ""
    companions: Callable[[Path], Sequence[Path]] = lambda path: ()
