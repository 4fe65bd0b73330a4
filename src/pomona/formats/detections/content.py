"""What a file of annotations holds, as far as one has to look to know its format."""

from __future__ import annotations

import codecs
import xml.etree.ElementTree as Xml
from functools import cached_property
from pathlib import Path
from typing import Any

from pomona.errors import FormatError
from pomona.formats.files import UTF16_MARKS, read_head, read_text
from pomona.formats.json_file import load_json
from pomona.formats.xml_file import begins_as_xml, load_xml

EXPECTED = "labels of photos"
_HEAD_BYTES = 512  # enough for every signature; text has no zero byte there, other files nearly always
_JPEG = b"\xff\xd8"
_BOMS = (codecs.BOM_UTF8, *UTF16_MARKS)


def is_blank_text(head: bytes) -> bool:
    """Say whether a file begins with nothing but white space, after the mark of its encoding where it has one."""
    mark = next((mark for mark in _BOMS if head.startswith(mark)), b"")
    return not head.removeprefix(mark).strip()


def check_not_utf16(path: Path, head: bytes, expected: str) -> None:
    """Raise `FormatError` of text whose first bytes, `head`, are the mark of UTF-16."""
    if head.startswith(UTF16_MARKS):
        raise FormatError(
            f"{path}: expected {expected}, but it cannot be read: its text is in UTF-16, as PowerShell's > writes it; "
            "save it as UTF-8"
        )


class FileContent:
    """A file's first bytes, and its content as JSON, XML or lines of text; each is read once, when it is asked for.

    Of `json`, `xml` and `lines` at most one is there, by the first character. `must_be_text`: `head` is empty, so that
    it is of no format known by its bytes, and a file that cannot be read as text is an error.

    Raises `MissingFileError`, and `FormatError` where the file cannot be read, or is JSON or XML that is broken, or
    text in UTF-16 that is not XML.
    """

    def __init__(self, path: Path, *, must_be_text: bool = False) -> None:
        self.path = path
        self._begin = read_head(path, EXPECTED, _HEAD_BYTES)
        self.head = b"" if must_be_text else self._begin
        self._must_be_text = must_be_text

    @property
    def suffix(self) -> str:
        """The suffix of its name, in lower case."""
        return self.path.suffix.lower()

    @property
    def is_blank(self) -> bool:
        """Whether it begins with nothing but white space."""
        return not self._must_be_text and is_blank_text(self.head)

    @cached_property
    def json(self) -> Any:
        """The content of JSON, None of anything else."""
        return load_json(self.path, EXPECTED) if self._text.startswith(("{", "[")) else None

    @cached_property
    def xml(self) -> Xml.Element | None:
        """The root of XML, None of anything else."""
        return load_xml(self.path, EXPECTED) if self._is_xml or self._text.startswith("<") else None

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

    @property
    def _is_xml(self) -> bool:
        """Whether it begins as XML, which may be in another encoding than other text."""
        return begins_as_xml(self._begin)

    @cached_property
    def _text(self) -> str:
        """What it holds from the first letter on; "" of XML, and of what is no text."""
        if self.is_blank or self._is_xml or self.head.startswith(_JPEG):
            return ""
        check_not_utf16(self.path, self._begin, EXPECTED)
        if b"\x00" in self.head:
            return ""
        return read_text(self.path, EXPECTED).lstrip()
