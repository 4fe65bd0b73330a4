"""XML that another program wrote, element by element, so that an error can say which element it is about."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.errors import FormatError
from pomona.formats.xml_file import load_xml


@dataclass(frozen=True, eq=False)
class Element:
    """An element of an XML file and its path in it, such as `document/chunk/sensors`."""

    path: Path
    place: str
    node: ElementTree.Element

    @classmethod
    def of_file(cls, path: Path, expected: str) -> Element:
        """Return the outermost element of a file that is to hold `expected`."""
        node = load_xml(path, expected)
        return cls(path, node.tag, node)

    @property
    def tag(self) -> str:
        """The element's name."""
        return str(self.node.tag)

    @property
    def where(self) -> str:
        """The file and the element, for messages."""
        number = self.node.get("id")
        return f"{self.path}: {self.place}" + (f" {number}" if number is not None else "")

    def error(self, expected: str) -> FormatError:
        """Return the error that says what was expected here."""
        return FormatError(f"{self.where}: expected {expected}")

    def get(self, name: str) -> Element | None:
        """Return the first child of this name, None where there is none."""
        node = self.node.find(name)
        return None if node is None else Element(self.path, f"{self.place}/{name}", node)

    def at(self, name: str) -> Element:
        """Return the first child of this name, which has to be there."""
        found = self.get(name)
        if found is None:
            raise self.error(f"an element <{name}>, which is not there")
        return found

    def all(self, name: str) -> list[Element]:
        """Return all children of this name."""
        return [Element(self.path, f"{self.place}/{name}", node) for node in self.node.findall(name)]

    def everywhere(self, name: str) -> list[Element]:
        """Return all elements of this name, however deep: Metashape puts cameras into groups."""
        return [Element(self.path, f"{self.place}/{name}", node) for node in self.node.iter(name)]

    def attribute(self, name: str, default: str | None = None) -> str:
        """Return an attribute; `default` where it is not there, which is an error if that is None."""
        value = self.node.get(name, default)
        if value is None:
            raise self.error(f"an attribute {name}")
        return value

    def whole(self, name: str, *, least: int = 0) -> int:
        """Return an attribute that is a whole number of at least `least`."""
        text = self.attribute(name)
        if not (text.strip().isdecimal() and len(text) < 16 and int(text) >= least):
            raise self.error(f"an attribute {name}, a whole number of at least {least}, found '{text[:40]}'")
        return int(text)

    def number_of(self, name: str) -> float:
        """Return an attribute that is a finite number."""
        try:
            number = float(self.attribute(name))
        except ValueError:
            number = float("nan")
        if not np.isfinite(number):
            raise self.error(f"an attribute {name}, a number, found '{self.attribute(name)[:40]}'")
        return number

    def numbers(self, *shape: int) -> FloatArray:
        """Return the finite numbers of the element's text, as many as `shape` holds."""
        words = (self.node.text or "").split()
        try:
            values = np.array([float(word) for word in words])
        except ValueError:
            values = np.array([np.nan])
        if values.size != np.prod(shape) or not np.isfinite(values).all():
            raise self.error(f"{np.prod(shape)} finite numbers, found '{' '.join(words)[:60]}'")
        return values.reshape(shape)

    def number(self) -> float:
        """Return the finite number that is the element's text."""
        return float(self.numbers(1)[0])

    def positive(self) -> float:
        """Return the number above 0 that is the element's text."""
        number = self.number()
        if not number > 0:
            raise self.error(f"a number above 0, found {number:g}")
        return number
