"""Reading XML that other programs wrote, with errors that name the file and the line."""

from __future__ import annotations

import math
import xml.etree.ElementTree as Xml
from pathlib import Path

from pomona.errors import FormatError, InputError
from pomona.formats.files import read_text


def load_xml(path: Path, expected: str) -> Xml.Element:
    """Return the root of an XML file that is to hold `expected`.

    Raises `MissingFileError`, and `FormatError` where it is empty, no XML, or defines entities of its own.
    """
    text = read_text(path, expected)
    if "<!ENTITY" in text:  # nothing that we read needs them, and they can be made to fill the memory
        raise FormatError(f"{path}: expected {expected}, found XML that defines entities, which is not read")
    try:
        return Xml.fromstring(text.encode())
    except (Xml.ParseError, ValueError, LookupError) as error:
        raise FormatError(f"{path}: expected {expected}, but it is no XML: {error}") from None


def finite_number(text: str | None, name: str) -> float:
    """Return the number of an attribute or element called `name`; raises `InputError` where there is no finite one."""
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{name}: expected a finite number, found {text!r:.40}")
    return value
