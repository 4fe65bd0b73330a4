"""Reading XML that other programs wrote, with errors that name the file and the line."""

from __future__ import annotations

import codecs
import math
import re
import xml.etree.ElementTree as Xml
from pathlib import Path

from pomona.errors import FormatError, InputError
from pomona.formats.files import UTF16_MARKS, read_head

_DECLARED = re.compile(rb"""\s*<\?xml[^>]{0,200}?\sencoding\s*=\s*["']([A-Za-z][\w.\-]{0,40})["']""")
# What Python has among its encodings for other ends than text; some take very long for a text made for it.
_NO_CHARSETS = frozenset({"idna", "punycode", "unicode_escape", "raw_unicode_escape"})


def load_xml(path: Path, expected: str) -> Xml.Element:
    """Return the root of an XML file that is to hold `expected`, in the encoding that it is in.

    Raises `MissingFileError`, and `FormatError` where it is empty, no XML, or defines entities of its own.
    """
    data = read_head(path, expected, -1)  # -1: all of it
    try:
        text = _decoded(data)
    except (ValueError, LookupError) as error:
        raise FormatError(f"{path}: expected {expected}, but it cannot be read: {error}") from None
    if not text.strip():
        raise FormatError(f"{path}: expected {expected}, but the file is empty")
    if "<!ENTITY" in text:  # nothing that we read needs them, and they can be made to fill the memory
        raise FormatError(f"{path}: expected {expected}, found XML that defines entities, which is not read")
    try:
        # The parser is given the text that was looked through, whatever encoding this declares.
        return Xml.fromstring(text.encode(), parser=Xml.XMLParser(encoding="utf-8"))
    except (Xml.ParseError, ValueError, LookupError) as error:
        raise FormatError(f"{path}: expected {expected}, but it is no XML: {error}") from None


def begins_as_xml(head: bytes) -> bool:
    """Say whether the first bytes of a file are those of XML, in any encoding that `load_xml` reads."""
    return head.decode(_wide_encoding(head) or "utf-8-sig", "ignore").lstrip().startswith("<")


def _decoded(data: bytes) -> str:
    """The text of an XML file: UTF-16 by its mark or its first letter, UTF-8 where it is that, else what it declares.

    Programs write UTF-8 below a declaration that they have copied; text of another encoding that is by chance UTF-8,
    too, is as good as never seen.
    """
    if wide := _wide_encoding(data):
        return data.decode(wide)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        declared = _DECLARED.match(data)
        if declared is None:
            raise
    name = codecs.lookup(declared[1].decode("ascii")).name
    if name.replace("-", "_") in _NO_CHARSETS:
        raise LookupError(f"unknown encoding: {name}")
    return data.decode(name)


def _wide_encoding(head: bytes) -> str | None:
    """The encoding of text in UTF-16; None of what is in another."""
    if head.startswith(UTF16_MARKS):
        return "utf-16"
    return {b"<\x00": "utf-16-le", b"\x00<": "utf-16-be"}.get(head[:2])


def finite_number(text: str | None, name: str) -> float:
    """Return the number of an attribute or element called `name`; raises `InputError` where there is no finite one."""
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{name}: expected a finite number, found {text!r:.40}")
    return value
