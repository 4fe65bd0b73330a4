"""Files damaged at random, as disks, editors and people with bad intent damage them, each by its seed.

Bytes are damaged as bytes; JSON, XML, tables, PNG and ZIP also as what they are, so that what comes out still looks
like it to a reader and gets past its first check.
"""

from __future__ import annotations

import io
import json
import re
import struct
import xml.etree.ElementTree as Xml
import zipfile
import zlib
from typing import Any

import numpy as np

Rng = np.random.Generator

_WORDS = (
    "", "nan", "inf", "-inf", "-1", "0", "-0.0", "1e999", "1e308", "1e-320", "9" * 20, "9" * 400, "0x10", "1_000", "٣",
    "null",
    "true", "[]", "{}", '""', "../../../etc/passwd", "/etc/passwd", "C:\\Windows\\win.ini", "\\\\host\\share\\a.jpg",
    "=1+1", "<b>", "%s%n", "\u202e", "a" * 300, ";", ",", "\t", "\n", "\r", "#", "&", "<", ">", '"', "'", "\x00",
)  # fmt: skip
_VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, -(2**63) - 1, 10**400, 0.5, float("nan"), float("inf"), -1e308, "", "0",
    "nan",
    "é", "\ud800", "\x00", "../../x.jpg", "/etc/passwd", "C:/x.jpg", [], {}, [[]], [None], {"": None}, [0] * 50,
    "9" * 400,
)  # fmt: skip
_INTS = (
    0,
    1,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x10000,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    2**40,
    2**63 - 1,
    2**64 - 1,
)
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_HEAD_BYTES = 512  # where most formats keep their counts and sizes


def mutated(content: bytes, rng: Rng) -> bytes:
    """Return the content with one to four things wrong with it."""
    for _ in range(int(rng.integers(1, 5))):
        content = _once(content, rng)
    return content


def _once(content: bytes, rng: Rng) -> bytes:
    if rng.random() < 0.6 and (shaped := _as_what_it_is(content, rng)) is not None:
        return shaped
    return _bytes(content, rng)


def _as_what_it_is(content: bytes, rng: Rng) -> bytes | None:
    head = content.lstrip()[:1]
    if content.startswith(b"\x89PNG"):
        return _png(content, rng)
    if content.startswith(b"PK\x03\x04"):
        return _zip(content, rng)
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        return _integers(content, rng)
    if head in (b"{", b"[") and rng.random() < 0.7:
        try:
            return _json(json.loads(text), rng)
        except (ValueError, RecursionError):
            return _text(text, rng)
    if head == b"<" and rng.random() < 0.7:
        try:
            return _xml(Xml.fromstring(text), rng)
        except (Xml.ParseError, ValueError):
            return _text(text, rng)
    return _text(text, rng)


def _bytes(content: bytes, rng: Rng) -> bytes:
    data = bytearray(content)
    at = _place(len(data), rng)
    end = at + int(rng.integers(1, 2 ** int(rng.integers(1, 10))))
    match int(rng.integers(0, 7)):
        case 0 if data:
            data[at % len(data)] ^= 1 << int(rng.integers(0, 8))
        case 1:
            del data[at:end]
        case 2:
            data[at:at] = data[at:end]
        case 3:
            del data[at:]
        case 4:
            data[at : at + 8] = rng.bytes(8)
        case 5:
            data[at : at + int(rng.integers(0, 6))] = _WORDS[rng.integers(len(_WORDS))].encode()
        case _:
            other = _place(len(data), rng)
            data[at:end] = data[other : other + (end - at)]
    return bytes(data)


def _place(size: int, rng: Rng) -> int:
    """A place in a file, in its head as often as not."""
    return int(rng.integers(0, max(1, min(size, _HEAD_BYTES) if rng.random() < 0.5 else size)))


def _integers(content: bytes, rng: Rng) -> bytes:
    """A whole number of 1, 2, 4 or 8 bytes, of either byte order, becomes one that programs trip over."""
    size = int(rng.choice([1, 2, 4, 8]))
    value = int(_INTS[rng.integers(len(_INTS))]) & (2 ** (8 * size) - 1)
    at = _place(max(1, len(content) - size), rng)
    return content[:at] + value.to_bytes(size, "little" if rng.random() < 0.5 else "big") + content[at + size :]


def _text(text: str, rng: Rng) -> bytes:
    lines = text.split("\n")
    k = int(rng.integers(len(lines)))
    match int(rng.integers(0, 6)):
        case 0 if numbers := list(_NUMBER.finditer(text)):
            one = numbers[rng.integers(len(numbers))]
            text = text[: one.start()] + _WORDS[rng.integers(len(_WORDS))] + text[one.end() :]
        case 1:
            del lines[k]
            text = "\n".join(lines)
        case 2:
            lines.insert(int(rng.integers(len(lines) + 1)), lines[k])
            text = "\n".join(lines)
        case 3:
            separator = next((s for s in (";", "\t", ",", " ") if s in lines[k]), ",")
            cells = lines[k].split(separator)
            cells[rng.integers(len(cells))] = _WORDS[rng.integers(len(_WORDS))]
            lines[k] = separator.join(cells)
            text = "\n".join(lines)
        case 4:
            text = text.replace("\n", str(rng.choice(["\r\n", "\r", " ", "\n\n"])))
        case _:
            words = lines[k].split(" ")
            lines[k] = " ".join(words[: int(rng.integers(len(words) + 1))])
            text = "\n".join(lines)
    encoding = "utf-8" if rng.random() < 0.95 else str(rng.choice(["utf-16", "latin-1", "utf-8-sig"]))
    return text.encode(encoding, "replace")


def _json(root: Any, rng: Rng) -> bytes:
    holder, key = _inside(root, rng)
    if holder is None:
        root = _VALUES[rng.integers(len(_VALUES))]
    else:
        _change(holder, key, root, rng)
    try:
        return json.dumps(root).encode()
    except (ValueError, RecursionError):  # moved into itself
        return b"[" * 5000


def _change(holder: Any, key: Any, root: Any, rng: Rng) -> None:
    match int(rng.integers(0, 7)):
        case 0 | 1 | 2:
            holder[key] = _VALUES[rng.integers(len(_VALUES))]
        case 3:
            del holder[key]
        case 4:
            other, other_key = _inside(root, rng)
            holder[key] = json.loads(json.dumps(other[other_key])) if other is not None else None
        case 5 if isinstance(holder, list):
            holder.extend([holder[key]] * int(rng.choice([1, 2, 100])))
        case 5:
            holder[str(_WORDS[rng.integers(len(_WORDS))])] = holder.pop(key)
        case _:
            for _ in range(int(rng.choice([1, 3, 400]))):
                holder[key] = [holder[key]]


def _inside(root: Any, rng: Rng) -> tuple[Any, Any]:
    """A random holder and key, each level as likely to be the last; None of an empty root."""
    holder, key, value = None, None, root
    while isinstance(value, dict | list) and len(value) and (holder is None or rng.random() < 0.75):
        holder = value
        key = list(value)[rng.integers(len(value))] if isinstance(value, dict) else int(rng.integers(len(value)))
        value = holder[key]
    return holder, key


def _xml(root: Xml.Element, rng: Rng) -> bytes:
    elements = list(root.iter())
    one, word = elements[rng.integers(len(elements))], _WORDS[rng.integers(len(_WORDS))].replace("\x00", "")
    match int(rng.integers(0, 8)):
        case 0 if one.attrib:
            one.set(list(one.attrib)[rng.integers(len(one.attrib))], word)
        case 1 if one.attrib:
            del one.attrib[list(one.attrib)[rng.integers(len(one.attrib))]]
        case 2:
            one.text = word
        case 3 if len(one):
            one.remove(one[rng.integers(len(one))])
        case 4 if len(one):
            one.append(one[rng.integers(len(one))])
        case 5:
            one.tag = elements[rng.integers(len(elements))].tag
        case 6:
            entity = '<!DOCTYPE a [<!ENTITY b "' + "c" * 50 + '">]>'
            return (entity + Xml.tostring(root, "unicode").replace(">", ">&b;", 1)).encode()
        case _:
            one.text = (one.text or "") + " " + word
    return Xml.tostring(root, "utf-8")


def _png(content: bytes, rng: Rng) -> bytes:
    """One chunk changed, its checksum set right; the header and the palette more often than pixels."""
    chunks, at = [], 8
    while at + 12 <= len(content):
        size = int.from_bytes(content[at : at + 4], "big")
        chunks.append([content[at + 4 : at + 8], content[at + 8 : at + 8 + size]])
        at += 12 + size
    if not chunks:
        return _bytes(content, rng)
    k = 0 if rng.random() < 0.4 else int(rng.integers(len(chunks)))
    match int(rng.integers(0, 4)):
        case 0:
            chunks.insert(k, chunks[int(rng.integers(len(chunks)))])
        case 1:
            del chunks[k]
        case _:
            chunks[k] = [chunks[k][0], _integers(chunks[k][1], rng)]
    parts = [struct.pack(">I", len(d)) + n + d + struct.pack(">I", zlib.crc32(n + d)) for n, d in chunks]
    return content[:8] + b"".join(parts)


def _zip(content: bytes, rng: Rng) -> bytes:
    """One member changed or renamed, packed again with checksums that are right."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as file:
            members = [[info.filename, file.read(info)] for info in file.infolist()]
    except (zipfile.BadZipFile, OSError, EOFError, NotImplementedError, RuntimeError, ValueError, zlib.error):
        return _bytes(content, rng)
    if not members:
        return _bytes(content, rng)
    k = int(rng.integers(len(members)))
    match int(rng.integers(0, 5)):
        case 0:
            members[k][0] = str(rng.choice(["../../x.npy", "/x.npy", members[0][0], "x.txt", "x.npy"]))
        case 1:
            del members[k]
        case 2:
            members[k][1] = _array_header(bytes(members[k][1]), rng)
        case _:
            members[k][1] = _bytes(bytes(members[k][1]), rng)
    packed = io.BytesIO()
    how = zipfile.ZIP_DEFLATED if rng.random() < 0.3 else zipfile.ZIP_STORED
    with zipfile.ZipFile(packed, "w", how) as file:
        for name, data in members:
            file.writestr(zipfile.ZipInfo(str(name)), data, how)
    return packed.getvalue()


def _array_header(data: bytes, rng: Rng) -> bytes:
    """The shape or type in the header of NumPy's array changed: larger than there is, of objects, nonsense."""
    changes = {
        rb"'shape': \([^)]*\)": [
            b"'shape': (9999999999,)",
            b"'shape': (-1,)",
            b"'shape': ()",
            b"'shape': (3, 1000000000)",
        ],
        rb"'descr': '[^']*'": [b"'descr': '|O'", b"'descr': '<U900000000'", b"'descr': '<f8'", b"'descr': 'nonsense'"],
    }
    pattern = list(changes)[rng.integers(len(changes))]
    new = changes[pattern][rng.integers(4)]
    header = re.sub(pattern, lambda _: new, data[:_HEAD_BYTES], count=1)
    return header + data[_HEAD_BYTES:]
