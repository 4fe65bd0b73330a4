"""What a file of annotations holds, as far as one has to look to know its format."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from functools import cached_property
from pathlib import Path
from typing import Any

from pomona.formats.files import read_head, read_text
from pomona.formats.json_file import load_json
from pomona.formats.xml_file import load_xml

EXPECTED = "labels of photos"
_HEAD_BYTES = 512  # enough for every signature; text has no zero byte there, other files nearly always
_JPEG = b"\xff\xd8"


class FileContent:
    """A file's first bytes, and its content as JSON, XML or lines of text; each is read once, when it is asked for.

    Of `json`, `xml` and `lines` at most one is there, by the first character. `must_be_text`: without a look at the
    bytes, so that a file that cannot be read as text is an error.

    Raises `MissingFileError`, and `FormatError` where the file cannot be read, or is JSON or XML that is broken.
    """

    def __init__(self, path: Path, *, must_be_text: bool = False) -> None:
        self.path = path
        self.head = b"" if must_be_text else read_head(path, EXPECTED, _HEAD_BYTES)
        self._must_be_text = must_be_text

    @property
    def suffix(self) -> str:
        """The suffix of its name, in lower case."""
        return self.path.suffix.lower()

    @property
    def is_blank(self) -> bool:
        """Whether it begins with nothing but white space."""
        return not self._must_be_text and not self.head.strip()

    @cached_property
    def json(self) -> Any:
        """The content of JSON, None of anything else."""
        return load_json(self.path, EXPECTED) if self._text.startswith(("{", "[")) else None

    @cached_property
    def xml(self) -> Xml.Element | None:
        """The root of XML, None of anything else."""
        return load_xml(self.path, EXPECTED) if self._text.startswith("<") else None

    @cached_property
    def lines(self) -> str:
        """The text of what is neither JSON nor XML, without white space before it; "" of anything else."""
        if self._text.startswith(("{", "[", "<")):
            return ""
        if self._text and self.suffix == ".json":
            load_json(self.path, EXPECTED)  # says what is wrong with it
        return self._text

    @property
    def first_line(self) -> str:
        """The first of `lines`."""
        return self.lines.partition("\n")[0]

    @cached_property
    def _text(self) -> str:
        if self.is_blank or b"\x00" in self.head or self.head.startswith(_JPEG):
            return ""
        return read_text(self.path, EXPECTED).lstrip()
